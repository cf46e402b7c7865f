# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Two Modbus RTU boards and the vacuum rig behind them, on a pseudo-terminal.

A relay board (coil 0 is the pump, coil N the valve of segment N, which evacuates when on) and an
analog board (input register N - 1 is the current of the transmitter of segment N in uA, 4 mA at
ambient pressure and 20 mA at 100 kPa below).  A rig with regulators has, in place of the relay
board, an analog output board: holding register N - 1 is the set-point of the regulator of segment
N as a current in uA, 4 mA for no vacuum and 20 mA for 100 kPa.  It shares no code with the driver,
so that each checks the other.  Every fault of a rig can be switched on,
or typed while it runs.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
import random
import struct

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.protocols import JammingReading
from soft_continuum.hardware.simulated_jamming import (
    JammingPlant,
    SimulatedJamming,
    SimulatedRegulators,
)
from soft_continuum.parameters.parameter import Value
from soft_continuum.sim.emulators.device import (
    Command,
    device_parser,
    EmulatedDevice,
    execute,
    RANGES,
    serve,
    set_to,
)

RELAY_UNIT, ANALOG_UNIT, OUTPUT_UNIT = 1, 2, 3
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
FULL_SCALE = 100e3  # Pa of vacuum at 20 mA
LOW, HIGH = 4000, 20000  # uA
DEAD_BAND = 300.0  # Pa, of a regulator
FRAME_GAP = 0.005  # s without a byte that end a frame
IDLE_STEP = 0.05  # s
BITS_PER_CHARACTER = 10
TIMEOUT = 0.4  # s: boards that share a processor with a plant answer later than real ones


def crc(data: bytes) -> bytes:
    """Return the checksum of a frame as it is sent, the low byte first."""
    remainder = 0xFFFF
    for byte in data:
        remainder ^= byte
        for _ in range(8):
            remainder = remainder >> 1 ^ (0xA001 if remainder & 1 else 0)
    return struct.pack('<H', remainder)


class Transmitter:
    """A pressure transmitter of one segment, which may fail."""

    broken_wire = False
    stuck_at: int | None = None  # uA

    def read(self) -> JammingReading:
        """Return the state of the segment."""
        raise NotImplementedError

    @property
    def vacuum(self) -> float:
        """Vacuum of the segment, Pa below ambient."""
        return JammingPlant().ambient_pressure - self.read().pressures[0]

    def current(self) -> int:
        """Return the current of the transmitter, uA."""
        if self.broken_wire:
            return 0
        if self.stuck_at is not None:
            return self.stuck_at
        return round(LOW + (HIGH - LOW) * self.vacuum / FULL_SCALE)


class EmulatedSegment(SimulatedJamming, Transmitter):
    """One segment with a pump of its own; it may leak."""

    def __init__(self, clock: Clock, initially_stiff: bool) -> None:
        """Start evacuated or soft."""
        super().__init__(clock, 1, JammingPlant(), initially_stiff)

    def set_leak(self, rate: float) -> None:
        """Lose ``rate`` Pa/s more than a tight segment."""
        self._advance()
        tight = JammingPlant()
        self._plant = replace(
            tight, leak_rate=tight.leak_rate + rate,
            ultimate_vacuum=max(0.0, tight.ultimate_vacuum - rate * tight.evacuation_time))


class RegulatedSegment(SimulatedRegulators, Transmitter):
    """One segment with a regulator, which may hang, or have a supply that is too weak."""

    def __init__(self, clock: Clock, initially_stiff: bool) -> None:
        """Start with the largest vacuum or none; 20 mA are more than the supply gives."""
        super().__init__(clock, 1, JammingPlant(), initially_stiff, max_vacuum=80e3,
                         dead_band=DEAD_BAND)
        self.hangs = False
        self.output = LOW  # uA
        self.output = round(LOW + (HIGH - LOW) * self.read().vacuums[0] / FULL_SCALE)

    def set_output(self, current: int) -> None:
        """Take a current from the output board, uA."""
        self.output = current
        if not self.hangs:
            self.set_vacuum(0, max(0.0, (current - LOW) / (HIGH - LOW) * FULL_SCALE))

    def set_leak(self, rate: float) -> None:
        """Lose so much air, Pa/s, that the supply no longer makes up for all of it."""
        self._advance()
        tight = JammingPlant()
        self._plant = replace(tight, ultimate_vacuum=max(
            0.0, tight.ultimate_vacuum - rate * tight.evacuation_time))
        self._vacuum = [min(self._vacuum[0], self._plant.ultimate_vacuum)]


class Refusal(Exception):
    """A request that is answered by an exception; the argument is its code."""


