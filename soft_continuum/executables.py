# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What ``ros2 run`` and ``./run`` start.

Everything heavy is imported inside, so that Ctrl-C during start-up ends quietly too.
"""

from importlib import import_module
import os
import sys
from typing import NoReturn


def _call(module: str, function: str, *arguments: object) -> NoReturn:
    try:
        status: int = getattr(import_module(module), function)(*arguments)
    except KeyboardInterrupt:  # before the program takes over the signals
        status = 130
    sys.stdout.flush()
    sys.stderr.flush()
    # All is taken down by now; what the interpreter would still do for numba takes 0.7 s.
    os._exit(status)


def tendon_actuation() -> None:
    """Run the node that owns the tendon steppers."""
    _call('soft_continuum.nodes.runtime', 'run', ['tendon_actuation'])


def jamming_valves() -> None:
    """Run the node that owns pump, valves and pressure sensors."""
    _call('soft_continuum.nodes.runtime', 'run', ['jamming_valves'])


def kinematics() -> None:
    """Run the node that knows the shape of the arm."""
    _call('soft_continuum.nodes.runtime', 'run', ['kinematics'])


def shape_sequencer() -> None:
    """Run the node that executes shape sequences."""
    _call('soft_continuum.nodes.runtime', 'run', ['shape_sequencer'])


def grbl_emulator() -> None:
    """Run an emulated GRBL stepper controller on a pseudo-terminal."""
    _call('soft_continuum.emulators.grbl', 'main')


def modbus_emulator() -> None:
    """Run emulated Modbus valves, pump and sensors on a pseudo-terminal."""
    _call('soft_continuum.emulators.modbus', 'main')


def up() -> None:
    """Run the four nodes in one process."""
    _call('soft_continuum.nodes.up', 'main')


def demo() -> None:
    """Run the paper's three shapes on a simulated rig."""
    _call('soft_continuum.nodes.demo', 'main')


if __name__ == '__main__':
    name = sys.argv.pop(1)
    globals()[name]()
