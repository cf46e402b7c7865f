# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Mapping of the axes and buttons of a joystick."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import copysign, isfinite
from typing import Any

from soft_continuum.parameters.parameter import ParameterError

NONE = -1
"""Number of an axis or a button that the device does not have."""
ENABLE = 'enable'
EMERGENCY_STOP = 'emergency_stop'
RESET = 'reset'
MODE = 'mode'
NEXT_SEGMENT = 'next_segment'
SOFTEN, STIFFEN = 'soften', 'stiffen'
BUTTONS = (ENABLE, EMERGENCY_STOP, RESET, MODE, NEXT_SEGMENT, SOFTEN, STIFFEN)
AXES = ('x', 'y', 'z')
MAX_AXIS = 1.001  # that an axis may show; joy_node goes to 1


class PadError(ValueError):
    """A message that is not one of the device that the parameters describe."""


@dataclass(frozen=True)
class PadState:
    """
    The state of stick and buttons.

    stick: deflection along x, y and z, each from -1 to 1, exactly 0 at rest.  pressed: names in
    BUTTONS.
    """

    stick: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pressed: frozenset[str] = frozenset()

    @property
    def at_rest(self) -> bool:
        """Whether no stick is deflected."""
        return not any(self.stick)


@dataclass(frozen=True)
class Pad:
    """
    Numbers and scales of the axes and buttons of a message.

    axes, scales: of x, y, z.  buttons: number by name.  dead_zone: deflection that counts as rest.
    """

    axes: tuple[int, ...]
    scales: tuple[float, ...]
    buttons: Mapping[str, int]
    dead_zone: float

    @staticmethod
    def from_parameters(values: Mapping[str, Any]) -> 'Pad':
        """Return the described pad; raises ParameterError if two functions share a number."""
        pad = Pad(tuple(values[f'teleop.{axis}_axis'] for axis in AXES),
                  tuple(values[f'teleop.{axis}_scale'] for axis in AXES),
                  {name: values[f'teleop.{name}_button'] for name in BUTTONS},
                  values['teleop.dead_zone'])
        for kind, numbers in (('axis', dict(zip(AXES, pad.axes, strict=True))),
                              ('button', dict(pad.buttons))):
            owners: dict[int, str] = {}
            for name, number in numbers.items():
                if number != NONE and owners.setdefault(number, name) != name:
                    raise ParameterError(
                        f'teleop.{owners[number]}_{kind} and teleop.{name}_{kind} are both '
                        f'{number}; give one of them another number, or -1 for none')
        return pad

    def read(self, axes: Sequence[float], buttons: Sequence[int]) -> PadState:
        """Return the controls in a message of the device; raises PadError."""
        if not axes and not buttons:
            raise PadError('the message has no axes and no buttons; is the joystick plugged in?')
        for n, value in enumerate(axes):
            if n in self.axes and not (isfinite(value) and abs(value) <= MAX_AXIS):
                raise PadError(f'axis {n} is {value:g}; allowed: -1 to 1; check the driver of the '
                               'joystick')
        stick = []
        for name, number, scale in zip(AXES, self.axes, self.scales, strict=True):
            _check_number(f'teleop.{name}_axis', 'axis', number, len(axes))
            stick.append(0.0 if number == NONE else self._beyond(axes[number]) * scale)
        pressed = set()
        for name, number in self.buttons.items():
            _check_number(f'teleop.{name}_button', 'button', number, len(buttons))
            if number != NONE and buttons[number]:
                pressed.add(name)
        return PadState((stick[0], stick[1], stick[2]), frozenset(pressed))

    def write(self, controls: PadState) -> tuple[list[float], list[int]]:
        """Return the axes and buttons of a message with these controls, if the pad has them."""
        axes = [0.0] * (max(self.axes) + 1)
        buttons = [0] * (max(self.buttons.values()) + 1)
        for value, number, scale in zip(controls.stick, self.axes, self.scales, strict=True):
            if number != NONE and value and scale:
                share = min(abs(value / scale), 1.0)
                axes[number] = copysign(
                    self.dead_zone + share * (1.0 - self.dead_zone), value * scale)
        for name in controls.pressed:
            if self.buttons[name] != NONE:
                buttons[self.buttons[name]] = 1
        return axes, buttons

    def _beyond(self, value: float) -> float:
        """Return the deflection beyond the dead zone, -1 to 1."""
        beyond = max(0.0, min(abs(value), 1.0) - self.dead_zone) / (1.0 - self.dead_zone)
        return copysign(beyond, value) if beyond else 0.0


def _check_number(parameter: str, kind: str, number: int, count: int) -> None:
    if number >= count:
        plural = 'axes' if kind == 'axis' else 'buttons'
        raise PadError(f'the message has {count} {plural}, none with the number {number} '
                       f'({parameter}); give the parameter the number that this joystick has')
