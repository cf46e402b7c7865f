# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The measured tensions of a motion: what ends it."""

from collections.abc import Sequence
from math import isfinite

from soft_continuum.hardware.protocols import TendonReading

SPARE = 0.02  # of the limit, for the noise of a load cell


class TensionGuard:
    """
    Ends motions that pull a tendon beyond the limit, where a driver measures tension.

    A motion may begin beyond it, as one that lets a tendon go; then it must not pull any more.
    """

    def __init__(self, tendons: Sequence[str]) -> None:
        """tendons: their names."""
        self._tendons = tendons
        self._begin: tuple[float, ...] = ()

    def begin(self, reading: TendonReading) -> None:
        """Note the tensions with which a motion begins."""
        self._begin = reading.tensions or ()

    def problem(self, reading: TendonReading, limit: float) -> str:
        """Return why a motion must end, empty for nothing; limit: N."""
        if reading.tensions is None:
            return ''
        began = self._begin or (0.0,) * len(reading.tensions)
        for name, tension, first in zip(self._tendons, reading.tensions, began, strict=True):
            if not isfinite(tension):
                return (f'the measured tension of {name} is not a number; check its load cell, '
                        'or use a driver without')
            if tension > max((1.0 + SPARE) * limit, first):
                return (f'the measured tension of {name} is {tension:.1f} N; tension_limit: '
                        f'{limit:g} N; see what holds it, and pay it out')
        return ''
