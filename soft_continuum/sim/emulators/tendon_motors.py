# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The emulated motors of all tendons of an arm, and the parameters of nodes that drive them."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path
from typing import Self

from soft_continuum.hardware.clock import Clock
from soft_continuum.parameters.parameter import Value
from soft_continuum.sim.emulators.device import EmulatedDevice
from soft_continuum.sim.emulators.dynamixel import (
    dynamixel_parameters,
    DynamixelEmulator,
    make_servos,
    SERVO_MODEL,
)
from soft_continuum.sim.emulators.grbl import grbl_parameters, GrblEmulator, STEPS_PER_MM
from soft_continuum.sim.emulators.modbus import modbus_parameters

AXES = 3
"""Axes of an emulated board; boards share the tendons of larger arms evenly."""


def board_links(first: str | Path, tendons: int) -> tuple[str, ...]:
    """Return a link to the port of each GRBL board of an arm: the first, then with _2, _3, ..."""
    return tuple(str(first) + (f'_{n}' if n > 1 and str(first) else '')
                 for n in range(1, ceil(tendons / AXES) + 1))


def driving_parameters(grbl: str | Path = '', modbus: str | Path = '', tendons: int = 2, *,
                       dynamixel: str | Path = '') -> dict[str, Value]:
    """
    Return the node parameters for boards at these ports.

    grbl: of the tendons, with spaces between; or dynamixel: of servos.  tendons: how many.
    """
    moving = (dynamixel_parameters(dynamixel, tendons) if dynamixel
              else grbl_parameters(grbl, tendons))
    return moving | modbus_parameters(modbus)


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
