# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Pump and valves, or vacuum regulators, and pressure transmitters (4-20 mA) on Modbus RTU boards.

Pump and valves are on a relay board, regulators on an analog output board (4-20 mA or 0-10 V),
transmitters on an analog input board.  The boards keep their relays and outputs as they are when
this program or the line fails, unless an output board has a watchdog of its own.  Without power
regulators get their lowest output, and the arm becomes soft.  What valves then do depends on the
plumbing, that is on ``modbus.energised_valve_evacuates``: true: without power all segments vent
and the arm becomes soft; false: without power they stay connected to the (resting) pump and hold
their vacuum as long as nothing leaks.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import nan
from typing import Any, ClassVar, Self, TypeVar

from soft_continuum.hardware.modbus import PARAMETERS
from soft_continuum.hardware.modbus.bus import (
    BITS_PER_CHARACTER,
    ModbusBus,
    ModbusExceptionError,
    OVERHEAD,
)
from soft_continuum.hardware.protocols import HardwareError, JammingReading
from soft_continuum.parameters.parameter import Parameter, ParameterError

BROKEN_WIRE, SHORT_CIRCUIT = 3600, 21000
"""Range of a working transmitter, uA."""
COILS_INTERVAL = 0.2
"""Period of relay readings, s: relays only change by a command or a reset of the board."""
MAX_REGISTERS, MAX_COILS = 125, 2000
"""Largest counts of one reply."""
REQUEST_SIZE = 8  # bytes
WRITTEN_SIZE = 3
"""Bytes that the reply to a write has besides OVERHEAD."""

T = TypeVar('T')


@dataclass(frozen=True)
class Board(ABC):
    """A board with one address per segment; unit: its number."""

    unit: int
    of_segments: tuple[int, ...]

    @property
    def span(self) -> range:
        """All addresses that one request must read."""
        return range(min(self.of_segments), max(self.of_segments) + 1)

    @property
    def reply_size(self) -> int:
        """Bytes of a reply with all of them besides OVERHEAD."""
        return 2 * len(self.span)

    def each(self, found: Sequence[T]) -> tuple[T, ...]:
        """Return the value of every segment among those of the span."""
        return tuple(found[self.span.index(address)] for address in self.of_segments)

    def check_span(self, names: str, limit: int) -> Self:
        """Return it; ParameterError when addresses reach farther than one reply can carry."""
        if len(self.span) > limit:
            raise ParameterError(
                f'{names} reach from {self.span[0]} to {self.span[-1]}; one request reads at '
                f'most {limit}, so put them closer together')
        return self

    @abstractmethod
    def ask(self, bus: ModbusBus, first: int, count: int) -> tuple[int, ...]:
        """Return ``count`` coils or registers from ``first`` on; raises HardwareError."""

    def ask_all(self, bus: ModbusBus) -> tuple[int, ...]:
        """Return those of the whole span; raises HardwareError."""
        return self.ask(bus, self.span[0], len(self.span))

    def get_in_step(self, bus: ModbusBus) -> None:
        """
        Make the board answer a request whose reply has a unique length.

        Boards answer in the order of their requests, so no earlier reply can follow then.  It is
        asked for a single register (or, if it only has one, for two: it may refuse).
        """
        try:
            self.ask(bus, self.span[0], 1 if len(self.span) > 1 else 2)
        except ModbusExceptionError:
            if len(self.span) > 1:
                raise


