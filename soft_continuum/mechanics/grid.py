# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes of an arm on a grid of bendings, for the reach of its tip."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np

from soft_continuum.mechanics._checks import segment_order, whole
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.directions import bending_towards
from soft_continuum.mechanics.inverse import set_shape
from soft_continuum.mechanics.statics import Statics, StaticsError

Bent: TypeAlias = tuple[Any, Array]
"""A state, and the bending (segments, 2), rad, that was commanded."""


def bends(arm: Arm, segment: int, count: int, directions: int) -> Array:
    """
    Return evenly spaced bendings (k, 2), rad, of one segment (0-based) up to its limit.

    About a single axis these are ``count`` bendings from limit to limit.  Otherwise they are the
    straight segment and half as many bendings in each of the directions.
    """
    limit, axes = arm.segments[segment].bending_angle_limit, arm.bending_axes[segment]
    if axes.sum() == 1:
        return np.asarray(np.linspace(-limit, limit, count)[:, None] * axes)
    sizes = limit * np.linspace(0.0, 1.0, count // 2 + 1)[1:]
    ways = 2.0 * np.pi * np.arange(directions) / directions
    return np.array([np.zeros(2), *(size * bending_towards(way)
                                    for size in sizes for way in ways)])


def set_each(
        statics: Statics, grid: Sequence[Array], order: Sequence[int] | None = None, *,
        jamming: bool = True,
        progress: Callable[[Sequence[Bent], str], Iterable[Bent]] = lambda states, _: states
        ) -> list[Bent]:
    """
    Return the arm at all combinations of bendings, without those that no tendons hold.

    grid: per segment, (k, 2), rad.  order, jamming, progress: as for set_on_grid.
    """
    count = len(grid)
    states: list[Bent] = [(statics.chain.straight(), np.zeros((count, 2)))]
    for s in segment_order(order, count):
        after = []
        for state, before in progress(states, f'segment {s + 1}'):
            for bend in grid[s]:
                bending = before.copy()
                bending[s] = bend
                try:
                    after.append((set_shape(
                        statics, bending, state, (s,), jamming=jamming), bending))
                except StaticsError:
                    continue
        states = after
    return states


def set_on_grid(
        statics: Statics, angles: int = 2, directions: int = 6,
        order: Sequence[int] | None = None, *, jamming: bool = True,
        progress: Callable[[Sequence[Bent], str], Iterable[Bent]] = lambda states, _: states
        ) -> list[Bent]:
    """
    Return the arm with every segment straight or evenly bent up to its limit in each direction.

    angles, directions: number of each, so (1 + angles * directions) ** segments shapes; about one
    axis there are two directions.  order: of setting the segments (default: base first).
    jamming: whether all others are stiff meanwhile; without it all are soft, those not yet set
    are held straight, and the order has little effect.  progress: called with the states and
    the segment's name, returns an iterable of the states.  Returns each state with the commanded
    bending (segments, 2), rad, without those that no tendons hold.  Raises ValueError for counts
    below 1.
    """
    for name, count in (('angles', angles), ('directions', directions)):
        if not whole(count) or count < 1:
            raise ValueError(f'{name} is {count!r}; a whole number, at least 1, is needed')
    arm = statics.chain.arm
    return set_each(statics, [bends(arm, s, 2 * angles + 1, directions)
                              for s in range(len(arm.segments))], order,
                    jamming=jamming, progress=progress)


def workspace(statics: Statics, angles: int = 2, directions: int = 6
              ) -> tuple[Array, Array]:
    """
    Return the tips and bendings of the shapes of set_on_grid, set base first.

    Returns tips (m, 3), m, and bending (m, segments, 2), rad.  A shape takes about 10 ms, or
    0.2 ms for a planar arm.
    """
    states = [state for state, _ in set_on_grid(statics, angles, directions)]
    return (np.array([state.poses[-1, :3] for state in states]).reshape(-1, 3),
            np.array([state.bending for state in states]).reshape(
                -1, len(statics.chain.arm.segments), 2))
