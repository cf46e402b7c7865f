# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Random shapes of a design, by the full statics.

The shapes of a unit depend on seed, design and unit alone, so that a study gives the same numbers
wherever and in whatever order its units are computed.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.directions import hinged
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.mechanics.inverse import set_shape
from soft_continuum.mechanics.statics import Statics
from soft_continuum.obstacles import CollisionScene
from soft_continuum.study.design import Design

HELD, TENSION, TRAVEL, TOUCHES, FALLS = 'held', 'tension', 'travel', 'touches', 'falls'
"""What became of a shape; beyond a limit of the rig; nearer to an obstacle than the margin; no
tendons hold it."""


def shapes(design: Design, first: int, count: int, seed: int) -> list[dict[str, Any]]:
    """
    Return the rows of some shapes of a design, from a number on.

    Columns: design, shape; softenings; solves; bent_1, ... what each segment was to be bent (rad;
    in space its rotation about x, and turned_1, ... about y); outcome; x, y, z (m) and the
    direction of the tip (unit vector); tension, the largest (N); pull, the largest (m); nan where
    there is none.
    """
    arm, statics = design.arm, Statics(design.arm)
    draw = np.random.default_rng([seed, design.number, first, 0])
    jamming = bool(design.values['arm.jamming'])
    around = CollisionScene(arm, design.obstacles)
    rows = []
    for shape in range(first, first + count):
        bending = drawn(arm, draw, jamming)
        state, solves = set_to(statics, bending, jamming)
        soft = int(bending.any(axis=1).sum())
        row: dict[str, Any] = {'design': design.number, 'shape': shape,
                               'softenings': soft if jamming else 0, 'solves': solves}
        for s, (about, axes) in enumerate(zip(bending, arm.bending_axes, strict=True), start=1):
            row |= {f'{name}_{s}': float(value) for name, value in zip(
                ('bent', 'turned'), about[axes], strict=False)}
        rows.append(row | {'outcome': outcome_of(state, design.values, around)} | _tip(state))
    return rows


def drawn(arm: Arm, draw: np.random.Generator, jamming: bool) -> Array:
    """Return random bending within the limits, of some of the segments, or of all at once."""
    count = len(arm.segments)
    limits = arm.bending_angle_limits
    chosen = np.ones(count, dtype=bool)
    if jamming:  # with fewer softenings a smaller set is reached
        chosen[draw.permutation(count)[draw.integers(1, count + 1):]] = False
    if hinged(arm):
        sizes = limits * draw.uniform(-1.0, 1.0, count)
        return np.where(arm.bending_axes & chosen[:, None], sizes[:, None], 0.0)
    sizes = limits * np.sqrt(draw.random(count))  # even over the disc of rotation vectors
    ways = draw.uniform(-np.pi, np.pi, count)
    bending = sizes[:, None] * np.column_stack([-np.sin(ways), np.cos(ways)])
    return np.where(arm.bending_axes & chosen[:, None], bending, 0.0)


def set_to(statics: Any, bending: Array, jamming: bool) -> tuple[Any, int]:
    """Return the state with a bending, or None, and how many bendings were solved for."""
    try:
        state = set_shape(statics, bending, jamming=jamming)
    except StaticsError:
        return None, 1
    return state, int(bending.any(axis=1).sum()) if jamming else 1


def outcome_of(state: Any, values: Mapping[str, Any], around: CollisionScene) -> str:
    """Return what became of a shape; state: None where no tendons hold it."""
    if state is None:
        return FALLS
    low, high = values['pull_limits']
    if np.max(state.tensions) > values['tension_limit']:
        return TENSION
    if np.min(state.pulls) < low or np.max(state.pulls) > high:
        return TRAVEL
    near = around.clearance(state).distance
    return TOUCHES if near < values['obstacles.margin'] else HELD


def _tip(state: Any) -> dict[str, float]:
    names = ('x', 'y', 'z', 'pointing_x', 'pointing_y', 'pointing_z', 'tension', 'pull')
    if state is None:
        return dict.fromkeys(names, float('nan'))
    numbers = np.concatenate([state.poses[-1, :3], state.rotations[-1][:, 2],
                              [np.max(state.tensions), np.abs(state.pulls).max()]])
    return dict(zip(names, numbers.tolist(), strict=True))
