# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The cost of one solve against the number of joints."""

import numpy as np

from benchmarks import paper
from benchmarks.kernel import Kernel
from benchmarks.reference import MissingCompilerError, Reference
from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import interleave, progress, Sampler, sampler
from soft_continuum.mechanics import Statics
from soft_continuum.mechanics.plane.chain import PlaneChain
from soft_continuum.mechanics.space.statics import SpaceStatics

MOST_IN_SPACE = 1000  # joints
BODIES = (12, 24, 49, 99, 199, 332, 665, 999)  # per segment


def run(quick: bool) -> Section:
    """Time chains of more and more bodies and return the table."""
    samplers: dict[str, Sampler] = {}
    iterations, joints, off = {}, {}, {}
    for n in BODIES:
        statics = Statics(paper.arm().with_bodies(n))
        pull = paper.pull_for_tip_segment(statics, paper.ANGLE)
        task, _ = paper.cold_and_warm(statics, pull)
        kernel = Kernel(statics, task.start, task.pulls, paper.ALL_SOFT)
        joints[n], iterations[n] = statics.chain.bodies, kernel.iterations
        samplers[f'kernel {n}'] = sampler(kernel.run)
        samplers[f'statics {n}'] = sampler(
            lambda s=statics, t=task: s.solve(t.start, t.pulls, paper.ALL_SOFT))  # type: ignore[misc]
        if joints[n] <= MOST_IN_SPACE:
            solid = SpaceStatics(statics.chain.arm)
            samplers[f'space {n}'] = sampler(lambda s=solid, t=task: s.solve(  # type: ignore[misc]
                s.chain.straight(), t.pulls, paper.ALL_SOFT))
        try:
            reference = Reference(PlaneChain(statics.chain.arm))
            shape = reference.solve(np.cumsum(task.start.joint_angles), 0.0, pull)
            off[n] = paper.apart(statics, np.diff(shape, prepend=0.0), kernel.joint_angles)
            samplers[f'c {n}'] = lambda r=reference, t=task: r.seconds_per_solve(  # type: ignore[misc]
                t.start, t.pull, 20)
        except MissingCompilerError as error:
            progress(str(error))
    times = interleave(samplers, 7 if quick else 61, 0.5 if quick else 4.0)
    rows = []
    for n in BODIES:
        kernel_time, statics_time = times[f'kernel {n}'].median, times[f'statics {n}'].median
        c, space = times.get(f'c {n}'), times.get(f'space {n}')
        per_joint = kernel_time / (joints[n] * iterations[n])
        rows.append([
            str(joints[n]), str(iterations[n]), number(c.median * 1e6) if c else '',
            number(kernel_time * 1e6), number(statics_time * 1e6), number(per_joint * 1e9),
            number(space.median * 1e6) if space else '',
            f'{off[n]:.0e}' if c else ''])
    slope = np.polyfit(np.log([joints[n] for n in BODIES[3:]]), np.log(
        [times[f'kernel {n}'].median / iterations[n] for n in BODIES[3:]]), 1)[0]
    head = ['joints', 'iterations', 'C, µs', 'compiled solver, µs', 'Statics.solve, µs',
            'compiled solver per joint and iteration, ns', 'Statics.solve in space, µs', 'off, m']
    return Section('benchmarks/performance.md', 'joints', '\n'.join([
        machine(), '', table(head, rows), '',
        f'From {joints[BODIES[3]]} joints on the time of an iteration grows like the number of '
        f'joints to the power {slope:.2f}.']))
