# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The hardware nodes on one computer, the others on another, and a cable that is bad, or cut."""

import json
from pathlib import Path
import time

import pytest

from support.split_arm import PARAMETERS, SplitArm
from support.two_computers import Computers, Quality, RIG, why_not, WORKSTATION

LOSSY = Quality(delay=0.05, jitter=0.01, loss=0.05)
"""In each direction, so that a round trip takes 0.1 s."""
FORWARD, BACK = [0.0, 0.0, 0.5], [0.0, 0.0, -0.5]
STALE_TIMEOUT = 2.0  # s: a busy machine is silent for more than the 0.5 s that ./run soak tries
SLOW = {**PARAMETERS, 'stale_timeout': STALE_TIMEOUT, 'tendon_speed': 0.006}
"""A motion takes longer than the timeout."""
ALLOWED, BUSY = STALE_TIMEOUT + 0.1, 2.0  # s: what a cut takes, and what a busy machine may add
AFTERWARDS = 1.0  # s

pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not() or 'namespaces may be made')


@pytest.fixture
def split(domain, tmp_path):
    """Return an arm on two computers, whose cable delays and loses."""
    with SplitArm(domain, tmp_path, LOSSY, SLOW) as arm:
        yield arm


def links():
    """Return the network interfaces of this computer."""
    return {path.name for path in Path('/sys/class/net').iterdir()}


def test_goals_succeed_over_a_slow_and_lossy_cable_and_a_cut_ends_all_motion(split):
    doctor = split.start(split.computers.workstation, 'doctor', '--network', '--json')
    doctor.wait()
    checks = {c['step']: c for c in json.loads(doctor.output.splitlines()[-1])['checks']}
    assert checks[f'computer {RIG}']['message'] == 'jamming_valves, tendon_actuation'
    assert checks[f'computer {WORKSTATION}']['message'] == 'kinematics, shape_sequencer'
    assert checks['description']['status'] == checks['version']['status'] == 'OK'
    trip = float(checks[f'round trip to {RIG}']['message'].split()[1])
    assert trip >= 80.0  # ms: no frame is faster than 40 ms

    split.operator.send(FORWARD)
    split.rig.wait_for(lambda: split.moving, 'a motion')
    valves = split.valves
    split.computers.cut()
    cut = time.time_ns()
    answer = split.operator.answer()
    assert answer.startswith(
        f'HARDWARE_FAULT: nothing received for {STALE_TIMEOUT:g} s from '), answer
    split.rig.wait_for(lambda: not split.moving, 'rest')
    assert split.moved_after(cut) < ALLOWED + BUSY
    assert split.valves == valves
    rests_at, rest = split.rig.tendons.last.position, time.time_ns()

    split.computers.mend()
    time.sleep(AFTERWARDS)
    split.rig.wait_for_more(split.rig.tendons)
    assert split.rig.tendons.last.position == rests_at
    assert split.moved_after(rest) == 0.0
    assert split.valves == valves
    split.operator.send(FORWARD)
    assert split.operator.answer() == 'reached'

    split.operator.send(BACK)
    split.rig.wait_for(lambda: split.moving, 'a motion')
    valves = split.valves
    killed = split.kill(WORKSTATION)
    split.rig.wait_for(lambda: not split.moving, 'rest')
    assert split.moved_after(killed) < ALLOWED + BUSY
    assert split.valves == valves


def test_nothing_is_left_behind():
    before = links()
    with Computers() as computers:
        pids = computers.rig.pid, computers.workstation.pid
        computers.set(Quality(loss=1.0))
    assert links() == before
    assert not any(Path('/proc', str(pid)).exists() for pid in pids)
