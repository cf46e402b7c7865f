# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Spatial statics against SoRoSim, and what they cost beside the planar ones."""

from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from math import nan
import time

import numpy as np

from benchmarks.rods import Rod, shapes, STEEL, TPU
from benchmarks.tables import machine, number, Section, table
from references import solve_rods
from soft_continuum.mechanics import (
    _kernel,
    bending_for_tip,
    PAPER,
    pulls_for_bending,
    SECOND_ORDER,
    set_shape,
)
from soft_continuum.mechanics.arm import Arm, Disc, Segment, Tendon
from soft_continuum.mechanics.batch import solve_batch, solve_path
from soft_continuum.mechanics.space.sensitivity import SpaceLinearisation
from soft_continuum.mechanics.space.statics import SpaceStatics

BODIES = (12, 50, 100)
PULL = 0.006  # m


def run(quick: bool) -> Section:
    """Measure; the section is of the page about accuracy."""
    _kernel.functions()  # loaded before anything is timed
    rows = [_row(name, rod, bodies, 4 if quick else None)
            for name, rod in (('steel', STEEL), ('TPU', TPU)) for bodies in BODIES]
    head = ('rod, bodies', 'shapes solved', 'error of the tip, mm: mean', 'worst', 'ms, median')
    return Section('benchmarks/accuracy.md', 'spatial', '\n\n'.join([
        'Rods under gravity and wrenches, computed with SoRoSim (Cosserat rods) and rounded to '
        f'about 0.1 mm (`data/sorosim`). {machine()}',
        table(head, rows), _beside_rods(),
        _questions(3 if quick else 30), _batches(300 if quick else 3000)]))


def _row(name: str, rod: Rod, bodies: int, most: int | None) -> tuple[str, ...]:
    errors, times, every = [], [], list(islice(shapes(rod), most))
    for shape in every:
        begin = time.thread_time()
        statics = SpaceStatics(shape.arm(rod, bodies))
        state = statics.solve(statics.chain.straight(), [], [True, True])
        times.append(1e3 * (time.thread_time() - begin))
        if not state.jumped:
            errors.append(1e3 * shape.errors(state)[-1])
    found = np.array(errors)
    return (f'{name}, {bodies}', f'{len(found)} of {len(every)}', number(found.mean()),
            number(found.max()), number(float(np.median(times))))


def _beside_rods() -> str:
    """Return how far the chain of an arm with three tendons is off its rods, by its bodies."""
    pulls, rows = (0.008, -0.005, -0.006), []
    for bodies in (6, 12, 48):
        cells = []
        for discretisation, spacers in ((PAPER, 0), (SECOND_ORDER, 0), (SECOND_ORDER, 2)):
            statics = SpaceStatics(replace(
                three_tendons(), bodies_per_segment=bodies, discretisation=discretisation,
                spacers=spacers))
            state = statics.solve(statics.chain.straight(), pulls, [True] * 3)
            off = np.linalg.norm(state.points - solve_rods(state, pulls).points, axis=1)
            cells.append(number(1e3 * float(off.max())))
        rows.append((str(bodies), *cells))
    return table(('bodies in each of three segments, all soft and hanging',
                  'largest distance from Kirchhoff rods, mm: `PAPER`', '`SECOND_ORDER`',
                  'with two spacers'), rows)


def three_tendons() -> Arm:
    """Return an arm of three segments and tendons that hangs."""
    return Arm(
        (Segment(0.07, 0.02, 0.02, 0.015, 0.05),) * 3, (Disc(0.02, 0.02),) * 4,
        tuple(Tendon(f't{i}', 2.0944 * i, 0.025, 3) for i in range(3)),
        gravity=(0.0, 0.0, 9.8))


def _questions(repeats: int) -> str:
    """Return how long what is asked of an arm of three segments and tendons takes."""
    statics = SpaceStatics(three_tendons())
    straight, soft, pulls = statics.chain.straight(), [True, False, False], (0.006, -0.004, -0.003)
    state = statics.solve(straight, pulls, soft)
    bend = [(0.4, 0.6), (nan, nan), (nan, nan)]
    there = set_shape(statics, [(0.4, 0.6), (-0.5, 0.2), (0.3, 0.7)])
    path = np.linspace(straight.pulls, state.pulls, 50)
    asked: dict[str, Callable[[], object]] = {
        'one solve': lambda: statics.solve(straight, pulls, soft),
        'derivatives by all pulls': lambda: SpaceLinearisation(statics, state).pulls(),
        'a path of 50 rows': lambda: solve_path(statics, straight, path, soft),
        'pulls for a bending': lambda: pulls_for_bending(statics, straight, bend, soft),
        'three segments set': lambda: set_shape(statics, there.bending),
        'bending for a tip position': lambda: bending_for_tip(statics, there.tip),
        'bending for a tip pose': lambda: bending_for_tip(
            statics, there.tip, there.orientations[-1])}
    times: dict[str, list[float]] = {name: [] for name in asked}
    for _ in range(repeats):
        for name, answer in asked.items():
            begin = time.thread_time()
            answer()
            times[name].append(1e3 * (time.thread_time() - begin))
    return table(('three segments and tendons, 12 bodies per segment', 'ms, median'), [
        (name, number(float(np.median(each)))) for name, each in times.items()])


def _batches(count: int) -> str:
    """Return how many solves a batch makes, in wall time and in processor time of all threads."""
    random = np.random.default_rng(1)
    statics = SpaceStatics(three_tendons())
    arms = [SpaceStatics(replace(three_tendons(), payload=float(payload)))
            for payload in random.uniform(0.0, 0.02, count)]
    pulls = random.uniform(-PULL, PULL, (count, 3))
    pulls[:, 0] = -pulls[:, 1:].sum(axis=1)
    rows, off = [], 0.0
    for name, of, soft in (('one arm, all segments soft', [statics], [True] * 3),
                           ('one arm, segment 1 soft', [statics], [True, False, False]),
                           ('as many arms, segment 1 soft', arms, [True, False, False])):
        starts = [each.chain.straight() for each in of]
        solve_batch(of[:1], starts[:1], pulls[:8], soft)
        wall, used = time.perf_counter(), time.process_time()
        batch = solve_batch(of, starts, pulls, soft)
        wall, used = time.perf_counter() - wall, time.process_time() - used
        alone = [of[i % len(of)].solve(starts[i % len(of)], pulls[i], soft).tip
                 for i in range(0, count, count // 50)]
        off = max(off, np.abs(batch.tips[::count // 50] - alone).max())
        rows.append((name, number(count / wall), number(count / used)))
    return table((f'{count:,} pulls up to {1e3 * PULL:g} mm in one batch', 'solves/s', 'per core'),
                 rows) + f'\n\nA batch differs from single solves by at most {off:.0e} m.'
