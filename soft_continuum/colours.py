# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The colours of the arm in every live view, red, green and blue from 0 to 255."""

from math import isnan

import numpy as np

Colour = tuple[int, int, int]

STIFF: Colour = (52, 73, 94)
SOFT: Colour = (243, 150, 40)
UNKNOWN: Colour = (170, 170, 170)
DISC: Colour = (206, 211, 217)
GHOST: Colour = (39, 174, 96)
GHOST_OPACITY = 0.3
SLACK: Colour = (150, 155, 160)
LOCKED: Colour = (90, 60, 130)
TENSIONS: tuple[Colour, ...] = ((41, 128, 215), (240, 196, 25), (214, 40, 40))
"""Of a taut tendon: at no tension, at half the limit and at the limit."""


def tension_colour(tension: float, limit: float) -> Colour:
    """Return the colour of a tendon by its tension: 0: slack, nan: not known; limit: N."""
    if isnan(tension):
        return LOCKED
    if tension == 0.0:
        return SLACK
    position = min(1.0, tension / limit) * (len(TENSIONS) - 1)
    r, g, b = (int(np.interp(position, range(len(TENSIONS)), channel))
               for channel in zip(*TENSIONS, strict=True))
    return r, g, b


def segment_colour(stiff: bool | None) -> Colour:
    """Return the colour of a segment; None: not known."""
    return UNKNOWN if stiff is None else STIFF if stiff else SOFT
