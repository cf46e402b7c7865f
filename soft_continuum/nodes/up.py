# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""
The four nodes in one process, for machines without launch_ros: ``./run up``.

It takes the arguments of launch/bringup.launch.py.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
import sys

from ament_index_python.packages import get_package_share_directory

from soft_continuum.nodes.runtime import NODES, run
from soft_continuum.parameters.nodes import NODE_PARAMETERS

DRIVERS = ('tendon_driver', 'jamming_driver')


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
    """Run until Ctrl-C."""
    return run(list(NODES), ros_arguments(sys.argv[1:]))
