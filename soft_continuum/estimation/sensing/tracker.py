# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of the discs by a tracker, such as motion capture."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import acos, degrees
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from soft_continuum.estimation.sensing.tare import SensorError, straight_heights
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.rotations import compose, IDENTITY, inverse, moved_by, rotate
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.text import MAX_NAME, printable

MAX_LENGTH_ERROR = 0.01
"""Permitted deviation of a quaternion's length from 1."""
MAX_LEAN = 0.19
"""rad, permitted tilt of a disc out of the plane of the arm."""
MAX_OFF_PLANE = 0.05
"""m, permitted distance from that plane."""
MAX_BEYOND = 0.1
"""m, permitted distance from the base beyond that in the straight arm."""


@dataclass(frozen=True)
class Tracker:
    """
    The frame of a tracker, and the offsets of its tracked bodies.

    frame: base_link.  own_frame: of the tracker, empty if that is base_link.  to_base: pose (7,)
    of its frame in base_link.  offsets: by disc, pose (7,) of the disc in its tracked body.
    reach: m, largest distance of a disc from the base.  axes: (6,), as pose_axes of the arm.
    """

    frame: str
    own_frame: str
    to_base: Array
    offsets: tuple[Array, ...]
    reach: float
    axes: NDArray[np.bool_]

    @classmethod
    def of(cls, values: Mapping[str, Any], arm: Arm) -> Self:
        """Return the tracker of parameters frame_id and tracker.*; raises ParameterError."""
        given, discs = values['tracker.offsets'], len(arm.discs)
        if tuple(given) == (0.0,):
            given = IDENTITY * discs
        if len(given) != 7 * discs:
            raise ParameterError(
                f'parameter tracker.offsets has {len(given)} numbers; needed: x, y, z and '
                f'quaternion x, y, z, w for each of {discs} discs, or 0.0 for none')
        offsets = tuple(
            given_pose('tracker.offsets', given[7 * n:7 * n + 7]) for n in range(discs))
        base = given_pose('tracker.base_pose', values['tracker.base_pose'])
        return cls(values['frame_id'], values['tracker.frame_id'], inverse(base), offsets,
                   straight_heights(arm)[-1], arm.pose_axes)

    def in_base(self, frame: str, pose: Sequence[float]) -> Array:
        """
        Return the tracked body as a pose (7,) in base_link.

        Raises SensorError for another frame, and for an invalid pose.
        """
        row = np.array(pose, dtype=float)
        if not np.isfinite(row).all():
            raise SensorError('a pose with numbers that are not finite; is it lost?')
        length = float(np.linalg.norm(row[3:]))
        if abs(length - 1.0) > MAX_LENGTH_ERROR:
            raise SensorError(f'a quaternion of length {length:.3g}, not 1; is it lost?')
        row[3:] /= length
        if frame == self.frame:
            return row
        if self.own_frame and frame == self.own_frame:
            return compose(self.to_base, row)
        raise SensorError(
            f'poses in {printable(frame, MAX_NAME)!r}; needed: {self.frame!r}, or '
            + (f'{self.own_frame!r} (tracker.frame_id)' if self.own_frame else
               'its name in tracker.frame_id and where base_link is in it in tracker.base_pose'))

    def disc(self, n: int, followed: Array) -> Array:
        """
        Return the pose (7,) of the bottom of a disc, from that of its tracked body.

        Raises SensorError when it is out of reach of the arm or its discs.
        """
        pose = compose(followed, self.offsets[n])
        if pose[6] < 0.0:
            pose[3:] *= -1.0
        distance = float(np.linalg.norm(pose[:3]))
        if distance > self.reach + MAX_BEYOND:
            raise SensorError(
                f'{distance:.3g} m from the base, the straight arm has {self.reach:.3g} m; are '
                'positions in m, is tracker.base_pose right, was ~/tare called?')
        off = float(np.linalg.norm(pose[:3][~self.axes[:3]]))
        lean = max((acos(min(1.0, float(rotate(pose[3:], axis) @ axis)))
                    for axis in np.eye(3)[~moved_by(self.axes[3:])]), default=0.0)
        if lean > MAX_LEAN or off > MAX_OFF_PLANE:
            raise SensorError(
                f'{degrees(lean):.0f} degrees and {off * 1e3:.0f} mm out of the plane of '
                'the arm; call ~/tare with the arm straight, and check tracker.base_pose')
        return pose


def given_pose(name: str, numbers: Sequence[float]) -> Array:
    """Return a parameter as a pose (7,); raises ParameterError if it is invalid."""
    pose = np.array(numbers, dtype=float)
    length = float(np.linalg.norm(pose[3:])) if len(pose) == 7 else 0.0
    if abs(length - 1.0) > MAX_LENGTH_ERROR:
        raise ParameterError(f'parameter {name} is {list(numbers)}; needed: position x, y, z and '
                             'quaternion x, y, z, w, of length 1')
    pose[3:] /= length
    return pose
