# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Two computers: a cable that delays, loses and is cut; how goals end, and when tendons rest."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from random import Random
import tempfile
import time

from benchmarks.tables import table
from soak.report import progress, Report, spread
from soak.workbench import domain, FAILED
from soft_continuum.mechanics._kernel import warm_up
from support.split_arm import SplitArm
from support.two_computers import PERFECT, Quality, why_not, WORKSTATION

GOALS = 8  # for each quality of the cable
CUTS, KILLS = 50, 20
ALLOWED = 0.6  # s from the cut to rest
UNDER_WAY = 0.3  # s until what arrived before is done: a valve switches
AFTERWARDS = 3.0  # s in which nothing may move by itself
QUALITIES = (
    PERFECT,
    Quality(0.005, 0.001, 0.01),
    Quality(0.025, 0.005, 0.05),
    Quality(0.05, 0.01, 0.05),
    Quality(0.05, 0.03, 0.05),
    Quality(0.05, 0.01, 0.15),
    Quality(0.1, 0.02, 0.05),
    Quality(0.2, 0.02, 0.05),
)
MUST_WORK = QUALITIES[:5]
CUT_AT = Quality(0.05, 0.01, 0.05)
SHAPES = ([0.0, 0.0, 0.5], [0.0, 0.0, -0.5])
FROM_BENT, FROM_STRAIGHT = 1.5, 0.8  # s that a motion to one of them lasts at least
RANDOM = Random(1)


def run(share: float) -> Report:
    """Send goals over every cable, cut it during motion, and kill the workstation."""
    if problem := why_not():
        return Report(problem, (f'not measured: {problem}',))
    warm_up()
    body, failures = [], list[str]()
    cut, killed = Ends('cable cut'), Ends('workstation killed')
    with split(CUT_AT) as arm:
        for i in range(max(1, round(share * CUTS))):
            _cut(arm, SHAPES[i % 2], cut)
    for _ in range(max(1, round(share * KILLS))):
        with split(CUT_AT) as arm:  # the next kinematics would not know the shape of a bent arm
            _kill(arm, killed)
    for ends in cut, killed:
        failures += ends.failures
        progress(str(ends))
    body.append(table((
        '', 'times', 'in motion', 'motion ceased, ms: median', 'longest', 'valves switched',
        'moved or switched afterwards', 'goals aborted with a reason'), [cut.row, killed.row]))
    rows, goals = [], max(1, round(share * GOALS))
    for quality in QUALITIES:
        with split(quality) as arm:
            rows.append(_goals(arm, quality, goals, failures))
    body.append(table(('delay, ms', 'jitter, ms', 'loss', 'goals reached', 'time, s: median',
                       'longest'), rows))
    return Report('\n\n'.join(body), tuple(failures))


@dataclass
class Ends:
    """What followed when motions were ended in one way; ceased: s until rest, of each."""

    what: str
    count: int = 0
    ceased: list[float] = field(default_factory=list)
    switched: int = 0
    afterwards: int = 0
    aborted: int = 0
    others: list[str] = field(default_factory=list)

    @property
    def failures(self) -> list[str]:
        """The claims that did not hold."""
        found = [*self.others]
        if max(self.ceased, default=0.0) > ALLOWED:
            found.append(f'moved for {max(self.ceased):.3f} s')
        found += [f'{number} times: {text}' for number, text in (
            (self.afterwards, 'moved or switched by itself'),
            (self.switched, 'valves were switched')) if number]
        return [f'{self.what}: {text}' for text in found]

    @property
    def row(self) -> tuple[str, ...]:
        """Of the table."""
        median, _, longest = spread(self.ceased)
        return (self.what, str(self.count), str(len(self.ceased)), median, longest,
                str(self.switched), str(self.afterwards), str(self.aborted or '-'))


@contextmanager
def split(quality: Quality) -> Iterator[SplitArm]:
    """Return an arm on two computers, whose cable is like this."""
    with (tempfile.TemporaryDirectory() as folder, domain() as number,
          SplitArm(number, Path(folder), quality) as arm):
        yield arm


def _goals(arm: SplitArm, quality: Quality, count: int, failures: list[str]) -> tuple[str, ...]:
    times, others = [], []
    for i in range(count):
        begin = time.monotonic()
        arm.operator.send(SHAPES[i % 2])
        answer = arm.operator.answer(90.0)
        if answer == 'reached':
            times.append(time.monotonic() - begin)
        else:
            others.append(answer)
            if quality in MUST_WORK:
                failures.append(f'{quality}: {answer}')
        arm.clear()
    progress(f'{quality}: {len(times)} of {count}; {others}')
    ordered = sorted(times) or [nan]
    return (f'{quality.delay * 1e3:g}', f'{quality.jitter * 1e3:g}', f'{quality.loss:.0%}',
            f'{len(times)} of {count}',
            *(f'{each:.1f}' for each in (ordered[len(times) // 2], ordered[-1])))


def _begin(arm: SplitArm, shape: list[float], lasts: float, ends: Ends) -> bool:
    """Send a goal and wait for a random moment of a motion; return whether there is one."""
    arm.operator.send(shape)
    arm.rig.wait_for(lambda: arm.moving, 'a motion')
    time.sleep(RANDOM.uniform(0.0, lasts))
    ends.count += 1
    return arm.moving


def _see(arm: SplitArm, begin: int, moving: bool, ends: Ends) -> None:
    """Note what happens to the arm, as long as it is alone."""
    time.sleep(UNDER_WAY)
    valves = arm.valves
    time.sleep(RANDOM.uniform(1.0, 6.0))
    if moving:
        ends.ceased.append(arm.moved_after(begin))
        ends.switched += arm.valves != valves


def _cut(arm: SplitArm, shape: list[float], ends: Ends) -> None:
    try:
        moving = _begin(arm, shape, FROM_BENT, ends)
        arm.computers.cut()
        _see(arm, time.time_ns(), moving, ends)
        rest, valves = time.time_ns(), arm.valves
        arm.computers.mend()
        answer = arm.operator.answer()
        if answer.startswith('HARDWARE_FAULT: '):
            ends.aborted += 1
        elif moving:
            ends.others.append(f'a goal ended with {answer}')
        time.sleep(AFTERWARDS)
        ends.afterwards += bool(arm.moved_after(rest)) or arm.valves != valves
        arm.clear()
    except FAILED as error:
        ends.others.append(str(error))


def _kill(arm: SplitArm, ends: Ends) -> None:
    try:
        moving = _begin(arm, SHAPES[0], FROM_STRAIGHT, ends)
        _see(arm, arm.kill(WORKSTATION), moving, ends)
        rest, valves = time.time_ns(), arm.valves
        arm.up(WORKSTATION)
        arm.operate()
        time.sleep(AFTERWARDS)
        ends.afterwards += bool(arm.moved_after(rest)) or arm.valves != valves
    except FAILED as error:
        ends.others.append(str(error))
