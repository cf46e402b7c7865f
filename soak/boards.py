# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What may drive the tendons under the nodes: an emulated stepper board, or emulated servos.

The truth about both is in metres that each tendon is pulled in.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
import os
from pathlib import Path
import time
from typing import Any, ClassVar, Generic, TypeVar

from soft_continuum.hardware.clock import STEADY
from soft_continuum.sim.emulators.dynamixel import dynamixel_parameters, DynamixelEmulator
from soft_continuum.sim.emulators.grbl import GrblEmulator
from support.ros_rig import TENDONS
from support.servo_rig import repair, servos, SIGNS, TOLERANCE
from support.servo_stops import REST_SPEED, watch_rest

STEPS_PER_METRE = 200e3
STEPPER_REST = 0.2  # s without a step
SERVO_SPEED = 0.025  # m/s of a planned motion
Pulls = tuple[float, ...]
Emulator = TypeVar('Emulator')


class Board(ABC, Generic[Emulator]):
    """
    An emulator and what is true.

    resolution: m by which a reported pull may differ from the true one at rest.  reach: m by which
    a tendon may rest beside where it was sent, and move while it is held.
    """

    resolution: ClassVar[float]
    reach: ClassVar[float]

    def __init__(self, emulator: Emulator) -> None:
        """Take an emulator that runs."""
        self.emulator = emulator
        self._threads = ThreadPoolExecutor(1)

    @property
    @abstractmethod
    def pulls(self) -> Pulls:
        """By how much each tendon is pulled in since the beginning, m."""

    @property
    @abstractmethod
    def moving(self) -> bool:
        """Whether something turns."""

    @property
    @abstractmethod
    def driven(self) -> bool:
        """Whether a motor moves a tendon, rather than the tendon a motor without torque."""

    @abstractmethod
    def repair(self) -> None:
        """End every fault as an operator does, without a motion."""

    def watch_rest(self) -> Future[float]:
        """Begin to watch how long it takes from now until the moving tendons rest, s."""
        return self._threads.submit(self._watcher())

    @abstractmethod
    def _watcher(self) -> Callable[[], float]:
        """Return what waits for rest and returns how long that took from this call."""


class Steppers(Board[GrblEmulator]):
    """An emulated GRBL board."""

    resolution = reach = 0.6 / STEPS_PER_METRE  # what lies between two steps is rounded

    @property
    def pulls(self) -> Pulls:
        """By how much each tendon is pulled in since the beginning, m."""
        return tuple(steps / STEPS_PER_METRE for steps in self.emulator.motors[:len(TENDONS)])

    @property
    def moving(self) -> bool:
        """Whether the motors make steps."""
        return self.emulator.moving

    driven = moving

    def repair(self) -> None:
        """End every fault; a locked board is power-cycled."""
        grbl = self.emulator
        with grbl.lock:
            grbl.hang = grbl.firmware.race = False
            grbl.drop_ok, grbl.late_ok, grbl.garble = 0, 0.0, 0.0
            if not os.path.exists(grbl.port):
                grbl.plug()
            if grbl.firmware.state in ('Alarm', 'Hold', 'Door') and not grbl.moving:
                grbl.reset()

    def _watcher(self) -> Callable[[], float]:
        grbl, since = self.emulator, self.emulator.time

        def wait() -> float:
            while grbl.moving or grbl.time - grbl.firmware.stood_since <= STEPPER_REST:
                time.sleep(0.005)
            return max(0.0, grbl.firmware.stood_since - since)
        return wait


class Servos(Board[DynamixelEmulator]):
    """Emulated servos; they report whole pulses, from the last replies."""

    resolution, reach = TOLERANCE, 2e-4  # m: servos rest within friction

    @property
    def pulls(self) -> Pulls:
        """By how much each tendon is pulled in since the beginning, m."""
        return self.emulator.pulls

    @property
    def moving(self) -> bool:
        """Whether a spool turns."""
        return self.emulator.moving

    @property
    def driven(self) -> bool:
        """Whether a servo with torque turns faster than one that rests."""
        return self.emulator.read(lambda: any(
            servo.torque and abs(servo.motor.speed) * servo.motor.tendon.radius > REST_SPEED
            for servo in self.emulator.servos))

    def repair(self) -> None:
        """End every fault; a servo that has shut down is rebooted."""
        repair(self.emulator)

    def _watcher(self) -> Callable[[], float]:
        since = self.emulator.clock()
        return lambda: watch_rest(self.emulator, since).slow


@contextmanager
def _steppers(folder: Path, faster: float) -> Iterator[tuple[Board[Any], Mapping[str, Any]]]:
    motors = {110: 450000 * faster, 111: 450000 * faster,
              120: 100000 * faster**2, 121: 100000 * faster**2}
    with GrblEmulator(str(folder / 'tendons'), settings=motors) as emulator:
        yield Steppers(emulator), {
            'tendon_driver': 'grbl', 'grbl.port': emulator.port,
            'tendon_speed': 0.015 * faster, 'speed_limit': 0.03 * faster,
            'tendon_acceleration': min(0.1 * faster**2, 10.0),
            'acceleration_limit': 0.3 * faster**2}


@contextmanager
def _servos(folder: Path, _: float) -> Iterator[tuple[Board[Any], Mapping[str, Any]]]:
    """Servos are as fast as they are."""
    os.environ['XDG_STATE_HOME'] = str(folder)  # where the nodes keep their zeros
    with servos(len(TENDONS), link=folder / 'tendons', clock=STEADY) as emulator:
        yield Servos(emulator), {
            **dynamixel_parameters(emulator.port, len(TENDONS)),
            'dynamixel.signs': [float(sign) for sign in SIGNS[:len(TENDONS)]],
            'tendon_speed': SERVO_SPEED}


BOARDS: dict[str, Callable[
    [Path, float], AbstractContextManager[tuple[Board[Any], Mapping[str, Any]]]]] = {
        'grbl': _steppers, 'dynamixel': _servos}
"""By tendon_driver: emulator, and the parameters of the nodes, in a folder; how much faster."""
