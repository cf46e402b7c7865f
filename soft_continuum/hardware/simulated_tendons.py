# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated steppers: finite speed and acceleration, whole steps."""

from collections.abc import Callable, Mapping, Sequence
from math import copysign, sqrt
from typing import Any, ClassVar, Self

from soft_continuum.hardware.protocols import Accuracy, check_motion, TendonReading
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import Parameter

TIME_STEP = 0.001  # s
BRAKING_SHARE = 0.8  # of the acceleration limit, to brake before the target


class SimulatedTendons:
    """Simulated steppers that start at zero pull, referenced and at rest."""

    reference_moves = False
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        Parameter('simulated_tendons.step', 5e-6, 'pull per step of the simulated steppers',
                  1e-9, 1e-3, unit='m'),
    )

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]) -> Self:
        """Return what the parameters of the node describe."""
        return cls(clock, arm_from_parameters(values).tendon_names, values['speed_limit'],
                   values['acceleration_limit'], values['simulated_tendons.step'])

    def __init__(self, clock: Callable[[], float], tendons: Sequence[str], speed_limit: float,
                 acceleration_limit: float, step: float) -> None:
        """
        Take the time (s) from ``clock``.

        tendons: their names.  speed_limit: m/s.  acceleration_limit: m/s^2.  step: pull per
        motor step, m.
        """
        self._clock = clock
        self._tendons = tuple(tendons)
        self._speed_limit = speed_limit
        self._acceleration = acceleration_limit
        self._step = step
        self._accuracy = Accuracy((step,) * len(tendons))
        self._time = clock()
        self._pulls = [0.0] * len(tendons)
        self._speeds = [0.0] * len(tendons)
        self._targets = [0.0] * len(tendons)
        self._arrival = self._time
        self._braking = False
        self._zero = [0.0] * len(tendons)

    def open(self) -> None:
        """Connect."""
        self._advance()

    def close(self) -> None:
        """Stop and hold."""
        self.stop()

    def read(self) -> TendonReading:
        """Return pulls in whole steps, and speeds."""
        self._advance()
        pulls = (self._step * round((p - z) / self._step)
                 for p, z in zip(self._pulls, self._zero, strict=True))
        return TendonReading(tuple(pulls), tuple(self._speeds), referenced=True,
                             accuracy=self._accuracy)

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Set new targets (m), to be reached after ``duration`` s as far as the limits allow."""
        check_motion(self._tendons, pulls, duration)
        self._advance()
        self._targets = [self._step * round(p / self._step) + z
                         for p, z in zip(pulls, self._zero, strict=True)]
        self._arrival = self._time + duration
        self._braking = False

    def stop(self) -> None:
        """Brake with the acceleration limit."""
        self._advance()
        self._braking = True

    def reference(self) -> None:
        """Take the present position as zero."""
        self._advance()
        self._zero = list(self._pulls)

    def _advance(self) -> None:
        """Integrate the motion up to now."""
        now = self._clock()
        while self._time < now and (any(self._speeds) or self._pulls != self._targets):
            step = min(TIME_STEP, now - self._time)
            self._time += step
            if self._braking:
                self._brake(step)
            else:
                self._approach(step)
        self._time = max(self._time, now)

    def _brake(self, step: float) -> None:
        max_change = self._acceleration * step
        for i, speed in enumerate(self._speeds):
            self._speeds[i] = copysign(max(0.0, abs(speed) - max_change), speed) or 0.0
            self._pulls[i] += self._speeds[i] * step
        if not any(self._speeds):
            self._targets = list(self._pulls)

    def _approach(self, step: float) -> None:
        """Continue towards the targets, all tendons to arrive together."""
        remaining = [t - p for t, p in zip(self._targets, self._pulls, strict=True)]
        # In time if the limits allow, and never too fast to brake before the target.
        duration = max(self._arrival - self._time, step, *(
            abs(d) / min(self._speed_limit, sqrt(BRAKING_SHARE * 2 * self._acceleration * abs(d)))
            for d in remaining if d != 0.0))
        max_change = self._acceleration * step
        for i, distance in enumerate(remaining):
            change = distance / duration - self._speeds[i]
            self._speeds[i] += max(-max_change, min(max_change, change))
            if abs(distance) <= abs(self._speeds[i]) * step + 1e-12 and (
                    abs(self._speeds[i]) <= 2 * max_change):
                self._pulls[i], self._speeds[i] = self._targets[i], 0.0
            else:
                self._pulls[i] += self._speeds[i] * step
