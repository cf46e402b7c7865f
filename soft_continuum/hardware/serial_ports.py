# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Serial ports: opened exclusively, with errors that name the remedy."""

import contextlib
import errno
import os
from pathlib import Path
import termios

import serial
from serial.tools.list_ports import comports

from soft_continuum.hardware.protocols import HardwareError

BY_ID = Path('/dev/serial/by-id')
"""Where Linux keeps stable names of devices."""


def list_ports() -> list[str]:
    """Return the ports of this computer; a device's stable name rather than ttyUSB0, if any."""
    stable = {os.path.realpath(link): str(link) for link in sorted(BY_ID.glob('*'))}
    # Ports on the main board (ttyS0 ...) exist whether or not anything is behind them.
    others = [p.device for p in comports() if p.hwid != 'n/a']
    return [*stable.values(), *sorted(p for p in others if os.path.realpath(p) not in stable)]


def describe_ports() -> str:
    """Return one sentence that names the ports of this computer."""
    if ports := list_ports():
        return 'ports found: ' + ', '.join(ports)
    return 'no serial port found on this computer: check the cable and the power'


def open_serial(port: str, baud_rate: int) -> serial.Serial:
    """
    Open a serial port that no other program may open until it is closed.

    port: such as /dev/serial/by-id/usb-...  Raises HardwareError with the cause and the remedy.
    """
    if not port:
        raise HardwareError(f'no serial port is configured; {describe_ports()}')
    try:
        line = serial.Serial(port, baud_rate, exclusive=True)
        with contextlib.suppress(OSError, ValueError):  # not every adapter has this mode
            line.set_low_latency_mode(True)  # some keep what they receive for 16 ms
        return line
    except (OSError, ValueError) as error:  # serial.SerialException is an OSError
        raise HardwareError(f'serial port {port}: {_explain(port, error)}') from None


def close_serial(port: serial.Serial) -> None:
    """Close a port and drop unsent bytes, for which it may otherwise wait up to 30 s."""
    with contextlib.suppress(OSError, ValueError, termios.error):
        termios.tcflush(port.fileno(), termios.TCOFLUSH)
    port.close()


def _explain(port: str, error: OSError | ValueError) -> str:
    code = getattr(error, 'errno', None)
    if code == errno.ENOENT or not os.path.exists(port):
        return f'does not exist; {describe_ports()}'
    if code in (errno.EACCES, errno.EPERM):
        return ('not allowed for this user; add the user to the group that owns the port and '
                f'log in again: sudo usermod -aG {_group(port)} $USER')
    # pyserial reports a lock that it did not get without a number of its own.
    if code in (errno.EAGAIN, errno.EBUSY) or 'exclusively lock' in str(error):
        return ('is in use by another program; close it (find it with: fuser -v '
                f'{os.path.realpath(port)})')
    if code in (errno.EIO, errno.ENXIO, errno.ENODEV):
        return f'the device was disconnected; check the cable and the power; {describe_ports()}'
    return f'cannot be opened ({error}); {describe_ports()}'


def _group(port: str) -> str:
    try:
        return Path(port).group()
    except (OSError, KeyError):
        return 'dialout'
