# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Each node killed at random moments of a sequence: what the others notice, and what is known."""

from dataclasses import dataclass, field
from random import Random
import time
from typing import Any

import numpy as np

from benchmarks.tables import table
from soak.report import progress, Report, spread
from soak.watch import THRESHOLDS
from soak.workbench import ClaimError, FAILED, Workbench, workbench
from support.ros_rig import ALL

KILLS = 50  # of each node
GOAL = 1.0  # s
MAX_FAILURES = 5
ANGLE = 0.5  # rad
MAX_DELAY = 8.0  # s from the start of a goal to the kill: some goals have ended
PARAMETERS = {'tendon_speed': 0.007, 'modbus.baud_rate': 115200}


@dataclass
class Killed:
    """What followed the kills of one node, s; known, unknown: the state after its restart."""

    noticed: list[float] = field(default_factory=list)
    ceased: list[float] = field(default_factory=list)
    known: int = 0
    unknown: int = 0


def run(share: float) -> Report:
    """Kill every node ``share`` of 50 times."""
    random, failures = Random(1), list[str]()
    results = {name: Killed() for name in ALL}
    victim, victims = '', [*ALL] * max(1, round(share * KILLS))
    while victims and len(failures) < MAX_FAILURES:
        with workbench(PARAMETERS) as bench:
            try:
                bench.start_all()
                while victims:
                    victim = victims.pop()
                    if len(victims) % 20 == 0:
                        progress(f'{len(victims) + 1} kills left')
                    _kill(bench, victim, results[victim], random)
                    bench.restore()
                    bench.check_nodes()
                    bench.clear()
            except FAILED as error:  # go on with new nodes
                output = bench.nodes[victim].output[-1000:] if victim in bench.nodes else ''
                failures.append(f'kill of {victim}: {error}\nits output: {output}')
                progress(failures[-1])
    for name, killed in results.items():
        if max(killed.noticed + killed.ceased, default=0.0) > GOAL:
            failures.append(f'{name}: noticed after {max(killed.noticed, default=0.0):.2f} s, '
                            f'motion for {max(killed.ceased, default=0.0):.2f} s')
    return Report(_body(results), tuple(failures))


def _kill(bench: Workbench, victim: str, killed: Killed, random: Random) -> None:
    rig = bench.rig
    angles = [random.uniform(-ANGLE, ANGLE) for _ in range(3)]
    if random.random() < 0.25:  # an S whose pulls nearly cancel, as if the arm were straight
        angles = [0.4 * angles[0], -0.44 * angles[0], 0.0]
    goal = rig.goal_when_heard(angles)
    deadline = time.monotonic() + random.uniform(0.0, MAX_DELAY)
    while time.monotonic() < deadline and not goal.ended:
        time.sleep(0.005)
    shape = tuple(rig.joints.last.position)
    sent = len(bench.trajectories)
    died, ended = time.time_ns(), goal.ended
    ceased = bench.board.watch_rest() if bench.board.driven else None
    bench.nodes[victim].kill()
    if victim != 'shape_sequencer' and not ended:
        def hold() -> Any:
            return next((entry for entry in bench.trajectories.heard[sent:]
                         if not entry.message.points), None)

        rig.wait_for(lambda: hold() or goal.ended, 'the sequencer to notice')
        if entry := hold():
            killed.noticed.append((entry.time - died) * 1e-9)
            if goal.result()[0] == 'SUCCEEDED':
                raise ClaimError('a goal succeeded without a node')
    rests_at = bench.wait_for_rest()
    if ceased:
        killed.ceased.append(ceased.result())
    bench.start(victim)
    _claim_state(bench, victim, killed, shape)
    bench.check_rest(rests_at, 'by a restart')


def _claim_state(bench: Workbench, victim: str, killed: Killed, shape: Any) -> None:
    """Check the state that a node reports after its restart: true, or declared unknown."""
    rig = bench.rig
    if victim == 'tendon_actuation':
        rig.wait_for_more(rig.tendons, 5)
        known = bench.referenced
        if known and (off := bench.differences(commanded=False)[0]) > bench.board.resolution:
            raise ClaimError(f'reported pulls {rig.pulls} are {1e3 * off:.3f} mm off')
    elif victim == 'kinematics':
        shapes = len(rig.joints)
        rig.wait_for_more(rig.tendons, 20)  # kinematics answers each with the shape, if known
        known = len(rig.joints) > shapes
        if known:
            now = rig.joints.last.position
            if np.abs(np.subtract(now, shape)).max() > np.radians(0.5):
                raise ClaimError(f'the shape became {now}; it was {shape}')
    elif victim == 'jamming_valves':
        rig.wait_for_more(rig.pressures[0], 20)
        known = True
        wrong = [i + 1 for i, r in enumerate(rig.stiff)
                 if r.last.data and bench.modbus.vacuum(i) < THRESHOLDS.release_vacuum]
        if wrong:
            raise ClaimError(f'segments {wrong} are reported stiff')
    else:
        known = True
        rig.wait_for(lambda: not rig.states[victim].last.running, 'an idle sequencer')
    killed.known += known
    killed.unknown += not known


def _body(results: dict[str, Killed]) -> str:
    rows = []
    for name, killed in results.items():
        noticed, ceased = spread(killed.noticed), spread(killed.ceased)
        rows.append((name, str(killed.known + killed.unknown), noticed[0], noticed[2],
                     str(len(killed.ceased)), ceased[0], ceased[2], str(killed.unknown)))
    head = ('node', 'kills', 'noticed, ms: median', 'longest', 'in motion',
            'motion ceased, ms: median', 'longest', 'state declared unknown')
    return table(head, rows)
