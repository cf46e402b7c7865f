# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated vacuum pump with one valve and one pressure sensor per segment."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import exp
from typing import Any, ClassVar, Self

from soft_continuum.hardware.protocols import JammingReading
from soft_continuum.parameters.parameter import Parameter


@dataclass(frozen=True)
class JammingPlant:
    """
    How the simulated segments lose and gain air (estimates, not measured on the paper's arm).

    ambient_pressure: Pa absolute.  ultimate_vacuum: Pa below it.  evacuation_time, venting_time:
    time constants, s.  valve_delay: s.  leak_rate: Pa/s while the pump rests.
    """

    ambient_pressure: float = 101325.0
    ultimate_vacuum: float = 94e3
    evacuation_time: float = 0.4
    venting_time: float = 0.6
    valve_delay: float = 0.03
    leak_rate: float = 500.0


class SimulatedJamming:
    """Simulated pump and valves; they start with every segment evacuated, or all soft."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        Parameter('simulated_jamming.ultimate_vacuum', 94e3,
                  'vacuum the simulated pump reaches below ambient', 1e3, 101e3, unit='Pa'),
        Parameter('simulated_jamming.evacuation_time', 0.4,
                  'time constant of evacuating a simulated segment', 0.01, 100.0, unit='s'),
        Parameter('simulated_jamming.venting_time', 0.6,
                  'time constant of venting a simulated segment', 0.01, 100.0, unit='s'),
        Parameter('simulated_jamming.valve_delay', 0.03, 'delay of a simulated valve',
                  0.0, 10.0, unit='s'),
        Parameter('simulated_jamming.leak_rate', 500.0,
                  'vacuum a simulated segment loses while the pump is off', 0.0, 1e5, unit='Pa/s'),
        Parameter('simulated_jamming.initially_stiff', True,
                  'the simulated rig starts with the pump on and all segments evacuated'),
    )

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]) -> Self:
        """Return what the parameters of the node describe."""
        plant = JammingPlant(values['ambient_pressure'], **{
            name: values[f'simulated_jamming.{name}'] for name in (
                'ultimate_vacuum', 'evacuation_time', 'venting_time', 'valve_delay', 'leak_rate')})
        return cls(clock, len(values['arm.segment_lengths']), plant,
                   values['simulated_jamming.initially_stiff'])

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
            return vacuum * exp(-duration / plant.venting_time)
        if self._pump:
            short = (plant.ultimate_vacuum - vacuum) * exp(-duration / plant.evacuation_time)
            return plant.ultimate_vacuum - short
        return max(0.0, vacuum - plant.leak_rate * duration)
