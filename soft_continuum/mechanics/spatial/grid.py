# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes of a spatial arm on a grid of bendings: what its tip reaches."""

from collections.abc import Callable, Iterable, Sequence
from typing import TypeAlias

import numpy as np

from soft_continuum.mechanics._checks import segment_order, whole
from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.mechanics.spatial.chain import SpatialEquilibrium
from soft_continuum.mechanics.spatial.inverse import pulls_for_bending, SAME_BENDING, set_shape
from soft_continuum.mechanics.spatial.statics import SpatialStatics

Bent: TypeAlias = tuple[SpatialEquilibrium, Array]


def set_on_grid(
        statics: SpatialStatics, angles: int = 2, directions: int = 6,
        order: Sequence[int] | None = None, *, jamming: bool = True,
        progress: Callable[[Sequence[Bent], str], Iterable[Bent]] = lambda states, _: states
        ) -> list[Bent]:
    """
    Return the arm with every segment straight or bent, evenly up to its limit, in each direction.

    angles, directions: how many of both, so (1 + angles * directions) ** segments shapes.  order:
    in which segments are set (default: base first).  jamming: whether all others are stiff then;
    without it all are soft, those not set yet are held straight, and the order changes little.
    progress: from the states to begin at and what is set to an iterable of them that shows how
    far it is.  Returns each state with the bending (segments, 2) rad that was set, without those
    that no tendons hold.  Raises ValueError for counts below 1.
    """
    for name, count in (('angles', angles), ('directions', directions)):
        if not whole(count) or count < 1:
            raise ValueError(f'{name} is {count!r}; a whole number, at least 1, is needed')
    arm, free = statics.chain.arm, statics.chain.arm.bending_axes
    states: list[Bent] = [(statics.chain.straight(), np.zeros((len(arm.segments), 2)))]
    for s in segment_order(order, len(arm.segments)):
        sizes = arm.segments[s].bending_angle_limit * np.linspace(0.0, 1.0, angles + 1)[1:]
        ways = 2.0 * np.pi * np.arange(directions) / directions
        bends = [np.zeros(2), *(size * np.array([-np.sin(way), np.cos(way)])
                                for size in sizes for way in ways)]
        after = []
        for state, before in progress(states, f'segment {s + 1}'):
            for bend in bends:
                if np.any(np.abs(bend[~free[s]]) > SAME_BENDING):
                    continue  # a hinge about the other axis
                bending = before.copy()
                bending[s] = np.where(free[s], bend, 0.0)
                try:
                    after.append((_bent(statics, state, bending, s, jamming), bending))
                except StaticsError:
                    continue
        states = after
    return states


def _bent(statics: SpatialStatics, state: SpatialEquilibrium, bending: Array, segment: int,
          jamming: bool) -> SpatialEquilibrium:
    if jamming:
        return set_shape(statics, bending, state, (segment,))
    if np.abs(state.bending - bending).max() <= SAME_BENDING:
        return state
    return pulls_for_bending(statics, state, bending, [True] * statics.chain.segments).state


def workspace(statics: SpatialStatics, angles: int = 2, directions: int = 6
              ) -> tuple[Array, Array]:
    """
    Return tips that the arm reaches when it is set base first, and their bending.

    Of the shapes of set_on_grid: tips (m, 3), m, and bending (m, segments, 2), rad.  Each takes
    some 10 ms.
    """
    states = [state for state, _ in set_on_grid(statics, angles, directions)]
    return (np.array([state.tip for state in states]).reshape(-1, 3),
            np.array([state.bending for state in states]).reshape(
                -1, len(statics.chain.arm.segments), 2))
