# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Pump and valves on a Modbus RTU relay board, pressure transmitters (4-20 mA) on an analog board.

The boards have no watchdog and no fail-safe: they keep their relays as they are when this program
or the line fails.  What the segments do when the boards lose power depends on the plumbing, that
is on ``modbus.energised_valve_evacuates``: true: without power all segments vent and the arm
becomes soft; false: without power they stay connected to the (resting) pump and hold their vacuum
as long as nothing leaks.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import nan
from typing import Any, ClassVar, Self

from soft_continuum.hardware.modbus_bus import (
    BITS_PER_CHARACTER,
    ModbusBus,
    OVERHEAD,
    RefusedError,
)
from soft_continuum.hardware.protocols import HardwareError, JammingReading
from soft_continuum.parameters.parameter import Parameter, ParameterError

BROKEN_WIRE, SHORT_CIRCUIT = 3600, 21000
"""uA; no working transmitter gives less than the one or more than the other."""
COILS_INTERVAL = 0.2
"""s between two readings of the relays: they change only by a command or a reset of the board."""
REQUEST_SIZE = 8  # bytes
OPEN_ATTEMPTS = 2
"""A reply to a program that was killed just before may still be on its way to the first one."""


@dataclass(frozen=True)
class RegisterMap:
    """
    Where pump, valves and transmitters are; one coil and one register per segment.

    relay_unit, analog_unit: unit numbers, which may be the same.  energised_valve_evacuates: what
    a coil that is on does.  ambient_pressure: Pa.  vacuum_at_4_ma, vacuum_at_20_ma: Pa below it.
    """

    relay_unit: int
    pump_coil: int
    valve_coils: tuple[int, ...]
    energised_valve_evacuates: bool
    analog_unit: int
    pressure_registers: tuple[int, ...]
    ambient_pressure: float
    vacuum_at_4_ma: float
    vacuum_at_20_ma: float

    @property
    def coils(self) -> range:
        """All coils that one request must read."""
        used = self.pump_coil, *self.valve_coils
        return range(min(used), max(used) + 1)

    @property
    def registers(self) -> range:
        """All registers that one request must read."""
        return range(min(self.pressure_registers), max(self.pressure_registers) + 1)

    def pressure(self, current: int) -> float:
        """Return the absolute pressure (Pa) at a current (uA), nan when the wire is broken."""
        if not BROKEN_WIRE <= current <= SHORT_CIRCUIT:
            return nan
        share = (current - 4000) / 16000
        return self.ambient_pressure - (
            self.vacuum_at_4_ma + share * (self.vacuum_at_20_ma - self.vacuum_at_4_ma))


