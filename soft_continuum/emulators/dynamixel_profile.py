# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The way to a goal position: step, rectangular or trapezoidal profile.

After 'What is the Profile' of the e-Manual (_includes/en/dxl/profile_description.md).
"""

from math import inf, sqrt

STEP, RECTANGULAR, TRIANGULAR, TRAPEZOIDAL = range(4)
"""As bits 4 and 5 of Moving Status have them."""
NEAR = 0.01  # pulses


class Profile:
    """
    A desired position (pulses) and speed (pulses/s) on the way to ``goal``.

    A new goal begins with the speed that there is.
    """

    def __init__(self, position: float) -> None:
        """Stand."""
        self.hold(position)

    def hold(self, position: float) -> None:
        """End here, at once."""
        self.position = self.goal = position
        self.speed = 0.0
        self.kind = STEP
        self._limit = self._acceleration = inf

    @property
    def ongoing(self) -> bool:
        """Whether the goal has not been reached."""
        return self.position != self.goal

    def begin(self, goal: float, velocity: float, acceleration: float) -> None:
        """Go to ``goal``; velocity (pulses/s) 0 is a step, acceleration (pulses/s^2) 0 endless."""
        self.goal = goal
        self._limit = velocity or inf
        self._acceleration = acceleration or inf
        if not velocity:
            self.kind = STEP
        elif not acceleration:
            self.kind = RECTANGULAR
        else:
            reached = velocity**2 / acceleration < abs(goal - self.position)
            self.kind = TRAPEZOIDAL if reached else TRIANGULAR

    def begin_timed(self, goal: float, duration: float, ramp: float) -> None:
        """Go to ``goal`` in ``duration`` s (0: a step), of which ``ramp`` s each to start, end."""
        ramp = min(ramp, 0.5 * duration)
        velocity = abs(goal - self.position) / (duration - ramp) if duration else 0.0
        self.begin(goal, velocity, velocity / ramp if ramp else 0.0)

    def advance(self, time: float) -> None:
        """Let time (s) pass."""
        left = self.goal - self.position
        if self._limit == inf:
            self.position, self.speed = self.goal, 0.0
            return
        if self._acceleration == inf:
            wanted = min(self._limit, abs(left) / time)
            self.speed = wanted if left > 0.0 else -wanted
        else:
            change = self._acceleration * time
            # Of a braking in steps of time, so that it ends at the goal.
            wanted = min(self._limit, abs(left) / time,
                         sqrt(change**2 / 4.0 + 2.0 * self._acceleration * abs(left)) - change / 2)
            wanted = wanted if left > 0.0 else -wanted
            self.speed += max(-change, min(change, wanted - self.speed))
        self.position += self.speed * time
        if abs(self.goal - self.position) < NEAR and abs(self.speed) * time < 1.0:
            self.position, self.speed = self.goal, 0.0
