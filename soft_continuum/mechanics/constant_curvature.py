# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Constant-curvature kinematics: every segment is an arc, loads are neglected (paper, III, [17]).

Angles are bending angles in rad, one per segment; pulls are in m, of the right and left tendon.
"""

from collections.abc import Sequence
from math import sin

import numpy as np
from numpy.typing import ArrayLike

from soft_continuum.mechanics.arm import Arm, ArmError
from soft_continuum.mechanics.chain import Array


def chord(length: float, angle: float) -> float:
    """Return the chord in m of an arc of ``length`` m that turns by ``angle`` rad."""
    half = angle / 2.0
    return length * (1.0 - half * half / 6.0 if abs(half) < 1e-4 else sin(half) / half)


def segment_pulls(arm: Arm, segment: int, angle: float) -> tuple[float, float]:
    """
    Return by how much both tendons shorten (m) in one segment (0-based) bent to ``angle`` rad.

    The tendon runs straight between the guides at the segment's two ends.
    """
    length = arm.segments[segment].length
    lower, upper = (arm.tendons[0].offset_at(segment, part) for part in (0.0, 1.0))
    straight = (length**2 + (upper - lower)**2)**0.5
    arc = chord(length, angle)
    # Seen along the chord both end planes are turned by half the angle, to opposite sides.
    across = (upper - lower) * np.cos(angle / 2.0)
    along = (upper + lower) * np.sin(angle / 2.0)
    right = np.hypot(arc - along, across)
    left = np.hypot(arc + along, across)
    return straight - float(right), straight - float(left)


def pulls(arm: Arm, angles: Sequence[float]) -> tuple[float, float]:
    """Return the pulls (m) of the right and left tendon for bending angles (rad) per segment."""
    _check_angles(arm, angles)
    each = [segment_pulls(arm, segment, angle) for segment, angle in enumerate(angles)]
    return sum(right for right, _ in each), sum(left for _, left in each)


def bending_angle(arm: Arm, segment: int, pull: float) -> float:
    """
    Return the angle (rad) at which the right tendon is ``pull`` m shorter in a segment (0-based).

    Negative pulls (tendon paid out) give negative angles.  Raises ArmError when the segment cannot
    take up that pull within its bending angle limit.
    """
    from scipy.optimize import brentq  # 0.3 s that nodes that find none need not wait for

    limit = arm.segments[segment].bending_angle_limit
    # Far from straight the pull turns back: the angles between the turns around zero count.
    grid = np.linspace(-limit, limit, 721)
    rising = np.diff([segment_pulls(arm, segment, a)[0] for a in grid]) > 0.0
    turns = np.flatnonzero(~rising)
    least = grid[turns[turns < 360].max() + 1] if np.any(turns < 360) else -limit
    most = grid[turns[turns >= 360].min()] if np.any(turns >= 360) else limit
    low, high = segment_pulls(arm, segment, least)[0], segment_pulls(arm, segment, most)[0]
    if not low <= pull <= high:
        raise ArmError(
            f'a pull of {pull:g} m needs more than the bending angle limit of {limit:g} rad; '
            f'allowed: {low:.4g} to {high:.4g} m')
    return float(brentq(
        lambda a: segment_pulls(arm, segment, a)[0] - pull, least, most, xtol=1e-15, rtol=1e-14))


def bending(arm: Arm, pulls_of: Sequence[float], start: Array, soft: Sequence[bool]) -> Array:
    """
    Return the least bending (segments, 2), rad, that the tendons allow with their pulls.

    pulls_of: (2,) m, -inf for a tendon that is slack.  start: as returned, which segments that are
    not soft keep.  Where both tendons are too short it is in the middle.  Raises ArmError unless
    one segment is soft.
    """
    if sum(soft) != 1:
        raise ArmError('two tendons determine the bending of one soft segment; soft: '
                       f'{list(soft)}')
    found, index = np.array(start, dtype=float), list(soft).index(True)
    limit, found[index] = arm.segments[index].bending_angle_limit, 0.0
    others = pulls(arm, found[:, 1].tolist())
    bounds = []
    for sign, pull, other in zip((1.0, -1.0), pulls_of, others, strict=True):
        try:
            angle = bending_angle(arm, index, pull - other) if pull > -np.inf else -limit
        except ArmError:  # paid out or pulled in beyond the limit
            angle = -limit if pull < other else limit
        bounds.append(sign * angle)
    least, most = bounds
    found[index, 1] = np.clip(0.0, least, most) if least <= most else 0.5 * (least + most)
    return found


def poses(arm: Arm, angles: ArrayLike) -> Array:
    """
    Return (x, z, tangent angle) of every calculation point, shape (2 * discs, 3), m and rad.

    The points are the bottom and top centre of every disc, base first.  For many shapes (...,
    segments) at once there are as many.
    """
    _check_angles(arm, angles)
    bent = np.moveaxis(np.asarray(angles, dtype=float), -1, 0)
    place = np.zeros((3, *bent.shape[1:]))  # x, z, angle
    points = []

    def along(length: Array | float, angle: Array) -> Array:
        return length * np.stack([np.sin(angle), np.cos(angle), np.zeros_like(angle)])

    for k, disc in enumerate(arm.discs):
        points.append(place)
        place = place + along(disc.height, place[2])
        points.append(place)
        if k < len(arm.segments):
            half = 0.5 * bent[k]
            chords = arm.segments[k].length * np.sinc(half / np.pi)
            place = place + along(chords, place[2] + half)
            place[2] += bent[k]
    return np.moveaxis(np.array(points), (0, 1), (-2, -1))


def _check_angles(arm: Arm, angles: ArrayLike) -> None:
    count = np.shape(angles)[-1] if np.shape(angles) else 0
    if count != len(arm.segments):
        raise ArmError(
            f'{count} bending angles given, the arm has {len(arm.segments)} segments')
    if not np.all(np.isfinite(angles)):
        raise ArmError(f'bending angles must be finite numbers; given: {angles!r}')
