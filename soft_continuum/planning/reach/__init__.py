# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Plans by tip: the sequence of softened segments and angles that brings the tip to its goal.

``reach`` plans to one goal of the tip, ``follow`` a path through several, both among obstacles.
"""

from soft_continuum.planning.reach.following import follow
from soft_continuum.planning.reach.passage import MotionValidator
from soft_continuum.planning.reach.search import reach
from soft_continuum.planning.settings import ReachSettings

__all__ = ['MotionValidator', 'ReachSettings', 'follow', 'reach']
