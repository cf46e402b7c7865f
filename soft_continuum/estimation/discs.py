# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Motion of the discs of an arm, and the accuracy of the model.

Differences of poses, and their covariances, are shifts along x, y, z (m) and rotation vectors
(rad) in base_link; for motions that a planar arm cannot make they are 0.
"""

from typing import Any

import numpy as np

from soft_continuum.estimation.sensing.rigid import displacement, levers
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.orientations import matrices

SHIFT_ERROR, TURN_ERROR = 3e-4, 3e-3  # m, rad: of a disc's pose, of what no unknown can explain
MODEL_ERROR = np.diag(np.repeat([SHIFT_ERROR, TURN_ERROR], 3))**2
"""Covariance (6, 6) of a disc's pose for that."""


def pose_error(state: Any, other: Any) -> Array:
    """Return the displacement of the discs' bottoms from another state, (discs, 6)."""
    return np.array([displacement(now, then) for now, then in zip(
        state.poses[::2], other.poses[::2], strict=True)])


def bent_evenly(state: Any) -> Array:
    """
    Return the motion of the discs per rad of even bending, (discs, 6, 2 * segments).

    Bending is about x and y of the body below each joint, where segments bend about them.
    """
    chain = state.chain
    axes = np.concatenate([np.eye(3)[None], state.rotations[:-1]])[:, :, :2]
    discs, joints = state.poses[::2, :3], state.backbone[:-1]
    found = np.zeros((chain.segments + 1, 6, chain.segments, 2))
    moments = np.cross(axes, joints[:, :, None], axis=1)
    turns, offsets = (each.reshape(chain.segments, -1, 3, 2).sum(axis=1)
                      for each in (axes, moments))
    for segment, (turn, offset) in enumerate(zip(turns, offsets, strict=True)):
        above = slice(segment + 1, None)
        found[above, :3, segment] = np.cross(turn[None], discs[above, :, None], axis=1) - offset
        found[above, 3:, segment] = turn
    found *= chain.arm.bending_axes / chain.joints_per_segment
    return found.reshape(len(discs), 6, -1)


def camera_moved(state: Any) -> Array:
    """Return the apparent motion of the discs for motions of the camera, (discs, 6, 6)."""
    return levers(state.poses[::2, :3])


def angle_stddevs(state: Any, covariances: Array) -> Array:
    """
    Return the standard deviations (segments,), rad, of the turns of all discs but the base.

    They combine x and y of the disc below.  covariances: (discs, 6, 6).
    """
    below = matrices(state.poses[:-2:2, 3:])
    inside = below.transpose(0, 2, 1) @ covariances[1:, 3:, 3:] @ below
    return np.asarray(np.sqrt(np.trace(inside[:, :2, :2], axis1=1, axis2=2)))
