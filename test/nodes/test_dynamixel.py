# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The nodes with Dynamixel servos behind a pseudo-terminal, in real time."""

from pathlib import Path
import sys

import pytest

from support.processes import Processes
from support.ros_rig import ALL, QUICK, Rig

BEND = (0.0, 0.0, 0.3)
SLOW = {'tendon_speed': 0.004, 'tendon_acceleration': 0.1, 'speed_limit': 0.03,
        'acceleration_limit': 0.3, 'stale_timeout': 2.0}


def test_a_node_that_is_killed_in_motion_knows_where_its_servos_are_and_sets_the_shape(
        rig: Rig, processes: Processes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('XDG_STATE_HOME', str(tmp_path / 'state'))
    port = tmp_path / 'servos'
    processes.start([sys.executable, '-m', 'soft_continuum', 'emulate', 'dynamixel',
                     '--link', str(port)])
    rig.wait_for(port.exists, 'servos')
    given = {**QUICK, **SLOW, 'tendon_driver': 'dynamixel', 'dynamixel.port': str(port),
             'dynamixel.tension_limits': [60.0, 60.0]}
    node = processes.node('tendon_actuation', parameters=given)
    rig.start(*(name for name in ALL if name != 'tendon_actuation'), **SLOW)
    rig.wait_until_ready(*ALL)
    rig.wait_for(lambda: 'without power' in rig.statuses['tendon_actuation'].last.message,
                 'why the position is not referenced')
    rig.stiffen()
    assert rig.trigger('tendon_actuation/reference').success
    rig.wait_for_shape()
    goal = rig.goal_in_motion(BEND)
    node.kill()
    assert goal.result()[0] == 'ABORTED'
    last = rig.pulls

    heard = len(rig.tendons)
    rig.start('tendon_actuation', ready=False, **given)
    rig.wait_for(lambda: len(rig.tendons) > heard + 20, 'tendon_states')
    states = list(rig.tendons)[heard:]
    # By what was commanded ahead, and the lag of the servo: no turn, and no zero, was lost.
    assert list(states[0].position) == pytest.approx(last, abs=2e-3)
    assert states[0].position[0] > 1e-4
    assert not any(any(m.velocity) for m in states)
    assert list(states[-1].position) == pytest.approx(list(states[0].position), abs=2e-4)

    # No parameter says how near servos come to their goals.
    goal = rig.goal_when_heard(BEND)
    assert goal.result()[0] == 'SUCCEEDED', goal.result()[1].error_string
    told = rig.states['tendon_actuation'].last
    assert list(told.pull_tolerances) == [1e-4, 1e-4]
    # 2 % of the 4.1 N m at which an XM430-W350 stalls, on 10 mm
    assert list(told.tension_deviations) == pytest.approx([8.2, 8.2])
    assert list(told.tension_relative_deviations) == [0.3, 0.3]
