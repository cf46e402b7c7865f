# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Rotations as matrices, quaternions, rotation vectors and angles, and poses.

Quaternions are x, y, z, w.  Poses are arrays (7,) of position x, y, z (m) and unit quaternion; the
pose of B in A maps coordinates in B to coordinates in A.  Planar poses are x, z (m) and the angle
about +y (rad).
"""

from collections.abc import Sequence
from math import atan2, hypot, pi, sin

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics.arm import Array, PLANAR_AXES

IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])  # signs of the quaternion of the inverse
UP = np.array([0.0, 0.0, 1.0])
TINY = 1e-12  # rad
UNKNOWN = 1e6
"""Variance, m^2 or rad^2, of a coordinate that is not measured."""


def matrices(turns: Array) -> Array:
    """Return unit quaternions (..., 4) as rotation matrices (..., 3, 3)."""
    x, y, z, w = np.moveaxis(turns, -1, 0)
    return np.moveaxis(np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]), (0, 1), (-2, -1))


def quaternions(rotations: Array) -> Array:
    """
    Return rotation matrices (..., 3, 3) as unit quaternions (..., 4), w not negative.

    From the row of 4 q q^T with the largest diagonal element (Shepperd 1978), which is exact for
    every angle.
    """
    r = np.moveaxis(rotations.reshape(-1, 3, 3), 0, -1)
    products = np.array([
        [1 + r[0, 0] - r[1, 1] - r[2, 2], r[1, 0] + r[0, 1], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
        [r[1, 0] + r[0, 1], 1 - r[0, 0] + r[1, 1] - r[2, 2], r[2, 1] + r[1, 2], r[0, 2] - r[2, 0]],
        [r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], 1 - r[0, 0] - r[1, 1] + r[2, 2], r[1, 0] - r[0, 1]],
        [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1 + r[0, 0] + r[1, 1] + r[2, 2]],
    ])
    largest = np.argmax(np.einsum('iik->ik', products), axis=0)
    rows = products[largest, :, np.arange(len(largest))]
    found = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    upright: Array = np.where(found[:, 3:] < 0.0, -found, found)
    return upright.reshape(*rotations.shape[:-2], 4)


def rotation_vectors(rotations: Array) -> Array:
    """Return the rotation vectors (k, 3), rad, of matrices (k, 3, 3) that turn by less than pi."""
    sines = 0.5 * np.column_stack([rotations[:, 2, 1] - rotations[:, 1, 2],
                                   rotations[:, 0, 2] - rotations[:, 2, 0],
                                   rotations[:, 1, 0] - rotations[:, 0, 1]])
    sine = np.linalg.norm(sines, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(rotations, axis1=1, axis2=2) - 1.0))
    found: Array = sines * (angle / np.maximum(sine, 1e-300))[:, None]
    return found


def rotation(vector: Array) -> Array:
    """Return the matrix (3, 3) of a rotation vector (3,), rad."""
    x, y, z = vector.tolist()
    angle = max(hypot(x, y, z), TINY)
    across, twice = sin(angle) / angle, 2.0 * (sin(angle / 2.0) / angle)**2
    return np.array([
        [1.0 - twice * (y*y + z*z), twice * x*y - across * z, twice * x*z + across * y],
        [twice * x*y + across * z, 1.0 - twice * (x*x + z*z), twice * y*z - across * x],
        [twice * x*z - across * y, twice * y*z + across * x, 1.0 - twice * (x*x + y*y)]])


def cross_matrices(vectors: Array) -> Array:
    """Return the matrices of the cross product with vectors (..., 3), (..., 3, 3)."""
    if vectors.ndim == 1:  # IMUs send many: this takes a fifth of the time
        x, y, z = vectors.tolist()
        return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    found = np.zeros((*vectors.shape, 3))
    for row, column, other in ((2, 1, 0), (0, 2, 1), (1, 0, 2)):
        found[..., row, column] = vectors[..., other]
        found[..., column, row] = -vectors[..., other]
    return found


def turned_about_axes(angles: Array) -> Array:
    """Return the rotations (k, 3, 3) for angles (k, 3), rad: the inverse of angles_about_axes."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles).T, np.sin(angles).T
    rows = [[cy * cz, -cy * sz, sy],
            [cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy],
            [sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy]]
    return np.moveaxis(np.array(rows), -1, 0)


def angles_about_axes(rotations: Array) -> Array:
    """
    Return intrinsic angles (k, 3), rad, about x, then y, then z.

    rotations: (k, 3, 3), each of less than a right angle.
    """
    return np.column_stack([
        np.arctan2(-rotations[:, 1, 2], rotations[:, 2, 2]), np.arcsin(rotations[:, 0, 2]),
        np.arctan2(-rotations[:, 0, 1], rotations[:, 0, 0])])


def orientation(angle: float) -> tuple[float, float, float, float]:
    """Return the quaternion (x, y, z, w) of a rotation by ``angle`` rad about +y."""
    half = angle / 2.0
    return 0.0, float(np.sin(half)), 0.0, float(np.cos(half))


def wrapped(angle: float) -> float:
    """Return an angle, rad, as one from -pi to pi."""
    return (angle + pi) % (2.0 * pi) - pi


def matrix_angle(one: Array, other: Array) -> float:
    """Return the angle between two rotation matrices (3, 3), rad."""
    return float(np.arccos(np.clip((np.trace(one.T @ other) - 1.0) / 2.0, -1.0, 1.0)))