class ModbusEmulator(EmulatedDevice):
    """
    The boards; faults may be set at any time.

    Segments count from 0 here.  hang: answer nothing.  late: s by which every reply is late.
    drop, garble: share of replies that are lost or damaged.  echo: the adapter receives what it
    sends.  zeros: so many end every reply.  refuse: exception code that answers
    everything, 0 for none.  transform: what is sent instead of a reply.  stuck: coils, or
    outputs, that do not follow.  A reply has the state at the time of its request, however late
    it is.
    """

    def __init__(self, segments: int = 3, *, initially_stiff: bool = False,
                 link: str | Path | None = None, baud_rate: int = 0, seed: int = 0,
                 clock: Clock = STEADY, regulators: bool = False) -> None:
        """
        Make the rig.

        link: path of a symbolic link to the port.  baud_rate: 0 for no delay.  clock: the time in
        which it answers, evacuates and vents.  regulators: in place of pump and valves.
        """
        super().__init__(link, clock)
        self.transform: Callable[[bytes], bytes] | None = None
        self.stuck: set[int] = set()
        self.requests: list[bytes] = []
        """Every request to one of the boards, as received."""
        self.regulators = regulators
        kind = RegulatedSegment if regulators else EmulatedSegment
        self.segments: list[EmulatedSegment | RegulatedSegment] = [
            kind(clock, initially_stiff) for _ in range(segments)]
        self._coils = [] if regulators else [initially_stiff] * (segments + 1)
        self._boards = {ANALOG_UNIT: self._analog_board, **(
            {OUTPUT_UNIT: self._output_board} if regulators else {RELAY_UNIT: self._relay_board})}
        self._baud_rate = baud_rate
        self._random = random.Random(seed)
        self._received, self._received_at = b'', 0.0
        self._last_due = dict.fromkeys(self._boards, 0.0)
        self.repair()  # sets all faults to none

    @property
    def coils(self) -> tuple[bool, ...]:
        """States of the relays: the pump, then the valves."""
        with self.lock:
            return tuple(self._coils)

    def vacuum(self, segment: int) -> float:
        """Return the true vacuum of a segment, Pa below ambient."""
        with self.lock:
            return self.segments[segment].vacuum

    @property
    def outputs(self) -> tuple[int, ...]:
        """Currents from the output board to the regulators, uA; empty without one."""
        with self.lock:
            return tuple(segment.output for segment in self.segments
                         if isinstance(segment, RegulatedSegment))

    def power_cycle(self) -> None:
        """Power-cycle a board: its relays release, its outputs fall to 4 mA."""
        for coil in range(len(self._coils)):
            self._set_coil(coil, False)
        for number in range(len(self.outputs)):
            self._set_output(number, LOW)

    def hang_regulator(self, segment: int) -> None:
        """Make a regulator keep its present set-point, whatever it is set to."""
        with self.lock:
            found = self.segments[segment]
            if not isinstance(found, RegulatedSegment):
                raise ValueError('this rig has valves; start it with --regulators')
            found.hangs = True

    def stick_sensor(self, segment: int) -> None:
        """Freeze a transmitter at its present current."""
        with self.lock:
            self.segments[segment].stuck_at = self.segments[segment].current()

    def repair(self) -> None:
        """Clear all faults except an unplugged adapter."""
        with self.lock:
            self.hang, self.late, self.drop, self.garble, self.refuse = False, 0.0, 0.0, 0.0, 0
            self.transform, self.echo, self.zeros = None, False, 0
            self.stuck.clear()
            for segment in self.segments:
                segment.broken_wire, segment.stuck_at = False, None
                segment.set_leak(0.0)
                if isinstance(segment, RegulatedSegment):
                    segment.hangs = False
                    segment.set_output(segment.output)

    # The line.

    def _pause(self) -> float:
        return FRAME_GAP if self._received else IDLE_STEP

    def _take(self, data: bytes) -> None:
        if data:
            if self.echo:
                self.send(data)
            self._received, self._received_at = self._received + data, self.clock()
        gap = self.clock() - self._received_at > FRAME_GAP or self._master < 0
        self._received = self._answer_all(self._received, gap)

    def _answer_all(self, received: bytes, gap: bool) -> bytes:
        """Answer the whole frames in ``received``; return the rest, which a gap discards."""
        while len(received) >= 4:
            size = 8
            if received[1] == 0x0F and len(received) > 6:
                size = 9 + received[6]
            elif received[1] not in (1, 3, 4, 5, 6):
                size = len(received) if gap else len(received) + 1
            if len(received) < size:
                break
            frame, received = received[:size], received[size:]
            if crc(frame[:-2]) != frame[-2:]:
                return b''
            self._answer(frame)
        return b'' if gap else received

    def _answer(self, request: bytes) -> None:
        if request[0] not in self._boards:
            return
        self.requests.append(request)
        if self.hang:
            return
        reply = self._reply(request)
        if self.transform is not None:
            reply = self.transform(reply)
        if self._random.random() < self.drop:
            return
        if reply and self._random.random() < self.garble:
            damaged = self._random.randrange(len(reply))
            flipped = reply[damaged] ^ 1 << self._random.randrange(8)
            reply = reply[:damaged] + bytes([flipped]) + reply[damaged + 1:]
        reply += bytes(self.zeros)
        late = self.late
        if self._baud_rate:
            # Request, reply and the silence of 3.5 characters between them.
            characters = len(request) + len(reply) + 3.5
            late += characters * BITS_PER_CHARACTER / self._baud_rate
        # A board replies in the order of its requests, but may overtake the other board.
        due = self._last_due[request[0]] = max(self._last_due[request[0]], self.clock() + late)
        self._later(due, partial(self.send, reply))

    # The boards.

    def _reply(self, request: bytes) -> bytes:
        unit, function = request[:2]
        try:
            if self.refuse:
                raise Refusal(self.refuse)
            answer = self._boards[unit](function, request[2:-2])
            reply = bytes([unit, function]) + answer
        except Refusal as refusal:
            reply = bytes([unit, function | 0x80, *refusal.args])
        return reply + crc(reply)

    def _relay_board(self, function: int, data: bytes) -> bytes:
        if function not in (1, 5, 0x0F):
            raise Refusal(ILLEGAL_FUNCTION)
        first, value = struct.unpack('>HH', data[:4])
        if function == 5:
            if value not in (0, 0xFF00):
                raise Refusal(ILLEGAL_VALUE)
            self._check(first, 1, len(self._coils))
            self._set_coil(first, value != 0)
            return data
        if not 1 <= value <= 2000:
            raise Refusal(ILLEGAL_VALUE)
        self._check(first, value, len(self._coils))
        if function == 1:
            bits = sum(on << i for i, on in enumerate(self._coils[first:first + value]))
            return bytes([(value + 7) // 8]) + bits.to_bytes((value + 7) // 8, 'little')
        if data[4] != (value + 7) // 8 or len(data) != 5 + data[4]:
            raise Refusal(ILLEGAL_VALUE)
        bits = int.from_bytes(data[5:], 'little')
        for i in range(value):
            self._set_coil(first + i, bool(bits >> i & 1))
        return data[:4]

    def _analog_board(self, function: int, data: bytes) -> bytes:
        if function != 4:
            raise Refusal(ILLEGAL_FUNCTION)
        return self._registers(data, [segment.current() for segment in self.segments])

    def _output_board(self, function: int, data: bytes) -> bytes:
        if function == 3:
            return self._registers(data, self.outputs)
        if function != 6:
            raise Refusal(ILLEGAL_FUNCTION)
        register, value = struct.unpack('>HH', data)
        self._check(register, 1, len(self.segments))
        if not LOW <= value <= HIGH:
            raise Refusal(ILLEGAL_VALUE)
        self._set_output(register, value)
        return data

    def _set_output(self, number: int, current: int) -> None:
        with self.lock:
            segment = self.segments[number]
            if number not in self.stuck and isinstance(segment, RegulatedSegment):
                segment.set_output(current)

    def _registers(self, data: bytes, values: Sequence[int]) -> bytes:
        """Return the reply to a request for registers that have these values."""
        first, count = struct.unpack('>HH', data)
        if not 1 <= count <= 125:
            raise Refusal(ILLEGAL_VALUE)
        self._check(first, count, len(values))
        return struct.pack(f'>B{count}H', 2 * count, *values[first:first + count])

    @staticmethod
    def _check(first: int, count: int, size: int) -> None:
        if first + count > size:
            raise Refusal(ILLEGAL_ADDRESS)

    def _set_coil(self, coil: int, on: bool) -> None:
        with self.lock:
            if coil in self.stuck:
                return
            self._coils[coil] = on
            valves = [s for s in self.segments if isinstance(s, EmulatedSegment)]
            if coil > 0:
                valves[coil - 1].set_evacuated(0, on)
            else:
                for segment in valves:
                    segment.set_pump(on)


def modbus_parameters(port: str | Path) -> dict[str, Value]:
    """Return the parameters of valves and sensors at a port."""
    return {'jamming_driver': 'modbus', 'modbus.port': str(port),
            'modbus.timeout': TIMEOUT}


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
