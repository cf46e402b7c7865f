# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Stiff or soft: what the pressures say of every segment, and when the pump runs."""

from dataclasses import dataclass
from math import isfinite

from soft_continuum.hardware.protocols import HardwareError, JammingDriver, JammingReading


@dataclass(frozen=True)
class JammingSettings:
    """
    Thresholds, all as vacuum below ambient in Pa; ambient_pressure is absolute.

    A segment becomes stiff at ``stiff_vacuum`` and stops being stiff below ``release_vacuum``.
    The pump starts when an evacuated segment is below ``pump_start_vacuum`` and rests when all
    are above ``pump_stop_vacuum``.
    """

    ambient_pressure: float = 101325.0
    stiff_vacuum: float = 50e3
    release_vacuum: float = 40e3
    pump_start_vacuum: float = 60e3
    pump_stop_vacuum: float = 80e3

    def __post_init__(self) -> None:
        """Refuse thresholds in the wrong order."""
        order = ('release_vacuum', 'stiff_vacuum', 'pump_start_vacuum', 'pump_stop_vacuum')
        for low, high in zip(order, order[1:], strict=False):
            if not getattr(self, low) < getattr(self, high):
                raise ValueError(
                    f'parameter {low} ({getattr(self, low):g} Pa) must be below {high} '
                    f'({getattr(self, high):g} Pa)')


class JammingController:
    """Switches segments and knows from the pressure which of them are stiff."""

    def __init__(self, driver: JammingDriver, segments: int, settings: JammingSettings) -> None:
        """Use an opened ``driver``."""
        self._driver = driver
        self._settings = settings
        self._reading: JammingReading | None = None
        self.stiff = [False] * segments

    @property
    def reading(self) -> JammingReading:
        """The last reading; raises HardwareError before the first."""
        if self._reading is None:
            raise HardwareError('pressures have not been read yet')
        return self._reading

    def update(self) -> JammingReading:
        """Read the pressures, decide which segments are stiff, switch the pump if needed."""
        reading = self._driver.read()
        self._reading = reading
        vacuum = [self._settings.ambient_pressure - p for p in reading.pressures]
        for i, value in enumerate(vacuum):
            threshold = (self._settings.release_vacuum if self.stiff[i]
                         else self._settings.stiff_vacuum)
            # A segment that is being vented may already move: it is not stiff any more.
            self.stiff[i] = reading.evacuated[i] and isfinite(value) and value >= threshold
        evacuated = [v for v, open_ in zip(vacuum, reading.evacuated, strict=True) if open_]
        if any(not v >= self._settings.pump_start_vacuum for v in evacuated):
            if not reading.pump:
                self._driver.set_pump(True)
        elif reading.pump and all(v >= self._settings.pump_stop_vacuum for v in evacuated):
            self._driver.set_pump(False)
        return reading

    def set_stiff(self, segment: int, stiff: bool) -> None:
        """Evacuate or vent a segment (0-based); ``stiff`` follows when the pressure says so."""
        self._driver.set_evacuated(segment, stiff)
        if not stiff:
            self.stiff[segment] = False
