# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Stiff or soft: the state of every segment by its pressure, and when the pump runs."""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from time import monotonic

from soft_continuum.hardware.protocols import HardwareError, JammingDriver, JammingReading

RESPONSE_TIME = 10.0
"""s after which the pressure of a segment must have followed its valve."""
FOLLOW_TIME, FOLLOW_DROP = 0.3, 5e3
"""s after venting, and Pa that must be lost by then, for a sensor to be believed in between."""


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


class PressureWatch:
    """Detects the segments whose pressure does not follow their valve."""

    def __init__(self, segments: int, settings: JammingSettings) -> None:
        """Watch from the first reading on."""
        self._settings = settings
        self._driven: list[tuple[bool, bool] | None] = [None] * segments
        self._since = [0.0] * segments
        self._vacuum = [0.0] * segments  # when the valve was switched, Pa
        self._distrusted = [False] * segments

    def faults(self, reading: JammingReading, now: float) -> tuple[str, ...]:
        """Return what is wrong with each segment, empty for nothing; now: s, never set back."""
        return tuple(self._fault(i, reading, now) for i in range(len(self._driven)))

    def _fault(self, i: int, reading: JammingReading, now: float) -> str:
        evacuated = reading.evacuated[i]
        driven, before = (evacuated, evacuated and reading.pump), self._driven[i]
        vacuum = self._settings.ambient_pressure - reading.pressures[i]
        vented = now - self._since[i]
        if (before == (False, False) and evacuated and vented >= FOLLOW_TIME
                and vacuum > max(self._vacuum[i] - FOLLOW_DROP, self._settings.release_vacuum)):
            self._distrusted[i] = True  # it did not notice the venting that ends now
        if driven != before:
            self._driven[i], self._since[i] = driven, now
            if before is None or before[0] != evacuated:
                self._vacuum[i] = vacuum
        overdue = now - self._since[i] >= RESPONSE_TIME
        name, kilopascals = f'segment {i + 1}', f'{vacuum / 1e3:.1f} kPa of vacuum'
        if not isfinite(vacuum):
            return f'{name}: no pressure; check the wire and the supply of its pressure sensor'
        # A sensor that did not notice the venting is believed again when it shows it.
        if vacuum < self._settings.release_vacuum:
            self._distrusted[i] = False
        elif overdue and not evacuated:
            self._distrusted[i] = True
        if self._distrusted[i]:
            return (f'{name}: has {kilopascals} though it was vented; its pressure sensor or its '
                    'valve is stuck, or its vent is blocked. Vent it until the pressure shows it')
        if overdue and driven == (True, True) and vacuum < self._settings.stiff_vacuum:
            return (f'{name}: has only {kilopascals} after {RESPONSE_TIME:g} s with the pump '
                    'running; it leaks, its valve or its pressure sensor is stuck, or the pump '
                    'is too weak')
        return ''


class JammingController:
    """
    Switches segments and knows from the pressure which of them are stiff.

    stiff: per segment; False also when that is not known.  faults: per segment, what is wrong
    with its pressure, empty for nothing.
    """

    def __init__(self, driver: JammingDriver, segments: int, settings: JammingSettings,
                 clock: Callable[[], float] = monotonic) -> None:
        """Use an opened ``driver``; clock: s, never set back."""
        self._driver = driver
        self._settings = settings
        self._clock = clock
        self._watch = PressureWatch(segments, settings)
        self._reading: JammingReading | None = None
        self.stiff = [False] * segments
        self.faults = ('',) * segments

    @property
    def reading(self) -> JammingReading:
        """The last reading; raises HardwareError before the first."""
        if self._reading is None:
            raise HardwareError('pressures have not been read yet')
        return self._reading

    def update(self) -> JammingReading:
        """
        Read the pressures, decide which segments are stiff, switch the pump if needed.

        Raises HardwareError when the driver does; then no segment counts as stiff, because a
        valve that lost its power may vent it unseen.
        """
        try:
            reading = self._driver.read()
        except HardwareError:
            self.stiff = [False] * len(self.stiff)
            raise
        self._reading = reading
        self.faults = self._watch.faults(reading, self._clock())
        vacuum = [self._settings.ambient_pressure - p for p in reading.pressures]
        for i, value in enumerate(vacuum):
            threshold = (self._settings.release_vacuum if self.stiff[i]
                         else self._settings.stiff_vacuum)
            # A segment that is being vented may already move: it is not stiff any more.
            self.stiff[i] = (reading.evacuated[i] and not self.faults[i] and isfinite(value)
                             and value >= threshold)
        evacuated = [v for v, open_ in zip(vacuum, reading.evacuated, strict=True) if open_]
        if any(not v >= self._settings.pump_start_vacuum for v in evacuated):
            if not reading.pump:
                self._driver.set_pump(True)
        elif reading.pump and all(v >= self._settings.pump_stop_vacuum for v in evacuated):
            self._driver.set_pump(False)
        return reading

    def set_stiff(self, segment: int, stiff: bool) -> None:
        """Evacuate or vent a segment (0-based); ``stiff`` follows with the pressure."""
        if not stiff:  # at once, as a command that fails may have been carried out
            self.stiff[segment] = False
        self._driver.set_evacuated(segment, stiff)
