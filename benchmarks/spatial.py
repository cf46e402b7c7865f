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
    Statics,
)
from soft_continuum.mechanics.arm import Arm, Disc, Segment, Tendon
from soft_continuum.mechanics.batch import solve_batch, solve_path
from soft_continuum.mechanics.space.sensitivity import SpaceLinearisation
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.parameters.files import load_arm
from soft_continuum.user_files import description_file

BODIES = (12, 24, 50, 100)
PULLS = 0.004, -0.006  # m
PULL = 0.006  # m
REPEATS = 300


def run(quick: bool) -> Section:
    """Measure; the section is of the page about accuracy."""
    _kernel.functions()  # loaded before anything is timed
    rows = [_row(rod, bodies, 4 if quick else None) for rod in (STEEL, TPU) for bodies in BODIES]
    head = ('rod', 'bodies', 'shapes solved', 'error of the tip, mm: mean', 'worst',
            'of all stations, mm: mean', 'worst', 'ms per shape: median', 'worst')
    return Section('benchmarks/accuracy.md', 'spatial', '\n\n'.join([
        'Shapes of rods of steel and TPU under gravity and wrenches, computed with SoRoSim '
        f'(Cosserat rods) and rounded to about 0.1 mm (`data/sorosim`). {machine()}',
        table(head, rows), _beside_rods(),
        _beside_the_plane(20 if quick else REPEATS),
        _questions(3 if quick else 30), _batches(300 if quick else 3000)]))


def _row(rod: Rod, bodies: int, most: int | None) -> tuple[str, ...]:
    errors, times, every = [], [], list(islice(shapes(rod), most))
    for shape in every:
        begin = time.thread_time()
        statics = SpaceStatics(shape.arm(rod, bodies))
        state = statics.solve(statics.chain.straight(), [], [True, True])
        times.append(1e3 * (time.thread_time() - begin))
        if not state.jumped:
            errors.append(1e3 * shape.errors(state))
    found = np.array(errors)
    return (rod.name, str(bodies), f'{len(found)} of {len(every)}', number(found[:, -1].mean()),
            number(found[:, -1].max()), number(found.mean()), number(found.max()),
            number(float(np.median(times))), number(max(times)))


def _beside_rods() -> str:
    """Return how far the chain of an arm with three tendons is off its rods, by its bodies."""
    pulls, rows = (0.008, -0.005, -0.006), []
    for bodies in (6, 12, 24, 48):
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


def _beside_the_plane(repeats: int) -> str:
    """Return how long one solve of the same planar arm takes by either, in turns."""
    arm = load_arm(description_file())
    planar, solid = Statics(arm), SpaceStatics(arm)
    soft = [True, False, False]
    solves: dict[str, Callable[[], object]] = {
        'planar solver': lambda: planar.solve(planar.chain.straight(), PULLS, soft),
        'spatial solver': lambda: solid.solve(solid.chain.straight(), PULLS, soft)}
    return _times("the paper's arm, from straight", solves, repeats)


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
    return _times('three segments and tendons, 12 bodies per segment', asked, repeats)


def _batches(count: int) -> str:
    """Return how many solves a batch makes, in wall time and in processor time of all threads."""
    random = np.random.default_rng(1)
    statics = SpaceStatics(three_tendons())
    arms = [SpaceStatics(replace(three_tendons(), payload=float(payload)))
            for payload in random.uniform(0.0, 0.02, count)]
    pulls = random.uniform(-PULL, PULL, (count, 3))
    pulls[:, 0] = -pulls[:, 1:].sum(axis=1)
    rows = []
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
        off = np.abs(batch.tips[::count // 50] - alone).max()
        rows.append((name, number(count / wall), number(count / used), f'{off:.0e}'))
    return table((f'{count:,} pulls up to {1e3 * PULL:g} mm in one batch', 'solves/s', 'per core',
                  'difference, m'), rows)


def _times(title: str, asked: dict[str, Callable[[], object]], repeats: int) -> str:
    """Return how long each takes, in turns."""
    times: dict[str, list[float]] = {name: [] for name in asked}
    for _ in range(repeats):
        for name, answer in asked.items():
            begin = time.thread_time()
            answer()
            times[name].append(1e3 * (time.thread_time() - begin))
    head = (title, 'ms, median', '99 %')
    return table(head, [(name, number(float(np.median(each))), number(float(np.quantile(
        each, 0.99)))) for name, each in times.items()])
