# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Poses: arrays (7,) of position x, y, z (m) and unit quaternion x, y, z, w.

The pose of B in A maps coordinates in B to coordinates in A.
"""

from collections.abc import Sequence
from math import atan2, hypot, sin

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics.arm import Array, PLANAR_AXES
from soft_continuum.mechanics.orientations import cross_matrices, full_poses

IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
UP = np.array([0.0, 0.0, 1.0])
TINY = 1e-12  # rad
UNKNOWN = 1e6
"""Variance, m^2 or rad^2, of a coordinate that is not measured."""


def in_plane(pose: Array, covariance: Array) -> tuple[Array, Array]:
    """
    Return x, z (m) and angle (rad), (3,), and covariance (3, 3) as a pose and (6, 6) covariance.

    Coordinates outside the plane count as not measured.
    """
    found = UNKNOWN * np.eye(6)
    found[np.ix_(PLANAR_AXES, PLANAR_AXES)] = covariance
    return full_poses(np.reshape(pose, (1, 3)))[0], found


def planar_pose(pose: Array) -> Array:
    """Return x, z (m) and angle (rad), (..., 3), of poses (..., 7) in the plane of an arm."""
    sine, cosine = pose[..., 4], pose[..., 6]  # of half the angle, with either sign
    angle = np.arctan2(2.0 * sine * cosine, cosine**2 - sine**2)
    return np.stack([pose[..., 0], pose[..., 2], angle], axis=-1)


def moved_by(turns: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which directions x, y, z (3,) change with turns about these axes (3,)."""
    moved: NDArray[np.bool_] = turns.sum() > turns
    return moved


def compose(outer: Array, inner: Array) -> Array:
    """Return the pose of C in A, from those of B in A (outer) and of C in B (inner)."""
    return np.concatenate([outer[:3] + rotate(outer[3:], inner[:3]),
                           _product(outer[3:], inner[3:])])


def inverse(pose: Array) -> Array:
    """Return the pose of A in B, from that of B in A."""
    back = pose[3:] * np.array([-1.0, -1.0, -1.0, 1.0])
    return np.concatenate([-rotate(back, pose[:3]), back])


def rotate(quaternion: Array, vector: Array) -> Array:
    """Return a vector (3,) turned by a quaternion."""
    axis, w = quaternion[:3], quaternion[3]
    twice = 2.0 * np.cross(axis, vector)
    turned: Array = vector + w * twice + np.cross(axis, twice)
    return turned


def mean_pose(poses: Sequence[Array]) -> Array:
    """Return the mean of poses that are close together; its w is not negative."""
    rows = np.array(poses)
    quaternions = rows[:, 3:]
    _, vectors = np.linalg.eigh(quaternions.T @ quaternions)
    turn = vectors[:, -1]
    return np.concatenate([rows[:, :3].mean(axis=0), turn if turn[3] >= 0.0 else -turn])


def levers(vectors: Array) -> Array:
    """Return the matrices (..., 6, 6) that move pose differences by vectors (..., 3), m."""
    found = np.zeros((*vectors.shape[:-1], 6, 6)) + np.eye(6)
    found[..., :3, 3:] = -cross_matrices(vectors)
    return found


def angle_between(one: Array, other: Array) -> float:
    """Return the angle between the orientations of two poses, rad."""
    turn = _product(one[3:] * np.array([-1.0, -1.0, -1.0, 1.0]), other[3:])
    return 2.0 * float(np.arctan2(np.linalg.norm(turn[:3]), abs(turn[3])))


def displacement(pose: Array, other: Array, unless_about: Array | None = None) -> Array:
    """
    Return the shift (m) and turn (rad) of a pose relative to another, (6,).

    The turn is a rotation vector in their common frame.  unless_about: direction (3,) in that
    frame about which turns are ignored.
    """
    turn = _product(pose[3:], other[3:] * np.array([-1.0, -1.0, -1.0, 1.0]))
    if unless_about is not None and np.hypot(turn[:3] @ unless_about, turn[3]) > 0.0:
        twist = np.array([*(-(turn[:3] @ unless_about) * unless_about), turn[3]])
        turn = _product(twist / np.linalg.norm(twist), turn)
    sine = float(np.linalg.norm(turn[:3]))
    angle = 2.0 * np.arctan2(sine, abs(turn[3]))
    factor = np.copysign(angle / sine if sine > 0.0 else 2.0, turn[3])
    return np.concatenate([pose[:3] - other[:3], factor * turn[:3]])


def displaced(pose: Array, by: Array) -> Array:
    """Return the pose at a displacement (6,) from another one; nan where that is nan."""
    angle = np.linalg.norm(by[3:])
    turn = np.append(0.5 * np.sinc(angle / (2.0 * np.pi)) * by[3:], np.cos(0.5 * angle))
    return np.concatenate([pose[:3] + by[:3], _product(turn, pose[3:])])


def turn_between(one: Array, other: Array) -> Array:
    """Return the rotation vector (3,), rad, of the smallest turn from a direction to another."""
    across, along = skew(one) @ other, one @ other
    sine = hypot(*across.tolist())
    if sine < TINY and along < 0.0:  # half a turn, about anything across it: y where that is
        across = skew(one)[:, 2 if abs(one[2]) < abs(one[0]) else 0]
        return np.asarray(np.pi / hypot(*across) * across)
    return np.asarray(atan2(sine, along) / max(sine, TINY) * across)


def rotation(vector: Array) -> Array:
    """Return the matrix (3, 3) of a rotation vector (3,), rad."""
    x, y, z = vector.tolist()
    angle = max(hypot(x, y, z), TINY)
    across, twice = sin(angle) / angle, 2.0 * (sin(angle / 2.0) / angle)**2
    return np.array([
        [1.0 - twice * (y*y + z*z), twice * x*y - across * z, twice * x*z + across * y],
        [twice * x*y + across * z, 1.0 - twice * (x*x + z*z), twice * y*z - across * x],
        [twice * x*z - across * y, twice * y*z + across * x, 1.0 - twice * (x*x + y*y)]])


def skew(vector: Array) -> Array:
    """Return the matrix (3, 3) of the cross product with a vector (3,)."""
    x, y, z = vector.tolist()  # np.cross takes ten times as long
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _product(a: Array, b: Array) -> Array:
    ax, ay, az, aw = a.tolist()  # np.cross takes ten times as long
    bx, by, bz, bw = b.tolist()
    return np.array([aw * bx + bw * ax + ay * bz - az * by, aw * by + bw * ay + az * bx - ax * bz,
                     aw * bz + bw * az + ax * by - ay * bx, aw * bw - ax * bx - ay * by - az * bz])
