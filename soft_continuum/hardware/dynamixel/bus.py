# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
One bus of Dynamixel servos: requests and their validated replies.

A reply counts only if its CRC, ID, length and order match the request. Every request waits for its
reply, a few milliseconds; so one thread owns a bus.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
import contextlib
from dataclasses import dataclass
from pathlib import Path
import termios
from typing import Any, Self

from soft_continuum.extras import needed
from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.dynamixel.registers import Register
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.serial_tendons import SerialLink

REPLY_TIME, SEARCH_TIME = 0.15, 0.03
"""Time limits of replies, s: to requests to one servo, and in searches."""
REPLY_GAP = 0.004
"""Time after a reply in which a second servo of the same ID would also reply, s."""
ALERT = 0x80
"""Bit of the error of a reply: the servo has a hardware error."""
BROADCAST, LAST_ID = 0xFE, 0xFC
TURN_TIME = 0.003  # s that a servo gives each lower ID before it answers a ping to everybody
STATUS_OVERHEAD = 11  # bytes of a reply without its data
FAST_OVERHEAD = 4  # bytes around the data of each servo in the reply to a fast sync read
PROTOCOL_1_PING = 0x01
TIMED_OUT = -3001  # COMM_RX_TIMEOUT of the SDK
REASONS = {
    1: 'the instruction failed', 2: 'it does not support the instruction',
    3: 'the request was damaged', 4: 'the value is out of range', 5: 'the data are too short',
    6: 'the value is beyond a limit', 7: 'the register cannot be written now'}
"""Errors in replies, e-Manual, Protocol 2.0, status packet."""


class NoReplyError(HardwareError):
    """No reply was received in time."""


class DamagedReplyError(HardwareError):
    """The received bytes are not a reply to the request."""


class ServoRejectedError(HardwareError):
    """A servo rejected the request."""


@dataclass(frozen=True)
class Reply:
    """Data of one servo; alert: whether it has a hardware error."""

    data: bytes
    alert: bool