@dataclass(frozen=True)
class Transmitters(Board):
    """
    Input registers with the currents of the transmitters, and their scaling.

    ambient_pressure: Pa.  vacuum_at_4_ma, vacuum_at_20_ma: Pa below it.
    """

    ambient_pressure: float
    vacuum_at_4_ma: float
    vacuum_at_20_ma: float

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Self:
        """Return those that the parameters describe; raises ParameterError."""
        found = cls(values['modbus.analog_unit'], _addresses(values, 'modbus.pressure_registers'),
                    values['ambient_pressure'], values['modbus.vacuum_at_4_ma'],
                    values['modbus.vacuum_at_20_ma'])
        if found.vacuum_at_4_ma == found.vacuum_at_20_ma:
            raise ParameterError(
                f'parameters modbus.vacuum_at_4_ma and modbus.vacuum_at_20_ma are both '
                f'{found.vacuum_at_4_ma:g} Pa; give the two ends of the range')
        return found.check_span('modbus.pressure_registers', MAX_REGISTERS)

    def pressure(self, current: int) -> float:
        """Return the absolute pressure (Pa) at a current (uA), nan when the wire is broken."""
        if not BROKEN_WIRE <= current <= SHORT_CIRCUIT:
            return nan
        share = (current - 4000) / 16000
        return self.ambient_pressure - (
            self.vacuum_at_4_ma + share * (self.vacuum_at_20_ma - self.vacuum_at_4_ma))

    def read(self, bus: ModbusBus) -> tuple[float, ...]:
        """Return the absolute pressure of every segment, Pa; raises HardwareError."""
        return tuple(map(self.pressure, self.each(self.ask_all(bus))))

    def ask(self, bus: ModbusBus, first: int, count: int) -> tuple[int, ...]:
        """Return currents, uA."""
        return bus.read_input_registers(self.unit, first, count)


@dataclass(frozen=True)
class Outputs(Board):
    """
    Holding registers with the set-points of the regulators, and their scaling.

    values: of a register at the ends of the range.  vacuums: Pa below ambient at these ends.
    """

    values: tuple[int, int]
    vacuums: tuple[float, float]

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Self:
        """Return those that the parameters describe; raises ParameterError."""
        low, high = values['modbus.output_range']
        if low != int(low) or high != int(high):
            raise ParameterError(f'parameter modbus.output_range is {[low, high]}; give whole '
                                 'numbers, as registers hold them')
        return cls(values['modbus.output_unit'], _addresses(values, 'modbus.output_registers'),
                   (int(low), int(high)), values['modbus.output_vacuums']
                   ).check_span('modbus.output_registers', MAX_REGISTERS)

    def value(self, vacuum: float) -> int:
        """Return the register value of a vacuum (Pa), at least the lowest value."""
        (low, high), (least, most) = self.values, self.vacuums
        return low + round(max(0.0, (vacuum - least) / (most - least)) * (high - low))

    def vacuum(self, value: int) -> float:
        """Return the vacuum (Pa) of a register value; 0 at or below the lowest value."""
        (low, high), (least, most) = self.values, self.vacuums
        return least + (value - low) / (high - low) * (most - least) if value > low else 0.0

    def ask(self, bus: ModbusBus, first: int, count: int) -> tuple[int, ...]:
        """Return what registers hold."""
        return bus.read_holding_registers(self.unit, first, count)


@dataclass(frozen=True)
class Relays(Board):
    """Coils of valves and pump; energised_valve_evacuates: what a coil that is on does."""

    pump_coil: int
    energised_valve_evacuates: bool

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Self:
        """Return those that the parameters describe; raises ParameterError."""
        found = cls(values['modbus.relay_unit'], _addresses(values, 'modbus.valve_coils'),
                    values['modbus.pump_coil'], values['modbus.energised_valve_evacuates'])
        if found.pump_coil in found.of_segments:
            raise ParameterError(
                f'parameter modbus.pump_coil is {found.pump_coil}, which is also one of '
                'modbus.valve_coils; every coil switches one thing')
        return found.check_span('modbus.pump_coil and modbus.valve_coils', MAX_COILS)

    @property
    def span(self) -> range:
        """All coils that one request must read."""
        coils = self.pump_coil, *self.of_segments
        return range(min(coils), max(coils) + 1)

    @property
    def reply_size(self) -> int:
        """Bytes of a reply with all of them besides OVERHEAD."""
        return (len(self.span) + 7) // 8

    def ask(self, bus: ModbusBus, first: int, count: int) -> tuple[bool, ...]:
        """Return which coils are on."""
        return bus.read_coils(self.unit, first, count)


