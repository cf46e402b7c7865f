# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Motion of the servos by their replies: speed, rest, and detection of blocked ones.

One blocked servo soon stops the others.

A servo lags behind its goal, by more under load, so its position error is a poor indicator.  Its
travel is a better one: it is compared with that of an unloaded motor.  Load and friction change a
part of the travel, or change it once; a blocked servo does not travel at all.
"""

from collections import deque
from collections.abc import Sequence

from soft_continuum.hardware.dynamixel.exchange import profile_speed, ServoState
from soft_continuum.hardware.dynamixel.registers import RADIANS_PER_PULSE, TICK_RANGE
from soft_continuum.hardware.dynamixel.setup import FoundServo, FRICTION_SHARE, Spools

REST_TIME, REST_PULSES = 0.03, 1
"""Time (s) in which a servo at rest turns by at most so many pulses."""
VELOCITY_TIME = 0.008  # s
SHORT, SHARE = 1.5e-4, 0.15
"""Tolerated travel error (m), and share of the expected travel below which a servo is blocked."""
MEMORY = 1.0  # s in which the way is looked at
MOTOR_TIME, MAX_MOTOR_TIME = 0.015, 0.03
"""s in which a motor follows a voltage, est, and of one with much inertia, by its current."""
MAX_LATE = 0.005  # s between request and reply after which the goal in force is unknown
CYCLE, STEP = 0.01, 1e-3  # s


class Track:
    """Positions of servos in the last REST_TIME."""

    def __init__(self, time: float, positions: Sequence[int]) -> None:
        """Begin with servos at rest at ``positions``; time: s."""
        self._places = deque([(time, positions)])

    def add(self, time: float, positions: Sequence[int]) -> None:
        """Add positions of a later time (s)."""
        self._places.append((time, positions))
        while len(self._places) > 2 and self._places[1][0] <= time - REST_TIME:
            self._places.popleft()

    def velocities(self) -> list[float]:
        """Return the velocities in the last 0.01 s, pulses/s."""
        end, places = self._places[-1]
        begin, before = next(
            ((time, at) for time, at in reversed(self._places) if time <= end - VELOCITY_TIME),
            self._places[0])
        return [(b - a) / max(end - begin, VELOCITY_TIME)
                for a, b in zip(before, places, strict=True)]

    def still(self) -> bool:
        """Whether they have rested for REST_TIME."""
        return len(self._places) > 2 and (
            self._places[-1][0] - self._places[0][0] > 0.99 * REST_TIME) and all(
            max(places) - min(places) <= REST_PULSES
            for places in zip(*(places for _, places in self._places), strict=True))


class Following:
    """Compares servos with unloaded motors; for one thread at a time."""

    def __init__(self, servos: Sequence[FoundServo], spools: Spools,
                 states: Sequence[ServoState]) -> None:
        """Begin with servos at rest."""
        self._servos, self._scale = tuple(servos), spools.pull_per_pulse
        # Friction of the gear turns with the direction.
        self._short = [SHORT + 1.5 * abs(scale) * FRICTION_SHARE * servo.full_error
                       * servo.tension_limit * servo.radius / servo.model.stall_torque
                       for servo, scale in zip(servos, self._scale, strict=True)]
        self.place(states)

    def place(self, states: Sequence[ServoState]) -> None:
        """Start again with servos at rest."""
        self._places = [float(state.written.goal) for state in states]  # of the motors, pulses
        self._most = [  # pulses/s^2 with what its load leaves of the current of a servo
            max(0, servo.goal_current - abs(state.current)) * servo.tension(1) * servo.radius
            / servo.model.stall_torque * servo.model.no_load_speed / RADIANS_PER_PULSE
            / MAX_MOTOR_TIME for servo, state in zip(self._servos, states, strict=True)]
        self._speeds = [0.0] * len(self._places)  # pulses/s
        self._behind: list[deque[tuple[float, float]]] = [deque() for _ in self._places]
        """For each servo, where the motor and where it were, pulses, up to MEMORY ago."""

    def add(self, before: Sequence[ServoState], states: Sequence[ServoState], missed: bool
            ) -> None:
        """Add the latest positions; missed: whether states before them were lost."""
        for i, (old, new) in enumerate(zip(before, states, strict=True)):
            self._go_on(i, old, 1e-3 * ((new.tick - old.tick) % TICK_RANGE))
            seen = self._behind[i]
            if missed or new.time - new.asked > MAX_LATE:
                seen.clear()
            seen.append((self._places[i], new.position))
            if len(seen) > MEMORY / CYCLE:
                seen.popleft()

    def _go_on(self, i: int, state: ServoState, elapsed: float) -> None:
        """Let the motor of a servo go on to its goal."""
        fastest, lag = profile_speed(state.written), self._servos[i].lag_time
        while elapsed > 0.0:
            step = min(elapsed, STEP)
            wanted = (state.written.goal - self._places[i]) / lag
            wanted = max(-fastest, min(fastest, wanted))
            faster = (wanted - self._speeds[i]) / MOTOR_TIME
            self._speeds[i] += max(-self._most[i], min(self._most[i], faster)) * step
            self._places[i] += self._speeds[i] * step
            elapsed -= step

    @property
    def caught(self) -> int | None:
        """Which servo does not follow; None if all do."""
        for i, (seen, scale, short) in enumerate(zip(
                self._behind, self._scale, self._short, strict=True)):
            place, position = seen[-1] if seen else (0.0, 0.0)
            for motor, servo in seen:
                way, gone = abs(place - motor), position - servo
                gone = gone if place > motor else -gone
                if abs(scale) * (way - gone) > short and gone < SHARE * way:
                    return i
        return None
