# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``install-service``: shows the units and rules that start the nodes, then writes them."""

import argparse
from collections.abc import Mapping, Sequence
from getpass import getuser
import grp
import os
from pathlib import Path
import shlex
import sys

from serial.tools.list_ports import comports

from soft_continuum.arguments import Parser, whole_number_in
from soft_continuum.cli.common import run_verb
from soft_continuum.cli.prompts import ask, DeclinedError, one_of
from soft_continuum.cli.service import (
    boards_of,
    ENVIRONMENT,
    ports_of,
    RULES,
    udev_rules,
    unit_name,
    units,
)
from soft_continuum.cli.up import check_start, description_files, nodes_of, ros_arguments
from soft_continuum.parameters.files import load_rig
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.names import JAMMING_VALVES, TENDON_ACTUATION
from soft_continuum.ros.network import given_network
from soft_continuum.text import write_whole
from soft_continuum.user_files import config_home

HARDWARE = (TENDON_ACTUATION, JAMMING_VALVES)
UDEV = Path('/etc/udev/rules.d')
MAX_DOMAIN = 232  # above it ROS has no ports
LOAD_RULES = 'sudo udevadm control --reload && sudo udevadm trigger'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    parser = Parser('install-service', 'Have systemd start the nodes with this computer, as this '
                    'user, and udev name the boards. Shows every file, asks, and writes below '
                    '~/.config; what takes root it says and does not do.',
                    '--params-file', '--namespace')
    parser.add_argument('--nodes', choices=('all', 'hardware'), default='all',
                        help='hardware: only those that own devices; the others run on another '
                        'computer (default: %(default)s)')
    parser.add_argument('--domain', type=whole_number_in(0, MAX_DOMAIN), metavar='N',
                        help='ROS_DOMAIN_ID (default: that of this terminal)')
    parser.add_argument('--yes', action='store_true', help='write without asking')
    parser.add_argument('--remove', action='store_true', help='remove what it has written')
    try:
        return run_verb(parser, _run, argv)
    except DeclinedError as error:
        return parser.fail(error)


def _run(options: argparse.Namespace) -> None:
    try:
        (_remove if options.remove else _install)(options)
    except OSError as error:
        raise ParameterError(f'{error.filename}: cannot be written: {error.strerror}; set '
                             'XDG_CONFIG_HOME, or correct the owner of that directory') from None


def _folder() -> Path:
    """Return where systemd finds the units of a user."""
    return config_home() / 'systemd' / 'user'


def _install(options: argparse.Namespace) -> None:
    options.params_file = [Path(path).resolve() for path in description_files(options)]
    namespace = (options.namespace or '').strip('/')
    check_start(namespace, options.params_file)
    nodes = [node for node in nodes_of(options.params_file, namespace)
             if options.nodes == 'all' or node in HARDWARE]
    command = [sys.executable, '-m', 'soft_continuum', '%i', *ros_arguments(options)[1:],
               '--disable-external-lib-logs']  # systemd keeps the log, within bounds
    files = {_folder() / name: text for name, text in units(
        namespace, nodes, command, _environment(options.domain)).items()}
    ports = ports_of(load_rig(options.params_file, namespace))
    boards = boards_of(ports, comports())
    rules = config_home() / 'soft_continuum' / RULES
    if boards:
        files[rules] = udev_rules(boards.values())
    _show(files)
    for name in ports.keys() - boards.keys():
        print(f'No rule for {name}: {ports[name]} is not plugged in here, or no USB port. Plug it '
              'in, and call this again.')
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
                 'as it is already' if there == text else 'takes the place of another')
        print(f'--- {path} ({state})\n{text}')


def _confirm(question: str, yes: bool) -> None:
    if not yes and ask(f'{question} (yes, no)', one_of('yes', 'y', 'no', 'n')) in ('no', 'n'):
        raise DeclinedError('not confirmed, so nothing was changed')


def _next(name: str, boards: Mapping[str, object], rules: Path) -> list[str]:
    """Return what the user does next, a line each."""
    lines = []
    if boards:
        lines += [f'sudo cp {shlex.quote(str(rules))} {UDEV} && {LOAD_RULES}',
                  *(f'  then name the port /dev/soft_continuum/{board} in the parameter file'
                    for board in boards)]
        if os.getuid() and not _in_group('dialout'):
            lines.append(f'sudo usermod -aG dialout {getuser()}   (and log in again)')
    return [*lines, 'systemctl --user daemon-reload',
            f'systemctl --user enable --now {name}.target',
            'loginctl enable-linger   (to start with the computer, before anybody logs in)',
            f"journalctl --user -u '{name}@*' -f   (the log)",
            f'systemctl --user stop {name}.target   (the end: tendons are held)']


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
        raise ParameterError(f'there is nothing to remove: no {wanted[1]}; --namespace says of '
                             'which arm')
    print('To be removed:', *there, sep='\n  ')
    _confirm('Remove these files?', options.yes)
    for path in there:
        path.unlink()
    print('Removed. Nodes that run go on; next:',
          f'systemctl --user stop {name}.target',
          'systemctl --user daemon-reload',
          *([f'sudo rm {UDEV / RULES} && {LOAD_RULES}'] if (UDEV / RULES).exists() else []),
          sep='\n  ')
