# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Servos on one bus, behind a pseudo-terminal: reception, replies, their timing and losses.

A pseudo-terminal has no baud rate, but reports the one that the computer has set: servos receive
only packets at their own.  Bytes take their time on the wire, at 10 bits each.  Faults can be
typed while they run.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
import random
import termios

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.parameters.parameter import Value
from soft_continuum.planning.settings import MotionLimits
from soft_continuum.sim.emulators.device import (
    Command,
    device_parser,
    EmulatedDevice,
    execute,
    RANGES,
    serve,
    set_to,
)
from soft_continuum.sim.emulators.dynamixel_models import (
    BAUD_RATES,
    CURRENT_POSITION,
    MODELS,
    RETURN_DELAY_UNIT,
)
from soft_continuum.sim.emulators.dynamixel_packets import (
    ALERT,
    BROADCAST,
    Error,
    fast_blocks,
    Instruction,
    MAX_ID,
    old_status,
    OldPacketReader,
    Packet,
    PacketReader,
    status,
)
from soft_continuum.sim.emulators.dynamixel_servo import (
    DynamixelServo,
    ENCODER_ERROR,
    OVERLOAD_ERROR,
    SHOCK_ERROR,
    SpringTendon,
)

BAUD_RATE = 1000000
SPOOL_RADIUS = 0.01
"""m, of an emulated servo."""
SERVO_MODEL = 'XM430-W350'
TENSION_LIMIT, STALL_SHARE = MotionLimits.tension_limit, 0.5
"""N, limited to this share of the stall tension of the servo."""
BITS_PER_BYTE = 10
GAP = 0.05  # s without a byte after which a packet that began is given up; assumed
PING_SLOT = 0.003  # s for each ID in answer to a broadcast ping, as the maker's SDK waits
SPEEDS = {getattr(termios, name): int(name[1:]) for name in dir(termios)
          if name[0] == 'B' and name[1:].isdigit()}
SINGLE = (Instruction.PING, Instruction.READ, Instruction.WRITE, Instruction.REG_WRITE,
          Instruction.ACTION, Instruction.FACTORY_RESET, Instruction.REBOOT, Instruction.CLEAR)


