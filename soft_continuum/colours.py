# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Colours of the arm in all live views, red, green and blue from 0 to 255.

Each has one meaning.  Red means STOP and faults.
"""

from math import isnan

import numpy as np

Colour = tuple[int, int, int]

STIFF: Colour = (52, 73, 94)
SOFT: Colour = (243, 150, 40)
UNKNOWN: Colour = (170, 170, 170)
DISC: Colour = (206, 211, 217)
GHOST: Colour = (39, 174, 96)
GHOST_OPACITY = 0.3
MEASURED: Colour = (0, 150, 150)
"""Measured pose of a disc."""
MODEL: Colour = (235, 60, 200)
"""Modelled arm over a camera image."""
PREDICTED: Colour = (150, 92, 44)
"""Predicted arm beside the measured one."""
AXES: Colour = (20, 20, 20)
"""Axes at the base of a spatial arm."""
WRONG: Colour = (214, 40, 40)
"""Faults."""
OBSTACLE: Colour = (130, 130, 85)
"""Obstacles."""
OBSTACLE_OPACITY = 0.6
LOCKED: Colour = (142, 68, 173)
"""Tendon held by stiff segments, whose tension is undetermined."""
TENSIONS: tuple[Colour, ...] = ((130, 196, 240), (30, 120, 220), (10, 40, 150))
"""Tendon at no tension, at half the limit and at the limit: darker is tauter."""


def tension_colour(tension: float, limit: float) -> Colour:
    """Return the colour of a tendon by its tension: 0: slack, nan: unknown; limit: N."""
    if isnan(tension):
        return LOCKED
    position = min(1.0, tension / limit) * (len(TENSIONS) - 1)
    r, g, b = (int(np.interp(position, range(len(TENSIONS)), channel))
               for channel in zip(*TENSIONS, strict=True))
    return r, g, b


def segment_colour(stiff: bool | None) -> Colour:
    """Return the colour of a segment; None: unknown."""
    return UNKNOWN if stiff is None else STIFF if stiff else SOFT
