# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""One equilibrium of the paper's arm, found in every way there is."""

from dataclasses import dataclass, replace
from unittest.mock import patch

import numpy as np

from benchmarks import paper, slsqp
from benchmarks.kernel import Kernel, repeated
from benchmarks.reference import FLAGS, MissingCompilerError, Reference
from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import interleave, progress, Sampler, sampler
from soft_continuum.mechanics import (
    _kernel,
    Arm,
    Equilibrium,
    SLACK,
    Statics,
)
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.plane.chain import PlaneChain
from soft_continuum.mechanics.space.statics import SpaceStatics

C = 'C, called in a loop in C'
C_REPEATS = 200
TOLERANCE = 2e-5  # m within which MuJoCo has settled
INSTALL = 'MuJoCo is not installed: `./run exec python -m pip install -r requirements/test.txt`'


@dataclass(frozen=True)
class Contender:
    """One way to solve a task: its sampler, and how far (m) its shape is off that of Statics."""

    sampler: Sampler
    off: float


def run(quick: bool) -> Section:
    """Time the tasks and return the tables."""
    statics = Statics(paper.arm())
    tip_pull = paper.pull_for_tip_segment(statics, paper.ANGLE)
    tasks = {f'{pull * 1e3:.1f} mm': paper.cold_and_warm(statics, pull)
             for pull in (paper.ALL_PULLS, tip_pull)}
    residuals: list[float] = []
    notes: set[str] = set()
    contenders: dict[tuple[str, str], Contender] = {}
    columns = []
    for title, pair in tasks.items():
        for kind, task in zip(('cold', 'warm'), pair, strict=True):
            columns.append(f'{title}, {kind}')
            for name, contender in _contenders(statics, task, residuals, notes).items():
                contenders[name, columns[-1]] = contender
    columns.append('C-form')
    for name, contender in _c_form(statics).items():
        contenders[name, columns[-1]] = contender
    progress(f'timing {len(contenders)} contenders in turn')
    names = {'/'.join(key): key for key in contenders}
    timings = interleave({name: contenders[key].sampler for name, key in names.items()},
                         7 if quick else 61, 0.5 if quick else 4.0)
    results = {key: timings[name] for name, key in names.items()}
    bent = [f'{title} bends them to ' + ', '.join(
        f'{np.degrees(a):.1f}°' for a in statics.solve(
            cold.start, cold.pulls, paper.ALL_SOFT).bending_angles)
            for title, (cold, _) in tasks.items()]
    notes.add(f'All ways agree to {max(each.off for each in contenders.values()):.0e} m. Statics '
              f'and C leave at most {max(residuals):.0e} N m unbalanced. C: '
              f'`cc {" ".join(FLAGS)}`.')
    return Section('benchmarks/performance.md', 'solve', '\n\n'.join([
        f'Pull of the right tendon with all segments soft ({"; ".join(bent)}), and the C-form: '
        f'one segment soft at a time, to 36° each in three solves. {machine()}',
        table(['µs', *columns], [[name, *(
            number(results[name, column].median * 1e6) if (name, column) in results else ''
            for column in columns)] for name in dict.fromkeys(name for name, _ in contenders)]),
        ' '.join(sorted(notes))]))


def _contenders(statics: Statics, task: paper.Task, residuals: list[float],
                notes: set[str]) -> dict[str, Contender]:
    """Return every way to solve one task."""
    chain, start = PlaneChain(statics.chain.arm), task.start
    state = statics.solve(start, task.pulls, paper.ALL_SOFT)
    residuals.append(state.residual)
    begin = np.cumsum(start.joint_angles)
    tension = float(start.tensions[0])

    def off(joint_angles: Array) -> float:
        return paper.apart(statics, joint_angles, state.joint_angles)

    found: dict[str, Contender] = {}
    try:
        reference = Reference(chain)
        shape = np.diff(reference.solve(begin, tension, task.pull), prepend=0.0)
        residuals.append(reference.residual)
        found[C] = Contender(
            lambda: reference.seconds_per_solve(start, task.pull, C_REPEATS), off(shape))
    except MissingCompilerError as error:
        notes.add(f'C is left out: {error}.')
    kernel = Kernel(statics, start, task.pulls, paper.ALL_SOFT)
    found['compiled solver, called directly'] = Contender(
        sampler(kernel.run), off(kernel.joint_angles))
    found['Statics.solve'] = Contender(
        sampler(lambda: statics.solve(start, task.pulls, paper.ALL_SOFT)), 0.0)
    solid = SpaceStatics(chain.arm)
    begun = solid.chain.straight()
    if tension > 0.0:
        begun = solid.solve(begun, (float(start.pulls[0]), SLACK), paper.ALL_SOFT)
    found['Statics.solve in space, the same arm'] = Contender(
        sampler(lambda: solid.solve(begun, task.pulls, paper.ALL_SOFT)),
        float(np.abs(solid.solve(begun, task.pulls, paper.ALL_SOFT).points
                     - state.points).max()))
    found |= _in_mujoco(statics, task, notes)
    def plain() -> Equilibrium:
        with patch.object(_kernel, 'functions', lambda: _kernel.SOURCE):
            return statics.solve(start, task.pulls, paper.ALL_SOFT)

    found['Statics.solve without numba'] = Contender(sampler(plain), off(plain().joint_angles))
    minimum = slsqp.solver(chain, start.joint_angles, task.pull)
    found['scipy SLSQP with gradient'] = Contender(sampler(minimum), off(minimum()))
    return found


