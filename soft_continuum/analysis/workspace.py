# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Workspace of the tip, and its dependence on gravity and on the order of the segments.

Not from the paper.  Each segment is bent in turn while the others are stiff.  Under gravity a
segment that is set with others already bent above it carries them at another lever arm, so the
order matters.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import prod

import numpy as np
import scipy

from soft_continuum.analysis.results import progress
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.grid import bends, set_each
from soft_continuum.mechanics.statics import Statics


@dataclass(frozen=True, eq=False)
class Reach:
    """
    Tips of one arm, set in one order.

    order: segments, 0-based.  tips: (m, axes), m, along the axes of the arm.  bending: (m,
    segments, 2) rad, about x and y, in the same rows.  asked: number of shapes tried, including
    those that no tendon holds.
    """

    order: tuple[int, ...]
    tips: Array
    bending: Array
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


def reach(arm: Arm, order: Sequence[int], per_segment: int, directions: int = 1,
          jamming: bool = True) -> Reach:
    """
    Return the tips for ``per_segment`` angles between the limits of every segment.

    A segment that bends in all directions has half as many in each of ``directions``, and
    straight.  Without ``jamming`` all segments are bent at once.  Tendon friction is neglected.
    """
    grid = bendings(arm, per_segment, directions)
    found = set_each(Statics(arm), grid, order, jamming=jamming,
                     progress=progress)
    axes = arm.pose_axes[:3]
    return Reach(tuple(order),
                 np.array([state.poses[-1, :3][axes] for state, _ in found]).reshape(
                     -1, axes.sum()),
                 np.array([bending for _, bending in found]).reshape(-1, len(grid), 2),
                 prod(map(len, grid)))


def bendings(arm: Arm, per_segment: int, directions: int) -> list[Array]:
    """Return the bendings (k, 2), rad, of each segment; all combinations are set."""
    return [bends(arm, s, per_segment, directions) for s in range(len(arm.segments))]


def furthest_apart(one: Reach, other: Reach) -> float:
    """Return the largest distance (m) of tips with the same bending; nan without any."""
    return max((float(np.linalg.norm(a - b)) for a, b in tips_in_common(one, other)),
               default=float('nan'))


def tips_in_common(one: Reach, other: Reach) -> list[tuple[Array, Array]]:
    """Return both tips (m) for all common bendings."""
    there = {row.tobytes(): tip for row, tip in zip(other.bending, other.tips, strict=True)}
    return [(tip, there[row.tobytes()]) for row, tip in zip(one.bending, one.tips, strict=True)
            if row.tobytes() in there]
