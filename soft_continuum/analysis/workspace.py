# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Where the tip can go, and how that depends on gravity and on the order of the segments; ours.

Each segment is bent in turn while the others are stiff.  Under gravity a segment that is set with
others already bent above it carries them at another lever arm, so the order leaves its traces.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from soft_continuum.analysis.results import progress
from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.either import AnyArm
from soft_continuum.mechanics.inverse import set_on_grid
from soft_continuum.mechanics.spatial import SpatialArm, SpatialStatics
from soft_continuum.mechanics.spatial.grid import set_on_grid as set_on_grid_in_space
from soft_continuum.mechanics.statics import Statics


@dataclass(frozen=True, eq=False)
class Reach:
    """
    Tips of one arm, set in one order.

    order: segments, 0-based.  tips: (m, 2), x and z in m, or in space (m, 3).  angles: (m,
    segments) rad, or in space (m, 2 * segments) the bending about x and y, in the same rows.
    asked: how many shapes were tried; those that no tendon holds are left out.
    """

    order: tuple[int, ...]
    tips: Array
    angles: Array
    asked: int

    @property
    def hull(self) -> float:
        """Area (m^2) or volume (m^3) of the convex hull of the tips; 0 where they span none."""
        dimensions = self.tips.shape[1]
        if len(self.tips) <= dimensions or np.linalg.matrix_rank(
                self.tips - self.tips[0], tol=1e-9) < dimensions:
            return 0.0
        hull = scipy.spatial.ConvexHull(self.tips)
        return float(hull.volume)  # in the plane its volume is its area


def reach(arm: AnyArm, order: Sequence[int], per_segment: int, directions: int = 1,
          jamming: bool = True) -> Reach:
    """
    Return the tips for ``per_segment`` angles between the limits of every segment.

    In space there are half as many to each side, in so many ``directions``, and straight; without
    ``jamming`` all segments are bent at once.
    """
    if isinstance(arm, Arm):
        states = set_on_grid(Statics(arm), per_segment, order, progress)
        tips = [state.tip[:2] for state, _ in states]
        return Reach(tuple(order), np.array(tips).reshape(-1, 2),
                     np.array([angles for _, angles in states]).reshape(-1, len(arm.segments)),
                     shapes(arm, per_segment, directions))
    bent = set_on_grid_in_space(SpatialStatics(arm), per_segment // 2, directions, order,
                                jamming=jamming, progress=progress)
    return Reach(tuple(order), np.array([state.tip for state, _ in bent]).reshape(-1, 3),
                 np.array([bending for _, bending in bent]).reshape(-1, 2 * len(arm.segments)),
                 shapes(arm, per_segment, directions))


def bends(arm: AnyArm, per_segment: int, directions: int) -> int:
    """Return to how many angles, or bendings in space, each segment is set."""
    return 1 + per_segment // 2 * directions if isinstance(arm, SpatialArm) else per_segment


def shapes(arm: AnyArm, per_segment: int, directions: int) -> int:
    """Return how many shapes are tried."""
    return int(bends(arm, per_segment, directions)**len(arm.segments))


def furthest_apart(one: Reach, other: Reach) -> float:
    """Return the largest distance (m) of tips with the same angles; nan if there are none."""
    return max((float(np.linalg.norm(a - b)) for a, b in tips_in_common(one, other)),
               default=float('nan'))


def tips_in_common(one: Reach, other: Reach) -> list[tuple[Array, Array]]:
    """Return the two tips (m) of all angles that both have."""
    there = {row.tobytes(): tip for row, tip in zip(other.angles, other.tips, strict=True)}
    return [(tip, there[row.tobytes()]) for row, tip in zip(one.angles, one.tips, strict=True)
            if row.tobytes() in there]