class ModbusJamming:
    """
    A JammingDriver over Modbus RTU.

    A call makes one to four requests, each bounded by ``modbus.timeout`` (0.1 s by default, 1 s at
    most), and raises after the first that is not answered: a board that does not answer holds its
    caller for one timeout at a time, with ever longer pauses in which calls raise at once.
    Nothing is switched but by set_evacuated and set_pump: not on open, close or reconnection.
    """

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        Parameter('modbus.port', '', 'serial port, best by its stable name /dev/serial/by-id/...'),
        Parameter('modbus.baud_rate', 9600, 'baud rate of both boards, 8N1', 1200, 1000000,
                  unit='bit/s'),
        Parameter('modbus.timeout', 0.1,
                  'longest wait for a reply; well above what the boards need', 0.01, 1.0,
                  unit='s'),
        Parameter('modbus.relay_unit', 1, 'unit number of the relay board', 1, 247),
        Parameter('modbus.pump_coil', 0, 'coil of the pump, counted from 0', 0, 65535),
        Parameter('modbus.valve_coils', (1.0, 2.0, 3.0),
                  'coil of the valve of each segment, base first', 0, 65535),
        Parameter('modbus.energised_valve_evacuates', True,
                  'a coil that is on connects its segment to the pump, so that segments vent when '
                  'power fails; false: to the atmosphere'),
        Parameter('modbus.analog_unit', 2, 'unit number of the analog board', 1, 247),
        Parameter('modbus.pressure_registers', (0.0, 1.0, 2.0),
                  'input register with the current, in uA, of the transmitter of each segment',
                  0, 65535),
        Parameter('modbus.vacuum_at_4_ma', 0.0,
                  'vacuum below ambient at which a transmitter gives 4 mA', -1e6, 1e6, unit='Pa'),
        Parameter('modbus.vacuum_at_20_ma', 100e3,
                  'vacuum below ambient at which a transmitter gives 20 mA', -1e6, 1e6, unit='Pa'),
    )

    def __init__(self, bus: ModbusBus, registers: RegisterMap) -> None:
        """Use ``bus``, which nothing else may use."""
        self._bus = bus
        self._map = registers
        self._coils: tuple[bool, ...] | None = None  # None: not known
        self._coils_at = 0.0

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]) -> Self:
        """
        Return a driver for checked ``values`` of PARAMETERS, of the arm and of ambient_pressure.

        clock: not used; a device continues when a node's clock is paused or set.
        Raises ParameterError when the values do not fit together.
        """
        registers = registers_from_parameters(values)
        baud_rate, timeout = values['modbus.baud_rate'], values['modbus.timeout']
        largest = max(2 * len(registers.registers), (len(registers.coils) + 7) // 8, 3)
        on_wire = (REQUEST_SIZE + OVERHEAD + largest) * BITS_PER_CHARACTER / baud_rate
        if timeout < 2 * on_wire:
            raise ParameterError(
                f'parameter modbus.timeout is {timeout:g} s; request and reply take '
                f'{on_wire:.3f} s at {baud_rate} baud, so allow at least {2 * on_wire:.3f} s')
        return cls(ModbusBus(values['modbus.port'], baud_rate, timeout), registers)

    def open(self) -> None:
        """Connect and read the present state; switch nothing."""
        self._bus.open()
        for attempt in range(OPEN_ATTEMPTS):
            try:
                self.read()
                return
            except HardwareError:
                if attempt == OPEN_ATTEMPTS - 1:
                    self._bus.close()
                    raise

    def close(self) -> None:
        """Disconnect; leave pump and valves as they are."""
        self._bus.close()

    def read(self) -> JammingReading:
        """Return pressures as of now, relays as of at most COILS_INTERVAL ago."""
        self._get_in_step()
        coils = self._coils
        if coils is None or self._bus.clock() >= self._coils_at + COILS_INTERVAL:
            coils = self._read_coils()
        addresses = self._map.registers
        currents = self._bus.read_input_registers(
            self._map.analog_unit, addresses[0], len(addresses))
        return JammingReading(
            tuple(self._map.pressure(currents[addresses.index(r)])
                  for r in self._map.pressure_registers),
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
        self._coils, addresses = None, self._map.coils
        self._coils = self._bus.read_coils(self._map.relay_unit, addresses[0], len(addresses))
        self._coils_at = self._bus.clock()
        return self._coils

    def _get_in_step(self) -> None:
        """
        After a missed reply, make sure that no late reply is taken for a new one.

        A board answers in the order of its requests.  Once it has answered a request whose reply
        has a length of its own, no earlier reply can follow: the analog board is asked for one
        register alone (or, where one is all, for two: it may refuse).  The relay board has no such
        request that switches nothing; its first reply is dropped, so that at most the reply to
        this request, as recent, can be taken for that to the next.
        """
        if not self._bus.out_of_step:
            return
        self._read_coils()
        self._coils = None
        registers = self._map.registers
        try:
            self._bus.read_input_registers(
                self._map.analog_unit, registers[0], 1 if len(registers) > 1 else 2)
        except RefusedError:
            if len(registers) > 1:
                raise
        self._bus.set_in_step()


def registers_from_parameters(values: Mapping[str, Any]) -> RegisterMap:
    """Return the addresses in the parameters; raises ParameterError when they do not fit."""
    segments = len(values['arm.segment_lengths'])
    registers = RegisterMap(
        relay_unit=values['modbus.relay_unit'],
        pump_coil=values['modbus.pump_coil'],
        valve_coils=_addresses(values, 'modbus.valve_coils', segments),
        energised_valve_evacuates=values['modbus.energised_valve_evacuates'],
        analog_unit=values['modbus.analog_unit'],
        pressure_registers=_addresses(values, 'modbus.pressure_registers', segments),
        ambient_pressure=values['ambient_pressure'],
        vacuum_at_4_ma=values['modbus.vacuum_at_4_ma'],
        vacuum_at_20_ma=values['modbus.vacuum_at_20_ma'])
    if registers.pump_coil in registers.valve_coils:
        raise ParameterError(
            f'parameter modbus.pump_coil is {registers.pump_coil}, which is also one of '
            'modbus.valve_coils; every coil switches one thing')
    if registers.vacuum_at_4_ma == registers.vacuum_at_20_ma:
        raise ParameterError(
            f'parameters modbus.vacuum_at_4_ma and modbus.vacuum_at_20_ma are both '
            f'{registers.vacuum_at_4_ma:g} Pa; give the two ends of the range')
    # What one reply can carry.
    for name, addresses, limit in (('modbus.pump_coil and modbus.valve_coils',
                                   registers.coils, 2000),
                                  ('modbus.pressure_registers', registers.registers, 125)):
        if len(addresses) > limit:
            raise ParameterError(
                f'{name} reach from {addresses[0]} to {addresses[-1]}; one request reads at '
                f'most {limit}, so put them closer together')
    return registers


def _addresses(values: Mapping[str, Any], name: str, segments: int) -> tuple[int, ...]:
    """Return a list of addresses, one per segment; raise ParameterError when it is none."""
    given = values[name]
    if len(given) != segments:
        raise ParameterError(
            f'parameter {name} has {len(given)} entries; the arm has {segments} segments '
            '(arm.segment_lengths): give one for each')
    if len(set(given)) != segments or any(address != int(address) for address in given):
        raise ParameterError(
            f'parameter {name} is {[f"{a:g}" for a in given]}; give different whole numbers')
    return tuple(int(address) for address in given)
