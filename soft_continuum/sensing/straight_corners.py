# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a camera saw of the tags around the straight arm, as a parameter keeps it."""

from collections.abc import Mapping, Sequence

import numpy as np

from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.sensing.pictures import Array
from soft_continuum.sensing.tilt import SensorError

MAX_MOTION = 1.0  # px by which tags at rest may move
NUMBERS = 9  # of a tag that was seen: its own, and u and v of its corners

Corners = Mapping[int, Array]
"""Corners of each tag that is seen, by its number, (4, 2) px without distortion."""


def at_rest(seen: Sequence[Corners]) -> dict[int, Array]:
    """
    Return the mean corners of the tags that are in more than half of some pictures.

    Raises SensorError when they move.
    """
    found: dict[int, list[Array]] = {}
    for corners in seen:
        for n, places in corners.items():
            found.setdefault(n, []).append(places)
    often = {n: np.array(each) for n, each in found.items() if 2 * len(each) > len(seen)}
    for n, places in often.items():
        half = len(places) // 2
        motion = np.linalg.norm(places[half:].mean(axis=(0, 1)) - places[:half].mean(axis=(0, 1)))
        if motion > MAX_MOTION:
            raise SensorError(f'tag {n} moves, by {motion:.1f} px within half a second; wait '
                              'until the arm rests')
    return {n: places.mean(axis=0) for n, places in often.items()}


def as_numbers(corners: Corners) -> tuple[float, ...]:
    """Return corners as parameter tags.reference_corners has them."""
    return tuple(float(value) for n, places in sorted(corners.items())
                 for value in (n, *places.ravel()))


def from_numbers(numbers: Sequence[float]) -> dict[int, Array]:
    """Return the corners that parameter tags.reference_corners has; raises ParameterError."""
    if tuple(numbers) == (0.0,):
        return {}
    if len(numbers) % NUMBERS:
        raise ParameterError(f'parameter tags.reference_corners has {len(numbers)} numbers; '
                             'needed: the number and four corners (u, v) of each tag, as ~/tare '
                             'prints them, or 0.0 for none')
    return {int(row[0]): row[1:].reshape(4, 2) for row in np.reshape(numbers, (-1, NUMBERS))}
