# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The control loop of a servo, from its goals to the voltage of its motor.

After 'Position PID Gain' and 'Operating Mode' of the e-Manual: the profile gives the desired
position, a PID of its error the PWM, Goal PWM limits that, and in Current-based Position Control
Goal Current limits the current, and so the torque.  Feedforward is left out.
"""

from collections.abc import Mapping

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
from soft_continuum.emulators.dynamixel_profile import Profile

P_UNIT, I_UNIT, D_UNIT = 1.0 / 128.0, 1.0 / 65536.0, 1.0 / 16.0
LOOP_TIME = 1e-3  # s of one step of the sums of the integral and the derivative; assumed


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
