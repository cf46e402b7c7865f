# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
``install-service``: shows the systemd units and udev rules, then writes them.

Units start the nodes as a service; rules name the boards of this computer.
"""

import argparse
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from getpass import getuser
import grp
from itertools import count
import os
from pathlib import Path
import shlex
import sys
from typing import Any

from serial.tools.list_ports import comports

from soft_continuum.hardware.real_time import NICENESS, PRIORITY
from soft_continuum.lab.analysis.verbs import run_verb
from soft_continuum.parameters.arguments import (
    ask,
    DeclinedError,
    INTERRUPTED,
    one_of,
    Parser,
    whole_number_in,
    WRONG_USAGE,
)
from soft_continuum.parameters.parameter import ParameterError, Value
from soft_continuum.ros.description import load_rig
from soft_continuum.ros.environment import given_network
from soft_continuum.ros.names import JAMMING_VALVES, TENDON_ACTUATION
from soft_continuum.text import printable, write_whole
from soft_continuum.ui.cli.up import check_launch, description_files, nodes_of, start_arguments
from soft_continuum.user_files import config_home

HARDWARE = (TENDON_ACTUATION, JAMMING_VALVES)
UDEV = Path('/etc/udev/rules.d')
MAX_DOMAIN = 232  # above it ROS has no ports
LOAD_RULES = 'sudo udevadm control --reload && sudo udevadm trigger'
ENVIRONMENT = (
    'PATH', 'PYTHONPATH', 'LD_LIBRARY_PATH', 'AMENT_PREFIX_PATH', 'ROS_DISTRO', 'ROS_VERSION',
    'ROS_PYTHON_VERSION', 'RMW_IMPLEMENTATION', '_ROS_WHEELS_BOOTSTRAP_COMPLETE',
    'ROS_STATIC_PEERS', 'ROS_SECURITY_ENABLE', 'ROS_SECURITY_STRATEGY', 'ROS_SECURITY_KEYSTORE',
    'CYCLONEDDS_URI', 'XDG_STATE_HOME', 'XDG_CONFIG_HOME', 'XDG_CACHE_HOME')
"""Environment variables that nodes need, with their values at installation."""
FTDI = 0x0403  # vendor of adapters that buffer received data for 16 ms by default
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


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    parser = Parser('install-service', 'Start the nodes at boot with systemd, as this user, and '
                    'name the boards with udev. Shows every file, asks, and writes to ~/.config; '
                    'commands that need root are printed, not run.',
                    '--params-file', '--namespace')
    parser.add_argument('--nodes', choices=('all', 'hardware'), default='all',
                        help='hardware: only nodes that own devices; the others run on another '
                        'computer (default: %(default)s)')
    parser.add_argument('--domain', type=whole_number_in(0, MAX_DOMAIN), metavar='N',
                        help='ROS_DOMAIN_ID (default: that of this terminal)')
    parser.add_argument('--yes', action='store_true', help='write without asking')
    parser.add_argument('--remove', action='store_true', help='remove the files it has written')
    return run_verb(parser, _run, argv)


def _run(options: argparse.Namespace) -> None:
    try:
        (_remove if options.remove else _install)(options)
    except OSError as error:
        raise ParameterError(f'{error.filename}: cannot be written: {error.strerror}; set '
                             'XDG_CONFIG_HOME, or correct the owner of that directory') from None


def _folder() -> Path:
    """Return the directory of the user's systemd units."""
    return config_home() / 'systemd' / 'user'


def _install(options: argparse.Namespace) -> None:
    options.params_file = [Path(path).resolve() for path in description_files(options)]
    namespace = (options.namespace or '').strip('/')
    check_launch(namespace, options.params_file)
    nodes = [node for node in nodes_of(options.params_file, namespace)
             if options.nodes == 'all' or node in HARDWARE]
    command = [sys.executable, '-m', 'soft_continuum', '%i',
               *start_arguments(namespace, options.params_file),
               '--disable-external-lib-logs']  # systemd keeps the log, within bounds
    files = {_folder() / name: text for name, text in systemd_units(
        namespace, nodes, command, _environment(options.domain)).items()}
    ports = ports_of(load_rig(options.params_file, namespace))
    boards = boards_of(ports, comports())
    rules = config_home() / 'soft_continuum' / RULES
    if boards:
        files[rules] = udev_rules(boards.values())
    _show(files)
    for name in ports.keys() - boards.keys():
        print(f'No rule for {name}: {ports[name]} is not plugged in, or is not a USB port. Plug '
              'it in and run this again.')
    _confirm('Write these files?', options.yes)
    for path, text in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)
    print('Written. Nothing is started yet; next:', *_next(unit_name(namespace), boards, rules),
          sep='\n  ')


def _environment(domain: int | None) -> dict[str, str]:
    """Return the variables that the nodes need, of this process."""
    given = os.environ
    return {**{name: given[name] for name in ENVIRONMENT if given.get(name)},
            **given_network(given),
            'ROS_DOMAIN_ID': str(given.get('ROS_DOMAIN_ID') or 0 if domain is None else domain)}


