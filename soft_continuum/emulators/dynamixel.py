# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The command line of emulated Dynamixel servos: faults are typed while they run."""

from collections.abc import Callable, Sequence
import random

from soft_continuum.emulators.console import Command, device_parser, execute, RANGES, serve, set_to
from soft_continuum.emulators.driving import (
    BAUD_RATE,
    dynamixel_parameters,
    SERVO_MODEL,
    SPOOL_RADIUS,
)
from soft_continuum.emulators.dynamixel_bus import DynamixelEmulator
from soft_continuum.emulators.dynamixel_models import BAUD_RATES, CURRENT_POSITION, MODELS
from soft_continuum.emulators.dynamixel_motor import Tendon
from soft_continuum.emulators.dynamixel_servo import (
    DynamixelServo,
    ENCODER_ERROR,
    OVERLOAD_ERROR,
    SHOCK_ERROR,
)
from soft_continuum.hardware.clock import Clock


def make_servos(tendons: int, model: str, baud_rate: int = BAUD_RATE,
                mode: int = CURRENT_POSITION, signs: Sequence[int] = ()) -> list[DynamixelServo]:
    """
    Return servos with the IDs 1, 2, ... and spools of SPOOL_RADIUS, at different angles.

    mode: their operating mode.  signs: 1 where positive angles pull in, -1 where they pay out; all
    1 if there are none.
    """
    servos = [DynamixelServo(
        MODELS[model], n + 1, Tendon(SPOOL_RADIUS, signs[n] if signs else 1),
        baud_code=BAUD_RATES.index(baud_rate), start=700 * (n + 1) % 4096)
        for n in range(tendons)]
    for servo in servos:
        if mode in servo.model.modes:
            servo.set_up('Operating Mode', mode)
    return servos


def describe(emulator: DynamixelEmulator) -> str:
    """Return the state of the servos, for a person to read."""
    def of(number: int, servo: DynamixelServo) -> str:
        values, motor = servo.values, servo.motor
        state = ('without power' if not servo.powered else
                 'torque on' if servo.torque else 'torque off')
        return (f'{number}: ID {values["ID"]}, mode {values["Operating Mode"]}, {state}, position '
                f'{servo.position:.0f}, pulled {1e3 * motor.pull:.2f} mm, {motor.tension:.1f} N, '
                f'{servo.temperature:.0f} C, hardware error {values["Hardware Error Status"]}, '
                f'watchdog {values["Bus Watchdog"]}')

    return '\n'.join([emulator.port, *emulator.read(
        lambda: [of(n + 1, servo) for n, servo in enumerate(emulator.servos)])])


def _servo(change: Callable[..., object]) -> Callable[..., None]:
    """Return the function of a command that changes the servo of its first number."""
    def run(emulator: DynamixelEmulator, number: int, *values: float) -> None:
        emulator.read(lambda: change(emulator.servos[number - 1], *values))
    return run


def _supply(emulator: DynamixelEmulator, volts: float) -> None:
    for servo in emulator.servos:
        servo.supply = volts


