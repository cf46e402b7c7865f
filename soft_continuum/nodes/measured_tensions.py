# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Measured tensions of the tendons as they arrive, and those of them that the estimate uses."""

from collections.abc import Mapping, Sequence
from math import inf, isfinite
from typing import Any

from soft_continuum.estimation.measuring import TensionMeasurement

PERIOD = 0.1
"""s between two that are used: each costs as much as a pose, and says less of a resting arm."""


class MeasuredTensions:
    """Takes effort of tendon_states, which is there only where something measures it."""

    def __init__(self, tendons: Sequence[str], parameters: Mapping[str, Any]) -> None:
        """tendons: their names.  parameters: of kinematics, with the accuracy of the cells."""
        self._tendons = tendons
        self._deviation: float = parameters['estimation.tension_deviation']
        self._relative: float = parameters['estimation.tension_relative_deviation']
        self._waiting: tuple[float, list[TensionMeasurement]] | None = None
        self._taken = -inf

    def put(self, time: float, tensions: Mapping[str, float]) -> None:
        """Keep tensions (N, by tendon) that were measured at ``time`` (s), if it is time to."""
        if abs(time - self._taken) < PERIOD:
            return
        found = [TensionMeasurement(t, tensions[name], self._deviation, self._relative)
                 for t, name in enumerate(self._tendons) if isfinite(tensions.get(name, inf))]
        if found:
            self._waiting, self._taken = (time, found), time

    def take(self) -> list[tuple[float, list[TensionMeasurement]]]:
        """Return what has not been used: times in s, and the tensions then."""
        found = [] if self._waiting is None else [self._waiting]
        self._waiting = None
        return found
