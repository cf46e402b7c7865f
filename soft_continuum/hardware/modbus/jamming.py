# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Pump and valves on a Modbus RTU relay board, pressure transmitters (4-20 mA) on an analog board.

With ``modbus.regulators`` there are regulators in their place: regulators.py.

The boards have no watchdog and no fail-safe: they keep their relays as they are when this program
or the line fails.  What the segments do when the boards lose power depends on the plumbing, that
is on ``modbus.energised_valve_evacuates``: true: without power all segments vent and the arm
becomes soft; false: without power they stay connected to the (resting) pump and hold their vacuum
as long as nothing leaks.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from soft_continuum.hardware.modbus import PARAMETERS
from soft_continuum.hardware.modbus.bus import ModbusBus
from soft_continuum.hardware.modbus.regulators import ModbusRegulators
from soft_continuum.hardware.modbus.transmitters import (
    addresses,
    bus_from_parameters,
    check_span,
    span,
    Transmitters,
)
from soft_continuum.hardware.protocols import HardwareError, JammingReading
from soft_continuum.parameters.parameter import Parameter, ParameterError

COILS_INTERVAL = 0.2
"""Period of relay readings, s: relays only change by a command or a reset of the board."""
MAX_COILS = 2000
"""Largest count of one reply."""


@dataclass(frozen=True)
class RegisterMap:
    """
    Where pump, valves and transmitters are; one coil and one register per segment.

    relay_unit: unit number, which may be that of the transmitters.  energised_valve_evacuates:
    what a coil that is on does.
    """

    relay_unit: int
    pump_coil: int
    valve_coils: tuple[int, ...]
    energised_valve_evacuates: bool
    transmitters: Transmitters

    @property
    def coils(self) -> range:
        """All coils that one request must read."""
        return span((self.pump_coil, *self.valve_coils))


class ModbusJamming:
    """
    A JammingDriver over Modbus RTU.

    A call makes one to four requests, each bounded by ``modbus.timeout`` (0.1 s by default, 1 s at
    most), and raises after the first unanswered one: a board that does not reply blocks its caller
    for one timeout at a time, with increasing pauses in which calls raise at once.  Only
    set_evacuated and set_pump switch anything; open, close and reconnection do not.
    """

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = PARAMETERS
    COMMISSIONING = 'soft_continuum.hardware.modbus.commissioning'
    EMULATOR = 'soft_continuum.sim.emulators.modbus'

    def __init__(self, bus: ModbusBus, registers: RegisterMap) -> None:
        """Use ``bus`` exclusively."""
        self._bus = bus
        self._map = registers
        self._coils: tuple[bool, ...] | None = None  # None: not known
        self._coils_at = 0.0

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]
                        ) -> 'ModbusJamming | ModbusRegulators':
        """
        Return a driver for checked ``values`` of PARAMETERS, of the arm and of ambient_pressure.

        clock: not used; a device continues when a node's clock is paused or set.
        Raises ParameterError when the values do not fit together.
        """
        if values['modbus.regulators']:
            return ModbusRegulators.from_parameters(values)
        registers = registers_from_parameters(values)
        largest = max(2 * len(registers.transmitters.registers), (len(registers.coils) + 7) // 8,
                      3)
        return cls(bus_from_parameters(values, largest), registers)

    def open(self) -> None:
        """Connect and read the present state; switch nothing."""
        self._bus.open_with(self.read)

    def close(self) -> None:
        """Disconnect; leave pump and valves as they are."""
        self._bus.close()

    def read(self) -> JammingReading:
        """Return pressures as of now, relays as of at most COILS_INTERVAL ago."""
        self._get_in_step()
        coils = self._coils
        if coils is None or self._bus.clock() >= self._coils_at + COILS_INTERVAL:
            coils = self._read_coils()
        return JammingReading(
            self._map.transmitters.read(self._bus),
            tuple(coils[self._map.coils.index(c)] == self._map.energised_valve_evacuates
                  for c in self._map.valve_coils),
            coils[self._map.coils.index(self._map.pump_coil)])

    def set_evacuated(self, segment: int, evacuated: bool) -> None:
        """Switch the valve of a segment (0-based) and check that its relay follows."""
        self._switch(self._map.valve_coils[segment],
                     evacuated == self._map.energised_valve_evacuates,
                     f'valve of segment {segment + 1}')

    def set_pump(self, running: bool) -> None:
        """Switch the pump and check that its relay follows."""
        self._switch(self._map.pump_coil, running, 'pump')

    def _switch(self, coil: int, on: bool, what: str) -> None:
        self._get_in_step()
        self._coils = None  # whatever fails below, the relays must be read again
        self._bus.write_coil(self._map.relay_unit, coil, on)
        if self._read_coils()[self._map.coils.index(coil)] != on:
            state = 'on' if on else 'off'
            raise HardwareError(
                f'coil {coil} ({what}) of Modbus unit {self._map.relay_unit} does not follow: it '
                f'was switched {state} and reads back {"off" if on else "on"}; check the relay '
                'board (a hand switch, an interlock, its supply) and the coil numbers')

    def _read_coils(self) -> tuple[bool, ...]:
        self._coils, coils = None, self._map.coils
        self._coils = self._bus.read_coils(self._map.relay_unit, coils[0], len(coils))
        self._coils_at = self._bus.clock()
        return self._coils

    def _get_in_step(self) -> None:
        """
        After a missed reply, make sure that no late reply is taken for a new one.

        The relay board has no request that switches nothing and whose reply has a length of its
        own; its first reply is dropped, so that at most the reply to this request, as recent, can
        be taken for that to the next.
        """
        if not self._bus.out_of_step:
            return
        self._read_coils()
        self._coils = None
        self._map.transmitters.get_in_step(self._bus)
        self._bus.set_in_step()


def registers_from_parameters(values: Mapping[str, Any]) -> RegisterMap:
    """Return the addresses in the parameters; raises ParameterError when they do not fit."""
    registers = RegisterMap(
        relay_unit=values['modbus.relay_unit'],
        pump_coil=values['modbus.pump_coil'],
        valve_coils=addresses(values, 'modbus.valve_coils'),
        energised_valve_evacuates=values['modbus.energised_valve_evacuates'],
        transmitters=Transmitters.from_parameters(values))
    if registers.pump_coil in registers.valve_coils:
        raise ParameterError(
            f'parameter modbus.pump_coil is {registers.pump_coil}, which is also one of '
            'modbus.valve_coils; every coil switches one thing')
    check_span('modbus.pump_coil and modbus.valve_coils', registers.coils, MAX_COILS)
    return registers
