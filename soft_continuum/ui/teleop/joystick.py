# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A joystick, and the keyboard as one: its axes and buttons, and the enable button."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import copysign, inf, isfinite
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


MOVE = 'hold the enable button and move the stick'
RELEASE = 'release the enable button, let go of the stick, then press it again'


class EnableButton:
    """
    Allows motion when the button is pressed with the stick at rest, and ends it on any fault.

    Times are of one steady clock, s.  After every end the button must be released, then pressed
    with every stick at rest.

    A message that is delayed more than others of its sender is stale: the stick may be released by
    now.  Only differences between stamps count, so the clocks need not agree.
    """

    def __init__(self, timeout: float, unchanged_timeout: float) -> None:
        """
        Begin without a device.

        timeout: s without a message after which motion ends.  unchanged_timeout: s after which it
        ends if messages continue unchanged, as from a pad that has lost its radio, or without its
        operator.
        """
        self.timeout, self.unchanged_timeout = timeout, unchanged_timeout
        self.problem = ''
        """Why a held button moves nothing, or why motion ended; empty while motion is allowed."""
        self._controls: PadState | None = None  # None: no device
        self._received = self._changed = -inf
        self._was_released = self._may_move = False
        self._delay = inf  # s, the smallest between a stamp and its reception

    @property
    def held(self) -> bool:
        """Whether the button is held, by the last message."""
        return self._controls is not None and ENABLE in self._controls.pressed

    def receive(self, controls: PadState, now: float, stamp: float | None = None) -> None:
        """Process a message; stamp: s by the clock of its sender, None without one."""
        self.check(now)
        if stamp is not None:
            delay, least = now - stamp, self._delay
            self._delay = min(delay, least)
            if delay > least + self.timeout:
                self._delay = delay  # the clock of the sender was set, if this goes on
                self.lose(f'a message of the joystick came {delay - least:.2f} s late')
                return
        if controls != self._controls:
            self._changed = now
        self._controls, self._received = controls, now
        if not self.held:
            self._was_released, self._may_move, self.problem = True, False, ''
        elif not self._was_released:
            if RELEASE not in self.problem:
                self.problem = f'{self.problem}: {RELEASE}' if self.problem else RELEASE
        elif not self._may_move:
            self._may_move = controls.at_rest
            self.problem = '' if controls.at_rest else (
                f'the stick was not at rest ({_shown(controls)}) when the enable button was '
                'pressed: let go of the stick; if it drifts, enlarge teleop.dead_zone')
        elif not controls.at_rest and now - self._changed > self.unchanged_timeout:
            self.end(f'nothing changed for {self.unchanged_timeout:g} s')

    def lose(self, reason: str) -> None:
        """End motion: a message was invalid or stale."""
        self._controls = None
        self.end(reason)

    def check(self, now: float) -> None:
        """End motion if the last message is too old."""
        if self._controls is not None and now - self._received > self.timeout:
            self._delay = inf
            self.lose(f'nothing received from the joystick for {self.timeout:g} s')

    def stick(self, now: float) -> tuple[float, float, float] | None:
        """Return the deflection by which the arm may move now; None when it must not."""
        self.check(now)
        return self._controls.stick if self._controls is not None and self._may_move else None

    def connected(self, now: float) -> bool:
        """Whether messages are received."""
        self.check(now)
        return self._controls is not None

    def end(self, reason: str) -> None:
        """End motion, for a reason that is shown while the button is held."""
        self._was_released = self._may_move = False
        self.problem = reason


def _shown(controls: PadState) -> str:
    return ', '.join(f'{axis} {value:+.2f}' for axis, value in zip(
        'xyz', controls.stick, strict=True) if value)


HELD = 0.2  # s: keyboards repeat 10 to 30 times per second
STICK = {'right': (1, 0, 0), 'left': (-1, 0, 0), 'up': (0, 1, 0), 'down': (0, -1, 0),
         'u': (0, 0, 1), 'j': (0, 0, -1)}
"""Deflection by key."""
PRESSED = {'s': SOFTEN, 't': STIFFEN, 'n': NEXT_SEGMENT, 'm': MODE, 'r': RESET,
           'e': EMERGENCY_STOP}
"""Button by key."""
SPEEDS = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0)
FASTER, SLOWER = ('+', '='), ('-', '_')


class Keyboard:
    """
    A keyboard as a joystick: which keys are held; times are of one steady clock, s.

    A terminal reports a pressed key, repeatedly while it is held, but never its release.  So a key
    counts as held for HELD after its last report.  Keyboards repeat only after 0.25 to 0.7 s: a
    key first nudges the arm for HELD, and continues once it repeats.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self._speed = 3
        self._last = '', -inf  # key of the stick, and when it was told last
        self._button = '', -inf
        self._gripped = False  # the enable button was told to be held

    @property
    def speed(self) -> float:
        """Part of full speed at which a key moves the arm."""
        return SPEEDS[self._speed]

    def press(self, key: str, now: float) -> None:
        """Process a key that is pressed, or still held."""
        if key in STICK:
            self._last = key, now
        elif key in PRESSED:
            self.release()
            self._button = PRESSED[key], now
        elif key in FASTER:
            self._speed = min(self._speed + 1, len(SPEEDS) - 1)
        elif key in SLOWER:
            self._speed = max(self._speed - 1, 0)
        else:  # whatever else is hit: nothing goes on
            self.release()

    def release(self) -> None:
        """Let go of all keys."""
        self._last = self._button = '', -inf

    def controls(self, now: float) -> PadState:
        """Return the state as of a joystick: first its button is held, then it is deflected."""
        button, pressed = self._button
        if now - pressed <= HELD:
            return PadState(pressed=frozenset({button}))
        key, told = self._last
        if now - told > HELD:
            self._gripped = False
            return PadState()
        before, self._gripped = self._gripped, True
        x, y, z = (self.speed * value for value in STICK[key]) if before else (0.0, 0.0, 0.0)
        return PadState((x, y, z), frozenset({ENABLE}))