def _in_mujoco(statics: Statics, task: paper.Task, notes: set[str]) -> dict[str, Contender]:
    """Return MuJoCo's ways; none, and a note, where it is not installed."""
    try:
        from benchmarks import mujoco_chain
    except ImportError:
        notes.add(INSTALL)
        return {}
    found = {}
    for name, settings in mujoco_chain.SETTINGS.items():
        arm = mujoco_chain.MujocoArm(statics, settings)
        steps, rest, pull = arm.settle(task, TOLERANCE)
        state = statics.solve(task.start, (pull, SLACK), paper.ALL_SOFT)
        found[name] = Contender(
            arm.sampler(task, steps), paper.apart(statics, rest, state.joint_angles))
    return found


def _c_form(statics: Statics) -> dict[str, Contender]:
    """Return the ways to set the C-form: three solves, each of one soft segment."""
    steps = paper.steps_of(statics, paper.FORMS['C'])
    states = paper.walk(statics, steps)
    starts = [statics.chain.straight(), *states[:-1]]
    last = states[-1].joint_angles.reshape(statics.chain.segments, -1)
    kernels = [Kernel(statics, start, paper.pulls_of(step, start), paper.only(step.segment))
               for step, start in zip(steps, starts, strict=True)]
    found: dict[str, Contender] = {}
    try:
        alone = [_Alone(statics.chain.arm, step, last[step.segment]) for step in steps]
        found[C] = Contender(lambda: sum(one.seconds() for one in alone),
                             max(one.off for one in alone))
    except MissingCompilerError:
        pass
    found['compiled solver, called directly'] = Contender(
        sampler(repeated(kernels)),
        paper.apart(statics, kernels[-1].joint_angles, states[-1].joint_angles))
    found['Statics.solve'] = Contender(sampler(lambda: paper.walk(statics, steps, starts[0])), 0.0)

    def bent() -> Equilibrium:
        state = starts[0]
        for segment, sign in enumerate(paper.FORMS['C']):
            state = statics.bend(state, segment, sign * paper.ANGLE)
        return state

    found['Statics.bend, to angles'] = Contender(
        sampler(bent), paper.apart(statics, bent().joint_angles, states[-1].joint_angles))
    return found


class _Alone:
    """One segment of an arm without the rest, for C: what is locked does not matter to it."""

    def __init__(self, arm: Arm, step: paper.Step, joint_angles: Array) -> None:
        single = replace(arm, segments=arm.segments[step.segment:step.segment + 1],
                         discs=arm.discs[step.segment:step.segment + 2],
                         tendons=tuple(replace(
                             t, end=1, offset=tuple(t.offset_at(step.segment, part) for part in
                                                    (0.0, 1.0))) for t in arm.tendons))
        self._statics = Statics(single)
        self._reference = Reference(PlaneChain(single))
        self._start = self._statics.chain.straight()
        self._pull = step.change
        theta = self._reference.solve(np.cumsum(self._start.joint_angles), 0.0, self._pull)
        self.off = paper.apart(self._statics, np.diff(theta, prepend=0.0), joint_angles)

    def seconds(self) -> float:
        """Return the time of one solve, s."""
        return self._reference.seconds_per_solve(self._start, self._pull, C_REPEATS)
