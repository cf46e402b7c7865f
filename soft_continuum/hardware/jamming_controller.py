# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Stiffness of every segment, from its pressure, and control of the pump."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan
from time import monotonic

from soft_continuum.hardware.protocols import (
    HardwareError,
    JammingDriver,
    JammingReading,
    RegulatorDriver,
)
from soft_continuum.parameters.parameter import ParameterError

RESPONSE_TIME = 10.0
"""Time for the pressure of a segment to follow its valve or regulator, s."""
FOLLOW_TIME, FOLLOW_DROP = 0.3, 5e3
"""s of venting, at once or in parts, and Pa that a sensor must have lost by then."""
REFILL_TIME = 3.0
"""Pump time that restores the loss of a shorter venting, whatever the sensor shows, s."""


@dataclass(frozen=True)
class JammingSettings:
    """
    Thresholds, all as vacuum below ambient in Pa; ambient_pressure is absolute.

    A segment becomes stiff at ``stiff_vacuum`` and stops being stiff below ``release_vacuum``.
    The pump starts when an evacuated segment is below ``pump_start_vacuum`` and rests when all
    are above ``pump_stop_vacuum``.  With regulators a segment that is to be stiff gets
    ``full_vacuum``, and has followed its set-point when it is within ``vacuum_tolerance``.
    """

    ambient_pressure: float = 101325.0
    stiff_vacuum: float = 50e3
    release_vacuum: float = 40e3
    pump_start_vacuum: float = 60e3
    pump_stop_vacuum: float = 80e3
    full_vacuum: float = 80e3
    vacuum_tolerance: float = 3e3

    def __post_init__(self) -> None:
        """Refuse thresholds in the wrong order."""
        order = ('release_vacuum', 'stiff_vacuum', 'pump_start_vacuum', 'pump_stop_vacuum')
        for low, high in zip(order, order[1:], strict=False):
            if not getattr(self, low) < getattr(self, high):
                raise ParameterError(
                    f'parameter {low} ({getattr(self, low):g} Pa) must be below {high} '
                    f'({getattr(self, high):g} Pa)')

    def check_regulators(self, max_vacuum: float) -> None:
        """Raise HardwareError if regulators up to ``max_vacuum`` (Pa) cannot stiffen segments."""
        least = self.stiff_vacuum + self.vacuum_tolerance
        if not least <= self.full_vacuum <= max_vacuum:
            raise HardwareError(
                f'parameter full_vacuum is {self.full_vacuum:g} Pa, which regulators hold in a '
                f'stiff segment; it must be from {least:g} (stiff_vacuum and vacuum_tolerance) to '
                f'{max_vacuum:g} Pa (the largest set-point of the regulators)')


class PressureWatch:
    """
    Detects the segments whose pressure does not follow their valve or regulator.

    A set-point below ``release_vacuum`` counts as venting by a valve.
    """

    def __init__(self, segments: int, settings: JammingSettings) -> None:
        """Watch from the first reading on."""
        self._settings = settings
        self._driven: list[tuple[bool, bool] | None] = [None] * segments
        self._setpoints: list[float | None] = [None] * segments  # Pa, set-points
        self._since = [0.0] * segments
        self._read_at = 0.0
        self._vacuum = [nan] * segments  # Pa, as read last
        self._unnoticed: list[float | None] = [None] * segments
        """Pa shown when a venting began, until the sensor has shown less; None: it has."""
        self._vented = [0.0] * segments  # s since then, in which a reading showed it
        self._evacuated_at = [inf] * segments  # s, first time after the last reading
        self._pumped = [0.0] * segments  # s since it was vented last
        self._distrusted = [False] * segments

    def vent(self, i: int) -> None:
        """Note that a segment (0-based) is vented, however briefly: its sensor must confirm it."""
        if self._unnoticed[i] is None:
            self._unnoticed[i], self._vented[i] = self._vacuum[i], 0.0
        self._pumped[i] = 0.0

    def evacuate(self, i: int, now: float) -> None:
        """Note that a venting ends; now: s, never set back."""
        self._evacuated_at[i] = min(self._evacuated_at[i], now)

    def refilling(self, i: int) -> bool:
        """Whether a segment may have lost vacuum in a venting too short for its sensor."""
        return self._unnoticed[i] is not None

    def faults(self, reading: JammingReading, now: float) -> tuple[str, ...]:
        """Return what is wrong with each segment, empty for nothing; now: s, never set back."""
        faults = tuple(self._fault(i, reading, now) for i in range(len(self._driven)))
        self._read_at = now
        return faults

    def _follow(self, i: int, evacuated: bool, vacuum: float, elapsed: float) -> None:
        """Tell a sensor that shows its ventings from one that does not."""
        if self._driven[i] is None:  # at the start: a vented segment must show that, too
            self._vacuum[i] = vacuum
        open_, pump = self._driven[i] or (True, False)
        if not evacuated and open_:
            self.vent(i)  # as by a relay that fell off
        ended = self._evacuated_at[i] - self._read_at
        self._vented[i] += 0.0 if open_ else min(elapsed, ended)
        self._evacuated_at[i] = inf
        self._pumped[i] += elapsed if pump else 0.0
        shown = self._unnoticed[i]
        if shown is None or vacuum <= max(self._settings.release_vacuum, shown - FOLLOW_DROP):
            self._unnoticed[i] = None
        elif evacuated and self._vented[i] >= FOLLOW_TIME:
            self._distrusted[i], self._unnoticed[i] = True, None
        elif self._pumped[i] >= REFILL_TIME:
            self._unnoticed[i] = None

    def _fault(self, i: int, reading: JammingReading, now: float) -> str:
        evacuated = holds(reading, i, self._settings)
        vacuum = self._settings.ambient_pressure - reading.pressures[i]
        setpoint = reading.vacuums[i] if reading.vacuums else None
        self._follow(i, evacuated, vacuum, now - self._read_at)
        self._vacuum[i] = vacuum
        driven = evacuated, evacuated and (reading.pump or setpoint is not None)
        followed = (setpoint is not None
                    and abs(vacuum - setpoint) <= self._settings.vacuum_tolerance)
        if driven != self._driven[i] or setpoint != self._setpoints[i] or followed:
            self._driven[i], self._setpoints[i], self._since[i] = driven, setpoint, now
        overdue = now - self._since[i] >= RESPONSE_TIME
        name, kilopascals = f'segment {i + 1}', f'{vacuum / 1e3:.1f} kPa of vacuum'
        if not isfinite(vacuum):
            return f'{name}: no pressure; check the wire and the supply of its pressure sensor'
        # A sensor that missed the venting is trusted again once it shows it.
        if vacuum < self._settings.release_vacuum:
            self._distrusted[i] = False
        elif overdue and not evacuated:
            self._distrusted[i] = True
        if self._distrusted[i] and setpoint is None:
            return (f'{name}: has {kilopascals} after venting; its pressure sensor or its valve '
                    'is stuck, or its vent is blocked. Vent it until its pressure confirms it')
        if setpoint is not None:
            if overdue or self._distrusted[i]:
                return (f'{name}: has {kilopascals}, its regulator was set to '
                        f'{setpoint / 1e3:.1f} kPa; the regulator, its supply or the pressure '
                        'sensor fails, or the segment leaks. Set it to 0 until its pressure '
                        'confirms it')
        elif overdue and driven == (True, True) and vacuum < self._settings.stiff_vacuum:
            return (f'{name}: has only {kilopascals} after {RESPONSE_TIME:g} s with the pump '
                    'running; it leaks, its valve or its pressure sensor is stuck, or the pump '
                    'is too weak')
        return ''


