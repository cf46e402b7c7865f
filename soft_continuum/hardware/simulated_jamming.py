# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated vacuum pump with one valve per segment, or one regulator; and pressure sensors."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import exp
from typing import Any, ClassVar

from soft_continuum.hardware.jamming_controller import JammingSettings
from soft_continuum.hardware.protocols import JammingReading
from soft_continuum.parameters.parameter import Parameter


@dataclass(frozen=True)
class JammingPlant:
    """
    Dynamics of the simulated segments (estimates, not measured on the paper's arm).

    ambient_pressure: Pa absolute.  ultimate_vacuum: Pa below it.  evacuation_time, venting_time:
    time constants, s.  valve_delay: s.  leak_rate: Pa/s while the pump rests.
    """

    ambient_pressure: float = JammingSettings.ambient_pressure
    ultimate_vacuum: float = 94e3
    evacuation_time: float = 0.4
    venting_time: float = 0.6
    valve_delay: float = 0.03
    leak_rate: float = 500.0

    def evacuated(self, vacuum: float, duration: float) -> float:
        """Return the vacuum (Pa) after ``duration`` s with the running pump."""
        short = (self.ultimate_vacuum - vacuum) * exp(-duration / self.evacuation_time)
        return self.ultimate_vacuum - short

    def vented(self, vacuum: float, duration: float) -> float:
        """Return the vacuum (Pa) after ``duration`` s with the atmosphere."""
        return vacuum * exp(-duration / self.venting_time)


class SimulatedJamming:
    """Simulated pump and valves; they start with every segment evacuated, or all soft."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        Parameter('simulated_jamming.ultimate_vacuum', JammingPlant.ultimate_vacuum,
                  'ultimate vacuum below ambient of the simulated pump', 1e3, 101e3, unit='Pa'),
        Parameter('simulated_jamming.evacuation_time', JammingPlant.evacuation_time,
                  'time constant of evacuating a simulated segment', 0.01, 100.0, unit='s'),
        Parameter('simulated_jamming.venting_time', JammingPlant.venting_time,
                  'time constant of venting a simulated segment', 0.01, 100.0, unit='s'),
        Parameter('simulated_jamming.valve_delay', JammingPlant.valve_delay,
                  'delay of a simulated valve', 0.0, 10.0, unit='s'),
        Parameter('simulated_jamming.leak_rate', JammingPlant.leak_rate,
                  'rate at which a simulated segment loses vacuum while the pump is off',
                  0.0, 1e5, unit='Pa/s'),
        Parameter('simulated_jamming.initially_stiff', True,
                  'the simulated rig starts with the pump on and all segments evacuated'),
        Parameter('simulated_jamming.regulators', False,
                  'the simulated rig has a vacuum regulator for each segment instead of valves'),
        Parameter('simulated_jamming.max_vacuum', 90e3,
                  'maximum set-point of a simulated regulator', 1e3, 101e3, unit='Pa'),
        Parameter('simulated_jamming.dead_band', 500.0,
                  'deviation from its set-point within which a simulated regulator is idle',
                  0.0, 1e4,
                  unit='Pa'),
    )

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]
                        ) -> 'SimulatedJamming | SimulatedRegulators':
        """Return what the parameters of the node describe."""
        plant = JammingPlant(values['ambient_pressure'], **{
            name: values[f'simulated_jamming.{name}'] for name in (
                'ultimate_vacuum', 'evacuation_time', 'venting_time', 'valve_delay', 'leak_rate')})
        segments, stiff = (len(values['arm.segment_lengths']),
                           values['simulated_jamming.initially_stiff'])
        if values['simulated_jamming.regulators']:
            return SimulatedRegulators(
                clock, segments, plant, stiff, values['simulated_jamming.max_vacuum'],
                values['simulated_jamming.dead_band'])
        return cls(clock, segments, plant, stiff)

    def __init__(self, clock: Callable[[], float], segments: int, plant: JammingPlant,
                 initially_stiff: bool) -> None:
        """Take the time (s) from ``clock``."""
        self._clock = clock
        self._plant = plant
        self._time = clock()
        self._vacuum = [plant.ultimate_vacuum if initially_stiff else 0.0] * segments
        self._evacuated = [initially_stiff] * segments  # as switched
        self._position = [initially_stiff] * segments  # as the valve stands
        self._moves_at = [self._time] * segments
        self._pump = initially_stiff

    def open(self) -> None:
        """Connect."""

    def close(self) -> None:
        """Disconnect; everything stays as it is."""

    def read(self) -> JammingReading:
        """Return the present state."""
        self._advance()
        return JammingReading(
            tuple(self._plant.ambient_pressure - v for v in self._vacuum),
            tuple(self._evacuated), self._pump)

    def set_evacuated(self, segment: int, evacuated: bool) -> None:
        """Switch one valve; the segment follows after the valve's delay."""
        self._advance()
        if self._evacuated[segment] != evacuated:
            self._evacuated[segment] = evacuated
            self._moves_at[segment] = self._time + self._plant.valve_delay

    def set_pump(self, running: bool) -> None:
        """Switch the pump."""
        self._advance()
        self._pump = running

    def _advance(self) -> None:
        now = self._clock()
        for i in range(len(self._vacuum)):
            since = self._time
            if self._position[i] != self._evacuated[i] and self._moves_at[i] <= now:
                until = max(since, self._moves_at[i])
                self._vacuum[i] = self._after(self._vacuum[i], until - since, self._position[i])
                self._position[i], since = self._evacuated[i], until
            self._vacuum[i] = self._after(self._vacuum[i], now - since, self._position[i])
        self._time = now

    def _after(self, vacuum: float, duration: float, open_to_pump: bool) -> float:
        """Return the vacuum (Pa) after ``duration`` s with the valve in one position."""
        plant = self._plant
        if not open_to_pump:
            return plant.vented(vacuum, duration)
        if self._pump:
            return plant.evacuated(vacuum, duration)
        return max(0.0, vacuum - plant.leak_rate * duration)


