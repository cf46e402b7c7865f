# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What ``ros2 run`` and ``./run`` start.

Everything heavy is imported inside, so that Ctrl-C during start-up ends quietly too.
"""

from collections.abc import Callable
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
    _call('soft_continuum.nodes.runtime', 'run', 'tendon_actuation')


def jamming_valves() -> None:
    """Run the node that owns pump, valves and pressure sensors."""
    _call('soft_continuum.nodes.runtime', 'run', 'jamming_valves')


def kinematics() -> None:
    """Run the node that knows the shape of the arm."""
    _call('soft_continuum.nodes.runtime', 'run', 'kinematics')


def shape_sequencer() -> None:
    """Run the node that executes shape sequences."""
    _call('soft_continuum.nodes.runtime', 'run', 'shape_sequencer')


def _program(module: str) -> Callable[[], NoReturn]:
    def run() -> NoReturn:
        _call(f'soft_continuum.{module}', 'main')
    return run


# The devices to try the hardware drivers on, and the commands of docs/how_to/set_up_a_rig.md and measurement.md.
grbl_emulator = _program('emulators.grbl')
modbus_emulator = _program('emulators.modbus')
doctor = _program('commands.doctor')
calibrate = _program('commands.calibrate')
characterize = _program('commands.characterize')
converge = _program('commands.converge')
validate = _program('commands.validate')
identify = _program('commands.identify')
workspace = _program('commands.workspace')
record = _program('commands.record')
report = _program('commands.report')


def browser() -> None:
    """Run the view in a browser alone."""
    _call('soft_continuum.browser.main', 'browser')


def ui() -> None:
    """Run the four nodes and the view in a browser."""
    _call('soft_continuum.browser.main', 'ui')


def up() -> None:
    """Run the four nodes, each in a process of its own."""
    _call('soft_continuum.nodes.up', 'main')


def demo() -> None:
    """Run the paper's three shapes on a simulated rig."""
    _call('soft_continuum.nodes.demo', 'main')


if __name__ == '__main__':
    name = sys.argv.pop(1)
    globals()[name]()