def _addresses(values: Mapping[str, Any], name: str) -> tuple[int, ...]:
    """Return a list of addresses, one per segment; raise ParameterError if it is invalid."""
    given, segments = values[name], len(values['arm.segment_lengths'])
    if len(given) != segments:
        raise ParameterError(
            f'parameter {name} has {len(given)} entries; the arm has {segments} segments '
            '(arm.segment_lengths): give one for each')
    if len(set(given)) != segments or any(address != int(address) for address in given):
        raise ParameterError(
            f'parameter {name} is {[f"{a:g}" for a in given]}; give different whole numbers')
    return tuple(int(address) for address in given)


def _bus(values: Mapping[str, Any], *boards: Board) -> ModbusBus:
    """Return the bus of the parameters; ParameterError where its timeout is too short."""
    baud_rate, timeout = values['modbus.baud_rate'], values['modbus.timeout']
    largest = max(WRITTEN_SIZE, *(board.reply_size for board in boards))
    on_wire = (REQUEST_SIZE + OVERHEAD + largest) * BITS_PER_CHARACTER / baud_rate
    if timeout < 2 * on_wire:
        raise ParameterError(
            f'parameter modbus.timeout is {timeout:g} s; request and reply take '
            f'{on_wire:.3f} s at {baud_rate} baud, so allow at least {2 * on_wire:.3f} s')
    return ModbusBus(values['modbus.port'], baud_rate, timeout)


class ModbusVacuum(ABC):
    """
    Common base of valves and regulators.

    A call makes one to four requests, each bounded by ``modbus.timeout`` (0.1 s by default, 1 s at
    most), and raises after the first unanswered one: a board that does not reply blocks its caller
    for one timeout at a time, with increasing pauses in which calls raise at once.  Only setters
    switch or set anything; open, close and reconnection do not.
    """

    def __init__(self, bus: ModbusBus, transmitters: Transmitters) -> None:
        """Use ``bus`` exclusively."""
        self._bus, self._transmitters = bus, transmitters

    def open(self) -> None:
        """Connect and read the present state; change nothing."""
        self._bus.open_with(self.read)

    def close(self) -> None:
        """Disconnect; leave everything as it is."""
        self._bus.close()

    @abstractmethod
    def read(self) -> JammingReading:
        """Return the present state."""

    @abstractmethod
    def _drop_late_replies(self) -> None:
        """Make sure that no late reply of relays or outputs is taken for a new one."""

    def _get_in_step(self) -> None:
        """After a missed reply, make sure that no late reply is taken for a new one."""
        if self._bus.out_of_step:
            self._drop_late_replies()
            self._transmitters.get_in_step(self._bus)
            self._bus.set_in_step()


class ModbusRegulators(ModbusVacuum):
    """A RegulatorDriver over Modbus RTU; readings have the set-points as the board holds them."""

    def __init__(self, bus: ModbusBus, outputs: Outputs, transmitters: Transmitters) -> None:
        """Use ``bus`` exclusively."""
        super().__init__(bus, transmitters)
        self._outputs = outputs

    @property
    def max_vacuum(self) -> float:
        """Largest set-point, Pa below the atmosphere."""
        return self._outputs.vacuums[1]

    def read(self) -> JammingReading:
        """Return pressures and set-points as of now."""
        self._get_in_step()
        set_points = self._outputs.each(self._outputs.ask_all(self._bus))
        return JammingReading.of_regulators(self._transmitters.read(self._bus),
                                            tuple(map(self._outputs.vacuum, set_points)))

    def set_vacuum(self, segment: int, vacuum: float) -> None:
        """Set the vacuum of a segment (0-based), Pa, and check that its register follows."""
        self._get_in_step()
        outputs, value = self._outputs, self._outputs.value(vacuum)
        register = outputs.of_segments[segment]
        self._bus.write_register(outputs.unit, register, value)
        found = outputs.each(outputs.ask_all(self._bus))[segment]
        if found != value:
            raise HardwareError(
                f'holding register {register} (regulator of segment {segment + 1}) of Modbus unit '
                f'{outputs.unit} does not follow: {value} was written and it reads back {found}; '
                'check the output board (a mode by hand, its range) and the modbus parameters')

    def _drop_late_replies(self) -> None:
        self._outputs.get_in_step(self._bus)


