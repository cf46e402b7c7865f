# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Ends motions at excessive measured tensions."""

from collections.abc import Sequence
from math import isfinite

from soft_continuum.hardware.protocols import TendonReading
from soft_continuum.mechanics.arm import Array

SPARE = 0.02  # of the limit, for the noise of a load cell
SMALLEST_PULL = 1e-6  # m: less is no pulling in
MOST_NEGATIVE = 0.1  # of the limit: a tendon pushes less than the zero of a cell is off


class TensionGuard:
    """
    Refuses and ends motions that pull a tendon beyond the limit, where tension is measured.

    A tendon beyond the limit may only be paid out.
    """

    def __init__(self, tendons: Sequence[str]) -> None:
        """tendons: their names."""
        self._tendons = tendons
        self._lowest: tuple[float, ...] = ()  # N, of each since the motion began

    def refusal(self, reading: TendonReading, pulls: Array, limit: float) -> str:
        """Return why a motion through pulls (k, tendons) m must not begin; limit: N."""
        for t, tension in enumerate(reading.tensions or ()):
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
            if tension > max(limit, lowest[t]) + SPARE * limit:
                return f'{self._beyond(t, tension, limit)}; check what blocks it, and pay it out'
        return ''

    def unmeasured(self, reading: TendonReading, limit: float) -> str:
        """Return which load cell is stale or implausible, empty for none; limit: N."""
        for name, tension in zip(self._tendons, reading.tensions or (), strict=False):
            if not isfinite(tension):
                return (f'the tension of {name} is not measured: its load cell is stale or '
                        'reports no number; check it, or disable it (load_cells.enabled: false, '
                        'or another driver)')
            if tension < -MOST_NEGATIVE * limit:
                return (f'the load cell of {name} shows {tension:.1f} N, but a tendon cannot '
                        'push; check its sign, its scale and its zero')
        return ''

    def _beyond(self, tendon: int, tension: float, limit: float) -> str:
        return (f'the measured tension of {self._tendons[tendon]} is {tension:.1f} N; '
                f'tension_limit: {limit:g} N')
