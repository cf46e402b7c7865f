# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The problem of one solve of a planar arm, and the states on its path."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from soft_continuum.mechanics._linear_algebra import NO_TENSION
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import LEFT, RIGHT
from soft_continuum.mechanics.plane import _newton
from soft_continuum.mechanics.plane._arrays import System, TendonDrive
from soft_continuum.mechanics.plane.chain import PlaneChain
from soft_continuum.mechanics.plane.joints import compliances, tension_ratios

# How far a segment may turn in one solve, rad; beyond, the path is followed in smaller steps.
TURN_LIMIT = 2.0
TURN_LIMIT_NOT_CONVEX = 0.1  # where loads can outweigh springs, so that paths may end
TURN_LIMIT_BOTH_TAUT = 0.05  # where both tendons are taut, so that the arm may buckle


class Point(NamedTuple):
    """
    A state on the path, and how the solve for it ended.

    theta: (bodies,) rad, absolute angles.  tension: (2,) N.  lengths: (2,) m, as in State.  slack:
    (2,) m, of the tendons at the start, inf where unknown.
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
    slack: Array | None = None


class Problem(NamedTuple):
    """
    Degrees of freedom, loads and driven tendons in one solve.

    groups: number of rigid groups.  turn_limit: rad, of a segment in one solve.  tolerance: (3,),
    as in _newton.newton.  locked_angles: (joints,) rad, kept by locked joints.  stiff, vacuum: as
    in Equilibrium.
    """

    system: System
    drive: TendonDrive
    groups: int
    turn_limit: float
    tolerance: Array
    locked_angles: Array
    stiff: tuple[bool, ...]
    vacuum: tuple[float, ...] = ()

    def with_friction(self, chain: PlaneChain, angles: Array, sliding: Sequence[int]) -> Self:
        """Return the problem with the tendons' friction and stretch at joint angles (joints,)."""
        return self._replace(
            system=self.system._replace(ratios=tension_ratios(chain, angles, sliding)),
            drive=self.drive._replace(compliance=compliances(chain, angles, sliding)))

    def reached_by(self, end: Point) -> bool:
        """Return whether a solve found the equilibrium that continues the one it began at."""
        return self.reached(end.status, end.turned, end.tension)

    def reached(self, status: int, turned: float, tension: Array) -> bool:
        """Return the same, of how a solve ended, how far segments turned, and tension (2,)."""
        if status != _newton.CONVERGED or turned > self.turn_limit:
            return False
        return (turned <= TURN_LIMIT_BOTH_TAUT or tension[RIGHT] <= NO_TENSION
                or tension[LEFT] <= NO_TENSION)
