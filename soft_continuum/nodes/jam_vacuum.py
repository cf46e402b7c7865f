# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The part of the full vacuum of each jam, from its pressure."""

from collections.abc import Mapping, Sequence
from math import isfinite, nan
from typing import Any

MIN_PART = 0.01  # of a jam that the model has


class JamVacuum:
    """Follows the pressures of the segments whose jams are not rigid; others count as full."""

    def __init__(self, elastic: Sequence[bool], parameters: Mapping[str, Any]) -> None:
        """Begin with the full vacuum; parameters: those of kinematics."""
        self._elastic, self._parameters = elastic, parameters
        self._parts = [1.0] * len(elastic)

    def follow(self, segment: int, pressure: float, setpoints: Sequence[float]) -> None:
        """
        Take the pressure (absolute, Pa) of a segment (0-based).

        setpoints: of regulators, Pa below ambient; of valves empty.  After arrival the set-point
        counts, not the pressure: otherwise sensor noise would weaken and strengthen the jam, and
        the arm would creep in the model.
        """
        vacuum = self._parameters['ambient_pressure'] - pressure
        if not isfinite(vacuum) or not self._elastic[segment]:
            return
        wanted = setpoints[segment] if setpoints else nan
        followed = abs(vacuum - wanted) <= self._parameters['vacuum_tolerance']
        full = self._parameters['full_vacuum']
        part = wanted / full if followed else round(vacuum / full, 2)
        self._parts[segment] = min(1.0, max(MIN_PART, part))

    @property
    def parts(self) -> tuple[float, ...] | None:
        """Parts of the full vacuum, per segment; None if every jam is rigid."""
        return tuple(self._parts) if any(self._elastic) else None
