# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The cost of one solve against the number of joints."""

import numpy as np

from benchmarks import paper
from benchmarks.kernel import Kernel
from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import interleave, Sampler, sampler
from soft_continuum.mechanics import Statics
from soft_continuum.mechanics.space.statics import SpaceStatics

MOST_IN_SPACE = 1000  # joints
BODIES = (12, 24, 49, 99, 199, 332, 665, 999)  # per segment


def run(quick: bool) -> Section:
    """Time chains of more and more bodies and return the table."""
    samplers: dict[str, Sampler] = {}
    iterations, joints = {}, {}
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
    times = interleave(samplers, 7 if quick else 61, 0.5 if quick else 4.0)
    rows = []
    for n in BODIES:
        space = times.get(f'space {n}')
        rows.append([str(joints[n]), number(times[f'statics {n}'].median * 1e6),
                     number(space.median * 1e6) if space else '-'])
    slope = np.polyfit(np.log([joints[n] for n in BODIES[3:]]), np.log(
        [times[f'kernel {n}'].median / iterations[n] for n in BODIES[3:]]), 1)[0]
    head = ['joints', 'Statics.solve, µs', 'in space, µs']
    return Section('benchmarks/performance.md', 'joints', '\n\n'.join([
        machine(), table(head, rows),
        f'From {joints[BODIES[3]]} joints on the time of an iteration grows like the number of '
        f'joints to the power {slope:.2f}.']))