class SimulatedRegulators:
    """
    Simulated vacuum regulators; they start at their largest set-point, or with all segments soft.

    A regulator evacuates or vents its segment as a pump and a valve do, until it is within
    ``dead_band`` (Pa) of its set-point, and holds it there; at the set-point 0 it vents for good.
    """

    def __init__(self, clock: Callable[[], float], segments: int, plant: JammingPlant,
                 initially_stiff: bool, max_vacuum: float, dead_band: float) -> None:
        """Take the time (s) from ``clock``; max_vacuum: Pa."""
        self._clock, self._plant, self._dead_band = clock, plant, dead_band
        self._time = clock()
        self.max_vacuum = max_vacuum
        begin = max_vacuum if initially_stiff else 0.0
        self._set = [begin] * segments
        self._vacuum = [min(begin, plant.ultimate_vacuum)] * segments

    def open(self) -> None:
        """Connect."""

    def close(self) -> None:
        """Disconnect; everything stays as it is."""

    def read(self) -> JammingReading:
        """Return the present state."""
        self._advance()
        return JammingReading.of_regulators(
            tuple(self._plant.ambient_pressure - v for v in self._vacuum), tuple(self._set))

    def set_vacuum(self, segment: int, vacuum: float) -> None:
        """Set the vacuum of a segment (0-based), Pa; its pressure follows."""
        self._advance()
        self._set[segment] = vacuum

    def _advance(self) -> None:
        now = self._clock()
        duration, self._time = now - self._time, now
        for i, (vacuum, wanted) in enumerate(zip(self._vacuum, self._set, strict=True)):
            low, high = wanted - self._dead_band, wanted + self._dead_band if wanted else 0.0
            if vacuum < low:
                self._vacuum[i] = min(low, self._plant.evacuated(vacuum, duration))
            elif vacuum > high:
                self._vacuum[i] = max(high, self._plant.vented(vacuum, duration))
