# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What ``ros2 run`` and ``./run`` start.

Everything heavy is imported inside, so that Ctrl-C during start-up ends quietly too.
"""

from importlib import import_module
import sys


def _call(module: str, function: str, *arguments: object) -> int:
    try:
        status: int = getattr(import_module(module), function)(*arguments)
    except KeyboardInterrupt:  # before the program takes over the signals
        return 130
    return status


def tendon_actuation() -> int:
    """Run the node that owns the tendon steppers."""
    return _call('soft_continuum.nodes.runtime', 'run', ['tendon_actuation'])


def jamming_valves() -> int:
    """Run the node that owns pump, valves and pressure sensors."""
    return _call('soft_continuum.nodes.runtime', 'run', ['jamming_valves'])


def kinematics() -> int:
    """Run the node that knows the shape of the arm."""
    return _call('soft_continuum.nodes.runtime', 'run', ['kinematics'])


def shape_sequencer() -> int:
    """Run the node that executes shape sequences."""
    return _call('soft_continuum.nodes.runtime', 'run', ['shape_sequencer'])


def up() -> int:
    """Run the four nodes in one process."""
    return _call('soft_continuum.nodes.up', 'main')


def demo() -> int:
    """Run the paper's three shapes on a simulated rig."""
    return _call('soft_continuum.nodes.demo', 'main')


if __name__ == '__main__':
    name = sys.argv.pop(1)
    sys.exit(globals()[name]())
