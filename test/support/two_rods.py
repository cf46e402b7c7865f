# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An arm of two rods with three tendons each, upright."""

from soft_continuum.mechanics.arm import Disc
from soft_continuum.mechanics.spatial import SpatialArm, SpatialSegment, SpatialTendon

RODS = (SpatialSegment(0.08, 0.003, 0.003, 0.002, 0.01, bending_angle_limit=1.2),) * 2
TENDONS = tuple(SpatialTendon(f'{end}_{i}', 2.094395 * i + 0.5 * end, 0.01, end, compliance=1e-4)
                for end in (1, 2) for i in range(3))
ARM = SpatialArm(RODS, (Disc(0.005, 0.01),) * 3, TENDONS, 4, 3)
