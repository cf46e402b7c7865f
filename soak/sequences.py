# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Shape sequences with random faults at random times, for an hour of operation.

On an emulated stepper board, or on emulated servos.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isnan
from random import Random
import time
from typing import Any

from benchmarks.tables import table
from soak.boards import Board
from soak.faults import Fault, FAULTS
from soak.report import progress, Report
from soak.watch import Watch
from soak.workbench import ClaimError, FAILED, Workbench, workbench
from support.ros_rig import SEGMENTS

HOUR = 3600.0  # s
SPEED_UP = 6.0  # of pump, segments and motors
ANGLE = 0.6  # rad, largest bending angle of a random shape
MAX_SHAPES = 4
MAX_DELAY = 4.0  # s from the start of a goal to its fault
MAX_FAULT = 2.0  # s
LATENCY = 0.5  # s in which sensors and nodes must have noticed
MAX_GROWTH = 5.0  # MB/h
MAX_FAILURES = 5
PARAMETERS = {'jamming_timeout': 4.0, 'modbus.baud_rate': 115200}


@dataclass
class Tally:
    """Counts over all runs; goals: by how they ended; undisturbed: those without any event."""

    seconds: float = 0.0
    operation: float = 0.0
    goals: Counter[str] = field(default_factory=Counter)
    undisturbed: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    compared: int = 0
    unknown: int = 0
    unreported: float = 0.0  # m
    missed: float = 0.0  # m
    falsely_stiff: float = 0.0
    moved_stiff: float = 0.0
    growth: list[float] = field(default_factory=list)  # MB/h
    memory: float = 0.0  # MB
    failures: list[str] = field(default_factory=list)


def run(share: float, board: str = 'grbl') -> Report:
    """Run sequences until ``share`` of an hour of operation is done; board: one of BOARDS."""
    tally, random = Tally(), Random(1)
    while tally.operation < share * HOUR and len(tally.failures) < MAX_FAILURES:
        begin = time.monotonic()
        with workbench(PARAMETERS, SPEED_UP, board) as bench:
            bench.start_all()
            with Watch(bench) as watch:
                try:
                    _run_on(bench, watch, tally, random, FAULTS[board],
                            share * HOUR - tally.operation)
                except FAILED as error:  # go on with new nodes
                    tally.failures.append(f'{error} (after {dict(tally.faults)})')
                    progress(tally.failures[-1])
        tally.operation += watch.operation
        tally.seconds += time.monotonic() - begin
        tally.falsely_stiff = max(tally.falsely_stiff, *(s.seconds for s in watch.falsely_stiff))
        tally.moved_stiff = max(tally.moved_stiff, watch.moved_stiff.seconds)
        tally.growth.append(watch.memory_slope())
        tally.memory = watch.memory[-1][1] if watch.memory else 0.0
        if watch.failure:
            tally.failures.append(f'the watch ended: {watch.failure}')
    return Report(_body(tally, bench.board), (*tally.failures, *_claims(tally)))


def _run_on(bench: Workbench, watch: Watch, tally: Tally, random: Random,
            faults: Sequence[Fault], duration: float) -> None:
    queue: list[Fault | None] = []
    while watch.operation < duration and not watch.failure:
        if not queue:  # every fault once, and as often none, in a random order
            queue = [*faults, *[None] * len(faults)]
            random.shuffle(queue)
            progress(f'{(tally.operation + watch.operation) / 60:.0f} min of operation done')
        fault = queue.pop()
        name = fault.name if fault else 'none'
        try:
            if not _round(bench, tally, random, fault) and not _round(
                    bench, tally, random, fault):
                raise ClaimError(
                    f'no goal is accepted: {bench.rig.sequencer.last.rejected}')
            tally.faults[name] += 1
            bench.check_nodes()
        except FAILED as error:
            raise ClaimError(f'{name}: {error}') from error
        bench.clear()


