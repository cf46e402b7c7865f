# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An arm of two rods with three tendons each, upright."""

from soft_continuum.mechanics.arm import Arm, Disc, Segment, Tendon

RODS = (Segment(0.08, 0.003, 0.003, 0.002, 0.01, bending_angle_limit=1.2),) * 2
TENDONS = tuple(Tendon(f'{end}_{i}', 2.094395 * i + 0.5 * end, 0.01, end)
                for end in (1, 2) for i in range(3))
ARM = Arm(RODS, (Disc(0.005, 0.01),) * 3, TENDONS, 4, 3).with_compliant_tendons(1e-4)
