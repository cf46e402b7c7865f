# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Goals of the servos: a path within speed and acceleration limits, and a lead.

A servo holds a load only with a position error: its goal is a little ahead of where it is.  This
``lead`` is adapted while the path rests, until the tendons are where they should be.  It is
proportional to the current, so a stop keeps the part of it that loaded tendons need.
"""

from collections.abc import Sequence

from soft_continuum.hardware.dynamixel.setup import Spools
from soft_continuum.hardware.simulated_tendons import SimulatedTendons

MAX_STEP = 0.03
"""s of the path per cycle: what a cycle comes late by more is not caught up."""
LEAD_RATE = 8.0  # 1/s with which the lead removes an error at rest
MAX_LEAD = 0.01  # m
SATURATED = 0.95  # of the current that a servo may use: a lead would only wind up
MIN_COUNTS = 5  # of current, above which it determines the lead
PATH_RESOLUTION = 1e-9  # m


class HeldPath:
    """Where all tendons should be, in pulses of their servos; for one thread at a time."""

    def __init__(self, spools: Spools, zeros: Sequence[int], positions: Sequence[int],
                 goals: Sequence[int]) -> None:
        """Hold servos at their ``positions`` by their present ``goals``; zeros: of pulls."""
        self._spools, self._scale = spools, spools.pull_per_pulse
        self.zeros = list(zeros)
        self._leads_per_count = [0.0] * len(self._scale)  # as found at rest, pulses
        self.place(positions, goals)

    def place(self, positions: Sequence[int], goals: Sequence[int]) -> None:
        """Hold the servos at their positions, by their present goals."""
        self.wanted = [float(position) for position in positions]
        """Where the servos should be now, pulses."""
        self.lead = [
            max(-most, min(most, float(goal - position)))
            for goal, position, most in zip(goals, positions, self._max_lead(), strict=True)]
        self._origin = self._target = self.to_pulls(positions)
        self._time = 0.0  # s
        self._path = SimulatedTendons(
            lambda: self._time, self._spools.tendons, self._spools.speed_limit,
            self._spools.acceleration_limit, PATH_RESOLUTION)

    def aim(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move on to ``pulls`` (m), to be there after ``duration`` (s) as far as limits allow."""
        self._target = pulls
        self._path.move(tuple(p - o for p, o in zip(pulls, self._origin, strict=True)), duration)

    @property
    def done(self) -> bool:
        """Whether the path has come to its end."""
        reading = self._path.read()
        return not reading.moving and all(
            abs(a + b - c) < 10 * PATH_RESOLUTION
            for a, b, c in zip(self._origin, reading.pulls, self._target, strict=True))

    def advance(self, elapsed: float) -> None:
        """Let time (s) pass."""
        self._time += min(elapsed, MAX_STEP)
        self.wanted = self.to_pulses([
            a + b for a, b in zip(self._origin, self._path.read().pulls, strict=True)])

    def adapt(self, elapsed: float, positions: Sequence[int], currents: Sequence[int],
              limits: Sequence[int]) -> None:
        """Increase the lead of servos that are short of the end; currents and limits: counts."""
        for i, (error, current, limit, most) in enumerate(zip(
                self.errors(positions), currents, limits, self._max_lead(), strict=True)):
            if abs(error) > self.tolerances[i] / 2.0:
                if abs(current) < SATURATED * limit or error * current < 0.0:
                    lead = self.lead[i] + LEAD_RATE * min(elapsed, MAX_STEP) * error
                    self.lead[i] = max(-most, min(most, lead))
            elif abs(current) >= MIN_COUNTS and self.lead[i] * current > 0.0:
                self._leads_per_count[i] = (self.lead[i] + error) / current

    def holding_goals(self, positions: Sequence[int], currents: Sequence[int]) -> list[int]:
        """Return goals that hold servos where they are, against loads that need the currents."""
        return [round(position + max(-most, min(most, per_count * current)))
                for position, current, per_count, most in zip(
                    positions, currents, self._leads_per_count, self._max_lead(), strict=True)]

    @property
    def goals(self) -> list[int]:
        """Goal Position of every servo."""
        return [round(a + b) for a, b in zip(self.wanted, self.lead, strict=True)]

    def errors(self, positions: Sequence[int]) -> list[float]:
        """Return the position errors of servos, pulses."""
        return [a - b for a, b in zip(self.wanted, positions, strict=True)]

    @property
    def tolerances(self) -> list[float]:
        """Position tolerances of arrival, pulses."""
        return [tolerance / abs(scale) for tolerance, scale in zip(
            self._spools.arrival_tolerances, self._scale, strict=True)]

    def to_pulls(self, positions: Sequence[float]) -> tuple[float, ...]:
        """Return the pulls (m) of positions (pulses)."""
        return tuple(scale * (position - zero) for scale, position, zero in zip(
            self._scale, positions, self.zeros, strict=True))

    def to_pulses(self, pulls: Sequence[float]) -> list[float]:
        """Return the positions (pulses) of pulls (m)."""
        return [zero + pull / scale for scale, pull, zero in zip(
            self._scale, pulls, self.zeros, strict=True)]

    def _max_lead(self) -> list[float]:
        return [MAX_LEAD / abs(scale) for scale in self._scale]
