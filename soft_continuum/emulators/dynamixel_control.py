# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The control loop of a servo, from its goals to the voltage of its motor.

After 'Position PID Gain' and 'Operating Mode' of the e-Manual: the profile gives the desired
position, a PID of its error the PWM, Goal PWM limits that, and in Current-based Position Control
Goal Current limits the current, and so the torque.  Feedforward is left out.
"""

from collections.abc import Mapping
from math import inf, sqrt

from soft_continuum.emulators.dynamixel_models import (
    ACCELERATION_UNIT,
    CURRENT,
    CURRENT_POSITION,
    FULL_PWM,
    Model,
    PULSE,
    PWM,
    VELOCITY,
    VELOCITY_UNIT,
)
from soft_continuum.emulators.dynamixel_motor import Motor

P_UNIT, I_UNIT, D_UNIT = 1.0 / 128.0, 1.0 / 65536.0, 1.0 / 16.0
LOOP_TIME = 1e-3  # s of one step of the sums of the integral and the derivative; assumed
STEP, RECTANGULAR, TRIANGULAR, TRAPEZOIDAL = range(4)
"""As bits 4 and 5 of Moving Status have them."""
NEAR = 0.01  # pulses


class Control:
    """Voltage and torque limit for a motor; values: the control table by names."""

    def __init__(self, motor: Motor, values: Mapping[str, int], model: Model) -> None:
        """Stand."""
        self.profile = Profile(0.0)
        self.voltage = 0.0
        self._motor, self._values, self._model = motor, values, model
        self._sum = self._before = 0.0
        self._stopped = False

    def hold(self, position: float) -> None:
        """Keep a position (pulses)."""
        self.profile.hold(position)
        self._sum = self._before = 0.0
        self._stopped = False

    def stop(self, position: float) -> None:
        """Keep a position in every mode until there is a new goal."""
        self.hold(position)
        self._stopped = True

    def resume(self) -> None:
        """Follow the goals of the mode again after a stop."""
        self._stopped = False

    def begin(self, goal: int) -> None:
        """Go to a goal (pulses)."""
        values = self._values
        self.resume()
        if values['Drive Mode'] & 4:
            self.profile.begin_timed(goal, 1e-3 * values['Profile Velocity'],
                                     1e-3 * values['Profile Acceleration'])
        else:
            self.profile.begin(goal, values['Profile Velocity'] * VELOCITY_UNIT,
                               values['Profile Acceleration'] * ACCELERATION_UNIT)

    def step(self, time: float, position: float) -> None:
        """Let a little time (s) pass; position: as the servo counts it, pulses."""
        values, model = self._values, self._model
        if not values['Torque Enable']:
            self.profile.hold(position)
            self._sum = self._before = self.voltage = 0.0
            self._motor.step(time, 0.0, 0.0)
            return
        mode, limit = values['Operating Mode'], 2.0 * model.stall_torque
        most = abs(values['Goal PWM']) / FULL_PWM
        sign = -1.0 if values['Drive Mode'] & 1 else 1.0
        if self._stopped and mode in (CURRENT, VELOCITY, PWM):
            voltage = self._of_position(time, position)
        elif mode == PWM:
            voltage = values['Goal PWM'] / FULL_PWM
        elif mode == CURRENT:
            limit = self._torque(values['Goal Current'])
            voltage = 1.0 if values['Goal Current'] > 0 else -1.0
        elif mode == VELOCITY:
            wanted = values['Goal Velocity'] * VELOCITY_UNIT * PULSE
            now = sign * self._motor.speed
            voltage = self._limited(wanted + 5.0 * (wanted - now), model.full_speed)
        else:
            self.profile.advance(time)
            voltage = self._of_position(time, position)
            if mode == CURRENT_POSITION:
                limit = self._torque(values['Goal Current'])
        self.voltage = sign * max(-most, min(most, voltage))
        # A torque of 0 would be a motor that is switched off.
        self._motor.step(time, self.voltage, max(limit, 1e-9))

    def _torque(self, current: int) -> float:
        return abs(current) * self._model.current_unit * self._model.torque_constant

    @staticmethod
    def _limited(speed: float, full_speed: float) -> float:
        return max(-1.0, min(1.0, speed / full_speed))

    def _of_position(self, time: float, position: float) -> float:
        """Return what the PID gives, as a part of the full voltage."""
        values = self._values
        error = self.profile.position - position
        steps = time / LOOP_TIME
        change, self._before = (error - self._before) / steps, error
        integral = values['Position I Gain'] * I_UNIT
        if integral:
            most = FULL_PWM / integral
            self._sum = max(-most, min(most, self._sum + error * steps))
        else:
            self._sum = 0.0
        return (values['Position P Gain'] * P_UNIT * error + integral * self._sum
                + values['Position D Gain'] * D_UNIT * change) / FULL_PWM


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
