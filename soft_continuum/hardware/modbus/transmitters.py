# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Pressure transmitters (4-20 mA) of the segments, on a Modbus RTU analog input board."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import nan
from typing import Any, Self

from soft_continuum.hardware.modbus.bus import (
    BITS_PER_CHARACTER,
    ModbusBus,
    ModbusExceptionError,
    OVERHEAD,
)
from soft_continuum.parameters.parameter import ParameterError

BROKEN_WIRE, SHORT_CIRCUIT = 3600, 21000
"""Range of a working transmitter, uA."""
MAX_REGISTERS = 125
"""Largest count of one reply."""
REQUEST_SIZE = 8  # bytes


@dataclass(frozen=True)
class Transmitters:
    """
    Registers of the transmitters, one input register per segment, and their scaling.

    unit: number of the board.  ambient_pressure: Pa.  vacuum_at_4_ma, vacuum_at_20_ma: Pa below
    it.
    """

    unit: int
    of_segments: tuple[int, ...]
    ambient_pressure: float
    vacuum_at_4_ma: float
    vacuum_at_20_ma: float

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Self:
        """Return those that the parameters describe; raises ParameterError."""
        found = cls(values['modbus.analog_unit'], addresses(values, 'modbus.pressure_registers'),
                    values['ambient_pressure'], values['modbus.vacuum_at_4_ma'],
                    values['modbus.vacuum_at_20_ma'])
        if found.vacuum_at_4_ma == found.vacuum_at_20_ma:
            raise ParameterError(
                f'parameters modbus.vacuum_at_4_ma and modbus.vacuum_at_20_ma are both '
                f'{found.vacuum_at_4_ma:g} Pa; give the two ends of the range')
        check_span('modbus.pressure_registers', found.registers, MAX_REGISTERS)
        return found

    @property
    def registers(self) -> range:
        """All registers that one request must read."""
        return span(self.of_segments)

    def pressure(self, current: int) -> float:
        """Return the absolute pressure (Pa) at a current (uA), nan when the wire is broken."""
        if not BROKEN_WIRE <= current <= SHORT_CIRCUIT:
            return nan
        share = (current - 4000) / 16000
        return self.ambient_pressure - (
            self.vacuum_at_4_ma + share * (self.vacuum_at_20_ma - self.vacuum_at_4_ma))

    def read(self, bus: ModbusBus) -> tuple[float, ...]:
        """Return the absolute pressure of every segment, Pa; raises HardwareError."""
        registers = self.registers
        currents = bus.read_input_registers(self.unit, registers[0], len(registers))
        return tuple(self.pressure(currents[registers.index(r)]) for r in self.of_segments)

    def get_in_step(self, bus: ModbusBus) -> None:
        """Make sure that no late reply of the board can be taken for a new one."""
        get_in_step(bus.read_input_registers, self.unit, self.registers)


def get_in_step(read: Callable[[int, int, int], Any], unit: int, registers: range) -> None:
    """
    Make a board answer a request whose reply has a unique length.

    Boards answer in the order of their requests, so no earlier reply can follow then.  It is asked
    for a single register (or, if it only has one, for two: it may refuse).
    """
    try:
        read(unit, registers[0], 1 if len(registers) > 1 else 2)
    except ModbusExceptionError:
        if len(registers) > 1:
            raise


def addresses(values: Mapping[str, Any], name: str) -> tuple[int, ...]:
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


def span(of_segments: tuple[int, ...]) -> range:
    """Return all addresses that one request must read."""
    return range(min(of_segments), max(of_segments) + 1)


def check_span(names: str, found: range, limit: int) -> None:
    """Raise ParameterError when addresses reach farther than one reply can carry."""
    if len(found) > limit:
        raise ParameterError(
            f'{names} reach from {found[0]} to {found[-1]}; one request reads at '
            f'most {limit}, so put them closer together')


def bus_from_parameters(values: Mapping[str, Any], largest: int) -> ModbusBus:
    """
    Return the bus of the parameters; ParameterError where its timeout is too short.

    largest: bytes that a reply carries at most.
    """
    baud_rate, timeout = values['modbus.baud_rate'], values['modbus.timeout']
    on_wire = (REQUEST_SIZE + OVERHEAD + largest) * BITS_PER_CHARACTER / baud_rate
    if timeout < 2 * on_wire:
        raise ParameterError(
            f'parameter modbus.timeout is {timeout:g} s; request and reply take '
            f'{on_wire:.3f} s at {baud_rate} baud, so allow at least {2 * on_wire:.3f} s')
    return ModbusBus(values['modbus.port'], baud_rate, timeout)
