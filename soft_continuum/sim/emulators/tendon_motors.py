# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The emulated motors of all tendons of an arm, whatever drives them."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path
from typing import Self

from soft_continuum.hardware.clock import Clock
from soft_continuum.parameters.parameter import Value
from soft_continuum.sim.emulators.device import EmulatedDevice
from soft_continuum.sim.emulators.driving import (
    board_links,
    dynamixel_parameters,
    grbl_parameters,
    SERVO_MODEL,
    STEPS_PER_MM,
)
from soft_continuum.sim.emulators.dynamixel import DynamixelEmulator, make_servos
from soft_continuum.sim.emulators.grbl import GrblEmulator


@dataclass
class TendonMotors:
    """
    Motors that pull tendons; they are plugged in while this context manager is open.

    pulls: returns the pull of each tendon since the start, m.  load: applies tensions of the
    tendons to the motors, N.  parameters: returns those of a node that is to drive them.
    """

    devices: Sequence[EmulatedDevice]
    pulls: Callable[[], tuple[float, ...]]
    load: Callable[[Sequence[float]], None]
    parameters: Callable[[], dict[str, Value]]
    _plugged: ExitStack = field(default_factory=ExitStack)

    def __enter__(self) -> Self:
        """Plug in; raises OSError for a link that cannot be."""
        with ExitStack() as devices:
            for device in self.devices:
                devices.enter_context(device)
            self._plugged = devices.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """End."""
        self._plugged.close()


def _grbl(link: str | Path, tendons: int, clock: Clock) -> TendonMotors:
    """Return steppers on GRBL boards, which no tension stops; further ports end with _2, ..."""
    boards = [GrblEmulator(path, clock) for path in board_links(link, tendons)]
    share = ceil(tendons / len(boards))
    return TendonMotors(
        boards,
        lambda: tuple(steps / (STEPS_PER_MM * 1e3) for board in boards
                      for steps in board.motors[:share])[:tendons],
        lambda tensions: None,  # a stepper holds, or it loses steps
        lambda: grbl_parameters(' '.join(board.port for board in boards), tendons))


def _dynamixel(link: str | Path, tendons: int, clock: Clock) -> TendonMotors:
    """Return servos on one bus, which stall when a tension is more than their current limit."""
    bus = DynamixelEmulator(make_servos(tendons, SERVO_MODEL), link or None, clock)

    def load(tensions: Sequence[float]) -> None:
        for servo, tension in zip(bus.servos, tensions, strict=True):
            servo.motor.tendon.tension = float(tension)

    load([0.0] * tendons)
    return TendonMotors([bus], lambda: bus.pulls, load,
                        lambda: dynamixel_parameters(bus.port, tendons))


TENDON_MOTORS: Mapping[str, Callable[[str | Path, int, Clock], TendonMotors]] = {
    'grbl': _grbl, 'dynamixel': _dynamixel}
"""Emulated motors by the name of their driver."""
