# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans that set shapes or bring the tip to its goal, among obstacles; without ROS."""

from typing import Literal

TipKind = Literal['position', 'direction', 'pose']
TIP_KINDS: tuple[TipKind, ...] = ('position', 'direction', 'pose')
"""Constrained parts of a tip goal; the values of kind in the message TipGoal, from 0."""