class DynamixelEmulator(EmulatedDevice):
    """
    Servos at ``port``; use it in a ``with`` statement.

    Faults, to be set while it runs: ``drop`` and ``deaf`` (how many of the next answers, and of
    the next instructions, are lost), ``late`` (s that answers take besides), ``garble`` and
    ``garble_in`` (shares of answers, and of instructions, that arrive damaged).  ``transform``:
    what is sent instead of an answer.  Others are methods, or attributes of ``servos``.  While
    ``lock`` is held no time passes for the servos.
    """

    # A computer that is too slow lets the servos stand still, rather than their watchdogs end.
    MAX_LATENESS = 0.05

    def __init__(self, servos: Sequence[DynamixelServo], link: str | Path | None = None,
                 clock: Clock = STEADY, *, seed: int = 1) -> None:
        """Switch the servos on and plug the adapter in; link: where the port is always found."""
        super().__init__(link, clock)
        self.servos = list(servos)
        self.transform: Callable[[bytes], bytes] | None = None
        self.packets: list[Packet] = []
        """Every intact instruction packet that servos could receive."""
        self.random = random.Random(seed)
        self._readers = {2: PacketReader(), 1: OldPacketReader()}
        self._free = 0.0  # when the last byte of request or answer has passed
        self._heard_at = 0.0
        self.repair()
        self.plug()

    # The truth, whatever the servos answer

    @property
    def pulls(self) -> tuple[float, ...]:
        """Pull of each tendon since the start, m."""
        return self.read(lambda: tuple(servo.motor.pull for servo in self.servos))

    @property
    def moving(self) -> bool:
        """Whether a spool turns."""
        return self.read(lambda: any(servo.motor.speed for servo in self.servos))

    # Faults

    def power_cycle(self, number: int | None = None) -> None:
        """Switch one servo (0 is the first), or all, off and on."""
        def cycle() -> None:
            for servo in self.servos if number is None else [self.servos[number]]:
                servo.power_off()
                servo.power_on()
        self.read(cycle)

    def collide(self, number: int, other: int) -> None:
        """Give a servo (0 is the first) the ID of another one."""
        with self.lock:
            self.servos[number].values['ID'] = self.servos[other].values['ID']

    def repair(self) -> None:
        """Clear all faults except an unplugged adapter and those that need a reboot."""
        with self.lock:
            self.drop = self.deaf = 0
            self.late = self.garble = self.garble_in = 0.0
            self.transform = None
            for servo in self.servos:
                servo.repair()

    # Time and bytes

    def _resting(self) -> bool:
        return all(servo.resting for servo in self.servos)

    def _step(self, time: float) -> None:
        for servo in self.servos:
            servo.advance(time)

    def _take(self, data: bytes) -> None:
        if not data:
            return
        now = self.clock()
        if self.garble_in and self.random.random() < self.garble_in:
            data = self._damaged(data)
        baud_rate = SPEEDS.get(termios.tcgetattr(self._slave)[5], 0)
        for protocol, reader in self._readers.items():
            if now - self._heard_at > GAP:
                reader.clear()
            for packet in reader.feed(data):
                # The computer has written it all at once; on the wire it takes its time.
                self._free = max(now, self._free) + self._duration(packet.size, baud_rate)
                if self.deaf > 0:
                    self.deaf -= 1
                else:
                    self._carry_out(packet, protocol, baud_rate)
        self._heard_at = now

    @staticmethod
    def _duration(size: int, baud_rate: int) -> float:
        return size * BITS_PER_BYTE / baud_rate if baud_rate else 0.0

    # Reception and replies

    def _carry_out(self, packet: Packet, protocol: int, baud_rate: int) -> None:
        hearing = [servo for servo in self.servos if servo.answering
                   and BAUD_RATES[servo.values['Baud Rate']] == baud_rate
                   and (servo.values['Protocol Type'] == 1) == (protocol == 1)]
        if not hearing:
            return
        if not packet.intact:  # the ID may be wrong, too
            if packet.id <= MAX_ID:
                self._answer([(servo, (Error.CRC, b'')) for servo in hearing
                              if servo.values['ID'] == packet.id], baud_rate)
            return
        self.packets.append(packet)
        del self.packets[:-1000]
        if protocol == 1:
            self._old(packet, hearing, baud_rate)
        elif packet.instruction in SINGLE or packet.id != BROADCAST:
            self._single(packet, hearing, baud_rate)
        elif packet.instruction in (Instruction.SYNC_WRITE, Instruction.BULK_WRITE):
            self._write_many(packet, hearing)
        else:
            self._read_many(packet, hearing, baud_rate)

    def _single(self, packet: Packet, hearing: list[DynamixelServo], baud_rate: int) -> None:
        everyone, answers = packet.id == BROADCAST, []
        if everyone and packet.instruction == Instruction.FACTORY_RESET and (
                packet.parameters == b'\xff'):
            return
        for servo in hearing:
            shadow = servo.values['Secondary ID'] == packet.id
            if servo.values['ID'] == packet.id or everyone or shadow:
                answer = self._execute(servo, packet.instruction, packet.parameters)
                if answer and (not everyone or packet.instruction == Instruction.PING) and (
                        not shadow):
                    answers.append((servo, answer))
        if everyone:
            begin, slot = self._free, max(PING_SLOT, self._duration(14, baud_rate))
            for device in sorted({servo.values['ID'] for servo, _ in answers}):
                self._free = begin + slot * device
                self._answer([a for a in answers if a[0].values['ID'] == device], baud_rate)
        else:
            self._answer(answers, baud_rate, packet.id)

    def _write_many(self, packet: Packet, hearing: list[DynamixelServo]) -> None:
        rest, sync = packet.parameters, packet.instruction == Instruction.SYNC_WRITE
        address, length = rest[:2], int.from_bytes(rest[2:4], 'little')
        if sync:
            rest = rest[4:]
        while rest:
            if not sync:
                address, length = rest[1:3], int.from_bytes(rest[3:5], 'little')
                rest = rest[:1] + rest[5:]
            device, data, rest = rest[0], rest[1:1 + length], rest[1 + length:]
            for servo in hearing:
                if device in (servo.values['ID'], servo.values['Secondary ID']) and data:
                    self._execute(servo, Instruction.WRITE, address + data)

    def _read_many(self, packet: Packet, hearing: list[DynamixelServo], baud_rate: int) -> None:
        """
        Let the servos of a list answer one after the other.

        Each waits for the one before it: after one that is missing all keep silent (assumed).
        """
        given = packet.parameters
        if packet.instruction in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
            wanted = [(device, given[:4]) for device in given[4:]]
        elif packet.instruction in (Instruction.BULK_READ, Instruction.FAST_BULK_READ):
            wanted = [(given[i], given[i + 1:i + 5]) for i in range(0, len(given) - 4, 5)]
        else:
            return
        answers = []
        for device, what in wanted:
            same = [(servo, answer) for servo in hearing if servo.values['ID'] == device
                    and (answer := self._execute(servo, Instruction.READ, what))]
            if not same:
                break
            answers.append(same)
        if packet.instruction in (Instruction.SYNC_READ, Instruction.BULK_READ):
            for same in answers:
                self._answer(same, baud_rate)
        elif answers:
            length = 1 + sum(4 + int.from_bytes(what[2:], 'little') for _, what in wanted)
            blocks = fast_blocks(((same[0][0].values['ID'], *same[0][1]) for same in answers),
                                 length)
            self._put(b''.join(blocks), self._delay(answers[0][0][0]), baud_rate)

    def _old(self, packet: Packet, hearing: list[DynamixelServo], baud_rate: int) -> None:
        """Answer in Protocol 1.0: ping, read and write."""
        for servo in hearing:
            if packet.id != servo.values['ID']:
                continue
            given = packet.parameters
            if packet.instruction in (Instruction.READ, Instruction.WRITE) and len(given) > 1:
                given = given[:1] + b'\0' + given[1:]
                given += b'\0' if packet.instruction == Instruction.READ else b''
            answer = self._execute(servo, packet.instruction, given)
            if answer:
                error = 0x40 if answer[0] & ~ALERT else 0
                data = answer[1] if packet.instruction != Instruction.PING else b''
                self._put(old_status(packet.id, error, data), self._delay(servo), baud_rate)

    def _execute(self, servo: DynamixelServo, instruction: int, parameters: bytes
                 ) -> tuple[int, bytes] | None:
        servo.heard = servo.time
        return servo.execute(instruction, parameters)

    # Answers

    @staticmethod
    def _delay(servo: DynamixelServo) -> float:
        return servo.values['Return Delay Time'] * RETURN_DELAY_UNIT

    def _answer(self, answers: list[tuple[DynamixelServo, tuple[int, bytes]]], baud_rate: int,
                device: int | None = None) -> None:
        """Send the answer of a servo, or of several at once: a wire is low if any pulls it low."""
        packets = [status(servo.values['ID'] if device is None else device, *answer)
                   for servo, answer in answers]
        if not packets:
            return
        sent = packets[0]
        for other in packets[1:]:
            # Their clocks differ: one may begin a little later.
            other = b'\xff' * self.random.randint(0, 1) + other
            size = max(len(sent), len(other))
            sent = bytes(a & b for a, b in zip(sent.ljust(size, b'\xff'),
                                               other.ljust(size, b'\xff'), strict=True))
        self._put(sent, max(self._delay(servo) for servo, _ in answers), baud_rate)

    def _put(self, data: bytes, delay: float, baud_rate: int) -> None:
        self._free += delay + self._duration(len(data), baud_rate)
        if self.transform is not None:
            data = self.transform(data)
        if self.drop > 0:
            self.drop -= 1
            return
        if self.garble and self.random.random() < self.garble:
            data = self._damaged(data)
        self._later(self._free + self.late, partial(self.send, data))

    def _damaged(self, data: bytes) -> bytes:
        """Return data with a bit flipped, a byte lost, or a byte too many."""
        at = self.random.randrange(len(data))
        kind = self.random.randrange(3)
        middle = (bytes([data[at] ^ 1 << self.random.randrange(8)]) if kind == 0
                  else b'' if kind == 1 else data[at:at + 1] + bytes([self.random.randrange(256)]))
        return data[:at] + middle + data[at + 1:]


