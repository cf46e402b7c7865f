# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of rotations to and from quaternions and angles."""

import numpy as np

from soft_continuum.mechanics.arm import Array


def bending_between(orientations: Array) -> Array:
    """Return bending about x and y between successive (…, k, 3, 3), (…, k - 1, 2), rad."""
    axes = np.einsum('...ji,...j->...i', orientations[..., :-1, :, :],
                     orientations[..., 1:, :, 2])  # in the one before
    across = np.linalg.norm(axes[..., :2], axis=-1)
    factor = np.arctan2(across, axes[..., 2]) / np.maximum(across, 1e-300)
    bending: Array = np.stack([-axes[..., 1], axes[..., 0]], axis=-1) * factor[..., None]
    return bending


def quaternions(rotations: Array) -> Array:
    """
    Return rotation matrices (k, 3, 3) as unit quaternions x, y, z, w, (k, 4), w not negative.

    From the row of 4 q q^T with the largest diagonal element (Shepperd 1978), which is exact for
    every angle.
    """
    r = np.moveaxis(rotations, 0, -1)
    products = np.array([
        [1 + r[0, 0] - r[1, 1] - r[2, 2], r[1, 0] + r[0, 1], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
        [r[1, 0] + r[0, 1], 1 - r[0, 0] + r[1, 1] - r[2, 2], r[2, 1] + r[1, 2], r[0, 2] - r[2, 0]],
        [r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], 1 - r[0, 0] - r[1, 1] + r[2, 2], r[1, 0] - r[0, 1]],
        [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1 + r[0, 0] + r[1, 1] + r[2, 2]],
    ])
    largest = np.argmax(np.einsum('iik->ik', products), axis=0)
    rows = products[largest, :, np.arange(len(rotations))]
    found: Array = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return np.where(found[:, 3:] < 0.0, -found, found)


def matrices(turns: Array) -> Array:
    """Return unit quaternions x, y, z, w, (k, 4), as rotation matrices (k, 3, 3)."""
    x, y, z, w = np.moveaxis(turns, -1, 0)
    return np.moveaxis(np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]), -1, 0)


def rotation_vectors(rotations: Array) -> Array:
    """Return the rotation vectors (k, 3), rad, of matrices (k, 3, 3) that turn by less than pi."""
    sines = 0.5 * np.column_stack([rotations[:, 2, 1] - rotations[:, 1, 2],
                                   rotations[:, 0, 2] - rotations[:, 2, 0],
                                   rotations[:, 1, 0] - rotations[:, 0, 1]])
    sine = np.linalg.norm(sines, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(rotations, axis1=1, axis2=2) - 1.0))
    found: Array = sines * (angle / np.maximum(sine, 1e-300))[:, None]
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


def full_poses(planar: Array) -> Array:
    """
    Return poses (k, 7) of planar rows (k, 3).

    planar: x, z (m) and angle about +y (rad).  A pose is position x, y, z (m) and quaternion x, y,
    z, w; z of its frame is the tangent of the backbone.
    """
    poses = np.zeros((len(planar), 7))
    poses[:, 0], poses[:, 2] = planar[:, 0], planar[:, 1]
    poses[:, 4], poses[:, 6] = np.sin(planar[:, 2] / 2.0), np.cos(planar[:, 2] / 2.0)
    return poses


def cross_matrices(vectors: Array) -> Array:
    """Return the matrices of the cross product with vectors (..., 3), (..., 3, 3)."""
    found = np.zeros((*vectors.shape, 3))
    for row, column, other in ((2, 1, 0), (0, 2, 1), (1, 0, 2)):
        found[..., row, column] = vectors[..., other]
        found[..., column, row] = -vectors[..., other]
    return found


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
