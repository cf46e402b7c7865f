# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Replacements for parts of the ROBOTIS SDK (dynamixel-sdk 4.1.0) that do not suit this driver.

Its port can be opened by two programs, keeps the processor busy while it waits for a reply, and
measures timeouts with a clock that can be set.  Its packet handler stuffs the bytes FF FF FD in a
copy that it then does not send.  Only this module imports the SDK, and only drivers that use
Dynamixel servos import it.
"""

from typing import cast

from dynamixel_sdk import COMM_SUCCESS, COMM_TX_FAIL, PortHandler, Protocol2PacketHandler
import serial

from soft_continuum.hardware.clock import Clock

MAX_LATE_READS = 8  # after the timeout, of what a busy computer has not read in time
REPLY_TIME = 0.03
"""s for a reply beyond its own duration: the latency timer of FTDI adapters is 16 ms."""


class Port(PortHandler):  # type: ignore[misc]
    """An open serial port with the SDK's interface, on our clock; it sleeps while it waits."""

    def __init__(self, line: serial.Serial, clock: Clock) -> None:
        """Use an open ``line``."""
        super().__init__(line.port)
        line.timeout = 0
        self.ser, self.clock, self.is_open = line, clock, True
        self._deadline, self._late_reads = 0.0, 0
        self.reply_time = REPLY_TIME
        self.set_speed(line.baudrate)

    def set_speed(self, baud_rate: int) -> None:
        """Talk at another speed, bits/s."""
        self.ser.baudrate = self.baudrate = baud_rate
        self.tx_time_per_byte = 10.0 / baud_rate  # s: start, 8 bits, stop

    def readPort(self, length: int) -> bytes:  # noqa: N802 - named by the SDK
        """Return at most ``length`` bytes, as soon as there are any, or none at the timeout."""
        if length <= 0:
            return b''
        self.clock.wait([self.ser.fileno()], self._deadline - self.clock())
        return cast('bytes', self.ser.read(length))

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        """Start the timeout of a reply with so many bytes."""
        self.setPacketTimeoutMillis(
            1e3 * (self.tx_time_per_byte * packet_length + self.reply_time))

    def setPacketTimeoutMillis(self, msec: float) -> None:  # noqa: N802
        """Start a timeout, ms."""
        self._deadline, self._late_reads = self.clock() + 1e-3 * msec, 0

    def isPacketTimeout(self) -> bool:  # noqa: N802
        """Whether the timeout is over and all bytes received within it were read."""
        if self.clock() < self._deadline:
            return False
        self._late_reads += 1
        return self._late_reads > MAX_LATE_READS or not self.clock.wait([self.ser.fileno()], 0.0)


class Packets(Protocol2PacketHandler):  # type: ignore[misc]
    """Packets of Protocol 2.0."""

    def txPacket(self, port: Port, txpacket: list[int]) -> int:  # noqa: N802
        """Send a packet, with its bytes stuffed and its CRC; return COMM_SUCCESS or why not."""
        txpacket[:4] = 0xFF, 0xFF, 0xFD, 0x00
        data = list(self.addStuffing(txpacket))
        crc = self.updateCRC(0, data, len(data) - 2)
        data[-2:] = crc & 0xFF, crc >> 8
        port.clearPort()
        return cast('int', COMM_SUCCESS if port.writePort(data) == len(data) else COMM_TX_FAIL)
