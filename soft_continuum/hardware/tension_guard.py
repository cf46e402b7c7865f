# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The measured tensions of a motion: what ends it."""

from collections.abc import Sequence
from math import isfinite

from soft_continuum.hardware.protocols import TendonReading
from soft_continuum.mechanics.chain import Array

SPARE = 0.02  # of the limit, for the noise of a load cell
SMALLEST_PULL = 1e-6  # m: less is no pulling in


class TensionGuard:
    """
    Refuses and ends motions that pull a tendon beyond the limit, where a driver measures tension.

    What is beyond it already may only be let go.
    """

    def __init__(self, tendons: Sequence[str]) -> None:
        """tendons: their names."""
        self._tendons = tendons
        self._lowest: tuple[float, ...] = ()  # N, of each since the motion began

    def refusal(self, reading: TendonReading, pulls: Array, limit: float) -> str:
        """Return why a motion through pulls (k, tendons) m must not begin; limit: N."""
        for t, tension in enumerate(reading.tensions or ()):
            if problem := self._not_a_number(t, tension):
                return problem
            if tension > (1.0 + SPARE) * limit and (
                    pulls[:, t].max() > reading.pulls[t] + SMALLEST_PULL):
                return f'{self._beyond(t, tension, limit)}; only pay it out'
        return ''

    def begin(self, reading: TendonReading) -> None:
        """Note the tensions with which a motion begins."""
        self._lowest = reading.tensions or ()

    def problem(self, reading: TendonReading, limit: float) -> str:
        """Return why a motion must end, empty for nothing; limit: N."""
        if reading.tensions is None:
            return ''
        lowest = self._lowest or (0.0,) * len(reading.tensions)
        self._lowest = tuple(map(min, reading.tensions, lowest))
        for t, tension in enumerate(reading.tensions):
            if problem := self._not_a_number(t, tension):
                return problem
            if tension > max(limit, lowest[t]) + SPARE * limit:
                return f'{self._beyond(t, tension, limit)}; see what holds it, and pay it out'
        return ''

    def _not_a_number(self, tendon: int, tension: float) -> str:
        return '' if isfinite(tension) else (
            f'the measured tension of {self._tendons[tendon]} is not a number; check its load '
            'cell, or use a driver without')

    def _beyond(self, tendon: int, tension: float, limit: float) -> str:
        return (f'the measured tension of {self._tendons[tendon]} is {tension:.1f} N; '
                f'tension_limit: {limit:g} N')
