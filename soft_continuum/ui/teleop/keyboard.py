# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A keyboard as a joystick.

A terminal reports a pressed key, repeatedly while it is held, but never its release.  So a key
counts as held for HELD after its last report.  Keyboards repeat only after 0.25 to 0.7 s: a key
first nudges the arm for HELD, and continues once it repeats.
"""

from math import inf

from soft_continuum.ui.teleop.pad import (
    EMERGENCY_STOP,
    ENABLE,
    MODE,
    NEXT_SEGMENT,
    PadState,
    RESET,
    SOFTEN,
    STIFFEN,
)

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
    """Which keys are held; times are of one steady clock, s."""

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
