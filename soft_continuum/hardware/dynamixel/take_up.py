# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Take-up of slack: each tendon in turn is pulled in until its servo measures a small tension."""

from collections.abc import Sequence

from soft_continuum.hardware.dynamixel.exchange import ServoState
from soft_continuum.hardware.dynamixel.setup import FoundServo, Spools

SPEED = 0.002  # m/s
MAX_TRAVEL = 0.02  # m of each tendon
MAX_AHEAD = 0.002
"""Largest lead of a goal (m), which limits the jerk if a tendon gives way."""
TAUT_SHARE = 0.9  # of the current for that tension
TAUT_TIME = 0.2  # s
TAUT_PULSES = 2  # that a taut tendon may move in that time
MAX_TIME = 30.0  # s for each tendon, whatever happens


class TakeUp:
    """
    Takes up the slack of one tendon after the other; for one thread at a time.

    The servo itself limits the tension: its Goal Current is that of the tension until all tendons
    are taut.  currents: Goal Current of each servo.  goals: Goal Position of each.  failed: why
    the slack was not taken up, or empty.  done: whether it has ended.
    """

    def __init__(self, servos: Sequence[FoundServo], spools: Spools, positions: Sequence[int],
                 goals: Sequence[int], now: float) -> None:
        """Begin from where servos rest at their ``goals``; now: s."""
        self._servos, self._scale = tuple(servos), spools.pull_per_pulse
        self._tension = spools.take_up_tension
        self.currents = [servo.goal_current for servo in servos]
        self.goals = list(goals)
        self.failed, self.done = '', False
        self._at = -1
        self._next(positions, now)

    def _next(self, positions: Sequence[int], now: float) -> None:
        """Go on with the next tendon, from where it is."""
        self._at += 1
        if self._at == len(self._servos):
            self.done = True
            return
        at = self._at
        self.currents[at] = max(1, self._servos[at].current(self._tension))
        self._start, self._began, self._stepped = positions[at], now, now
        self._goal = float(positions[at])
        self._still = (now, positions[at])  # since when it rests, and where

    def step(self, states: Sequence[ServoState], now: float) -> None:
        """Set goals and currents for now (s); ``states``: the last replies of the servos."""
        at, servo = self._at, self._servos[self._at]
        state, scale = states[at], self._scale[at]
        if abs(state.position - self._still[1]) > TAUT_PULSES:
            self._still = now, state.position
        sign = 1.0 if scale > 0.0 else -1.0
        taut = (sign * state.current >= TAUT_SHARE * self.currents[at]
                and now - self._still[0] >= TAUT_TIME)
        if taut:
            self._next([s.position for s in states], now)
            return
        travel = scale * (state.position - self._start)
        if travel > MAX_TRAVEL or now - self._began > MAX_TIME:
            self.done = True
            self.failed = (
                f'{servo} pulled its tendon in by {1e3 * travel:.1f} mm without a tension of '
                f'{self._tension:g} N (dynamixel.take_up_tension): hook it in, take up slack by '
                'hand, or check dynamixel.signs and dynamixel.torque_constants')
            return
        ahead = self._goal + SPEED * min(now - self._stepped, 0.03) / scale
        most = state.position + MAX_AHEAD / scale
        self._goal = min(ahead, most) if scale > 0.0 else max(ahead, most)
        self._stepped = now
        self.goals[at] = round(self._goal)
