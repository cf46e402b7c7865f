# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The state of a servo in a sync read, and its validation.

The block also contains the values that the driver wrote: a reply that does not repeat them is not
the present one of this servo, or a write was lost.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from soft_continuum.hardware.dynamixel.bus import Reply
from soft_continuum.hardware.dynamixel.registers import (
    BUS_WATCHDOG,
    GOAL_CURRENT,
    GOAL_POSITION,
    PRESENT_CURRENT,
    PRESENT_POSITION,
    PROFILE_VELOCITY,
    RADIANS_PER_PULSE,
    REALTIME_TICK,
    Register,
    TICK_RANGE,
    TORQUE_ENABLE,
    VELOCITY_UNIT,
)

BLOCK = TORQUE_ENABLE.address, PRESENT_POSITION.end
REST_TIME, REST_PULSES = 0.03, 1
"""Time (s) in which a servo at rest turns by at most so many pulses."""
VELOCITY_TIME = 0.008  # s
TICK_TOLERANCE = 0.1
"""Largest advance of a servo's clock over the computer's between two replies, s."""


@dataclass(frozen=True)
class Written:
    """What the driver wrote to a servo: Bus Watchdog, Goal Current, Profile Velocity, goal."""

    watchdog: int
    current: int
    velocity: int
    goal: int


def profile_speed(written: Written) -> float:
    """Return the largest speed of a servo with the written values, pulses/s."""
    return written.velocity * VELOCITY_UNIT / RADIANS_PER_PULSE


def fastest(written: Written) -> float:
    """Return the largest plausible speed, including oscillation, pulses/s."""
    return 2.0 * profile_speed(written)


@dataclass(frozen=True)
class ServoState:
    """
    One servo at a time between asked and time (s), when its reply was received.

    position: pulses.  current: counts.  tick: ms.  alert: whether it has a hardware error.
    torque: whether it is on.
    """

    asked: float
    time: float
    written: Written
    position: int
    current: int
    tick: int
    alert: bool
    torque: bool = True

    @classmethod
    def from_reply(cls, reply: Reply, asked: float, time: float) -> 'ServoState':
        """Return the state in a reply to a sync read of BLOCK."""
        def get(register: Register) -> int:
            return register.decode(reply.data, BLOCK[0])

        return cls(asked, time, Written(get(BUS_WATCHDOG), get(GOAL_CURRENT),
                                        get(PROFILE_VELOCITY),
                                        get(GOAL_POSITION)),
                   get(PRESENT_POSITION), get(PRESENT_CURRENT), get(REALTIME_TICK), reply.alert,
                   bool(get(TORQUE_ENABLE)))

    def follows(self, earlier: 'ServoState', fastest: float) -> bool:
        """Whether this state is plausible after ``earlier``; fastest: pulses/s."""
        elapsed = self.time - earlier.asked  # at most: a busy computer sees a reply late
        ticks = (self.tick - earlier.tick) % TICK_RANGE
        new = ticks > 0 or self.time - earlier.time < 0.002
        return (new and 1e-3 * ticks <= elapsed + TICK_TOLERANCE
                and abs(self.position - earlier.position) <= fastest * (elapsed + 0.02) + 20)


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
