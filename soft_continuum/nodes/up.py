# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""
The four nodes in processes of their own, without launch_ros: ``./run up``.

It takes the arguments of launch/bringup.launch.py.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
import sys
from time import sleep

from ament_index_python.packages import get_package_share_directory

from soft_continuum.nodes.processes import NodeProcesses
from soft_continuum.nodes.runtime import argument_error, NODES, ROS_ARGUMENT_ERRORS, Signals
from soft_continuum.parameters.nodes import NODE_PARAMETERS
from soft_continuum.parameters.parameter import ParameterError

DRIVERS = ('tendon_driver', 'jamming_driver')
PERIOD = 0.05  # s between two looks at the processes


def description_file() -> Path:
    """Return the installed config/manipulator.yaml."""
    return Path(get_package_share_directory('soft_continuum')) / 'config' / 'manipulator.yaml'


def ros_arguments(argv: Sequence[str]) -> list[str]:
    """Translate the command line into ROS arguments."""
    parser = argparse.ArgumentParser(prog='./run up', description='Start the four nodes.')
    parser.add_argument('--namespace', default='', help='namespace of all nodes, such as left')
    parser.add_argument('--params-file', action='append', metavar='FILE', default=[],
                        help='description file of the arm: parameters of all nodes; a later one '
                        'overrides (default: config/manipulator.yaml)')
    for name in DRIVERS:
        table = {p.name: p for node in NODE_PARAMETERS.values() for p in node}
        parser.add_argument('--' + name.replace('_', '-'), choices=table[name].choices,
                            help=table[name].description)
    options = parser.parse_args(argv)
    arguments = ['up', '--ros-args']
    if options.namespace:
        arguments += ['-r', '__ns:=/' + options.namespace.strip('/')]
    for path in options.params_file or [str(description_file())]:
        arguments += ['--params-file', path]
    for name in DRIVERS:
        if getattr(options, name):
            arguments += ['-p', f'{name}:={getattr(options, name)}']
    return arguments


def main() -> int:
    """Run until Ctrl-C, or until no node is left; return the exit status."""
    signals, arguments = Signals(), ros_arguments(sys.argv[1:])
    try:
        with NodeProcesses(NODES, arguments) as nodes:
            signals.starting = False
            while not signals.received and nodes.running:
                sleep(PERIOD)
    except ParameterError as error:
        print(f'up: {error}', file=sys.stderr)
        return 2
    except ROS_ARGUMENT_ERRORS as error:
        print(f'up: {argument_error(arguments, error)}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 0
    return 0 if signals.received else 1
