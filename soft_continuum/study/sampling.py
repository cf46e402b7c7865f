# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
One unit of work: some random shapes of one design, by the full statics.

The shapes of a unit depend on seed, design and unit alone, so that a study gives the same numbers
wherever and in whatever order its units are computed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.either import AnyArm, statics_of
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.mechanics.inverse import set_shape
from soft_continuum.mechanics.spatial.directions import bending_axes
from soft_continuum.mechanics.spatial.inverse import pulls_for_bending
from soft_continuum.mechanics.spatial.inverse import set_shape as set_shape_in_space
from soft_continuum.mechanics.spatial.statics import SpatialStatics
from soft_continuum.study.design import Design, Study

UNIT, UNIT_IN_SPACE = 1000, 25
"""Shapes of one unit: about half a second of work, in space more where many fall."""
HELD, TENSION, TRAVEL, FALLS = 'held', 'tension', 'travel', 'falls'
"""What became of a shape; beyond a limit of the rig; no tendons hold it."""


@dataclass(frozen=True)
class Unit:
    """Some shapes of a design, by number."""

    design: int
    first: int
    count: int

    @property
    def name(self) -> str:
        """Its name, in the order of design and shape."""
        return f'{self.design:06d}-{self.first:08d}'


def units(study: Study) -> list[Unit]:
    """Return the work of a study, in order."""
    found = []
    for design in study.designs:
        size = UNIT if isinstance(design.arm, Arm) else UNIT_IN_SPACE
        found += [Unit(design.number, first, min(size, study.shapes - first))
                  for first in range(0, study.shapes, size)]
    return found


def compute(design: Design, unit: Unit, seed: int) -> tuple[dict[str, list[Any]], float]:
    """
    Return the rows of a unit as columns, and how long that took (s).

    Columns: design, shape; softenings; bent_1, ... what each segment was to be bent (rad; in space
    its rotation about x, and turned_1, ... about y); outcome; x, y, z (m) and the direction of the
    tip (unit vector); tension, the largest (N); pull, the largest (m); nan where there is none.
    """
    began = perf_counter()
    arm, statics = design.arm, statics_of(design.arm)
    draw = np.random.default_rng([seed, unit.design, unit.first])
    jamming = bool(design.values['arm.jamming'])
    values: Mapping[str, Any] = design.values
    low, high = values['pull_limits']
    rows = []
    for shape in range(unit.first, unit.first + unit.count):
        bending = _drawn(arm, draw, jamming)
        state, solves = _set(statics, bending, jamming)
        soft = int(np.any(bending.reshape(len(arm.segments), -1) != 0.0, axis=1).sum())
        row: dict[str, Any] = {'design': unit.design, 'shape': shape,
                               'softenings': soft if jamming else 0, 'solves': solves}
        columns = bending.reshape(len(arm.segments), -1)
        for s, about in enumerate(columns, start=1):
            row |= {f'{name}_{s}': float(value) for name, value in zip(
                ('bent', 'turned'), about, strict=False)}
        rows.append(row | _outcome(state, values['tension_limit'], low, high))
    return {name: [row[name] for row in rows] for name in rows[0]}, perf_counter() - began


def _drawn(arm: AnyArm, draw: np.random.Generator, jamming: bool) -> Array:
    """Return random bending within the limits, of some of the segments, or of all at once."""
    count = len(arm.segments)
    limits = np.array([s.bending_angle_limit for s in arm.segments])
    chosen = np.ones(count, dtype=bool)
    if jamming:  # with fewer softenings a smaller set is reached
        chosen[draw.permutation(count)[draw.integers(1, count + 1):]] = False
    if isinstance(arm, Arm):
        return np.where(chosen, limits * draw.uniform(-1.0, 1.0, count), 0.0)
    sizes = limits * np.sqrt(draw.random(count))  # even over the disc of rotation vectors
    ways = draw.uniform(-np.pi, np.pi, count)
    bending = sizes[:, None] * np.column_stack([-np.sin(ways), np.cos(ways)])
    return np.where(bending_axes(arm) & chosen[:, None], bending, 0.0)


def _set(statics: Any, bending: Array, jamming: bool) -> tuple[Any, int]:
    """Return the state with a bending, or None, and how many bendings were solved for."""
    try:
        if not isinstance(statics, SpatialStatics):
            return set_shape(statics, bending.tolist()), int(np.count_nonzero(bending))
        soft = np.any(bending != 0.0, axis=1)
        if jamming:
            return set_shape_in_space(statics, bending), int(soft.sum())
        return pulls_for_bending(statics, statics.chain.straight(), bending,
                                 [True] * len(bending)).state, 1
    except StaticsError:
        return None, 1


def _outcome(state: Any, tension_limit: float, low: float, high: float) -> dict[str, Any]:
    nan = float('nan')
    if state is None:
        return {'outcome': FALLS, 'x': nan, 'y': nan, 'z': nan, 'pointing_x': nan,
                'pointing_y': nan, 'pointing_z': nan, 'tension': nan, 'pull': nan}
    tension, pulls = float(np.max(state.tensions)), np.asarray(state.pulls)
    outcome = (TENSION if tension > tension_limit
               else TRAVEL if pulls.min() < low or pulls.max() > high else HELD)
    pointing = state.rotations[-1][:, 2]
    return {'outcome': outcome,
            **{axis: float(v) for axis, v in zip('xyz', state.poses[-1, :3], strict=True)},
            **{f'pointing_{axis}': float(v) for axis, v in zip('xyz', pointing, strict=True)},
            'tension': tension, 'pull': float(np.abs(pulls).max())}
