# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An emulated rig with its parameter file."""

from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from unittest.mock import patch

import yaml

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.grbl import tendons as grbl_tendons
from soft_continuum.sim.emulators.grbl import GrblEmulator
from soft_continuum.sim.emulators.modbus import ModbusEmulator
from support import driver_waits, grbl_rig
from support.virtual_clock import VirtualClock

DEADLINE = 60.0  # s until a test gives up waiting; a loaded computer is slow
SPEED = 8.0
"""By which emulators in real time live faster."""
PATIENCE = 50  # queries to the stepper board in this process: a busy computer answers late
TIMEOUT = 1.0  # s that a Modbus reply may take on one
until = partial(driver_waits.until, STEADY, step=0.05)


@dataclass
class Rig:
    """Both emulators, and the parameter file that describes them."""

    grbl: GrblEmulator
    modbus: ModbusEmulator
    file: Path

    def parameters(self, **changes):
        """Change parameters in the file; a name is a path with __ between its parts."""
        document = yaml.safe_load(self.file.read_text())
        for name, value in changes.items():
            *groups, key = name.split('__')
            place = document['/**']['ros__parameters']
            for group in groups:
                place = place.setdefault(group, {})
            place[key] = value
        self.file.write_text(yaml.safe_dump(document))


@contextmanager
def emulated_rig(folder, real_time=False):
    """
    A rig that is soft, without a reference, as after it was switched on.

    It lives, with the drivers and verbs in this process, in a time of their own; in real time, but
    faster, where a verb in a process of its own moves it.
    """
    with (_faster() if real_time else _own_time(),
          patch.object(grbl_tendons, 'MAX_UNANSWERED_QUERIES', PATIENCE),
          patch.object(grbl_tendons, 'PROGRESS_TIMEOUT', DEADLINE),
          patch.object(grbl_tendons, 'ACKNOWLEDGEMENT_TIMEOUT', DEADLINE),
          GrblEmulator(str(folder / 'grbl')) as grbl,
          ModbusEmulator(link=folder / 'modbus') as modbus):
        rig = Rig(grbl, modbus, folder / 'rig.yaml')
        rig.file.write_text('/**:\n  ros__parameters: {}\n')
        rig.parameters(
            tendon_driver='grbl', grbl__port=str(folder / 'grbl'), jamming_driver='modbus',
            modbus__port=str(folder / 'modbus'), modbus__timeout=TIMEOUT)
        yield rig


def _faster():
    return patch.object(STEADY, '_factor', SPEED)


def _own_time():
    clock = VirtualClock()
    return patch.multiple(Clock, __call__=lambda _: clock(),
                          wait=lambda _, files, timeout: clock.wait(files, timeout))


def reference(rig):
    """Give the controller a zero, as the node does."""
    tendons = steppers(rig)
    until(lambda: _references(tendons) and is_referenced(rig), 'a reference')


def _references(tendons):
    tendons.open()
    tendons.reference()
    STEADY.sleep(1.0)
    tendons.close()
    return True


def steppers(rig):
    """The driver of the rig's tendons, as a node has it."""
    return grbl_rig.driver(rig.grbl)


def is_referenced(rig):
    """Whether a node that starts now would know the zero of the tendons."""
    tendons = steppers(rig)
    tendons.open()
    referenced = tendons.read().referenced
    tendons.close()
    return referenced


def shorten(rig):
    """Make it an arm of one segment, which takes less time."""
    rig.parameters(
        arm__segment_lengths=[0.07], arm__outer_diameters=[0.05], arm__leaf_thicknesses=[0.0005],
        arm__leaf_widths=[0.0127], arm__segment_masses=[0.069], arm__disc_heights=[0.03, 0.03],
        arm__disc_masses=[0.06, 0.06], arm__bending_angle_limits=[1.0],
        modbus__valve_coils=[1.0], modbus__pressure_registers=[0.0])