def _show(files: Mapping[Path, str]) -> None:
    for path, text in files.items():
        there = path.read_text(encoding='utf-8', errors='replace') if path.is_file() else None
        state = ('new' if there is None else
                 'unchanged' if there == text else 'replaces another')
        print(f'--- {path} ({state})\n{text}')


def _confirm(question: str, yes: bool) -> None:
    if not yes and ask(f'{question} (yes, no)', one_of('yes', 'y', 'no', 'n')) in ('no', 'n'):
        raise DeclinedError('not confirmed, so nothing was changed')


def _next(name: str, boards: Mapping[str, object], rules: Path) -> list[str]:
    """Return the user's next steps, one in each line."""
    lines = []
    if boards:
        lines += [f'sudo cp {shlex.quote(str(rules))} {UDEV} && {LOAD_RULES}',
                  *(f'  then name the port /dev/soft_continuum/{board} in the parameter file'
                    for board in boards)]
        if os.getuid() and not _in_group('dialout'):
            lines.append(f'sudo usermod -aG dialout {getuser()}   (and log in again)')
    return [*lines, 'systemctl --user daemon-reload',
            f'systemctl --user enable --now {name}.target',
            'loginctl enable-linger   (to start at boot, before login)',
            f"journalctl --user -u '{name}@*' -f   (the log)",
            f'systemctl --user stop {name}.target   (to stop: tendons are held)']


def _in_group(name: str) -> bool:
    try:
        return grp.getgrnam(name).gr_gid in os.getgroups()
    except KeyError:
        return True  # a system without it, where ports have another


def _remove(options: argparse.Namespace) -> None:
    name = unit_name((options.namespace or '').strip('/'))
    wanted = [_folder() / f'{name}@.service', _folder() / f'{name}.target',
              config_home() / 'soft_continuum' / RULES]
    there = [path for path in wanted if os.path.lexists(path)]
    if not there:
        raise ParameterError(f'there is nothing to remove: no {wanted[1]}; give the namespace of '
                             'the arm with --namespace')
    print('To be removed:', *there, sep='\n  ')
    _confirm('Remove these files?', options.yes)
    for path in there:
        path.unlink()
    print('Removed. Running nodes continue; next:',
          f'systemctl --user stop {name}.target',
          'systemctl --user daemon-reload',
          *([f'sudo rm {UDEV / RULES} && {LOAD_RULES}'] if (UDEV / RULES).exists() else []),
          sep='\n  ')


@dataclass(frozen=True)
class Board:
    """
    A serial port named by a parameter; vendor, product: of USB.

    socket: where it is plugged in, which identifies it when it has no serial number.
    """

    name: str
    vendor: int
    product: int
    serial: str
    socket: str


def unit_name(namespace: str) -> str:
    """Return the name of an arm's target: soft_continuum, followed by its namespace."""
    return '_'.join(['soft_continuum', *filter(None, namespace.split('/'))])


def systemd_units(namespace: str, nodes: Sequence[str], command: Sequence[str],
                  environment: Mapping[str, str]) -> dict[str, str]:
    """
    Return the units of an arm by file name: one for each node, as a template, and their target.

    command: starts a node whose name is '%i'.  Raises ParameterError for text that a unit cannot
    hold.
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
    """Return a word quoted for systemd."""
    if not word.isprintable():
        raise ParameterError(f'{printable(word)} has a control character, which no unit can hold; '
                             'rename it')
    escaped = word.replace('\\', '\\\\').replace('"', '\\"').replace('%', '%%')
    return f'"{escaped}"'


def ports_of(values: Mapping[str, Value]) -> dict[str, str]:
    """Return the serial ports in the parameters, by the name that a rule gives each."""
    found: dict[str, str] = {}
    for name, value in values.items():
        device, _, last = name.rpartition('.')
        ports = str(value).split() if last == 'port' else []
        found |= {f'{device}_{n}' if len(ports) > 1 else device: port
                  for n, port in zip(count(1), ports, strict=False)}
    return found


def boards_of(ports: Mapping[str, str], present: Iterable[Any]) -> dict[str, Board]:
    """
    Return the USB boards that are plugged in, by the names of their ports.

    present: the ports of this computer, as serial.tools.list_ports.comports() returns them.
    """
    by_device = {os.path.realpath(one.device): one for one in present if one.vid is not None}
    return {name: Board(name, one.vid, one.pid, one.serial_number or '',
                        (one.location or '').partition(':')[0])
            for name, port in ports.items()
            if (one := by_device.get(os.path.realpath(port))) is not None}


def udev_rules(boards: Iterable[Board]) -> str:
    """
    Return rules that give boards stable names in /dev/soft_continuum.

    The group dialout may open them, ModemManager ignores them, and they reply at once.
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
    """Return a text of a board for a rule; pattern characters and quotes become wildcards."""
    return ''.join(c if c.isascii() and (c.isalnum() or c in '-_.:+ ') else '?' for c in text)
