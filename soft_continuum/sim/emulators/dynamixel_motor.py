# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The geared motor of a servo, its spool and the tendon on it, and the control loop of the motor.

A DC motor: its torque falls from the stall torque to nothing at the speed without load, both in
proportion to the voltage.  The gears rub with a part of the load and a part of the stall torque,
and the tendon turns the spool back when nothing holds it.  Inertia and friction are assumptions
(the maker gives neither): they are the order of what such servos show.

The loop is that of 'Position PID Gain' and 'Operating Mode' of the e-Manual: the profile gives the
desired position, a PID of its error the PWM, Goal PWM limits that, and in Current-based Position
Control Goal Current limits the current, and so the torque.  Feedforward is left out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import copysign, inf, sqrt

from soft_continuum.sim.emulators.dynamixel_models import (
    ACCELERATION_UNIT,
    CURRENT,
    CURRENT_POSITION,
    EmulatedModel,
    FULL_PWM,
    PULSE,
    PWM,
    VELOCITY,
    VELOCITY_UNIT,
)

TIME_CONSTANT = 0.015  # s in which the motor follows a voltage, est
LOAD_FRICTION = 0.1  # of the load torque, est
OWN_FRICTION = 0.01  # of the stall torque, est
OFF_DAMPING = 0.1  # of the damping of the powered motor, est
STICTION, STANDSTILL = 1.2, 1e-3
"""Factor of friction below this speed (rad/s), est."""
P_UNIT, I_UNIT, D_UNIT = 1.0 / 128.0, 1.0 / 65536.0, 1.0 / 16.0
LOOP_TIME = 1e-3  # s of one step of the sums of the integral and the derivative; assumed
STEP, RECTANGULAR, TRIANGULAR, TRAPEZOIDAL = range(4)
"""Profile types, bits 4 and 5 of Moving Status."""
NEAR = 0.01  # pulses


@dataclass
class SpringTendon:
    """
    A tendon on a spool, as a spring that cannot push.

    radius: m.  sign: 1 if positive angles pull it in.  stiffness: N/m.  slack: m that must be
    pulled in before it is taut.  weight: additional load, N.  tension: N, from the plant of a
    twin, which then replaces all these.
    """

    radius: float = 0.01
    sign: int = 1
    stiffness: float = 2000.0
    slack: float = 0.0
    weight: float = 0.0
    tension: float | None = None

    def pull(self, angle: float) -> float:
        """Return the pull (m) at an angle (rad) of the spool."""
        return self.sign * self.radius * angle

    def tension_at(self, angle: float) -> float:
        """Return the tension, N."""
        if self.tension is not None:
            return self.tension
        return max(0.0, self.stiffness * (self.pull(angle) - self.slack)) + self.weight


class Motor:
    """
    A motor, its gears and its spool; positive torque and angle have the same direction.

    angle: rad since the beginning.  speed: rad/s.  torque: N m, of the motor before the gears rub.
    caught: it is blocked.
    """

    def __init__(self, model: EmulatedModel, tendon: SpringTendon) -> None:
        """Stand at angle 0."""
        self.tendon = tendon
        self.angle = self.speed = self.torque = 0.0
        self.caught = False
        self._stall = model.stall_torque
        self._damping = model.stall_torque / model.full_speed
        self._inertia = TIME_CONSTANT * self._damping

    @property
    def pull(self) -> float:
        """Pull of the tendon, m."""
        return self.tendon.pull(self.angle)

    @property
    def tension(self) -> float:
        """Tension of the tendon, N."""
        return self.tendon.tension_at(self.angle)

    def step(self, time: float, voltage: float, limit: float) -> None:
        """
        Advance by a short time (s).

        voltage: part of the full one, -1 to 1.  limit: largest torque, N m; 0 is switched off.
        """
        load = -self.tendon.sign * self.tendon.radius * self.tension
        friction = LOAD_FRICTION * abs(load) + OWN_FRICTION * self._stall
        driving, damping, mass = voltage * self._stall, self._damping, self._inertia / time
        if limit <= 0.0:
            driving, damping = 0.0, OFF_DAMPING * self._damping
        speed = (mass * self.speed + driving + load) / (mass + damping)
        self.torque = driving - damping * speed if limit > 0.0 else 0.0
        if abs(self.torque) > limit > 0.0:
            self.torque = copysign(limit, self.torque)
            speed = (mass * self.speed + self.torque + load) / (mass + OFF_DAMPING * damping)
        lost = (1.0 if self.speed else STICTION) * friction / mass
        stands = self.caught or abs(speed) <= lost + STANDSTILL
        self.speed = 0.0 if stands else speed - copysign(friction / mass, speed)
        if self.speed == 0.0 and limit > 0.0:  # nothing that turns weakens it
            self.torque = max(-limit, min(limit, driving))
        self.angle += self.speed * time


class Control:
    """Voltage and torque limit for a motor; values: the control table by names."""

    def __init__(self, motor: Motor, values: Mapping[str, int], model: EmulatedModel) -> None:
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
        """Advance by a short time (s); position: as the servo counts it, pulses."""
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

    A new goal starts from the present speed.
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
