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
from scipy.spatial import ConvexHull

from soft_continuum.analysis.results import progress
from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.inverse import set_on_grid
from soft_continuum.mechanics.statics import Statics


@dataclass(frozen=True, eq=False)
class Reach:
    """
    Tips of one arm, set in one order.

    order: segments, 0-based.  tips: (m, 2), x and z in m.  angles: (m, segments) rad, in the same
    rows.  asked: how many shapes were tried; those that no tendon holds are left out.
    """

    order: tuple[int, ...]
    tips: Array
    angles: Array
    asked: int

    @property
    def area(self) -> float:
        """Area of the convex hull of the tips, m^2; 0 for fewer than three or on a line."""
        if len(self.tips) < 3 or np.linalg.matrix_rank(self.tips - self.tips[0], tol=1e-9) < 2:
            return 0.0
        return float(ConvexHull(self.tips).volume)  # in the plane its volume is its area


def reach(arm: Arm, order: Sequence[int], per_segment: int) -> Reach:
    """Return the tips for ``per_segment`` angles between the limits of every segment."""
    statics = Statics(arm)
    states = set_on_grid(statics, per_segment, order, progress)
    tips = [state.tip[:2] for state, _ in states]
    return Reach(tuple(order), np.array(tips).reshape(-1, 2),
                 np.array([angles for _, angles in states]).reshape(-1, len(arm.segments)),
                 per_segment**len(arm.segments))


def furthest_apart(one: Reach, other: Reach) -> float:
    """Return the largest distance (m) of tips with the same angles; nan if there are none."""
    return max((float(np.linalg.norm(a - b)) for a, b in tips_in_common(one, other)),
               default=float('nan'))


def tips_in_common(one: Reach, other: Reach) -> list[tuple[Array, Array]]:
    """Return the two tips (m) of all angles that both have."""
    there = {row.tobytes(): tip for row, tip in zip(other.angles, other.tips, strict=True)}
    return [(tip, there[row.tobytes()]) for row, tip in zip(one.angles, one.tips, strict=True)
            if row.tobytes() in there]
