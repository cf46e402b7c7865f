# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Many arms in one call, on all cores."""

from collections.abc import Callable, Sequence
from dataclasses import replace
import time

import numpy as np

from benchmarks import paper
from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import progress
from soft_continuum.mechanics import SLACK, Statics
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.batch import solve_batch
from soft_continuum.mechanics.chain import Batch

COUNT = 10_000
CHECKED = 50  # problems that are compared with Statics.solve
SPREAD = 0.2  # of the bending stiffness, to either side


def run(quick: bool) -> Section:
    """Time the batches and return the table."""
    count = COUNT // 10 if quick else COUNT
    random = np.random.default_rng(1)
    weightless, heavy = Statics(paper.arm()), Statics(paper.arm(gravity=True))
    first = paper.only(0)
    segment_pull = paper.steps_of(weightless, paper.FORMS['C'])[0].change
    progress(f'building {count} arms')
    arms = [_varied(heavy, random.uniform(1.0 - SPREAD, 1.0 + SPREAD, 3)) for _ in range(count)]
    cases: list[tuple[str, Statics | list[Statics], float, Sequence[bool]]] = [
        ('one arm, all segments soft', weightless, paper.ALL_PULLS, paper.ALL_SOFT),
        ('one arm, segment 1 soft, gravity', heavy, segment_pull, first),
        ('as many arms, segment 1 soft, gravity', arms, segment_pull, first),
    ]
    calls: list[Callable[[], Batch]] = []
    rows = []
    for _, arm, pull, soft in cases:
        pulls = _pulls(random, pull, count)
        start = (arm if isinstance(arm, Statics) else arm[0]).chain.straight()
        calls.append(lambda a=arm, s=start, p=pulls, m=soft: solve_batch(a, s, p, m))  # type: ignore[misc]
        solve_batch(arm if isinstance(arm, Statics) else arm[:8], start, pulls[:8], soft)
    times: list[list[float]] = [[] for _ in cases]
    used: list[list[float]] = [[] for _ in cases]
    off = [0.0] * len(cases)
    for repetition in range(3 if quick else 11):
        for i, call in enumerate(calls):
            begin, busy = time.perf_counter(), time.process_time()
            batch = call()
            times[i].append(time.perf_counter() - begin)
            used[i].append(time.process_time() - busy)
            if repetition == 0:
                off[i] = _off(cases[i], batch, count)
    for (name, *_), spent, busy_for in zip(cases, times, used, strict=True):
        rows.append([name, number(count / float(np.median(spent))),
                     number(count / float(np.median(busy_for)))])
    head = [f'{count:,} problems in one call', 'solves/s', 'per core']
    return Section('benchmarks/performance.md', 'batch', '\n\n'.join([
        machine(), table(head, rows),
        f'A batch differs from single solves by at most {max(off):.0e} m.']))


def _pulls(random: np.random.Generator, most: float, count: int) -> Array:
    return np.column_stack([random.uniform(0.0, most, count), np.full(count, SLACK)])


def _varied(statics: Statics, factors: Array) -> Statics:
    arm = statics.chain.arm
    segments = tuple(replace(s, stiffness_y=s.stiffness_y * float(f))
                     for s, f in zip(arm.segments, factors, strict=True))
    return Statics(replace(arm, segments=segments))


def _off(case: tuple[str, Statics | list[Statics], float, Sequence[bool]], batch: Batch,
         count: int) -> float:
    """Return how far (m) a sample of the batch is off what Statics.solve finds."""
    _, arms, _, soft = case
    worst = 0.0
    if not batch.found.all():
        return np.inf
    for i in range(0, count, count // CHECKED):
        statics = arms if isinstance(arms, Statics) else arms[i]
        start = statics.chain.straight()
        alone = statics.solve(start, (float(batch.pulls[i, 0]), SLACK), soft)
        worst = max(worst, paper.apart(statics, batch.configurations[i], alone.joint_angles))
    return worst
