# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Faults that are injected in the middle of a sequence."""

from collections.abc import Callable
from dataclasses import dataclass
from random import Random

from ros_rig import SEGMENTS

from soak.workbench import Workbench


@dataclass(frozen=True)
class Fault:
    """A name, and how the fault is injected into a workbench."""

    name: str
    inject: Callable[[Workbench, Random], object]


def _attribute(device: str, name: str, *values: float) -> Callable[[Workbench, Random], None]:
    """Return a fault that sets an attribute of an emulator to one of some values."""
    return lambda bench, random: setattr(getattr(bench, device), name, random.choice(values))


def _break_wire(bench: Workbench, random: Random) -> None:
    bench.modbus.segments[random.randrange(SEGMENTS)].broken_wire = True


def _stick(bench: Workbench, random: Random) -> None:
    bench.modbus.stuck.add(random.randint(1, SEGMENTS))


def _race(bench: Workbench, _: Random) -> None:
    bench.grbl.firmware.race = True


FAULTS = (
    Fault('stepper cable pulled', lambda bench, _: bench.grbl.unplug()),
    Fault('stepper board reset', lambda bench, _: bench.grbl.reset()),
    Fault('stepper board reset, banner lost', lambda bench, _: bench.grbl.reset(banner=False)),
    Fault('stepper board hangs', _attribute('grbl', 'hang', True)),
    Fault('alarm 1, 2 or 3', lambda bench, random: bench.grbl.alarm(random.randint(1, 3))),
    Fault('hold button', lambda bench, _: bench.grbl.hold()),
    Fault('door', lambda bench, _: bench.grbl.door()),
    Fault('jog run as a program', _race),
    Fault('acknowledgement lost', _attribute('grbl', 'drop_ok', 1)),
    Fault('acknowledgements late', _attribute('grbl', 'late_ok', 0.1, 3.0)),
    Fault('lines from the board garbled', _attribute('grbl', 'garble', 0.02, 0.2)),
    Fault('valve cable pulled', lambda bench, _: bench.modbus.unplug()),
    Fault('valve board loses power', lambda bench, _: bench.modbus.power_cycle()),
    Fault('valve boards hang', _attribute('modbus', 'hang', True)),
    Fault('replies late', _attribute('modbus', 'late', 0.05, 0.15, 0.4)),
    Fault('replies lost', _attribute('modbus', 'drop', 0.05, 0.3)),
    Fault('replies garbled', _attribute('modbus', 'garble', 0.05, 0.3)),
    Fault('sensor wire broken', _break_wire),
    Fault('valve stuck', _stick),
    Fault('stop', lambda bench, _: bench.rig.trigger('tendon_actuation/stop')),
    Fault('emergency stop', lambda bench, _: bench.emergency_stop(True)),
)
