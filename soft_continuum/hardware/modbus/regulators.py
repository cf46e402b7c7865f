# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Vacuum regulators on a Modbus RTU analog output board (4-20 mA or 0-10 V); transmitters as valves.

An output board keeps its outputs as they are when this program or the line fails, unless it has a
watchdog of its own; without power it gives its lowest output, and the arm becomes soft.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from soft_continuum.hardware.modbus.bus import ModbusBus
from soft_continuum.hardware.modbus.transmitters import (
    addresses,
    bus_from_parameters,
    check_span,
    get_in_step,
    MAX_REGISTERS,
    span,
    Transmitters,
)
from soft_continuum.hardware.protocols import HardwareError, JammingReading
from soft_continuum.parameters.parameter import ParameterError


@dataclass(frozen=True)
class Outputs:
    """
    Registers of the set-points, one per segment, and their scaling.

    unit: number of the board.  values: of a register at the ends of the range.  vacuums: Pa below
    ambient at these ends.
    """

    unit: int
    of_segments: tuple[int, ...]
    values: tuple[int, int]
    vacuums: tuple[float, float]

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Self:
        """Return those that the parameters describe; raises ParameterError."""
        low, high = values['modbus.output_range']
        if low != int(low) or high != int(high):
            raise ParameterError(f'parameter modbus.output_range is {[low, high]}; give whole '
                                 'numbers, as registers hold them')
        found = cls(values['modbus.output_unit'], addresses(values, 'modbus.output_registers'),
                    (int(low), int(high)), values['modbus.output_vacuums'])
        check_span('modbus.output_registers', found.registers, MAX_REGISTERS)
        return found

    @property
    def registers(self) -> range:
        """All registers that one request must read."""
        return span(self.of_segments)

    def value(self, vacuum: float) -> int:
        """Return the register value of a vacuum (Pa), at least the lowest value."""
        (low, high), (least, most) = self.values, self.vacuums
        return low + round(max(0.0, (vacuum - least) / (most - least)) * (high - low))

    def vacuum(self, value: int) -> float:
        """Return the vacuum (Pa) of a register value; 0 at or below the lowest value."""
        (low, high), (least, most) = self.values, self.vacuums
        return least + (value - low) / (high - low) * (most - least) if value > low else 0.0


class ModbusRegulators:
    """
    A RegulatorDriver over Modbus RTU.

    Timing and errors are those of ModbusJamming.  Only set_vacuum sets anything; open, close and
    reconnection do not.  Every reading has the set-points as the board holds them.
    """

    def __init__(self, bus: ModbusBus, outputs: Outputs, transmitters: Transmitters) -> None:
        """Use ``bus`` exclusively."""
        self._bus, self._outputs, self._transmitters = bus, outputs, transmitters

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Self:
        """Return a driver for checked parameters of ModbusJamming; raises ParameterError."""
        outputs, transmitters = (Outputs.from_parameters(values),
                                 Transmitters.from_parameters(values))
        largest = 2 * max(len(outputs.registers), len(transmitters.registers))
        return cls(bus_from_parameters(values, largest), outputs, transmitters)

    @property
    def max_vacuum(self) -> float:
        """Largest set-point, Pa below the atmosphere."""
        return self._outputs.vacuums[1]

    def open(self) -> None:
        """Connect and read the present state; set nothing."""
        self._bus.open_with(self.read)

    def close(self) -> None:
        """Disconnect; leave the set-points as they are."""
        self._bus.close()

    def read(self) -> JammingReading:
        """Return pressures and set-points as of now."""
        self._get_in_step()
        vacuums = tuple(map(self._outputs.vacuum, self._set_points()))
        return JammingReading.of_regulators(self._transmitters.read(self._bus), vacuums)

    def set_vacuum(self, segment: int, vacuum: float) -> None:
        """Set the vacuum of a segment (0-based), Pa, and check that its register follows."""
        self._get_in_step()
        outputs, value = self._outputs, self._outputs.value(vacuum)
        register = outputs.of_segments[segment]
        self._bus.write_register(outputs.unit, register, value)
        found = self._set_points()[segment]
        if found != value:
            raise HardwareError(
                f'holding register {register} (regulator of segment {segment + 1}) of Modbus unit '
                f'{outputs.unit} does not follow: {value} was written and it reads back {found}; '
                'check the output board (a mode by hand, its range) and the modbus parameters')

    def _set_points(self) -> tuple[int, ...]:
        """Return what the register of every segment holds."""
        registers = self._outputs.registers
        found = self._bus.read_holding_registers(
            self._outputs.unit, registers[0], len(registers))
        return tuple(found[registers.index(r)] for r in self._outputs.of_segments)

    def _get_in_step(self) -> None:
        """After a missed reply, make sure that no late reply is taken for a new one."""
        if self._bus.out_of_step:
            get_in_step(self._bus.read_holding_registers, self._outputs.unit,
                        self._outputs.registers)
            self._transmitters.get_in_step(self._bus)
            self._bus.set_in_step()
