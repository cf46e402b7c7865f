# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The geared motor of a servo, its spool, and the tendon on it.

A DC motor: its torque falls from the stall torque to nothing at the speed without load, both in
proportion to the voltage.  The gears rub with a part of the load and a part of the stall torque,
and the tendon turns the spool back when nothing holds it.  Inertia and friction are assumptions
(the maker gives neither): they are the order of what such servos show.
"""

from dataclasses import dataclass
from math import copysign

from soft_continuum.emulators.dynamixel_models import Model

TIME_CONSTANT = 0.015  # s in which the motor follows a voltage, est
LOAD_FRICTION = 0.1  # of the load torque, est
OWN_FRICTION = 0.01  # of the stall torque, est
OFF_DAMPING = 0.1  # of the damping of the powered motor, est
STICTION, STANDSTILL = 1.2, 1e-3
"""By how much friction is larger once the speed (rad/s) is below this, est."""


@dataclass
class Tendon:
    """
    A tendon on a spool, as a spring that cannot push.

    radius: m.  sign: 1 if positive angles pull it in.  stiffness: N/m.  slack: m that must be
    pulled in before it is taut.  weight: N that hang on it besides.  tension: N, from the plant of
    a twin, which then replaces all these.
    """

    radius: float = 0.01
    sign: int = 1
    stiffness: float = 2000.0
    slack: float = 0.0
    weight: float = 0.0
    tension: float | None = None

    def pull(self, angle: float) -> float:
        """Return how much is pulled in (m) when the spool has turned by an angle (rad)."""
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
    caught: nothing can turn it.
    """

    def __init__(self, model: Model, tendon: Tendon) -> None:
        """Stand at angle 0."""
        self.tendon = tendon
        self.angle = self.speed = self.torque = 0.0
        self.caught = False
        self._stall = model.stall_torque
        self._damping = model.stall_torque / model.full_speed
        self._inertia = TIME_CONSTANT * self._damping

    @property
    def pull(self) -> float:
        """By how much the tendon is pulled in, m."""
        return self.tendon.pull(self.angle)

    @property
    def tension(self) -> float:
        """Tension of the tendon, N."""
        return self.tendon.tension_at(self.angle)

    def step(self, time: float, voltage: float, limit: float) -> None:
        """
        Let a little time (s) pass.

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
