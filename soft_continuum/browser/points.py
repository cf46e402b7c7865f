# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Points along the backbone of a shape, drawn with constant curvature."""

from collections.abc import Sequence

import numpy as np

from soft_continuum.mechanics.chain import Chain
from soft_continuum.mechanics.directions import bending_vectors

Points = tuple[tuple[float, ...], ...]
"""x, y, z of some points, m."""


def points_of(chain: Chain, angles: Sequence[float], directions: Sequence[float] = ()
              ) -> Points:
    """Return points of a shape with bending angles and directions, rad; none for 0."""
    shape = chain.uniform(bending_vectors(chain.arm, angles, directions))
    return tuple(tuple(point) for point in np.vstack([np.zeros(3), shape.backbone]).tolist())
