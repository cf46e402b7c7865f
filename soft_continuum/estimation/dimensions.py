# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What an estimate needs to know of a planar arm, or of one in space: all else is the same.

A pose is x, z (m) and angle (rad) in the plane, (3,); in space position (m) and quaternion x, y,
z, w, (7,).  How poses differ, and their covariances, are numbers of metres, then of radians: x, z
and angle, or x, y, z and the rotation vector in base_link.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Protocol

import numpy as np

from soft_continuum.mechanics.arm import Arm, PointForce
from soft_continuum.mechanics.chain import Array, RigidChain
from soft_continuum.mechanics.either import AnyArm, AnyChain
from soft_continuum.mechanics.joints import wrapped
from soft_continuum.mechanics.sensitivity import Linearisation
from soft_continuum.mechanics.spatial.arm import Wrench
from soft_continuum.mechanics.spatial.orientations import bending_between, matrices
from soft_continuum.mechanics.spatial.sensitivity import SpatialLinearisation
from soft_continuum.sensing.rigid import displacement, mean_pose

SHIFT_ERROR, TURN_ERROR = 3e-4, 3e-3  # m, rad: of a disc's pose, of what no unknown can explain


@dataclass(frozen=True, eq=False)
class Derivatives:
    """
    How an equilibrium changes with n unknowns.

    poses: (discs, pose, n), of the discs' bottoms.  bending: (bendings * segments, n) rad.
    tensions: (tendons, n) N.  paths: (tendons, n) m.
    """

    poses: Array
    bending: Array
    tensions: Array
    paths: Array


class Dimensions(Protocol):
    """Plane or Space."""

    bendings: int
    """Numbers that tell how a segment bends."""
    shifts: int
    """Numbers of the position in a difference of poses; the others are of its orientation."""
    pose: int
    """Numbers of a difference of poses."""

    def poses(self, state: Any) -> Array:
        """Return the poses of the bottoms of all discs, base first, (discs, 3 or 7)."""

    def apart(self, pose: Array, other: Array, about: Array | None = None,
              bias: Array | float = 0.0) -> Array:
        """
        Return by how much a pose that is off by a bias differs from another, (pose,).

        about: direction (3,) about which alone it is not known how the pose is turned.
        """

    def mean(self, poses: Sequence[Array]) -> Array:
        """Return the mean of poses that lie close together."""

    def bending(self, state: Any) -> Array:
        """Return how each segment bends, (bendings * segments,), rad."""

    def uniform(self, chain: Any, poses: Sequence[Array]) -> Any:
        """Return the held state that bends evenly as its discs but the base are turned."""

    def held(self, state: Any, chain: AnyChain, change: Array) -> Any:
        """Return a state of an arm whose jams hold another bending, by (bendings * segments,)."""

    def derivatives(self, statics: Any, state: Any, sliding: Sequence[int], scales: Array
                    ) -> Derivatives:
        """
        Return those by what jams hold, stiffness, K, pulls and payload, each times a scale (n,).

        Those by the stiffness are per ``unit`` of the segment.
        """

    def sprung(self, state: Any) -> Array:
        """Return by how much the jams of the segments are bent, (bendings * segments,), rad."""

    def bent_evenly(self, state: Any) -> Array:
        """
        Return how the discs move when segments alone bend evenly, per rad.

        That is (discs, pose, bendings * segments).
        """

    def pushed(self, statics: Any, state: Any, sliding: Sequence[int], disc: int) -> Array:
        """Return how forces on a disc move all of them, per N, (discs, pose, shifts)."""

    def with_force(self, arm: Any, disc: int, force: Array) -> Any:
        """Return an arm with one more force (shifts,) N on a disc."""

    def camera_moved(self, poses: Array) -> Array:
        """Return how discs seem to move when the camera does, (discs, pose, pose)."""

    def unit(self, segment: Any) -> float:
        """Return by what its stiffness is derived."""

    def stiffer(self, segment: Any, factor: float) -> Any:
        """Return a segment of that many times the stiffness."""

    def giving(self, arm: Any, stretch: float) -> Any:
        """Return an arm whose tendons give: by ``stretch`` m/N where they are inextensible."""

    def lever(self, pose: Array, height: float) -> Array:
        """Return how a difference of poses is seen ``height`` m above, along the axis, (p, p)."""

    def angle_deviations(self, state: Any, covariances: Array) -> Array:
        """
        Return the standard deviation of the bending of each segment, (segments,), rad.

        covariances: (discs, pose, pose).
        """

    def spatial(self, covariance: Array) -> Array:
        """Return the covariance (6, 6) of a pose; of what an arm cannot do it is 0."""


