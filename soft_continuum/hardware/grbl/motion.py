# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Splitting of tendon motions into short jogs, and their queue in the controller.

The controller has no watchdog: it executes all queued jogs.  So at most MAX_QUEUED_TIME seconds of
motion are queued.  Positions are whole motor steps in machine coordinates.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, hypot, sqrt
from typing import Any, Self

from soft_continuum.hardware.grbl.link import AXES, G_WORDS
from soft_continuum.hardware.protocols import Accuracy
from soft_continuum.hardware.serial_tendons import check_per_tendon
from soft_continuum.hardware.simulated_tendons import SimulatedTendons
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import ParameterError

JOG_TIME = 0.02
"""s of motion per jog."""
FEED_MARGIN = 1.2
"""Speed factor of jogs, so that the controller catches up after a delay."""
MAX_JOG_TIME = 0.06
"""s of motion per jog after a late acknowledgement, if that makes its numbers no longer."""
MAX_QUEUED_TIME = 0.14
"""s of motion that may be queued; a status report does not yet include the last 60 ms."""
PATH_RESOLUTION = 1e-9  # m; positions are rounded to motor steps when they are sent
MM = 1e3  # per m

Steps = tuple[int, ...]


@dataclass(frozen=True)
class Motors:
    """
    The motors of the controller's first axes, one per tendon, and how they may move.

    tendons: their names.  steps_per_mm: of each motor.  signs: 1 where a positive motion pulls.
    speed_limit: m/s.  acceleration_limit: m/s^2.  pull_limits: smallest and largest pull, m.
    homed_pulls: of each tendon where homing ends, m; 0 alone: there are no limit switches.
    """

    tendons: tuple[str, ...]
    steps_per_mm: tuple[float, ...]
    signs: tuple[float, ...]
    speed_limit: float
    acceleration_limit: float
    pull_limits: tuple[float, float]
    homed_pulls: tuple[float, ...] = (0.0,)

    def __post_init__(self) -> None:
        """Raise ParameterError when a list has not one value for each tendon, or a wrong one."""
        check_per_tendon('grbl', self.tendons, steps_per_mm=self.steps_per_mm, signs=self.signs)
        low, pulls = self.pull_limits[0], self.homed_pulls
        if self.homes and (len(pulls) != len(self.tendons)
                           or not all(low <= pull <= 0.0 for pull in pulls)):
            raise ParameterError(
                f'parameter grbl.homed_pulls is {list(pulls)}; needed: {", ".join(self.tendons)}, '
                f'each from the lower of pull_limits, {low:g}, to 0 m')

    @classmethod
    def of_boards(cls, values: Mapping[str, Any]) -> list[tuple[str, Self]]:
        """
        Return the port of each board and its motors, which the parameters of the node describe.

        Boards share the tendons evenly, in their order.  Raises ParameterError.
        """
        every = cls(arm_from_parameters(values).tendon_names, *(values[name] for name in (
            'grbl.steps_per_mm', 'grbl.signs', 'speed_limit', 'acceleration_limit', 'pull_limits',
            'grbl.homed_pulls')))
        ports, count = values['grbl.port'].split() or [''], len(every.tendons)
        share = ceil(count / len(ports))
        if share > len(AXES):
            raise ParameterError(
                f'the arm has {count} tendons; a GRBL controller can move at most {len(AXES)}: '
                f'give the ports of {ceil(count / len(AXES))} as grbl.port, with spaces between')
        if share * (len(ports) - 1) >= count:
            raise ParameterError(f'grbl.port has {len(ports)} ports: too many for {count} tendons')
        parts = [every._part(slice(share * k, share * (k + 1))) for k in range(len(ports))]
        if len({part.homes for part in parts}) > 1:  # one tendon on a board, and 0 alone
            raise ParameterError(
                f'parameter grbl.homed_pulls is {list(every.homed_pulls)}; a tendon that is alone '
                'on its board needs a value below 0: 0.0 alone means that there are no switches')
        return list(zip(ports, parts, strict=True))

    def _part(self, of: slice) -> Self:
        """Return some of the motors."""
        return replace(self, tendons=self.tendons[of], steps_per_mm=self.steps_per_mm[of],
                       signs=self.signs[of],
                       homed_pulls=self.homed_pulls[of] if self.homes else self.homed_pulls)

    @property
    def homes(self) -> bool:
        """Whether the zero is found by limit switches, to which homing pays out all tendons."""
        return self.homed_pulls != (0.0,)

    @property
    def steps_per_metre(self) -> tuple[float, ...]:
        """Motor steps per m of travel of each motor."""
        return tuple(MM * s for s in self.steps_per_mm)

    @property
    def accuracy(self) -> Accuracy:
        """Position accuracy: a step."""
        return Accuracy(tuple(1.0 / steps for steps in self.steps_per_metre))

    def to_steps(self, position: Sequence[float]) -> Steps:
        """Return a position that the controller reports; axes without a tendon are ignored."""
        return tuple(round(steps) for steps in position[:len(self.tendons)])

    def to_pulls(self, steps: Sequence[int]) -> tuple[float, ...]:
        """Return the pulls (m) that a difference in steps makes."""
        return tuple(sign * n / s
                     for n, s, sign in zip(steps, self.steps_per_metre, self.signs, strict=True))

    def from_pulls(self, pulls: Sequence[float]) -> Steps:
        """Return the difference in steps that makes pulls (m)."""
        return tuple(round(sign * p * s)
                     for p, s, sign in zip(pulls, self.steps_per_metre, self.signs, strict=True))


def add(a: Steps, b: Steps) -> Steps:
    """Return the sum of two positions."""
    return tuple(x + y for x, y in zip(a, b, strict=True))


