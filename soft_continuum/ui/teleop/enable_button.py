# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The enable button: a joystick may move an arm only while it is held and all checks pass."""

from math import inf

from soft_continuum.ui.teleop.pad import ENABLE, PadState

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
