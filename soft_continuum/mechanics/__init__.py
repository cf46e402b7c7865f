# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Mechanics of a planar tendon-driven continuum arm with segments that jamming locks."""

from soft_continuum.mechanics.arm import Arm, ArmError, Disc, Segment
from soft_continuum.mechanics.chain import Equilibrium, LEFT, RIGHT, RigidChain
from soft_continuum.mechanics.statics import OverconstrainedError, SLACK, Statics, StaticsError

__all__ = [
    'LEFT',
    'RIGHT',
    'SLACK',
    'Arm',
    'ArmError',
    'Disc',
    'Equilibrium',
    'OverconstrainedError',
    'RigidChain',
    'Segment',
    'Statics',
    'StaticsError',
]
