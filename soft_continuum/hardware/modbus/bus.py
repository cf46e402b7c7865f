# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A Modbus RTU line: one request, one reply, and a pause after every error.

RTU replies carry no number, so a late reply looks like the answer to a later request.  Hence
nothing is sent twice, and a request succeeds only when exactly its reply is received in time:
unit, function, length, echo and CRC.  After anything else the line is not used until it has been
quiet for a while; ``out_of_step`` then indicates that late replies may still arrive.  Zeros around
a reply are ignored: lines without bias add some.  A write is acknowledged by its repetition, which
an adapter with a local echo also produces, so writes are only sent after an answered read.  Frames
and CRC are pymodbus's (frames.py); its client is not used, as it accepts a late reply.
"""

from collections.abc import Callable
import os
import threading
from typing import TYPE_CHECKING

import serial

from soft_continuum.extras import needed, require
from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.serial_ports import close_serial, open_serial

if TYPE_CHECKING:
    from pymodbus.pdu import ModbusPDU

PAUSE = 0.2
"""Timeouts of silence before the line is used again; doubled by each successive failure."""
SHORT_PAUSE = 0.05
"""Pauses up to this (s), and the first, are waited out: one lost reply costs one reading."""
MAX_PAUSE = 1.0
"""Pause, s; some boards need 0.5 s of silence to find the start of a request again."""
OPEN_ATTEMPTS = 2
"""A reply to a program that was killed just before may still be on its way to the first one."""
BITS_PER_CHARACTER = 11  # the longest there is; 8N1 has 10
EXCEPTION_SIZE = 5
NOTHING = b'\0'  # no reply begins with it, which is the unit of all
ECHOED = 5, 6
"""Functions whose reply repeats the request."""
MAX_DRAINED = 4096  # bytes: more than late replies can be
ECHO = ('the adapter repeats what is sent (local echo): switch its echo off, or use one that does '
        'not receive while it sends')
OVERHEAD = 5  # bytes of a reply besides what was read: unit, function, byte count, CRC
EXCEPTIONS = {
    1: 'does not support the function',
    2: 'has no such address',
    3: 'refuses the number of addresses or the value',
    4: 'reports an internal failure',
    6: 'is busy',
}


class ModbusExceptionError(HardwareError):
    """A device rejected a request."""


class ModbusBus:
    """
    Requests to the devices on one line, one at a time; for one thread, but ``close`` for any.

    Every request returns or raises HardwareError within the timeout, plus the gap between frames
    (2 to 32 ms, by baud rate) and a first or short pause; during a longer one it raises at once.
    Writing never waits.  A lost port is opened again by the next request.
    """

    def __init__(self, port: str, baud_rate: int, timeout: float, clock: Clock = STEADY) -> None:
        """Use ``port``, 8N1, once it is opened; timeout: s from a request to its whole reply."""
        with needed(HardwareError):
            require('pymodbus')  # every minor release has another interface
            from soft_continuum.hardware.modbus.frames import Frames
        self.clock = clock
        self._lock = threading.Lock()  # of all that follows, during a request
        self._port = port
        self._baud_rate = baud_rate
        self._timeout = timeout
        # The standard's 3.5 characters of silence between frames, at least 1.75 ms.
        self._gap = max(3.5 * BITS_PER_CHARACTER / baud_rate, 0.00175)
        self._frames = Frames()
        self._serial: serial.Serial | None = None
        self._opened = False  # by open(), whether or not the port is there now
        self._used_at = 0.0
        self._failures = 0  # in a row
        self._short_pause = max(SHORT_PAUSE, PAUSE * timeout)
        self._pause = 0.0
        self._paused_until = 0.0
        self._error = ''
        self._sent = b''  # the last request
        self.out_of_step = True

    def open(self) -> None:
        """Open the port; raises HardwareError with the remedy."""
        with self._lock:
            self._opened = False
            self._disconnect()
            self._failures, self._paused_until, self._error = 0, 0.0, ''
            self.out_of_step = True
            self._serial = open_serial(self._port, self._baud_rate)
            self._opened = True

    def open_with(self, read: Callable[[], object]) -> None:
        """Open the port and read once; closed again, raises HardwareError where that fails."""
        self.open()
        for attempt in range(OPEN_ATTEMPTS):
            try:
                read()
                return
            except HardwareError:
                if attempt == OPEN_ATTEMPTS - 1:
                    self.close()
                    raise

    def close(self) -> None:
        """Close the port; no request opens it again.  Waits for a request under way."""
        with self._lock:
            self._opened = False
            self._disconnect()

    def set_in_step(self) -> None:
        """Trust replies again: late ones can no longer arrive."""
        self.out_of_step = False
        self._failures = 0

    def read_coils(self, unit: int, first: int, count: int) -> tuple[bool, ...]:
        """Return ``count`` coils from ``first`` on (function 01)."""
        frame = self._frames.read(1, unit, first, count)
        reply = self._request(frame, OVERHEAD + (count + 7) // 8)
        return tuple(bool(bit) for bit in reply.bits[:count])

    def read_input_registers(self, unit: int, first: int, count: int) -> tuple[int, ...]:
        """Return ``count`` input registers from ``first`` on (function 04)."""
        frame = self._frames.read(4, unit, first, count)
        return tuple(self._request(frame, OVERHEAD + 2 * count).registers)

    def write_coil(self, unit: int, coil: int, on: bool) -> None:
        """Switch one coil (function 05); an acknowledgement does not prove that it moved."""
        if self.out_of_step:
            self.read_coils(unit, coil, 1)
        frame = self._frames.write_coil(unit, coil, on)
        self._request(frame, len(frame))

    def read_holding_registers(self, unit: int, first: int, count: int) -> tuple[int, ...]:
        """Return ``count`` holding registers from ``first`` on (function 03)."""
        frame = self._frames.read(3, unit, first, count)
        return tuple(self._request(frame, OVERHEAD + 2 * count).registers)

    def write_register(self, unit: int, register: int, value: int) -> None:
        """Write one holding register (function 06); an acknowledgement proves no more."""
        if self.out_of_step:
            self.read_holding_registers(unit, register, 1)
        frame = self._frames.write_register(unit, register, value)
        self._request(frame, len(frame))

    def _request(self, frame: bytes, size: int) -> 'ModbusPDU':
        """Send a request; return its reply of ``size`` bytes, or raise HardwareError."""
        with self._lock:
            line = self._ready_line()
            self._sent = frame
            try:
                if os.write(line.fileno(), frame) < len(frame):
                    raise OSError('it takes no more data')
                reply = self._read(line, size)
            except (OSError, ValueError):
                raise self._lost() from None
            self._used_at = self.clock()
            return self._checked(frame, reply, size)

    def _checked(self, frame: bytes, reply: bytes, size: int) -> 'ModbusPDU':
        """Return the answer to ``frame`` in ``reply``; raise HardwareError if there is none."""
        who = f'Modbus unit {frame[0]} on {self._port}'
        if not reply:
            raise self._failed(
                f'{who} does not answer within {self._timeout:g} s; check its power, the wires, '
                'its unit number and its baud rate')
        answer = self._decode(frame, reply.lstrip(NOTHING), size)
        if answer is None:
            raise self._failed(
                f'{who} sent {reply[:80].hex(" ")}, which is no reply to {frame.hex(" ")}; '
                f'{self._cause(reply)}')
        if answer.isError():
            code = answer.exception_code
            raise ModbusExceptionError(
                f'{who} {EXCEPTIONS.get(code, "refuses")} (exception {code} to function '
                f'{frame[1]:02d}, address {int.from_bytes(frame[2:4])}); compare the modbus '
                'parameters with the manual of the board')
        return answer

    def _read(self, line: serial.Serial, size: int) -> bytes:
        """Return ``size`` bytes, or what was received within the timeout."""
        deadline = self.clock() + self._timeout
        reply = b''
        while ((missing := size - len(reply.lstrip(NOTHING)))
               and self.clock.wait([line.fileno()], deadline - self.clock())):
            received = os.read(line.fileno(), missing)
            if not received:
                raise OSError('hung up')
            reply += received
        return reply

    def _cause(self, received: bytes) -> str:
        """Return the probable cause of unexpected bytes, and the remedy."""
        if received.startswith(self._sent) or self._sent.startswith(received):
            return ECHO
        if not received.strip(NOTHING):
            return 'check the wires (A, B and ground) and the termination and bias of the line'
        return ('check the wires and their termination, the baud rate, modbus.timeout (a device '
                'may answer later), and that no other program or controller uses the bus')

    def _decode(self, frame: bytes, reply: bytes, size: int) -> 'ModbusPDU | None':
        """Return the reply if it is one to this request and nothing besides."""
        unit, function = frame[:2]
        if (reply[:2] == bytes([unit, function | 0x80]) and len(reply) >= EXCEPTION_SIZE
                and not reply[EXCEPTION_SIZE:].strip(NOTHING)):
            expected, reply = True, reply[:EXCEPTION_SIZE]
        elif function in ECHOED:
            expected = reply == frame
        else:
            expected = len(reply) == size and reply[:3] == bytes([unit, function, size - OVERHEAD])
        return self._frames.decode(reply, unit) if expected else None

    def _ready_line(self) -> serial.Serial:
        """Return the line when it is open and not paused; raise HardwareError otherwise."""
        if not self._opened:
            raise HardwareError(f'serial port {self._port} is not open; configure the node')
        line = self._serial = self._serial or open_serial(self._port, self._baud_rate)
        if self._paused_until - self._short_pause <= self.clock():
            self.clock.sleep(self._paused_until - self.clock())
        try:
            unrequested = self._drain(line)
        except (OSError, ValueError):
            raise self._lost() from None
        if unrequested.strip(NOTHING) and not self._error:
            raise self._failed(
                f'{self._port}: {unrequested[:80].hex(" ")} was received without a request; '
                f'{self._cause(unrequested)}')
        if unrequested:
            self._paused_until = self.clock() + self._pause
        if self.clock() + self._short_pause < self._paused_until:
            raise HardwareError(f'{self._error} (waiting until the line is quiet)')
        self._error = ''
        self.clock.sleep(self._used_at + self._gap - self.clock())
        return line

    def _drain(self, line: serial.Serial) -> bytes:
        """Return what was received, as far as it is no endless stream."""
        received = b''
        # Linux hands over what its driver has sorted in so far: one read may not be all.
        while len(received) < MAX_DRAINED and self.clock.wait([line.fileno()], 0.0):
            part = os.read(line.fileno(), MAX_DRAINED)
            if not part:
                raise OSError('hung up')
            received += part
        return received

    def _failed(self, message: str) -> HardwareError:
        """Pause the line, and return the error to raise."""
        shortest = PAUSE * self._timeout
        self._pause = max(shortest, min(shortest * 2 ** self._failures, MAX_PAUSE))
        self._failures = min(self._failures + 1, 10)  # enough for any timeout
        self._paused_until = self.clock() + self._pause
        self._error = message
        self.out_of_step = True
        return HardwareError(message)

    def _disconnect(self) -> None:
        line, self._serial = self._serial, None
        if line is not None:
            close_serial(line)

    def _lost(self) -> HardwareError:
        self._disconnect()
        return self._failed(
            f'serial port {self._port}: the connection is lost; check the cable and the power of '
            'the adapter; the port is opened again automatically')