def turn_between(one: Array, other: Array) -> Array:
    """Return the rotation vector (3,), rad, of the smallest turn from a direction to another."""
    across, along = cross_matrices(one) @ other, one @ other
    sine = hypot(*across.tolist())
    if sine < TINY and along < 0.0:  # half a turn, about anything across it: y where that is
        across = cross_matrices(one)[:, 2 if abs(one[2]) < abs(one[0]) else 0]
        return np.asarray(pi / hypot(*across) * across)
    return np.asarray(atan2(sine, along) / max(sine, TINY) * across)


# Bending.

def bending_between(orientations: Array) -> Array:
    """Return bending about x and y between successive (…, k, 3, 3), (…, k - 1, 2), rad."""
    axes = np.einsum('...ji,...j->...i', orientations[..., :-1, :, :],
                     orientations[..., 1:, :, 2])  # in the one before
    across = np.linalg.norm(axes[..., :2], axis=-1)
    factor = np.arctan2(across, axes[..., 2]) / np.maximum(across, 1e-300)
    bending: Array = np.stack([-axes[..., 1], axes[..., 0]], axis=-1) * factor[..., None]
    return bending


def bending_rates(orientations: Array, turned: Array) -> Array:
    """Return the change of bending (segments, 2, k) for turns of the discs (discs, 3, k)."""
    below, above = orientations[:-1], orientations[1:, :, 2]
    axes = np.einsum('sji,sj->si', below, above)  # of each upper disc, in the frame below
    moved = np.einsum('sji,sjk->sik', below,
                      -cross_matrices(above) @ (turned[1:] - turned[:-1]))
    sine = np.linalg.norm(axes[:, :2], axis=1)
    angle = np.arctan2(sine, axes[:, 2])
    small = sine < 1e-4
    safe = np.where(small, 1.0, sine)
    factor = np.where(small, 1.0, angle / safe)
    # The cosine changes by -sine d(angle), so angle / sine by minus this times d(cosine).
    weight = np.where(small, 1.0 / 3.0, (sine - angle * axes[:, 2]) / safe**3)
    found = (factor[:, None, None] * moved[:, :2]
             - (weight[:, None] * moved[:, 2])[:, None] * axes[:, :2, None])
    bending: Array = np.stack([-found[:, 1], found[:, 0]], axis=1)
    return bending


# Poses.

def compose(outer: Array, inner: Array) -> Array:
    """Return the pose of C in A, from those of B in A (outer) and of C in B (inner)."""
    return np.concatenate([outer[:3] + rotate(outer[3:], inner[:3]),
                           _product(outer[3:], inner[3:])])


def inverse(pose: Array) -> Array:
    """Return the pose of A in B, from that of B in A."""
    back = pose[3:] * CONJUGATE
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


def angle_between(one: Array, other: Array) -> float:
    """Return the angle between the orientations of two poses, rad."""
    turn = _product(one[3:] * CONJUGATE, other[3:])
    return 2.0 * float(np.arctan2(np.linalg.norm(turn[:3]), abs(turn[3])))


def displacement(pose: Array, other: Array, unless_about: Array | None = None) -> Array:
    """
    Return the shift (m) and turn (rad) of a pose relative to another, (6,).

    The turn is a rotation vector in their common frame.  unless_about: direction (3,) in that
    frame about which turns are ignored.
    """
    turn = _product(pose[3:], other[3:] * CONJUGATE)
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


def levers(vectors: Array) -> Array:
    """Return the matrices (..., 6, 6) that move pose differences by vectors (..., 3), m."""
    found = np.zeros((*vectors.shape[:-1], 6, 6)) + np.eye(6)
    found[..., :3, 3:] = -cross_matrices(vectors)
    return found


def full_poses(planar: Array) -> Array:
    """
    Return poses (k, 7) of planar rows (k, 3).

    z of the frame of a pose is the tangent of the backbone.
    """
    poses = np.zeros((len(planar), 7))
    poses[:, 0], poses[:, 2] = planar[:, 0], planar[:, 1]
    poses[:, 4], poses[:, 6] = np.sin(planar[:, 2] / 2.0), np.cos(planar[:, 2] / 2.0)
    return poses


def planar_pose(pose: Array) -> Array:
    """Return poses (..., 7) in the plane of an arm as planar ones, (..., 3)."""
    sine, cosine = pose[..., 4], pose[..., 6]  # of half the angle, with either sign
    angle = np.arctan2(2.0 * sine * cosine, cosine**2 - sine**2)
    return np.stack([pose[..., 0], pose[..., 2], angle], axis=-1)


def in_plane(pose: Array, covariance: Array) -> tuple[Array, Array]:
    """
    Return a planar pose (3,) and its covariance (3, 3) as a pose and (6, 6) covariance.

    Coordinates outside the plane count as not measured.
    """
    found = UNKNOWN * np.eye(6)
    found[np.ix_(PLANAR_AXES, PLANAR_AXES)] = covariance
    return full_poses(np.reshape(pose, (1, 3)))[0], found


def moved_by(turns: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which directions x, y, z (3,) change with turns about these axes (3,)."""
    moved: NDArray[np.bool_] = turns.sum() > turns
    return moved


def _product(a: Array, b: Array) -> Array:
    """Return the product of two quaternions."""
    ax, ay, az, aw = a.tolist()  # np.cross takes ten times as long
    bx, by, bz, bw = b.tolist()
    return np.array([aw * bx + bw * ax + ay * bz - az * by, aw * by + bw * ay + az * bx - ax * bz,
                     aw * bz + bw * az + ax * by - ay * bx, aw * bw - ax * bx - ay * by - az * bz])
