# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The colours of the arm in every live view, red, green and blue from 0 to 255.

Each has one meaning.  Red is STOP, and what is wrong.
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
"""Of where a sensor sees a disc."""
MODEL: Colour = (235, 60, 200)
"""Of the arm as the model has it, over a picture of it."""
PREDICTED: Colour = (150, 92, 44)
"""Of the arm as the model alone has it, beside the one that is measured."""
AXES: Colour = (20, 20, 20)
"""Of the axes at the base of an arm in space."""
WRONG: Colour = (214, 40, 40)
"""Of what is wrong."""
OBSTACLE: Colour = (130, 130, 85)
"""Of what the arm must not touch."""
OBSTACLE_OPACITY = 0.6
LOCKED: Colour = (142, 68, 173)
"""Of a tendon that stiff segments hold: nothing determines its tension."""
TENSIONS: tuple[Colour, ...] = ((130, 196, 240), (30, 120, 220), (10, 40, 150))
"""Of a tendon at no tension, at half the limit and at the limit: the darker, the tauter."""


def tension_colour(tension: float, limit: float) -> Colour:
    """Return the colour of a tendon by its tension: 0: slack, nan: not known; limit: N."""
    if isnan(tension):
        return LOCKED
    position = min(1.0, tension / limit) * (len(TENSIONS) - 1)
    r, g, b = (int(np.interp(position, range(len(TENSIONS)), channel))
               for channel in zip(*TENSIONS, strict=True))
    return r, g, b


def segment_colour(stiff: bool | None) -> Colour:
    """Return the colour of a segment; None: not known."""
    return UNKNOWN if stiff is None else STIFF if stiff else SOFT
