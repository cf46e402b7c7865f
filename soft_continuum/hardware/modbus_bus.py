# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The only owner of a Modbus RTU line: one request, one reply, and silence after all that is wrong.

RTU replies carry no number, so a reply that comes late looks like the answer to a later request.
Hence nothing is sent twice, and a request succeeds only when exactly its reply comes back in time:
unit, function, length, echo and CRC.  After anything else the line is left alone until it has been
silent for a while; ``out_of_step`` then tells the user of the bus that late replies may still be
on their way.  Frames and CRC are pymodbus's; its client is not used, as it takes the late reply.
"""

import termios
from time import monotonic, sleep

from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.bit_message import ReadCoilsRequest, WriteSingleCoilRequest
from pymodbus.pdu.register_message import ReadInputRegistersRequest
import serial

from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.serial_ports import open_serial

QUIET = 2.0
"""Timeouts of silence before the line is used again; doubled by each failure in a row."""
LONGEST_QUIET = 1.0
"""s; some boards need 0.5 s without a byte to find the beginning of a request again."""
BITS_PER_CHARACTER = 11  # the longest there is; 8N1 has 10
EXCEPTION_SIZE = 5
OVERHEAD = 5  # bytes of a reply besides what was read: unit, function, byte count, CRC
EXCEPTIONS = {
    1: 'does not know the function',
    2: 'has no such address',
    3: 'refuses the number of addresses or the value',
    4: 'has failed inside',
    6: 'is busy',
}


class RefusedError(HardwareError):
    """A device answered, in time, that it will not do what it was asked."""


class ModbusBus:
    """
    Requests to the devices on one line, one at a time; for one thread.

    Every request returns or raises HardwareError within the timeout (plus the few milliseconds of
    silence between frames), at once while the line must stay silent.  A port that has gone is
    opened again by the next request.
    """

    def __init__(self, port: str, baud_rate: int, timeout: float) -> None:
        """Use ``port``, 8N1, once it is opened; timeout: s from a request to its whole reply."""
        self._port = port
        self._baud_rate = baud_rate
        self._timeout = timeout
        # The standard's 3.5 characters of silence between frames, at least 1.75 ms.
        self._gap = max(3.5 * BITS_PER_CHARACTER / baud_rate, 0.00175)
        self._framer = FramerRTU(DecodePDU(is_server=False))
        self._serial: serial.Serial | None = None
        self._opened = False  # by open(), whether or not the port is there now
        self._used_at = 0.0
        self._failures = 0  # in a row
        self._quiet = 0.0
        self._quiet_until = 0.0
        self._trouble = ''
        self.out_of_step = True

    def open(self) -> None:
        """Open the port; raises HardwareError that says what to do."""
        self.close()
        self._failures, self._quiet_until, self._trouble = 0, 0.0, ''
        self.out_of_step = True
        self._connect()
        self._opened = True

    def close(self) -> None:
        """Close the port; no request opens it again."""
        self._opened = False
        self._disconnect()

    def set_in_step(self) -> None:
        """Trust the replies again: none that is late can come any more."""
        self.out_of_step = False
        self._failures = 0

    def read_coils(self, unit: int, first: int, count: int) -> tuple[bool, ...]:
        """Return ``count`` coils from ``first`` on (function 01)."""
        request = ReadCoilsRequest(address=first, count=count, dev_id=unit)
        reply = self._request(request, OVERHEAD + (count + 7) // 8)
        return tuple(bool(bit) for bit in reply.bits[:count])

    def read_input_registers(self, unit: int, first: int, count: int) -> tuple[int, ...]:
        """Return ``count`` input registers from ``first`` on (function 04)."""
        request = ReadInputRegistersRequest(address=first, count=count, dev_id=unit)
        return tuple(self._request(request, OVERHEAD + 2 * count).registers)

    def write_coil(self, unit: int, coil: int, on: bool) -> None:
        """Switch one coil (function 05); that it was acknowledged does not say that it moved."""
        request = WriteSingleCoilRequest(address=coil, bits=[on], dev_id=unit)
        self._request(request, len(self._framer.buildFrame(request)))

    def _request(self, request: ModbusPDU, size: int) -> ModbusPDU:
        """Send a request; return its reply of ``size`` bytes, or raise HardwareError."""
        line = self._ready_line()
        frame = self._framer.buildFrame(request)
        try:
            line.write(frame)
            reply = bytes(line.read(size))
        except (OSError, termios.error):
            raise self._lost() from None
        self._used_at = monotonic()
        who = f'Modbus unit {request.dev_id} on {self._port}'
        if not reply:
            raise self._failed(
                f'{who} does not answer within {self._timeout:g} s; check its power, the wires, '
                'its unit number and its baud rate')
        answer = self._decode(frame, reply, size)
        if answer is None:
            raise self._failed(
                f'{who} sent {reply.hex(" ")}, which does not answer {frame.hex(" ")}; check the '
                'wires and their termination, the baud rate, modbus.timeout, and that no other '
                'program or controller uses the bus')
        if answer.isError():
            code = answer.exception_code
            raise RefusedError(
                f'{who} {EXCEPTIONS.get(code, "refuses")} (exception {code} to function '
                f'{request.function_code:02d}, address {request.address}); compare the modbus '
                'parameters with the manual of the board')
        return answer

    def _decode(self, frame: bytes, reply: bytes, size: int) -> ModbusPDU | None:
        """Return the reply if it is one to this request and nothing besides."""
        unit, function = frame[:2]
        if len(reply) == EXCEPTION_SIZE and reply[:2] == bytes([unit, function | 0x80]):
            expected = True
        elif function == WriteSingleCoilRequest.function_code:
            expected = reply == frame
        else:
            expected = len(reply) == size and reply[:3] == bytes([unit, function, size - OVERHEAD])
        return self._framer.handleFrame(reply, unit, 0)[1] if expected else None

    def _ready_line(self) -> serial.Serial:
        """Return the line when it is open and silent; raise HardwareError when it is not."""
        if not self._opened:
            raise HardwareError(f'serial port {self._port} is not open; configure the node')
        line = self._serial or self._connect()
        try:
            unasked = bytes(line.read(line.in_waiting))
        except (OSError, termios.error):
            raise self._lost() from None
        if unasked and not self._trouble:
            raise self._failed(
                f'{self._port}: {unasked.hex(" ")} came without a request; a device answers later '
                'than modbus.timeout, or another program or controller uses the bus')
        if unasked:
            self._quiet_until = monotonic() + self._quiet
        if monotonic() < self._quiet_until:
            raise HardwareError(f'{self._trouble} (waiting until the line is silent)')
        self._trouble = ''
        sleep(max(0.0, self._used_at + self._gap - monotonic()))
        return line

    def _failed(self, message: str) -> HardwareError:
        """Leave the line alone for a while, and return the error to raise."""
        shortest = QUIET * self._timeout
        self._quiet = max(shortest, min(shortest * 2 ** self._failures, LONGEST_QUIET))
        self._failures = min(self._failures + 1, 10)  # long enough for any timeout
        self._quiet_until = monotonic() + self._quiet
        self._trouble = message
        self.out_of_step = True
        return HardwareError(message)


    def _connect(self) -> serial.Serial:
        self._serial = open_serial(self._port, self._baud_rate, timeout=self._timeout,
                                   write_timeout=self._timeout)
        return self._serial

    def _disconnect(self) -> None:
        if self._serial is not None:
            self._serial.close()
            self._serial = None

    def _lost(self) -> HardwareError:
        self._disconnect()
        return self._failed(
            f'serial port {self._port}: the connection is lost; check the cable and the power of '
            'the adapter; the port is opened again by itself')