def subtract(a: Steps, b: Steps) -> Steps:
    """Return the difference of two positions."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


@dataclass(frozen=True)
class Jog:
    """A straight motion; feed: steps/s in the space of all motors, speed: m/s of the fastest."""

    start: Steps
    end: Steps
    seconds: float
    feed: float
    speed: float


class JogStream:
    """Plans a path within speed and acceleration limits and cuts it into jogs."""

    def __init__(self, motors: Motors, braking: float) -> None:
        """Start at zero, without a target; braking: m/s^2 with which the controller can brake."""
        self._motors = motors
        self._scale = motors.steps_per_metre
        # The controller plans to rest at the end of its queue: a faster motion could not brake
        # within what may be queued; m/s.
        self.speed_limit = min(motors.speed_limit, 0.8 * MAX_QUEUED_TIME * braking)
        self._braking = braking
        # As many digits as the fastest jog needs, so that a damaged one is not longer than 10 of
        # the longest, or 100 if a sign became a digit.
        fastest = self.speed_limit * max(self._scale)
        most_steps = 10 ** len(str(ceil(0.75 * JOG_TIME * fastest) + 1)) - 1
        self._max_jog_time = min(MAX_JOG_TIME, (most_steps - 1) / fastest)
        self.place((0,) * len(self._scale))

    def place(self, steps: Steps) -> None:
        """Start again at ``steps``, without a target."""
        self.end = steps  # of the last jog
        self.target = steps
        self._origin = steps  # of the planned path
        self._planned_until = 0.0  # s: there are jogs up to then
        self._path_time = 0.0  # s; stands still while no jog can be sent
        self._path = SimulatedTendons(
            lambda: self._path_time, self._motors.tendons, self.speed_limit,
            self._motors.acceleration_limit, PATH_RESOLUTION)
        self._queue: deque[Jog] = deque()
        self._first_jog_done = 0.0  # share of the first jog in the queue
        self._speed = 0.0  # m/s, as observed

    @property
    def moving(self) -> bool:
        """Whether motion is under way, or still to be sent."""
        return bool(self._queue) or self.end != self.target

    def set_target(self, steps: Steps, arrival: float, now: float) -> None:
        """Move to ``steps``, to be there at ``arrival`` (s, on the clock of ``now``)."""
        self.target = steps
        self._planned_until = max(self._planned_until, now)
        self._path.move(self._metres(self._origin, steps), max(0.0, arrival - self._planned_until))

    def next_jog(self, now: float) -> Jog | None:
        """Return the jog to send now, if any."""
        seconds = min(now + JOG_TIME - self._planned_until, self._max_jog_time)
        if self.end == self.target or seconds < 0.75 * JOG_TIME:
            return None
        if self._queued_time() + seconds > MAX_QUEUED_TIME:
            return None
        self._planned_until = max(self._planned_until + seconds, now)
        self._path_time += seconds
        end = tuple(origin + round(metres * s) for origin, metres, s in zip(
            self._origin, self._path.read().pulls, self._scale, strict=True))
        end = tuple(b - (b - a in G_WORDS) for a, b in zip(self.end, end, strict=True))
        if end == self.end:
            return None
        distances = self._metres(self.end, end)
        # Rounding to steps must not exceed the speed limit.
        shortest = max(abs(d) / self.speed_limit for d in distances)
        seconds = max(seconds, shortest)
        duration = max(seconds / FEED_MARGIN, shortest)
        jog = Jog(self.end, end, seconds, hypot(*subtract(end, self.end)) / duration,
                  max(abs(d) for d in distances) / duration)
        self._queue.append(jog)
        self.end = end
        return jog

    def observe(self, steps: Steps, speed: float) -> bool:
        """
        Update from the motor positions; return False if they are not on the planned path.

        speed: of the fastest motor, m/s.
        """
        self._speed = speed
        for i, jog in enumerate(self._queue):
            share = self._share_done(jog, steps)
            if share is not None:
                for _ in range(i):
                    self._queue.popleft()
                self._first_jog_done = share
                return True
        return not self._queue and self.arrived(steps)

    def arrived(self, steps: Steps) -> bool:
        """Whether ``steps`` is the end of the last jog."""
        return steps == self.end

    def clear_queue(self) -> None:
        """Note that the controller has executed all jogs."""
        self._queue.clear()

    def _queued_time(self) -> float:
        """Return how long (s) the controller would still move."""
        if not self._queue:
            return 0.0
        nominal = (sum(jog.seconds for jog in self._queue)
                   - self._first_jog_done * self._queue[0].seconds)
        # Acceleration and braking take longer: a trapezoid of speed, or a triangle if short.
        top = max(jog.speed for jog in self._queue)
        distance = sum(jog.speed * jog.seconds for jog in self._queue)
        now, braking = min(self._speed, top), self._braking
        peak = sqrt(braking * distance + now**2 / 2)
        if peak < top:
            return nominal + max(0.0, (2 * peak - now) / braking - distance / top)
        return nominal + ((top - now)**2 / top + top) / (2 * braking)

    def _share_done(self, jog: Jog, steps: Steps) -> float | None:
        """Return the share of a jog that is done at ``steps``; None when they are not on it."""
        way, made = self._metres(jog.start, jog.end), self._metres(jog.start, steps)
        share = sum(w * m for w, m in zip(way, made, strict=True)) / sum(w * w for w in way)
        share = min(1.0, max(0.0, share))
        tolerance = 1.5 / min(self._scale)  # motors step one after the other
        error = hypot(*(m - share * w for w, m in zip(way, made, strict=True)))
        return share if error <= tolerance else None

    def _metres(self, start: Steps, end: Steps) -> tuple[float, ...]:
        """Return the way from one position to another, m of each motor."""
        return tuple((b - a) / s for a, b, s in zip(start, end, self._scale, strict=True))