COMMANDS = {
    'unplug': Command('', 'unplug the adapter', DynamixelEmulator.unplug),
    'plug': Command('', 'put it back', DynamixelEmulator.plug),
    'power-cycle': Command('', 'switch the supply of all servos off and on',
                           DynamixelEmulator.power_cycle),
    'cycle': Command('N', 'switch one servo off and on',
                     lambda e, n: e.power_cycle(n - 1)),
    'off': Command('N', 'unplug one servo: no power, no bus',
                   _servo(DynamixelServo.power_off)),
    'on': Command('N', 'put it back', _servo(DynamixelServo.power_on)),
    'hang': Command('N', 'make one servo stop replying',
                    _servo(lambda s: setattr(s, 'hang', True))),
    'drop': Command('COUNT', 'drop the next replies', set_to('drop')),
    'deaf': Command('COUNT', 'drop the next instructions', set_to('deaf')),
    'late': Command('SECONDS', 'reply late', set_to('late')),
    'garble': Command('SHARE', 'damage this share of the replies', set_to('garble')),
    'garble-in': Command('SHARE', 'damage this share of the instructions', set_to('garble_in')),
    'noise': Command('BYTES', 'send this many bytes without an instruction',
                     lambda e, count: e.send(random.randbytes(count))),
    'collide': Command('N OTHER', 'give a servo the ID of another one',
                       lambda e, n, other: e.collide(n - 1, other - 1)),
    'overload': Command('N', 'overload: the motor switches off',
                        _servo(lambda s: s.fail(OVERLOAD_ERROR))),
    'shock': Command('N', 'electrical shock: the motor switches off',
                     _servo(lambda s: s.fail(SHOCK_ERROR))),
    'encoder': Command('N', 'fail the encoder',
                       _servo(lambda s: setattr(s, 'broken', ENCODER_ERROR))),
    'heat': Command('N DEGREES', 'set the temperature of the motor',
                    _servo(lambda s, degrees: setattr(s, 'temperature', degrees))),
    'voltage': Command('VOLTS', 'set the supply voltage of all servos', _supply),
    'weight': Command('N NEWTON', 'pull at the tendon with this force',
                      _servo(lambda s, force: setattr(s.motor.tendon, 'weight', force))),
    'catch': Command('N', 'block the spool',
                     _servo(lambda s: setattr(s.motor, 'caught', True))),
    'mode': Command('N MODE', 'set an operating mode, as another program might',
                    _servo(lambda s, mode: s.set_up('Operating Mode', mode))),
    'repair': Command('', 'clear all faults, but for unplugged cables and those that need a '
                          'reboot',
                      DynamixelEmulator.repair),
    'state': Command('', 'print the true state of the servos', describe),
}


def execute_command(emulator: DynamixelEmulator, line: str) -> str:
    """Execute a typed line; return the text to print.  Raises ValueError for an invalid one."""
    servos = len(emulator.servos)
    return execute(COMMANDS, {
        **RANGES, 'N': (1, servos), 'OTHER': (1, servos), 'DEGREES': (-20.0, 150.0),
        'VOLTS': (0.0, 30.0), 'NEWTON': (0.0, 1000.0), 'MODE': (0, 16)}, emulator, line)


def main(argv: Sequence[str] | None = None) -> int:
    """Serve emulated servos until ``quit`` or Ctrl-C; faults are typed on standard input."""
    parser = device_parser('dynamixel', 'Dynamixel servos of the X series on one bus.')
    parser.add_argument('--tendons', type=int, default=2, choices=range(1, 33), metavar='N',
                        help='number of servos, 1 to 32; their IDs are 1, 2, ... (default: 2)')
    parser.add_argument('--model', default=SERVO_MODEL, choices=MODELS,
                        help=f'one of {", ".join(MODELS)} (default: {SERVO_MODEL})')
    parser.add_argument('--baud-rate', type=int, default=BAUD_RATE, choices=BAUD_RATES[:-1],
                        metavar='RATE', help='bit/s of the bus: '
                        f'{", ".join(map(str, BAUD_RATES[:-1]))} (default: %(default)s)')
    parser.add_argument('--mode', type=int, default=CURRENT_POSITION, metavar='MODE',
                        choices=MODELS['XM430-W350'].modes, help='operating mode of servos that '
                        'have it: 0, 1, 3 (factory setting), 4, 5 or 16 (default: 5, '
                        'current-based position control)')
    parser.add_argument('--protocol-1', action='store_true',
                        help='servos with the old Protocol 1.0 (XM and XL430 only)')
    arguments = parser.parse_args(argv)
    if arguments.protocol_1 and not MODELS[arguments.model].old_protocol:
        parser.error(f'{arguments.model} does not support Protocol 1.0')
    servos = make_servos(arguments.tendons, arguments.model, arguments.baud_rate, arguments.mode)
    for servo in servos:
        servo.values['Protocol Type'] = 1 if arguments.protocol_1 else 2
    return serve(
        parser, lambda: DynamixelEmulator(
            servos, arguments.link, Clock(arguments.time_factor)),
        lambda emulator: dynamixel_parameters(
            emulator.port, len(emulator.servos), arguments.baud_rate, arguments.model),
        execute_command, ' N is the number of a servo, 1 is the first.')