class Plane:
    """One bending angle for each segment; x, z and angle for each disc."""

    bendings, shifts, pose = 1, 2, 3

    def poses(self, state: Any) -> Array:
        """Return x, z and angle."""
        found: Array = state.points[::2]
        return found

    def apart(self, pose: Array, other: Array, about: Array | None = None,
              bias: Array | float = 0.0) -> Array:
        """Return the difference."""
        away: Array = pose - other - bias
        away[2] = wrapped(away[2])
        return away

    def mean(self, poses: Sequence[Array]) -> Array:
        """Return the mean of angles that may be a full turn apart."""
        away = np.array(poses) - poses[0]
        away[:, 2] = wrapped(away[:, 2])
        mean: Array = poses[0] + away.mean(axis=0)
        return mean

    def bending(self, state: Any) -> Array:
        """Return the bending angles."""
        angles: Array = state.bending_angles
        return angles

    def uniform(self, chain: Any, poses: Sequence[Array]) -> Any:
        """Return it by the angles between the discs."""
        return chain.uniform(wrapped(np.diff([0.0, *(pose[2] for pose in poses)])))

    def held(self, state: Any, chain: AnyChain, change: Array) -> Any:
        """Return it with other held angles."""
        per = chain.joints_per_segment
        return replace(state, held_angles=state.held_angles + np.repeat(change / per, per),
                       chain=chain)

    def derivatives(self, statics: Any, state: Any, sliding: Sequence[int], scales: Array
                    ) -> Derivatives:
        """Return those of Linearisation."""
        found, chain = Linearisation(statics, state, sliding).all(), statics.chain
        joints = found.joint_angles * scales
        bending = joints.reshape(chain.segments, chain.joints_per_segment, -1).sum(axis=1)
        return Derivatives(disc_rows(chain, state.joint_angles, joints), bending,
                           found.tensions * scales, found.paths * scales)

    def sprung(self, state: Any) -> Array:
        """Return it by the joint angles."""
        away = (state.joint_angles - state.held_angles).reshape(len(state.stiff), -1)
        found: Array = away.sum(axis=1)
        return found

    def bent_evenly(self, state: Any) -> Array:
        """Return it by the joint angles."""
        chain = state.chain
        evenly = np.repeat(np.eye(chain.segments), chain.joints_per_segment, axis=0)
        return disc_rows(chain, state.joint_angles, evenly / chain.joints_per_segment)

    def pushed(self, statics: Any, state: Any, sliding: Sequence[int], disc: int) -> Array:
        """Return those of Linearisation."""
        rates = Linearisation(statics, state, sliding).forces().joint_angles
        return disc_rows(statics.chain, state.joint_angles, rates[:, 2 * disc - 2:2 * disc])

    def with_force(self, arm: Any, disc: int, force: Array) -> Any:
        """Return it with a PointForce."""
        return replace(arm, forces=(*arm.forces, PointForce(disc, *force.tolist())))

    def camera_moved(self, poses: Array) -> Array:
        """Return it about the origin."""
        found = np.tile(np.eye(3), (len(poses), 1, 1))
        found[:, 0, 2], found[:, 1, 2] = poses[:, 1], -poses[:, 0]
        return found

    def unit(self, segment: Any) -> float:
        """Return E I."""
        return float(segment.bending_stiffness)

    def stiffer(self, segment: Any, factor: float) -> Any:
        """Return it with another E I."""
        return replace(segment, bending_stiffness=segment.bending_stiffness * factor)

    def giving(self, arm: Any, stretch: float) -> Any:
        """Return it with another axial stiffness of the tendons, if it is infinite."""
        if arm.tendon.axial_stiffness < inf:
            return arm
        length = arm.tendon.free_length + arm.length
        return replace(arm, tendon=replace(arm.tendon, axial_stiffness=length / stretch))

    def lever(self, pose: Array, height: float) -> Array:
        """Return it; a turn shifts what is above."""
        found = np.eye(3)
        found[:2, 2] = height * np.array([np.cos(pose[2]), -np.sin(pose[2])])
        return found

    def angle_deviations(self, state: Any, covariances: Array) -> Array:
        """Return those of the discs' angles."""
        deviations: Array = np.sqrt(covariances[1:, 2, 2])
        return deviations

    def spatial(self, covariance: Array) -> Array:
        """Return it with 0 for y and for turns about x and z."""
        found = np.zeros((6, 6))
        found[np.ix_([0, 2, 4], [0, 2, 4])] = covariance
        return found


