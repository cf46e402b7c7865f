# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How tags are really stuck on the discs, from what they tell of the straight arm."""

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np

from soft_continuum.mechanics.chain import Array
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.sensing.layout import directions
from soft_continuum.sensing.tare import refuse_motion
from soft_continuum.sensing.tilt import SensorError

MAX_SHIFT, MAX_TURN = 0.01, 0.2
"""m and rad by which a tag may be off; more is an arm that is not straight."""


def tag_mounts(values: Mapping[str, Any], discs: int) -> tuple[Array, ...]:
    """
    Return x, z (m) and angle (rad) of each disc in the pose that its tag tells.

    values: has tags.mounts.  Raises ParameterError.
    """
    given = tuple(values['tags.mounts'])
    if given == (0.0,):
        given = (0.0,) * 3 * discs
    if len(given) != 3 * discs:
        raise ParameterError(f'parameter tags.mounts has {len(given)} numbers; needed: x, z and '
                             f'angle for each of {discs} discs, or 0.0 for none')
    return tuple(np.reshape(given, (discs, 3)))


def mounted(pose: Array, mount: Array) -> Array:
    """Return the pose (x, z, angle) of a disc, from that of its tag."""
    right, up = directions(pose[2])
    return np.array([*(pose[:2] + mount[0] * right + mount[1] * up), pose[2] + mount[2]])


def tag_mount(poses: Sequence[Array], height: float) -> Array:
    """
    Return x, z and angle of a disc in the pose of its tag, from such poses of the straight arm.

    poses: (k, 3).  height: z of the bottom of the disc in the straight arm, m.  Raises SensorError
    when it moves, or is too far off.
    """
    rows = np.array(poses)
    half = len(rows) // 2
    change = rows[half:].mean(axis=0) - rows[:half].mean(axis=0)
    refuse_motion(float(np.hypot(*change[:2])), abs(float(change[2])))
    mean = rows.mean(axis=0)
    off = np.array([0.0, height]) - mean[:2]
    shift, turn = float(np.linalg.norm(off)), abs(float(mean[2]))
    if shift > MAX_SHIFT or turn > MAX_TURN:
        raise SensorError(
            f'it is seen {shift * 1e3:.1f} mm and {degrees(turn):.1f} degrees from where it is in '
            'the straight arm; is the arm straight, does tags.fixed_positions fit?')
    right, up = directions(mean[2])
    return np.array([off @ right, off @ up, -mean[2]])
