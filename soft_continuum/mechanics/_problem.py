# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""One solve in the form that the compiled solver takes, and the states on the way to its end."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from soft_continuum.mechanics import _newton
from soft_continuum.mechanics._active_set import NO_TENSION
from soft_continuum.mechanics._arrays import Drive, System
from soft_continuum.mechanics.chain import Array, LEFT, RIGHT

# How far a segment may turn in one solve, rad; beyond, the path is followed in smaller steps.
TURN_LIMIT = 2.0
TURN_LIMIT_NOT_CONVEX = 0.1  # where loads can outweigh springs, so that paths may end
TURN_LIMIT_BOTH_TAUT = 0.05  # where both tendons are taut, so that the arm may buckle


@dataclass(frozen=True)
class Point:
    """
    A state on the path, and how the solve for it ended.

    theta: (bodies,) rad, absolute angles.  tension: (2,) N.  lengths: (2,) m, as in State.
    turned: rad, the largest sum over the joints of one segment of how far they turned: what folds
    up inside a segment may end as it began.
    """

    theta: Array
    tension: Array
    lengths: Array
    status: int = _newton.FAILED
    residual: float = np.inf
    iterations: int = 0
    turned: float = 0.0


@dataclass(frozen=True)
class Problem:
    """
    What is free, what acts, and what drives the tendons in one solve.

    groups: number of rigid groups.  turn_limit: rad, of a segment in one solve.  locked_angles:
    (joints,) rad, kept by locked joints.  stiff, vacuum: as in Equilibrium.
    """

    system: System
    drive: Drive
    groups: int
    turn_limit: float
    locked_angles: Array
    stiff: tuple[bool, ...]
    vacuum: tuple[float, ...] = ()

    def with_joints(self, joints: Array) -> Self:
        """Return the problem with other springs and jams, as System.joints."""
        return replace(self, system=self.system._replace(joints=joints))

    def with_friction(self, ratios: Array, compliance: Array) -> Self:
        """Return the problem with ratios (2, segments) of tension and compliance (2,) m/N."""
        return replace(self, system=self.system._replace(ratios=ratios),
                       drive=self.drive._replace(compliance=compliance))

    def reached_by(self, end: Point) -> bool:
        """Return whether a solve found the equilibrium that continues the one it began at."""
        both_taut = end.tension[RIGHT] > NO_TENSION and end.tension[LEFT] > NO_TENSION
        limit = TURN_LIMIT_BOTH_TAUT if both_taut else self.turn_limit
        return end.status == _newton.CONVERGED and end.turned <= limit