def _round(bench: Workbench, tally: Tally, random: Random, fault: Fault | None) -> bool:
    """Run one goal and restore the arm; return False when the goal was rejected."""
    goal = _goal(bench, random)
    if not goal.accepted:  # a busy computer makes devices seem to fail
        progress(f'rejected: {bench.rig.rejection(goal)}')
        bench.restore()
        return False
    goals = [goal]
    disturbance = random.choice(['', '', '', 'cancel', 'preempt'])
    if fault is not None or disturbance:
        _wait(goal, random.uniform(0.0, MAX_DELAY))
    if disturbance == 'cancel' and not goal.ended:
        goal.cancel()
    elif disturbance == 'preempt' and (newer := _goal(bench, random)).accepted:
        goals.append(newer)
    if fault is not None:
        _wait(goals[-1], random.uniform(0.0, 0.5))
        fault.inject(bench, random)
        _wait(goals[-1], random.uniform(0.0, MAX_FAULT))
    statuses = [each.result()[0] for each in goals]
    tally.goals.update(statuses)
    if fault is None and not disturbance:
        tally.undisturbed.update(statuses)
        if statuses != ['SUCCEEDED']:
            progress(f'{statuses[0]} without a fault: {goal.result()[1].error_string}')
    bench.wait_for_rest()
    _compare(bench, tally, commanded=statuses[-1] == 'SUCCEEDED')
    bench.restore()
    _compare(bench, tally, commanded=False)
    return True


def _goal(bench: Workbench, random: Random) -> Any:
    """Return a goal of some random shapes."""
    shapes = [[random.uniform(-ANGLE, ANGLE) for _ in range(SEGMENTS)]
              for _ in range(random.randint(1, MAX_SHAPES))]
    return bench.rig.goal(*shapes)


def _wait(goal: Any, seconds: float) -> None:
    """Let a goal run for a time, or to its end."""
    deadline = time.monotonic() + seconds
    while not goal.ended and time.monotonic() < deadline:
        time.sleep(0.01)


def _compare(bench: Workbench, tally: Tally, commanded: bool) -> None:
    if not bench.referenced:
        tally.unknown += 1
        return
    unreported, missed = bench.differences(commanded)
    if not bench.referenced:  # since then
        return
    tally.unreported = max(tally.unreported, unreported)
    tally.missed = max(tally.missed, missed)
    if unreported > bench.board.resolution or missed > bench.board.reach:
        raise ClaimError(
            f'reported pulls {bench.rig.pulls} are {1e3 * unreported:.3f} mm off, commanded ones '
            f'{1e3 * missed:.3f} mm: tendons are at {bench.board.pulls}, zero {bench.zero} m')
    tally.compared += 1


def _counts(goals: Counter[str]) -> str:
    return ', '.join(f'{count} {name.lower()}' for name, count in sorted(goals.items())) or '-'


def _claims(tally: Tally) -> list[str]:
    """Return the claims that do not hold."""
    claims = {
        f'a segment counted as stiff for {tally.falsely_stiff:.2f} s without its vacuum':
            tally.falsely_stiff <= LATENCY,
        f'the memory of the nodes grew by {max(tally.growth, default=0.0):.1f} MB/h':
            not max(tally.growth, default=0.0) > MAX_GROWTH,
        f'motors ran for {tally.moved_stiff:.2f} s in a stiff arm': tally.moved_stiff <= LATENCY,
    }
    return [claim for claim, holds in claims.items() if not holds]


def _body(tally: Tally, board: Board[Any]) -> str:
    growth = ', '.join('-' if isnan(g) else f'{g:+.1f}' for g in tally.growth)
    rows = [
        ('reported minus emulated pull, mm', f'{1e3 * tally.unreported:.4f}',
         f'{1e3 * board.resolution:.4f}'),
        ('end of a trajectory minus emulated pull, mm', f'{1e3 * tally.missed:.4f}',
         f'{1e3 * board.reach:.4f}'),
        ('segment counted as stiff without its vacuum, ms', f'{tally.falsely_stiff * 1e3:.0f}',
         f'{LATENCY * 1e3:.0f}'),
        ('motion while every segment was stiff, ms', f'{tally.moved_stiff * 1e3:.0f}',
         f'{LATENCY * 1e3:.0f}'),
        ('growth of memory in the last third of the time, MB/h', growth, f'{MAX_GROWTH:g}'),
        ('nodes that died, exceptions, goals that did not end, unrequested motions',
         str(len(tally.failures)), '0'),
    ]
    faults = tally.faults - Counter(none=tally.faults['none'])
    return (
        f'{tally.operation / 60:.1f} min of operation at the default speed, in '
        f'{tally.seconds / 60:.1f} min. {faults.total()} faults of {len(faults)} kinds. Goals: '
        f'{_counts(tally.goals)}. Without fault, cancel or newer goal: '
        f'{_counts(tally.undisturbed)}. Positions: {tally.compared} compared, {tally.unknown} '
        f'declared unknown. Memory of the nodes at the end: {tally.memory:.0f} MB.\n\n'
        + table(('', 'largest', 'allowed'), rows))
