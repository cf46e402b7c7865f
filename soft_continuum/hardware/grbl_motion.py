# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
How a tendon motion becomes short jogs, and how much of it waits in the controller.

The controller has no watchdog: what it was sent it does.  So it is never sent more than
MOST_QUEUED seconds of motion.  Positions are whole motor steps in machine coordinates.
"""

from collections import deque
from dataclasses import dataclass
from math import hypot, sqrt

from soft_continuum.hardware.simulated_tendons import SimulatedTendons

PIECE = 0.02
"""s of motion per jog."""
BOOST = 1.2
"""By which jogs are faster than planned, so that the controller catches up with what it lost."""
LONGEST_PIECE = 0.06  # s, when an acknowledgement was late
MOST_QUEUED = 0.14
"""s of motion that may wait in the controller; its report does not yet say the last 60 ms."""
FINEST = 1e-9  # m, of the planned path; it is rounded to motor steps when it is sent
REPORTED = 1e-6  # m, of the positions in a status report

Steps = tuple[int, int]
Pair = tuple[float, float]


@dataclass(frozen=True)
class Jog:
    """A straight motion; feed: m/s in the plane of both motors, speed: m/s of the faster one."""

    start: Steps
    end: Steps
    seconds: float
    feed: float
    speed: float


class JogStream:
    """Plans a path within speed and acceleration limits and cuts it into jogs."""

    def __init__(self, steps_per_metre: Pair, speed_limit: float, acceleration_limit: float,
                 braking: float) -> None:
        """
        Stand at zero, with nowhere to go.

        steps_per_metre: of both motors.  speed_limit: m/s.  acceleration_limit: m/s^2 of the
        planned path.  braking: m/s^2 with which the controller can brake.
        """
        self._scale = steps_per_metre
        # The controller plans to rest at the end of what it has: a faster motion could not brake
        # within what may be queued.
        self._speed_limit = min(speed_limit, 0.8 * MOST_QUEUED * braking)
        self._acceleration_limit = acceleration_limit
        self._braking = braking
        self.place((0, 0))

    def place(self, steps: Steps) -> None:
        """Stand at ``steps``, with nowhere to go."""
        self.end = steps  # where the jogs so far lead
        self.target = steps
        self._origin = steps  # of the planned path
        self._planned = 0.0  # until when there are jogs, s
        self._time = 0.0  # along the path; it stands still while no jog can be sent
        self._path = SimulatedTendons(
            lambda: self._time, self._speed_limit, self._acceleration_limit, FINEST)
        self._queue: deque[Jog] = deque()
        self._done = 0.0  # part of the first jog in the queue
        self._speed = 0.0  # as observed

    @property
    def moving(self) -> bool:
        """Whether motion is under way, or wanted."""
        return bool(self._queue) or self.end != self.target

    def aim(self, steps: Steps, arrival: float, now: float) -> None:
        """Go to ``steps``, to be there at ``arrival`` (s, on the clock of ``now``)."""
        self.target = steps
        self._planned = max(self._planned, now)
        self._path.move(self._metres(steps), max(0.0, arrival - self._planned))

    def next_jog(self, now: float) -> Jog | None:
        """Return what the controller must be sent now, if anything."""
        seconds = min(now + PIECE - self._planned, LONGEST_PIECE)
        if self.end == self.target or seconds < 0.75 * PIECE:
            return None
        if self._queued() + seconds > MOST_QUEUED:
            return None
        self._planned = max(self._planned + seconds, now)
        self._time += seconds
        end = self._steps(self._path.read().pulls)
        if end == self.end:
            return None
        distances = [(b - a) / s for a, b, s in zip(self.end, end, self._scale, strict=True)]
        # Rounding to steps must not make it faster than allowed.
        seconds = max(seconds, *(abs(d) / self._speed_limit for d in distances))
        hasty = max(seconds / BOOST, *(abs(d) / self._speed_limit for d in distances))
        jog = Jog(self.end, end, seconds, hypot(*distances) / hasty,
                  max(abs(d) for d in distances) / hasty)
        self._queue.append(jog)
        self.end = end
        return jog

    def observe(self, steps: Steps, speed: float) -> bool:
        """
        Note where the motors are; return False when that is not on the way they were sent.

        speed: of the faster motor, m/s.
        """
        self._speed = speed
        for i, jog in enumerate(self._queue):
            part = self._part(jog, steps)
            if part is not None:
                for _ in range(i):
                    self._queue.popleft()
                self._done = part
                return True
        return not self._queue and self.arrived(steps)

    def arrived(self, steps: Steps) -> bool:
        """Whether ``steps`` is where the jogs so far lead, as far as a status report can tell."""
        return all(abs(a - b) <= 0.5 + REPORTED * s
                   for a, b, s in zip(steps, self.end, self._scale, strict=True))

    def rest(self) -> None:
        """Take note that the controller has done all that it was sent."""
        self._queue.clear()

    def _queued(self) -> float:
        """Return how long (s) the controller would still move."""
        if not self._queue:
            return 0.0
        nominal = sum(jog.seconds for jog in self._queue) - self._done * self._queue[0].seconds
        # What speeding up and braking cost beyond that: a trapezoid, or a triangle if it is short.
        top = max(jog.speed for jog in self._queue)
        distance = sum(jog.speed * jog.seconds for jog in self._queue)
        now, braking = min(self._speed, top), self._braking
        peak = sqrt(braking * distance + now**2 / 2)
        if peak < top:
            return nominal + max(0.0, (2 * peak - now) / braking - distance / top)
        return nominal + ((top - now)**2 / top + top) / (2 * braking)

    def _part(self, jog: Jog, steps: Steps) -> float | None:
        """Return which part of a jog is done at ``steps``; None when that is not on its way."""
        x, y = ((b - a) / s for a, b, s in zip(jog.start, jog.end, self._scale, strict=True))
        u, v = ((b - a) / s for a, b, s in zip(jog.start, steps, self._scale, strict=True))
        part = min(1.0, max(0.0, (x * u + y * v) / (x * x + y * y)))
        # Motors step one after the other, and a report is rounded.
        tolerance = REPORTED + 1.5 / min(self._scale)
        return part if hypot(u - part * x, v - part * y) <= tolerance else None

    def _metres(self, steps: Steps) -> Pair:
        x, y = ((a - b) / s for a, b, s in zip(steps, self._origin, self._scale, strict=True))
        return x, y

    def _steps(self, metres: Pair) -> Steps:
        x, y = (b + round(a * s) for a, b, s in
                zip(metres, self._origin, self._scale, strict=True))
        return x, y
