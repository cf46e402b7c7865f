# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Motion as GRBL makes it: up to 15 blocks planned ahead to end at rest, cut into 10 ms segments.

Up to five segments are always cut in advance: what happens later, a feed hold or one more block,
cannot change them.  Positions are whole motor steps, lengths mm, times s.
"""

from collections import deque
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from math import hypot, inf, sqrt

BLOCKS = 15
SEGMENTS = 5
SEGMENT_TIME = 0.01  # s
FINE = 0.001  # s; the speed is constant over this

Steps = tuple[int, ...]
Coordinates = tuple[float, ...]
"""X, Y and Z."""


@dataclass
class Block:
    """A straight motion; entry_speed is what the blocks after it allow."""

    start: Steps
    end: Steps
    direction: Coordinates
    length: float
    speed: float
    acceleration: float
    junction_speed: float
    entry_speed: float = 0.0


@dataclass(frozen=True)
class MotionSegment:
    """Where the motors go within a time."""

    duration: float
    start: Steps
    end: Steps


@dataclass(frozen=True)
class MachineSettings:
    """steps_per_mm, rates (mm/s) and accelerations (mm/s^2) per axis; junction_deviation (mm)."""

    steps_per_mm: Coordinates
    rates: Coordinates
    accelerations: Coordinates
    junction_deviation: float


class MotionPlanner:
    """Blocks, segments and motors; ``motors``: the steps that were made."""

    def __init__(self, settings: MachineSettings, motors: Steps = (0, 0, 0)) -> None:
        """Stand at ``motors``."""
        self.settings = settings
        self.motors = motors
        self.clear()

    def clear(self) -> None:
        """Forget all motion; the motors stay where they are."""
        self.blocks: deque[Block] = deque()
        self.end = self.motors
        self.holding = False
        self._segments: deque[MotionSegment] = deque()
        self._into_segment = 0.0  # s
        self._cut = self.motors  # where the segments lead
        self.speed = 0.0  # mm/s along the path, at their end
        self._into_block = 0.0  # mm, at their end

    @property
    def free(self) -> int:
        """Number of blocks for which there is room."""
        return BLOCKS - len(self.blocks)

    @property
    def empty(self) -> bool:
        """Whether nothing is left to do."""
        return not self.blocks and not self._segments

    @property
    def standing(self) -> bool:
        """Whether the motors stand, at the end of all motion or of a hold."""
        return not self._segments and (not self.blocks or (self.holding and self.speed == 0.0))

    def add(self, target: Sequence[float], feed: float) -> None:
        """Go to ``target`` (mm) with ``feed`` (mm/s) as far as the settings allow it."""
        scale = self.settings.steps_per_mm
        end = tuple(round(mm * s) for mm, s in zip(target, scale, strict=True))
        vector = [(b - a) / s for a, b, s in zip(self.end, end, scale, strict=True)]
        length = hypot(*vector)
        if length == 0.0:
            return
        direction = tuple(x / length for x in vector)
        junction = 0.0
        if self.blocks:
            junction = self._junction_speed(self.blocks[-1].direction, direction)
            junction = min(junction, self.blocks[-1].speed, feed)
        self.blocks.append(Block(
            self.end, end, direction, length,
            min(feed, _along(self.settings.rates, direction)),
            _along(self.settings.accelerations, direction), junction))
        self.end = end
        exit_speed = 0.0
        for block in reversed(self.blocks):
            block.entry_speed = min(block.junction_speed, block.speed,
                                    sqrt(exit_speed**2 + 2 * block.acceleration * block.length))
            exit_speed = block.entry_speed

    def advance(self, duration: float) -> None:
        """Let the motors run for a time."""
        while duration > 0.0:
            self._cut_segments()
            if not self._segments:
                return
            segment = self._segments[0]
            step = min(duration, segment.duration - self._into_segment)
            self._into_segment += step
            duration -= step
            part = self._into_segment / segment.duration
            if part >= 1.0 - 1e-9:
                self.motors = segment.end
                self._segments.popleft()
                self._into_segment = 0.0
            else:
                self.motors = tuple(round(a + part * (b - a)) for a, b in
                                     zip(segment.start, segment.end, strict=True))

    def remaining_time(self) -> float:
        """Return how long the motors would move if nothing else came."""
        copy = deepcopy(self)
        total = 0.0
        while not copy.empty and total < 1e3:
            copy.advance(FINE)
            total += FINE
        return total

    def _junction_speed(self, before: Coordinates, after: Coordinates) -> float:
        """Return the speed (mm/s) at which a corner stays within the junction deviation."""
        cosine = -sum(a * b for a, b in zip(before, after, strict=True))
        if cosine > 0.999999:
            return 0.0
        if cosine < -0.999999:
            return inf
        half_sine = sqrt(0.5 * (1.0 - cosine))
        change = [b - a for a, b in zip(before, after, strict=True)]
        size = hypot(*change)
        acceleration = _along(self.settings.accelerations, tuple(c / size for c in change))
        return sqrt(acceleration * self.settings.junction_deviation * half_sine
                    / (1.0 - half_sine))

    def _cut_segments(self) -> None:
        while len(self._segments) < SEGMENTS and self.blocks:
            # A segment ends with its block, so that motors never cut a corner.
            start, elapsed, block = self._cut, 0.0, self.blocks[0]
            while self.blocks and self.blocks[0] is block and elapsed < SEGMENT_TIME - 1e-9:
                if self.holding and self.speed == 0.0:
                    break
                elapsed += FINE
                self._run_on(FINE)
            if elapsed == 0.0:
                return
            self._segments.append(MotionSegment(elapsed, start, self._cut))

    def _run_on(self, time: float) -> None:
        block = self.blocks[0]
        left = block.length - self._into_block
        exit_speed = self.blocks[1].entry_speed if len(self.blocks) > 1 else 0.0
        wanted = 0.0 if self.holding else min(
            block.speed, sqrt(exit_speed**2 + 2 * block.acceleration * left))
        most = block.acceleration * time
        self.speed += max(-most, min(most, wanted - self.speed))
        if self.holding and self.speed <= 0.0:
            self.speed = 0.0
            return
        # The last step of a block is made however slow it has become.
        distance = max(self.speed, most / 2) * time
        while distance >= left:
            distance -= left
            self._cut = block.end
            self._into_block = 0.0
            self.blocks.popleft()
            if not self.blocks:
                self.speed = 0.0
                return
            block = self.blocks[0]
            left = block.length
        self._into_block += distance
        part = self._into_block / block.length
        self._cut = tuple(round(a + part * (b - a)) for a, b in
                           zip(block.start, block.end, strict=True))


def _along(limits: Coordinates, direction: Coordinates) -> float:
    """Return the largest speed along a direction at which no axis exceeds its limit."""
    return min(limit / abs(d) for limit, d in zip(limits, direction, strict=True) if d != 0.0)
