# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Modbus RTU frames: requests of a client, and decoded replies.  Frames and CRC are pymodbus's.

Only this module imports pymodbus, and only a bus imports this module: not every node has one.
"""

from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.bit_message import ReadCoilsRequest, WriteSingleCoilRequest
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteSingleRegisterRequest,
)

READS = {1: ReadCoilsRequest, 3: ReadHoldingRegistersRequest, 4: ReadInputRegistersRequest}
"""By their functions."""


class Frames:
    """Makes the frames of requests and reads those of replies."""

    def __init__(self) -> None:
        self._framer = FramerRTU(DecodePDU(is_server=False))

    def read(self, function: int, unit: int, first: int, count: int) -> bytes:
        """Ask for ``count`` coils or registers from ``first`` on; function: one of READS."""
        return self._built(READS[function](address=first, count=count, dev_id=unit))

    def write_coil(self, unit: int, coil: int, on: bool) -> bytes:
        """Switch one coil (function 05)."""
        return self._built(WriteSingleCoilRequest(address=coil, bits=[on], dev_id=unit))

    def write_register(self, unit: int, register: int, value: int) -> bytes:
        """Write one holding register (function 06)."""
        return self._built(WriteSingleRegisterRequest(
            address=register, registers=[value], dev_id=unit))

    def decode(self, reply: bytes, unit: int) -> ModbusPDU | None:
        """Return the decoded frame of a unit; None for an invalid one, such as a wrong CRC."""
        return self._framer.handleFrame(reply, unit, 0)[1]

    def _built(self, request: ModbusPDU) -> bytes:
        return self._framer.buildFrame(request)
