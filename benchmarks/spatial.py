# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Spatial statics against SoRoSim, and what they cost beside the planar ones."""

from collections.abc import Callable
from itertools import islice
import time

import numpy as np

from benchmarks.rods import Rod, shapes, STEEL, TPU
from benchmarks.tables import machine, number, Section, table
from soft_continuum.mechanics import _kernel, Statics
from soft_continuum.mechanics.spatial import spatial, SpatialStatics
from soft_continuum.nodes.up import description_file
from soft_continuum.parameters.files import load_arm

BODIES = (12, 24, 50, 100)
PULLS = 0.004, -0.006  # m
REPEATS = 300


def run(quick: bool) -> Section:
    """Measure; the section is of the page about space."""
    _kernel.functions()  # loaded before anything is timed
    rows = [_row(rod, bodies, 4 if quick else None) for rod in (STEEL, TPU) for bodies in BODIES]
    head = ('rod', 'bodies', 'shapes solved', 'tip, mm: mean', 'worst', 'all stations, mm: mean',
            'worst', 'ms for a shape, median', 'worst')
    return Section('space.md', 'spatial', '\n\n'.join([
        f'{machine()}', table(head, rows), _beside_the_plane(20 if quick else REPEATS)]))


def _row(rod: Rod, bodies: int, most: int | None) -> tuple[str, ...]:
    errors, times, every = [], [], list(islice(shapes(rod), most))
    for shape in every:
        begin = time.perf_counter()
        statics = SpatialStatics(shape.arm(rod, bodies))
        state = statics.solve(statics.chain.straight(), [], [True, True])
        times.append(1e3 * (time.perf_counter() - begin))
        if not state.jumped:
            errors.append(1e3 * shape.errors(state))
    found = np.array(errors)
    return (rod.name, str(bodies), f'{len(found)} of {len(every)}', number(found[:, -1].mean()),
            number(found[:, -1].max()), number(found.mean()), number(found.max()),
            number(float(np.median(times))), number(max(times)))


def _beside_the_plane(repeats: int) -> str:
    """Return how long one solve of the same planar arm takes by either, in turns."""
    arm = load_arm(description_file())
    planar, solid = Statics(arm), SpatialStatics(spatial(arm))
    soft = [True, False, False]
    solves: dict[str, Callable[[], object]] = {
        'in the plane': lambda: planar.solve(planar.chain.straight(), PULLS, soft),
        'in space': lambda: solid.solve(solid.chain.straight(), PULLS, soft)}
    times: dict[str, list[float]] = {name: [] for name in solves}
    for _ in range(repeats):
        for name, solve in solves.items():
            begin = time.perf_counter()
            solve()
            times[name].append(1e3 * (time.perf_counter() - begin))
    head = ('the arm of the paper, from straight', 'ms, median', '99 %')
    return table(head, [(name, number(float(np.median(each))), number(float(np.quantile(
        each, 0.99)))) for name, each in times.items()])