class Space:
    """Bending about x and y for each segment; position and orientation for each disc."""

    bendings, shifts, pose = 2, 3, 6

    def poses(self, state: Any) -> Array:
        """Return positions and quaternions."""
        found: Array = state.poses[::2]
        return found

    def apart(self, pose: Array, other: Array, about: Array | None = None,
              bias: Array | float = 0.0) -> Array:
        """Return shift and rotation vector; about what alone is not known it is none."""
        return displacement(pose, other, about) - bias

    def mean(self, poses: Sequence[Array]) -> Array:
        """Return the mean pose."""
        return mean_pose(poses)

    def bending(self, state: Any) -> Array:
        """Return the bending about x and y, of each segment in turn."""
        bending: Array = state.bending.ravel()
        return bending

    def uniform(self, chain: Any, poses: Sequence[Array]) -> Any:
        """Return it by the axes of the discs."""
        turned = matrices(np.array([[0.0, 0.0, 0.0, 1.0], *(pose[3:] for pose in poses)]))
        return chain.uniform(bending_between(turned))

    def held(self, state: Any, chain: AnyChain, change: Array) -> Any:
        """Return it with other held rotation vectors."""
        per = chain.joints_per_segment
        more = np.column_stack([change.reshape(-1, 2), np.zeros(chain.segments)])
        return replace(state, held=state.held + np.repeat(more / per, per, axis=0), chain=chain)

    def derivatives(self, statics: Any, state: Any, sliding: Sequence[int], scales: Array
                    ) -> Derivatives:
        """Return those of SpatialLinearisation."""
        found = SpatialLinearisation(statics, state).all()
        poses = np.concatenate([found.points[::2], found.orientations], axis=1)
        return Derivatives(poses * scales, found.bending.reshape(-1, len(scales)) * scales,
                           found.tensions * scales, found.paths * scales)

    def sprung(self, state: Any) -> Array:
        """Return it by the rotation vectors of the joints."""
        away = (state.chain.joints(state.rotations) - state.held)[:, :2]
        found: Array = away.reshape(len(state.stiff), -1, 2).sum(axis=1).ravel()
        return found

    def bent_evenly(self, state: Any) -> Array:
        """Return it about the axes of the body below each joint."""
        chain = state.chain
        axes = np.concatenate([np.eye(3)[None], state.rotations[:-1]])[:, :, :2]
        discs, joints = state.points[::2], state.backbone[:-1]
        found = np.zeros((chain.segments + 1, 6, chain.segments, 2))
        for k, (axis, joint) in enumerate(zip(axes, joints, strict=True)):
            segment = k // chain.joints_per_segment
            above = slice(segment + 1, None)
            levers = (discs[above] - joint)[:, :, None]
            found[above, :3, segment] += np.cross(axis[None], levers, axis=1)
            found[above, 3:, segment] += axis
        evenly: Array = found.reshape(len(discs), 6, -1) / chain.joints_per_segment
        return evenly

    def pushed(self, statics: Any, state: Any, sliding: Sequence[int], disc: int) -> Array:
        """Return those of SpatialLinearisation."""
        found = SpatialLinearisation(statics, state).forces()
        poses = np.concatenate([found.points[::2], found.orientations], axis=1)
        return poses[:, :, 3 * disc - 3:3 * disc]

    def with_force(self, arm: Any, disc: int, force: Array) -> Any:
        """Return it with a Wrench."""
        x, y, z = force.tolist()
        return replace(arm, wrenches=(*arm.wrenches, Wrench(disc, (x, y, z))))

    def camera_moved(self, poses: Array) -> Array:
        """Return it about the origin."""
        found = np.tile(np.eye(6), (len(poses), 1, 1))
        found[:, :3, 3:] = np.cross(np.eye(3)[None], poses[:, None, :3]).transpose(0, 2, 1)
        return found

    def unit(self, segment: Any) -> float:
        """Return 1: the derivatives are by a factor."""
        return 1.0

    def stiffer(self, segment: Any, factor: float) -> Any:
        """Return it with all stiffnesses times a factor, and without friction, which has none."""
        return replace(segment, stiffness_x=segment.stiffness_x * factor,
                       stiffness_y=segment.stiffness_y * factor,
                       torsional_stiffness=segment.torsional_stiffness * factor, friction=0.0)

    def giving(self, arm: Any, stretch: float) -> Any:
        """Return it with another compliance of the tendons that have none."""
        return replace(arm, tendons=tuple(
            replace(tendon, compliance=tendon.compliance or stretch) for tendon in arm.tendons))

    def lever(self, pose: Array, height: float) -> Array:
        """Return it; a turn shifts what is above."""
        x, y, z = height * matrices(pose[None, 3:])[0, :, 2]
        found = np.eye(6)
        found[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
        return found

    def angle_deviations(self, state: Any, covariances: Array) -> Array:
        """Return those of the discs' turns about x and y of the disc below, together."""
        below = state.orientations[:-1]
        inside = below.transpose(0, 2, 1) @ covariances[1:, 3:, 3:] @ below
        deviations: Array = np.sqrt(np.trace(inside[:, :2, :2], axis1=1, axis2=2))
        return deviations

    def spatial(self, covariance: Array) -> Array:
        """Return it as it is."""
        return covariance


PLANE, SPACE = Plane(), Space()


def dimensions_of(arm: AnyArm) -> Dimensions:
    """Return those of an arm."""
    return PLANE if isinstance(arm, Arm) else SPACE


def model_error(dimensions: Dimensions) -> Array:
    """Return the covariance of a disc's pose for what no unknown of the model can explain."""
    return np.diag([SHIFT_ERROR] * dimensions.shifts
                   + [TURN_ERROR] * (dimensions.pose - dimensions.shifts))**2


def disc_rows(chain: RigidChain, angles: Array, joints: Array) -> Array:
    """
    Return the derivatives (discs, 3, n) of the poses of a planar arm's discs, at their bottoms.

    angles: (joints,) rad.  joints: (joints, n) their derivatives.
    """
    theta, turned = np.cumsum(angles), np.cumsum(joints, axis=0)
    below = chain.body_lengths * (np.arange(chain.joints) < chain.last_joint[:, None])
    rows = np.zeros((chain.segments + 1, 3, joints.shape[1]))
    rows[1:, 0] = (below * np.cos(theta)) @ turned
    rows[1:, 1] = (below * -np.sin(theta)) @ turned
    rows[1:, 2] = turned[chain.last_joint]
    return rows
