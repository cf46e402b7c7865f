# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Taring: offsets of sensors on their discs, from measurements of the straight arm."""

from collections import deque
from collections.abc import Sequence
from math import degrees
from typing import Generic, TypeVar

import numpy as np

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.rotations import (
    angle_between,
    compose,
    IDENTITY,
    inverse,
    mean_pose,
    turn_between,
)

WINDOW = 1.0
"""s of samples that are averaged, unless these are too few."""
SLOW_WINDOW = 5.0
"""s in which the last few samples of a slow sensor may lie."""
MAX_PAUSE = 2.0
"""s since the last sample, after which a sensor is stale."""
MIN_SPAN = 0.5
"""s that samples must cover."""
MIN_SAMPLES = 5
MAX_SAMPLES = 300
MAX_SHIFT, MAX_TURN = 0.001, 0.01
"""m and rad, permitted motion between the first and second half of the samples."""
MAX_DISTANCE = 0.3
"""m between a disc and its tracked body."""
MAX_TAG_SHIFT, MAX_TAG_TURN = 0.01, 0.2
"""m and rad, permitted offset of a tag; beyond it the arm is not straight."""
MAX_TILT = 0.5
"""rad, permitted turn of an IMU on its disc."""

T = TypeVar('T')


class SensorError(ValueError):
    """Data of a sensor cannot be used; the message says why, and what to do."""


def straight_heights(arm: Arm) -> tuple[float, ...]:
    """Return z of the bottom of each disc of the straight arm, m."""
    heights = np.array([disc.height for disc in arm.discs])
    lengths = np.array([segment.length for segment in arm.segments])
    return (0.0, *np.cumsum(heights[:-1] + lengths).tolist())


class Window(Generic[T]):
    """Measurements of a disc in the last second, or the last few samples of a slow sensor."""

    def __init__(self) -> None:
        """Start empty."""
        self._samples: deque[tuple[float, T]] = deque(maxlen=MAX_SAMPLES)
        self._step = WINDOW / MAX_SAMPLES

    def add(self, now: float, value: T) -> None:
        """Add a measurement made ``now``, s of a monotonic clock."""
        if not self._samples or now - self._samples[-1][0] >= self._step:
            self._samples.append((now, value))

    def recent(self, now: float) -> list[T]:
        """
        Return the measurements of the last second, the oldest first; empty without any.

        For sensors slower than five measurements a second, return the last five.
        Raises SensorError when these are too few for a mean.
        """
        every = list(self._samples)  # add may interrupt
        samples = [s for s in every if now - s[0] <= SLOW_WINDOW]
        if not samples or now - samples[-1][0] > MAX_PAUSE:
            return []
        recent = sum(now - time <= WINDOW for time, _ in samples)
        samples = samples[-max(recent, MIN_SAMPLES):]
        span = samples[-1][0] - samples[0][0]
        if len(samples) < MIN_SAMPLES or span < MIN_SPAN:
            raise SensorError(f'only {len(samples)} measurements over {span:.1f} s in the last '
                              f'{SLOW_WINDOW:g} s; needed: {MIN_SAMPLES}, over {MIN_SPAN:g} s; '
                              'wait a little and tare again')
        return [value for _, value in samples]


def refuse_motion(shift: float, turn: float) -> None:
    """Raise SensorError for motion between the first and second half of the measurements."""
    if shift > MAX_SHIFT or turn > MAX_TURN:
        raise SensorError(f'it moves by {shift * 1e3:.1f} mm and {turn:.3f} rad while it is '
                          'measured; wait until the arm rests')


def offset_of(followed: Sequence[Array], height: float) -> Array:
    """
    Return the pose (7,) of a disc in its tracked body, from poses (k, 7) of that in base_link.

    height: z of the bottom of the disc in the straight arm, m.  Raises SensorError when the body
    moves, or is too far away to be mounted on the disc.
    """
    mount = _mount(followed, height)
    if (distance := float(np.linalg.norm(mount[:3]))) > MAX_DISTANCE:
        raise SensorError(
            f'it is {distance:.2f} m from its disc in the straight arm; set the pose of '
            'base_link (tracker.base_pose)')
    return mount


def tag_offset(poses: Sequence[Array], height: float) -> Array:
    """
    Return the pose (7,) of a disc in the nominal disc frame of its tag, from poses (k, 7) of that.

    height: as for offset_of.  Raises SensorError when it moves, or is too far off.
    """
    mount = _mount(poses, height)
    shift, turn = float(np.linalg.norm(mount[:3])), angle_between(mount, np.array(IDENTITY))
    if shift > MAX_TAG_SHIFT or turn > MAX_TAG_TURN:
        raise SensorError(
            f'it is seen {shift * 1e3:.1f} mm and {degrees(turn):.1f} degrees from its pose in '
            'the straight arm; is the arm straight, does tags.fixed_positions fit?')
    return mount


def _mount(poses: Sequence[Array], height: float) -> Array:
    """Return the pose of a disc of the straight arm in a body with these poses, at rest."""
    half = len(poses) // 2
    before, after = mean_pose(poses[:half]), mean_pose(poses[half:])
    refuse_motion(float(np.linalg.norm(after[:3] - before[:3])), angle_between(before, after))
    straight = np.array(IDENTITY)
    straight[2] = height
    return compose(inverse(mean_pose(poses)), straight)


def turn_of(seen: Sequence[Array], up: Array) -> Array:
    """
    Return the smallest rotation vector (3,), rad, of an IMU on its disc.

    seen: (k, 3), up in its frame on the straight arm.  up: in base_link.
    Raises SensorError when it moves, or is turned by too much.
    """
    half = len(seen) // 2
    before, after, mean = (np.mean(part, axis=0) for part in (seen[:half], seen[half:], seen))
    refuse_motion(0.0, float(np.linalg.norm(after - before)))
    turn = turn_between(mean, up)
    if (angle := float(np.linalg.norm(turn))) > MAX_TILT:
        raise SensorError(f'it is turned by {angle:.2f} rad in the straight arm; set imu.axes, '
                          'and arm.mounting_angle if the base is turned')
    return turn
