# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The command line of the emulated Modbus rig: faults are typed while it runs."""

from collections.abc import Sequence
import random

from soft_continuum.emulators.console import Command, device_parser, execute, RANGES, serve, set_to
from soft_continuum.emulators.modbus_rig import (
    ANALOG_UNIT,
    FULL_SCALE,
    HIGH,
    LOW,
    ModbusEmulator,
    OUTPUT_UNIT,
    RELAY_UNIT,
)
from soft_continuum.parameters.parameter import Value


def parameters(emulator: ModbusEmulator) -> dict[str, Value]:
    """Return all parameters of a node that drives the rig, those that are the default, too."""
    numbers = range(len(emulator.segments))
    registers, vacuums = tuple(map(float, numbers)), (0.0, FULL_SCALE)
    switching: dict[str, Value] = {
        'modbus.regulators': True, 'modbus.output_unit': OUTPUT_UNIT,
        'modbus.output_registers': registers, 'modbus.output_range': (float(LOW), float(HIGH)),
        'modbus.output_vacuums': vacuums,
    } if emulator.regulators else {
        'modbus.relay_unit': RELAY_UNIT, 'modbus.pump_coil': 0,
        'modbus.valve_coils': tuple(n + 1.0 for n in numbers),
        'modbus.energised_valve_evacuates': True}
    return {'jamming_driver': 'modbus', 'modbus.port': emulator.port, **switching,
            'modbus.analog_unit': ANALOG_UNIT, 'modbus.pressure_registers': registers,
            'modbus.vacuum_at_4_ma': 0.0, 'modbus.vacuum_at_20_ma': FULL_SCALE}


def describe(emulator: ModbusEmulator) -> str:
    """Return the state of the rig, for a person to read."""
    head, told = emulator.port, [f'output {output} uA' for output in emulator.outputs]
    if not emulator.regulators:
        pump, *valves = ('on' if on else 'off' for on in emulator.coils)
        head, told = f'{head}: pump {pump}', [f'valve {valve}' for valve in valves]
    return '\n'.join([head, *(
        f'segment {i + 1}: {each}, vacuum {emulator.vacuum(i) / 1e3:.1f} kPa, '
        f'{emulator.segments[i].current()} uA' for i, each in enumerate(told))])


COMMANDS = {
    'unplug': Command('', 'unplug the adapter', ModbusEmulator.unplug),
    'plug': Command('', 'put it back', ModbusEmulator.plug),
    'hang': Command('', 'stop replying', set_to('hang', True)),
    'late': Command('SECONDS', 'reply late', set_to('late')),
    'drop': Command('SHARE', 'drop this share of the replies', set_to('drop')),
    'garble': Command('SHARE', 'damage this share of the replies', set_to('garble')),
    'echo': Command('', 'the adapter receives what it sends', set_to('echo', True)),
    'zeros': Command('BYTES', 'every reply ends with this many zeros, as on a line without bias',
                     set_to('zeros')),
    'refuse': Command('CODE', 'reply to everything with this Modbus exception; 0: stop that',
                      set_to('refuse')),
    'noise': Command('BYTES', 'send this many bytes without a request',
                     lambda e, count: e.send(random.randbytes(count))),
    'power-cycle': Command('', 'release every relay, or set every output to 4 mA, as in a loss of '
                               'power', ModbusEmulator.power_cycle),
    'stuck-coil': Command('COIL', 'a relay no longer follows; 0 is the pump',
                          lambda e, coil: e.stuck.add(coil)),
    'stuck-output': Command('SEGMENT', 'the output of a regulator no longer follows',
                            lambda e, segment: e.stuck.add(segment - 1)),
    'stuck-regulator': Command('SEGMENT', 'a regulator no longer follows its output',
                               lambda e, segment: e.hang_regulator(segment - 1)),
    'broken-wire': Command('SEGMENT', 'a transmitter gives no current; 1 is at the base',
                           lambda e, segment: setattr(
                               e.segments[segment - 1], 'broken_wire', True)),
    'stuck-sensor': Command('SEGMENT', 'freeze a transmitter at its present current',
                            lambda e, segment: e.stick_sensor(segment - 1)),
    'leak': Command('SEGMENT RATE', 'a segment loses RATE Pa/s',
                    lambda e, segment, rate: e.segments[segment - 1].set_leak(rate)),
    'repair': Command('', 'clear all faults but an unplugged adapter', ModbusEmulator.repair),
    'state': Command('', 'print relays, vacuum and currents', describe),
}


def execute_command(emulator: ModbusEmulator, line: str) -> str:
    """Execute a typed line; return the text to print.  Raises ValueError for an invalid one."""
    segments = len(emulator.segments)
    return execute(COMMANDS, {**RANGES, 'RATE': (0.0, 1e6), 'CODE': (0, 255),
                              'COIL': (0, segments), 'SEGMENT': (1, segments)}, emulator, line)


def main(argv: Sequence[str] | None = None) -> int:
    """Serve an emulated rig until ``quit`` or Ctrl-C; faults are typed on the standard input."""
    parser = device_parser('modbus', 'A jamming rig on an emulated Modbus RTU line.', timed=False)
    parser.add_argument('--segments', type=int, default=3, choices=range(1, 65), metavar='N',
                        help='number of segments, 1 to 64 (default: 3)')
    parser.add_argument('--stiff', action='store_true',
                        help='start with the pump on and every segment evacuated')
    parser.add_argument('--regulators', action='store_true',
                        help='vacuum regulators on an output board, in place of pump and valves')
    parser.add_argument('--baud-rate', type=int, default=9600, metavar='RATE',
                        help='reply as slowly as on this line; 0: at once (default: 9600)')
    arguments = parser.parse_args(argv)
    return serve(
        parser, lambda: ModbusEmulator(
            arguments.segments, initially_stiff=arguments.stiff, link=arguments.link,
            baud_rate=arguments.baud_rate, regulators=arguments.regulators),
        parameters, execute_command)