class DynamixelBus(SerialLink):
    """An open port with servos behind it; for one thread, but ``wake`` and ``abort``."""

    DEVICE, IS, HAS = 'the Dynamixel servos', 'are', 'have'

    def __init__(self, port: str, baud_rate: int, clock: Clock = STEADY) -> None:
        """Open a port that no other program may open until it is closed."""
        with needed(HardwareError):
            from soft_continuum.hardware.dynamixel.packets import Packets, Port
        super().__init__(port, baud_rate, clock)
        self._port = Port(self.line, clock)
        self._packets = Packets()
        self.fast: bool | None = None
        """Whether all servos support Fast Sync Read; None: not tried."""

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Self:
        """Open the port that the parameters of the node describe."""
        return cls(values['dynamixel.port'], values['dynamixel.baud'])

    @property
    def baud_rate(self) -> int:
        """Speed of the port, bits/s."""
        return int(self._port.baudrate)

    @baud_rate.setter
    def baud_rate(self, bits: int) -> None:
        try:
            self._port.set_speed(bits)
        except (OSError, ValueError) as error:
            raise HardwareError(f'{self.name} does not support {bits} baud ({error})') from None

    # One servo.

    def ping(self, servo: int, reply_time: float = REPLY_TIME) -> int:
        """
        Return the model number of a servo; reply_time: s that it may take.

        Raises DamagedReplyError when more than one servo replied: two servos have this ID.
        """
        data = self._ask(servo, 0x01, b'', 3, reply_time).data
        self._port.setPacketTimeoutMillis(1e3 * REPLY_GAP)
        if self._received():
            raise DamagedReplyError(f'more than one servo replied to the ID {servo}')
        return int.from_bytes(data[:2], 'little')

    def read(self, servo: int, register: Register) -> int:
        """Return the value of a register."""
        reply = self.read_bytes(servo, register.address, register.size)
        return register.decode(reply.data)

    def read_bytes(self, servo: int, address: int, length: int) -> Reply:
        """Return a part of the control table."""
        request = address.to_bytes(2, 'little') + length.to_bytes(2, 'little')
        return self._ask(servo, 0x02, request, length)

    def write(self, servo: int, register: Register, value: int) -> None:
        """Write a register; raises ServoRejectedError when the servo does not take the value."""
        self._ask(servo, 0x03, register.address.to_bytes(2, 'little') + register.encode(value), 0)

    def reboot(self, servo: int) -> None:
        """Restart a servo, which loses its torque and turn count, and clears its error."""
        self._ask(servo, 0x08, b'', 0)

    def pings_in_protocol_1(self, servo: int) -> bool:
        """Whether a servo answers in Protocol 1, with another checksum and header."""
        check = ~(servo + 2 + PROTOCOL_1_PING) & 0xFF
        self._send(bytes((0xFF, 0xFF, servo, 2, PROTOCOL_1_PING, check)))
        self._port.setPacketTimeout(12)
        reply = self._received(6)
        return (len(reply) == 6 and reply[:4] == bytes((0xFF, 0xFF, servo, 2))
                and reply[5] == ~sum(reply[2:5]) & 0xFF)

    def _ask(self, servo: int, instruction: int, parameters: bytes, length: int,
             reply_time: float = REPLY_TIME) -> Reply:
        """Send an instruction; return the reply, which must have ``length`` bytes of data."""
        self._transmit(servo, instruction, parameters)
        self._port.setPacketTimeoutMillis(1e3 * reply_time)
        packet = self._packet(servo, length + STATUS_OVERHEAD)
        if code := packet[8] & ~ALERT:
            raise ServoRejectedError(
                f'servo {servo} refuses: {REASONS.get(code, f"error {code}")}')
        return Reply(packet[9:-2], bool(packet[8] & ALERT))

    # All servos at once.

    def sync_read(self, servos: Sequence[int], first: int, end: int) -> list[Reply]:
        """
        Return the bytes from address ``first`` to before ``end`` of every servo, in their order.

        Raises NoReplyError or DamagedReplyError when one of the replies is missing or wrong.
        """
        length = end - first
        self._checked(lambda: self._packets.syncReadTx(
            self._port, first, length, list(servos), len(servos), self.fast))
        if self.fast:
            return self._fast_replies(servos, length)
        self._port.setPacketTimeout((STATUS_OVERHEAD + length) * len(servos))
        replies = []
        for servo in servos:
            packet = self._packet(servo, length + STATUS_OVERHEAD)
            replies.append(Reply(packet[9:-2], bool(packet[8] & ALERT)))
        return replies

    def _fast_replies(self, servos: Sequence[int], length: int) -> list[Reply]:
        """Receive one packet in which each servo has written its part."""
        share = length + FAST_OVERHEAD  # error, ID, data, and the CRC up to there
        total = 8 + share * len(servos)
        self._port.setPacketTimeout(total)
        packet = self._packet(BROADCAST, total, fast=True)
        replies = []
        for i, servo in enumerate(servos):
            part = packet[8 + i * share:][:share]
            if part[1] != servo:
                raise DamagedReplyError(f'{self.name}: servo {part[1]} replied as {servo}')
            replies.append(Reply(part[2:2 + length], bool(part[0] & ALERT)))
        return replies

    def sync_write(self, register: Register, values: Mapping[int, int]) -> None:
        """Write a register of several servos at once, without any acknowledgement."""
        data = [byte for servo, value in values.items()
                for byte in (servo, *register.encode(value))]
        self._checked(lambda: self._packets.syncWriteTxOnly(
            self._port, register.address, register.size, data, len(data)))

    def find(self, servos: Iterable[int]) -> list[int]:
        """Return which of these IDs reply, whatever their state."""
        found = []
        for servo in servos:
            with contextlib.suppress(NoReplyError):
                try:
                    self.ping(servo, SEARCH_TIME)
                except DamagedReplyError:
                    continue
                found.append(servo)
        return found

    def find_all(self) -> list[int]:
        """Return the IDs that reply to a broadcast ping; takes 1 to 4 s."""
        self._transmit(BROADCAST, 0x01, b'')
        self._port.setPacketTimeoutMillis(
            1e3 * LAST_ID * (TURN_TIME + (STATUS_OVERHEAD + 3) * self._port.tx_time_per_byte))
        found = set()
        while not self._port.isPacketTimeout():
            packet, result = self._next_packet()
            if result == 0:
                found.add(packet[4])
        return sorted(found)

    # Packets.

    def _transmit(self, servo: int, instruction: int, parameters: bytes) -> None:
        size = len(parameters) + 3
        packet = [0, 0, 0, 0, servo, size & 0xFF, size >> 8, instruction, *parameters, 0, 0]
        self._checked(lambda: self._packets.txPacket(self._port, packet))

    def _send(self, data: bytes) -> None:
        self._checked(lambda: 0 if self._port.writePort(data) == len(data) else -1)

    def _checked(self, send: Callable[[], int]) -> None:
        self.check_open()
        try:
            result = send()
        except (OSError, ValueError, termios.error) as error:
            raise self.lost(error) from None
        if result != 0:
            raise self.lost('it takes no more data')

    def _packet(self, servo: int, size: int, fast: bool = False) -> bytes:
        """Return the next packet, which must be a reply of ``size`` bytes from a servo."""
        received, result = self._next_packet(fast)
        who = 'the servos' if fast else f'servo {servo}'
        if result == TIMED_OUT:
            raise NoReplyError(f'no reply from {who} on {self.name}')
        wanted = size if fast else received[5] + 256 * received[6] + 7 if len(received) > 7 else 0
        if result != 0 or received[4] != servo or len(received) < size or wanted != size:
            raise DamagedReplyError(f'the reply from {who} on {self.name} is damaged')
        return received[:size]

    def _next_packet(self, fast: bool = False) -> tuple[bytes, int]:
        """Return what came until the timeout that was set, and 0 if that is a whole packet."""
        try:
            packet, result = self._packets.rxPacket(self._port, fast)
        except (OSError, ValueError, termios.error) as error:
            raise self.lost(error) from None
        return bytes(packet), result

    def _received(self, length: int = 64) -> bytes:
        """Return what is received within the timeout that was set."""
        data = b''
        try:
            while len(data) < length and not self._port.isPacketTimeout():
                data += self._port.readPort(length - len(data))
        except (OSError, ValueError, termios.error) as error:
            raise self.lost(error) from None
        return data


def latency_timer(port: str) -> int | None:
    """Return the latency timer (ms) of a USB adapter (FTDI); None if unknown."""
    with contextlib.suppress(OSError, ValueError):
        return int(Path('/sys/class/tty', Path(port).resolve().name, 'device', 'latency_timer'
                        ).read_text())
    return None