def holds(reading: JammingReading, segment: int, settings: JammingSettings) -> bool:
    """Return whether the set-point of a segment (0-based) allows it to be stiff."""
    if reading.vacuums:
        return reading.vacuums[segment] >= settings.release_vacuum
    return reading.evacuated[segment]


class JammingController:
    """
    Switches segments and determines from the pressures which of them are stiff.

    stiff: per segment; False also when that is not known.  faults: per segment, the fault of its
    pressure, empty for none.
    """

    def __init__(self, driver: JammingDriver | RegulatorDriver, segments: int,
                 settings: JammingSettings, clock: Callable[[], float] = monotonic) -> None:
        """Use an opened ``driver``; clock: s, never set back."""
        self._driver = driver
        # To ask what a protocol is takes long, and this is asked in every cycle.
        self._valves = None if isinstance(driver, RegulatorDriver) else driver
        self._settings = settings
        self._clock = clock
        self._watch = PressureWatch(segments, settings)
        self._reading: JammingReading | None = None
        self.stiff = [False] * segments
        self.faults = ('',) * segments

    def close(self) -> None:
        """Disconnect; everything stays as it is."""
        self._driver.close()

    @property
    def reading(self) -> JammingReading:
        """The last reading; raises HardwareError before the first."""
        if self._reading is None:
            raise HardwareError('pressures have not been read yet')
        return self._reading

    def update(self) -> JammingReading:
        """
        Read the pressures, decide which segments are stiff, switch the pump of valves if needed.

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
            self.stiff[i] = (holds(reading, i, self._settings) and not self.faults[i]
                             and isfinite(value) and value >= threshold
                             and not self._watch.refilling(i))
        if self._valves is not None:
            self._switch_pump(self._valves, reading, vacuum)
        return reading

    def _switch_pump(self, driver: JammingDriver, reading: JammingReading,
                     vacuum: Sequence[float]) -> None:
        # What a segment that may have lost vacuum unseen is worth to the pump.
        evacuated = [0.0 if self._watch.refilling(i) else v for i, v in enumerate(vacuum)
                     if reading.evacuated[i]]
        if any(not v >= self._settings.pump_start_vacuum for v in evacuated):
            if not reading.pump:
                driver.set_pump(True)
        elif reading.pump and all(v >= self._settings.pump_stop_vacuum for v in evacuated):
            driver.set_pump(False)

    def set_stiff(self, segment: int, stiff: bool) -> None:
        """Evacuate or vent a segment (0-based); ``stiff`` follows with the pressure."""
        if isinstance(self._driver, RegulatorDriver):
            self.set_vacuum(segment, self._settings.full_vacuum if stiff else 0.0)
            return
        self._note(segment, stiff)
        self._driver.set_evacuated(segment, stiff)

    def set_vacuum(self, segment: int, vacuum: float) -> None:
        """
        Set the vacuum of a segment (0-based), Pa below ambient; its pressure follows.

        Raises ValueError for a vacuum beyond the regulator's range, and if the rig has valves.
        """
        if not isinstance(self._driver, RegulatorDriver):
            raise ValueError('the rig has valves, not regulators: switch the segment stiff or '
                             'soft (set_stiff)')
        if not 0.0 <= vacuum <= self._driver.max_vacuum:  # nan neither
            raise ValueError(f'vacuum refused: {vacuum:g} Pa; allowed: 0 to '
                             f'{self._driver.max_vacuum:g} Pa (the largest set-point of the '
                             'regulators)')
        self._note(segment, vacuum >= self._settings.release_vacuum)
        self._driver.set_vacuum(segment, vacuum)

    def _note(self, segment: int, holds_vacuum: bool) -> None:
        """Note a command; a segment that is vented is not stiff, even if the command fails."""
        if holds_vacuum:
            self._watch.evacuate(segment, self._clock())
        else:
            self.stiff[segment] = False
            self._watch.vent(segment)
