# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What one solve is given in compiled form, what it ends in, and when that is near enough."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics import _newton
from soft_continuum.mechanics.chain import Array, LEFT, RIGHT

DIRECT_LIMIT = 2.0  # rad: a segment that turned further is followed in smaller steps
CAREFUL_LIMIT = 0.1  # rad: the same where loads can outweigh springs, so that paths may end
TAUT_LIMIT = 0.05  # rad: the same where both tendons are taut, so that the arm may buckle
NO_TENSION = 1e-7  # N: rounding of a tension of zero


@dataclass(frozen=True)
class Point:
    """
    A state on the way: absolute angles, tensions, and how the solve for it ended.

    turned: rad, all turning of the joints of a segment, the most of any: what folds up inside a
    segment may end as it began.
    """

    theta: Array
    tension: Array
    lengths: Array
    status: int = _newton.FAILED
    residual: float = np.inf
    iterations: int = 0
    turned: float = 0.0


@dataclass(frozen=True)
class Boundary:
    """What is free and what drives the tendons in one solve, in the compiled form."""

    group: NDArray[np.int64]
    groups: int
    direct_limit: float
    locked_angles: Array
    joints: Array
    ratios: Array
    compliance: Array
    mode: NDArray[np.int64]
    target: Array
    driven: NDArray[np.int64]
    stiff: tuple[bool, ...]
    vacuum: tuple[float, ...] = ()

    def near(self, end: Point) -> bool:
        """Return whether a solve found the equilibrium that the one before turns into."""
        taut = end.tension[RIGHT] > NO_TENSION and end.tension[LEFT] > NO_TENSION
        limit = TAUT_LIMIT if taut else self.direct_limit
        return end.status == _newton.CONVERGED and end.turned <= limit
