# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Faults that are injected in the middle of a sequence; those of servos are those of the tests."""

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Any

from soak.workbench import Workbench
from soft_continuum.sim.emulators.grbl import GrblEmulator
from support.ros_rig import SEGMENTS
from support.servo_rig import FAULTS as SERVO_FAULTS


@dataclass(frozen=True)
class Fault:
    """A name, and how the fault is injected into a workbench."""

    name: str
    inject: Callable[[Workbench, Random], object]


def _tendons(inject: Callable[[Any, Random], object]) -> Callable[[Workbench, Random], object]:
    """Return a fault of the emulator that drives the tendons."""
    return lambda bench, random: inject(bench.board.emulator, random)


def _stepper(name: str, *values: float) -> Callable[[Workbench, Random], object]:
    """Return a fault that sets an attribute of the stepper board to one of some values."""
    return _tendons(lambda grbl, random: setattr(grbl, name, random.choice(values)))


def _valves(name: str, *values: float) -> Callable[[Workbench, Random], None]:
    """Return a fault that sets an attribute of the valve boards to one of some values."""
    return lambda bench, random: setattr(bench.modbus, name, random.choice(values))


def _break_wire(bench: Workbench, random: Random) -> None:
    bench.modbus.segments[random.randrange(SEGMENTS)].broken_wire = True


def _stick(bench: Workbench, random: Random) -> None:
    bench.modbus.stuck.add(random.randint(1, SEGMENTS))


def _race(grbl: GrblEmulator, _: Random) -> None:
    grbl.firmware.race = True


_STEPPERS = (
    Fault('stepper cable pulled', _tendons(lambda grbl, _: grbl.unplug())),
    Fault('stepper board reset', _tendons(lambda grbl, _: grbl.reset())),
    Fault('stepper board reset, banner lost', _tendons(lambda grbl, _: grbl.reset(banner=False))),
    Fault('stepper board hangs', _stepper('hang', True)),
    Fault('alarm 1, 2 or 3', _tendons(lambda grbl, random: grbl.alarm(random.randint(1, 3)))),
    Fault('hold button', _tendons(lambda grbl, _: grbl.hold())),
    Fault('door', _tendons(lambda grbl, _: grbl.door())),
    Fault('jog run as a program', _tendons(_race)),
    Fault('acknowledgement lost', _stepper('drop_ok', 1)),
    Fault('acknowledgements late', _stepper('late_ok', 0.1, 3.0)),
    Fault('lines from the board garbled', _stepper('garble', 0.02, 0.2)),
)
_COMMON = (
    Fault('valve cable pulled', lambda bench, _: bench.modbus.unplug()),
    Fault('valve board loses power', lambda bench, _: bench.modbus.power_cycle()),
    Fault('valve boards hang', _valves('hang', True)),
    Fault('replies late', _valves('late', 0.05, 0.15, 0.4)),
    Fault('replies lost', _valves('drop', 0.05, 0.3)),
    Fault('replies garbled', _valves('garble', 0.05, 0.3)),
    Fault('sensor wire broken', _break_wire),
    Fault('valve stuck', _stick),
    Fault('stop', lambda bench, _: bench.rig.trigger('tendon_actuation/stop')),
    Fault('emergency stop', lambda bench, _: bench.emergency_stop(True)),
)
FAULTS = {
    'grbl': (*_STEPPERS, *_COMMON),
    'dynamixel': (*(Fault(f'servos: {fault.name}', _tendons(fault.inject))
                    for fault in SERVO_FAULTS), *_COMMON)}
"""By what drives the tendons, one of BOARDS."""