class ModbusJamming(ModbusVacuum):
    """A JammingDriver over Modbus RTU."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = PARAMETERS
    COMMISSIONING = 'soft_continuum.hardware.modbus.commissioning'
    EMULATOR = 'soft_continuum.sim.emulators.modbus'

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]
                        ) -> 'ModbusJamming | ModbusRegulators':
        """
        Return a driver for checked ``values`` of PARAMETERS, of the arm and of ambient_pressure.

        clock: not used; a device continues when a node's clock is paused or set.
        Raises ParameterError when the values do not fit together.
        """
        if values['modbus.regulators']:
            outputs = Outputs.from_parameters(values)
            transmitters = Transmitters.from_parameters(values)
            return ModbusRegulators(_bus(values, outputs, transmitters), outputs, transmitters)
        relays, transmitters = (Relays.from_parameters(values),
                                Transmitters.from_parameters(values))
        return cls(_bus(values, relays, transmitters), relays, transmitters)

    def __init__(self, bus: ModbusBus, relays: Relays, transmitters: Transmitters) -> None:
        """Use ``bus`` exclusively."""
        super().__init__(bus, transmitters)
        self._relays = relays
        self._coils: tuple[int, ...] | None = None  # None: not known
        self._coils_at = 0.0

    def read(self) -> JammingReading:
        """Return pressures as of now, relays as of at most COILS_INTERVAL ago."""
        self._get_in_step()
        coils, relays = self._coils, self._relays
        if coils is None or self._bus.clock() >= self._coils_at + COILS_INTERVAL:
            coils = self._read_coils()
        return JammingReading(
            self._transmitters.read(self._bus),
            tuple(on == relays.energised_valve_evacuates for on in relays.each(coils)),
            bool(coils[relays.span.index(relays.pump_coil)]))

    def set_evacuated(self, segment: int, evacuated: bool) -> None:
        """Switch the valve of a segment (0-based) and check that its relay follows."""
        self._switch(self._relays.of_segments[segment],
                     evacuated == self._relays.energised_valve_evacuates,
                     f'valve of segment {segment + 1}')

    def set_pump(self, running: bool) -> None:
        """Switch the pump and check that its relay follows."""
        self._switch(self._relays.pump_coil, running, 'pump')

    def _switch(self, coil: int, on: bool, what: str) -> None:
        self._get_in_step()
        self._coils = None  # whatever fails below, the relays must be read again
        self._bus.write_coil(self._relays.unit, coil, on)
        if self._read_coils()[self._relays.span.index(coil)] != on:
            state = 'on' if on else 'off'
            raise HardwareError(
                f'coil {coil} ({what}) of Modbus unit {self._relays.unit} does not follow: it '
                f'was switched {state} and reads back {"off" if on else "on"}; check the relay '
                'board (a hand switch, an interlock, its supply) and the coil numbers')

    def _read_coils(self) -> tuple[int, ...]:
        self._coils = None
        self._coils = self._relays.ask_all(self._bus)
        self._coils_at = self._bus.clock()
        return self._coils

    def _drop_late_replies(self) -> None:
        """
        Drop the first reply of the relay board.

        It has no request that switches nothing and whose reply has a length of its own; so at most
        the reply to this request, as recent, can be taken for that to the next.
        """
        self._read_coils()
        self._coils = None
