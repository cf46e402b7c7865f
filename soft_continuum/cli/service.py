# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What makes the nodes a service of a computer: units of systemd, and rules of udev for its boards.

Only texts: cli/install_service.py shows and writes them.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
import os
from typing import Any

from soft_continuum.arguments import INTERRUPTED, WRONG_USAGE
from soft_continuum.hardware.real_time import NICENESS, PRIORITY
from soft_continuum.parameters.parameter import ParameterError, Value
from soft_continuum.text import printable

ENVIRONMENT = (
    'PATH', 'PYTHONPATH', 'LD_LIBRARY_PATH', 'AMENT_PREFIX_PATH', 'ROS_DISTRO', 'ROS_VERSION',
    'ROS_PYTHON_VERSION', 'RMW_IMPLEMENTATION', '_ROS_WHEELS_BOOTSTRAP_COMPLETE',
    'ROS_STATIC_PEERS', 'ROS_SECURITY_ENABLE', 'ROS_SECURITY_STRATEGY', 'ROS_SECURITY_KEYSTORE',
    'CYCLONEDDS_URI', 'XDG_STATE_HOME', 'XDG_CONFIG_HOME', 'XDG_CACHE_HOME')
"""Variables of the shell that nodes need, as they are when the service is installed."""
FTDI = 0x0403  # vendor of adapters that keep what they receive for 16 ms unless told otherwise
RULES = '99-soft_continuum.rules'

UNIT = """\
# Written by soft_continuum install-service; --remove takes it away.
[Unit]
Description=soft_continuum node %i{where}
PartOf={name}.target
StartLimitIntervalSec=60
StartLimitBurst=5

[Service]
ExecStart={command}
{environment}
# A node that failed is started again, and then reads the real state and moves nothing. One that
# was given what it does not take would only fail again.
Restart=on-failure
RestartSec=2
RestartPreventExitStatus={wrong_usage}
SuccessExitStatus={interrupted}
KillSignal=SIGINT
TimeoutStopSec=30
# The threads that talk to devices go on before others on a busy computer. A service of a user gets
# what the limits of the user allow: see doctor.
LimitRTPRIO={priority}
LimitNICE={niceness}
NoNewPrivileges=yes
"""
TARGET = """\
# Written by soft_continuum install-service; --remove takes it away.
[Unit]
Description=soft_continuum{where}
Wants={services}

[Install]
WantedBy=default.target
"""


@dataclass(frozen=True)
class Board:
    """
    A serial port that a parameter names; vendor, product: of USB.

    socket: where it is plugged in, by which it is known when it has no serial number.
    """

    name: str
    vendor: int
    product: int
    serial: str
    socket: str


def unit_name(namespace: str) -> str:
    """Return the name of the target of an arm: soft_continuum, with its namespace behind it."""
    return '_'.join(['soft_continuum', *filter(None, namespace.split('/'))])


def units(namespace: str, nodes: Sequence[str], command: Sequence[str],
          environment: Mapping[str, str]) -> dict[str, str]:
    """
    Return the units of an arm by file name: one for each node, as a template, and their target.

    command: what starts a node but its name, which is '%i'.  Raises ParameterError for what a unit
    cannot hold.
    """
    name, where = unit_name(namespace), f' in {namespace}' if namespace else ''
    listed = '\n'.join(f'Environment={_quoted(f"{key}={value}")}'
                       for key, value in environment.items() if value)
    words = ' '.join(word if word == '%i' else _quoted(word).replace('$', '$$')
                     for word in command)
    return {
        f'{name}@.service': UNIT.format(
            name=name, where=where, command=words, environment=listed, wrong_usage=WRONG_USAGE,
            interrupted=INTERRUPTED, priority=PRIORITY, niceness=NICENESS),
        f'{name}.target': TARGET.format(
            where=where, services=' '.join(f'{name}@{node}.service' for node in nodes))}


def _quoted(word: str) -> str:
    """Return a word as systemd reads it back."""
    if not word.isprintable():
        raise ParameterError(f'{printable(word)} has a control character, which no unit can hold; '
                             'rename it')
    escaped = word.replace('\\', '\\\\').replace('"', '\\"').replace('%', '%%')
    return f'"{escaped}"'


def ports_of(values: Mapping[str, Value]) -> dict[str, str]:
    """Return the serial ports that parameters name, by the name that a rule gives each."""
    found: dict[str, str] = {}
    for name, value in values.items():
        device, _, last = name.rpartition('.')
        ports = str(value).split() if last == 'port' else []
        found |= {f'{device}_{n}' if len(ports) > 1 else device: port
                  for n, port in zip(count(1), ports, strict=False)}
    return found


def boards_of(ports: Mapping[str, str], present: Iterable[Any]) -> dict[str, Board]:
    """
    Return the boards behind ports, by the names of those, as far as they are plugged in by USB.

    present: the ports of this computer, as serial.tools.list_ports.comports() returns them.
    """
    by_device = {os.path.realpath(one.device): one for one in present if one.vid is not None}
    return {name: Board(name, one.vid, one.pid, one.serial_number or '',
                        (one.location or '').partition(':')[0])
            for name, port in ports.items()
            if (one := by_device.get(os.path.realpath(port))) is not None}


def udev_rules(boards: Iterable[Board]) -> str:
    """
    Return rules that give boards names of their own, below /dev/soft_continuum.

    They are opened by the group dialout, left alone by ModemManager, and answer at once.
    """
    lines = ['# Written by soft_continuum install-service.']
    for board in boards:
        known = (f'ATTRS{{serial}}=="{_safe(board.serial)}"' if board.serial else
                 f'KERNELS=="{_safe(board.socket)}"')
        usb = (f'ATTRS{{idVendor}}=="{board.vendor:04x}", '
               f'ATTRS{{idProduct}}=="{board.product:04x}", {known}')
        if not board.serial:
            lines.append(f'# {board.name} has no serial number: it is known by its socket.')
        lines.append(f'SUBSYSTEM=="tty", {usb}, SYMLINK+="soft_continuum/{board.name}", '
                     'GROUP="dialout", MODE="0660", ENV{ID_MM_PORT_IGNORE}="1"')
        if board.vendor == FTDI:
            lines.append(f'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", {usb}, '
                         'ATTR{latency_timer}="1"')
    return '\n'.join(lines) + '\n'


def _safe(text: str) -> str:
    """Return a text of a board for a rule: what a pattern or a quote would mean is any letter."""
    return ''.join(c if c.isascii() and (c.isalnum() or c in '-_.:+ ') else '?' for c in text)
