# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The emulated motors of all tendons of an arm, whatever drives them."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from itertools import chain
from math import ceil
from pathlib import Path
from typing import Protocol, Self

from soft_continuum.emulators.driving import (
    board_links,
    dynamixel_parameters,
    grbl_parameters,
)
from soft_continuum.emulators.dynamixel import make_servos
from soft_continuum.emulators.dynamixel_bus import DynamixelEmulator
from soft_continuum.emulators.grbl import STEPS_PER_MM
from soft_continuum.emulators.grbl_board import GrblEmulator
from soft_continuum.hardware.clock import Clock
from soft_continuum.parameters.parameter import Value

SERVO_MODEL = 'XM430-W350'


class TendonMotors(Protocol):
    """Motors that pull tendons; they are plugged in while this context manager is open."""

    def __enter__(self) -> Self:
        """Plug in; raises OSError for a link that cannot be."""

    def __exit__(self, *_: object) -> None:
        """End."""

    def pulls(self) -> tuple[float, ...]:
        """Return by how much each has pulled in its tendon since the beginning, m."""

    def load(self, tensions: Sequence[float]) -> None:
        """Let the tendons pull at the motors with these tensions, N."""

    def parameters(self) -> dict[str, Value]:
        """Return the parameters of a node that is to drive them."""


class GrblMotors:
    """Steppers on GRBL boards, which no tension stops."""

    def __init__(self, link: str | Path, tendons: int, clock: Clock) -> None:
        """Make the boards; the ports of further ones end with _2, _3, ..."""
        self._tendons = tendons
        self._boards = [GrblEmulator(path, clock) for path in board_links(link, tendons)]
        self._devices = ExitStack()

    def __enter__(self) -> Self:
        """Plug in; raises OSError for a link that cannot be."""
        with ExitStack() as devices:
            for board in self._boards:
                devices.enter_context(board)
            self._devices = devices.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """End."""
        self._devices.close()

    def pulls(self) -> tuple[float, ...]:
        """Return by how much each has pulled in its tendon since the beginning, m."""
        share = ceil(self._tendons / len(self._boards))
        motors = chain.from_iterable(board.motors[:share] for board in self._boards)
        return tuple(steps / (STEPS_PER_MM * 1e3) for steps in motors)[:self._tendons]

    def load(self, tensions: Sequence[float]) -> None:
        """Do nothing: a stepper holds, or it loses steps."""

    def parameters(self) -> dict[str, Value]:
        """Return the parameters of a node that is to drive them."""
        return grbl_parameters(' '.join(board.port for board in self._boards), self._tendons)


class DynamixelMotors:
    """Servos on one bus, which stall when a tension is more than their current limit."""

    def __init__(self, link: str | Path, tendons: int, clock: Clock) -> None:
        """Make the servos, without tension."""
        self.bus = DynamixelEmulator(make_servos(tendons, SERVO_MODEL), link or None, clock)
        self.load([0.0] * tendons)

    def __enter__(self) -> Self:
        """Plug in; raises OSError for a link that cannot be."""
        self.bus.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        """End."""
        self.bus.__exit__()

    def pulls(self) -> tuple[float, ...]:
        """Return by how much each has pulled in its tendon since the beginning, m."""
        return self.bus.pulls

    def load(self, tensions: Sequence[float]) -> None:
        """Let the tendons pull at the servos with these tensions, N."""
        for servo, tension in zip(self.bus.servos, tensions, strict=True):
            servo.motor.tendon.tension = float(tension)

    def parameters(self) -> dict[str, Value]:
        """Return the parameters of a node that is to drive them."""
        return dynamixel_parameters(self.bus.port, len(self.bus.servos))


TENDON_MOTORS: Mapping[str, Callable[[str | Path, int, Clock], TendonMotors]] = {
    'grbl': GrblMotors, 'dynamixel': DynamixelMotors}
"""By the name of the driver that drives them."""