def make_servos(tendons: int, model: str, baud_rate: int = BAUD_RATE,
                mode: int = CURRENT_POSITION, signs: Sequence[int] = ()) -> list[DynamixelServo]:
    """
    Return servos with the IDs 1, 2, ... and spools of SPOOL_RADIUS, at different angles.

    mode: their operating mode.  signs: 1 where positive angles pull in, -1 where they pay out; all
    1 if there are none.
    """
    servos = [DynamixelServo(
        MODELS[model], n + 1, SpringTendon(SPOOL_RADIUS, signs[n] if signs else 1),
        baud_code=BAUD_RATES.index(baud_rate), start=700 * (n + 1) % 4096)
        for n in range(tendons)]
    for servo in servos:
        if mode in servo.model.modes:
            servo.set_up('Operating Mode', mode)
    return servos


def tension_limit(model: str) -> float:
    """Return the tension limit (N) of a servo on an emulated spool."""
    return min(TENSION_LIMIT, STALL_SHARE * MODELS[model].stall_torque / SPOOL_RADIUS)


def dynamixel_parameters(port: str | Path, tendons: int, baud_rate: int = BAUD_RATE,
                         model: str = SERVO_MODEL) -> dict[str, Value]:
    """Return the parameters of servos with the IDs 1, 2, ... at a port."""
    return {'tendon_driver': 'dynamixel', 'dynamixel.port': str(port),
            'dynamixel.baud': baud_rate,
            'dynamixel.ids': tuple(range(1, tendons + 1)),
            'dynamixel.spool_radii': (SPOOL_RADIUS,) * tendons,
            'dynamixel.signs': (1.0,) * tendons,
            'dynamixel.tension_limits': (tension_limit(model),) * tendons,
            'dynamixel.torque_constants': (0.0,) * tendons}


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
