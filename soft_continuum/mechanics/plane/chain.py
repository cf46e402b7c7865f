# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A planar arm as a chain of bodies and hinges: x and z, and angles about y."""

import numpy as np

from soft_continuum.mechanics.arm import Arm, ArmError, Array
from soft_continuum.mechanics.chain import Chain, RIGHT
from soft_continuum.mechanics.rotations import full_poses


class PlaneChain(Chain):
    """The bodies, hinges, loads and guides of a planar arm; there is a joint below each body."""

    joint_axes = ('y',)

    def __init__(self, arm: Arm) -> None:
        """Discretise ``arm``; raises ArmError for one that is not planar."""
        if not arm.planar:
            raise ArmError('this arm is spatial; use Statics or Chain for any arm: a planar '
                           'one has equal right and left tendons, at 0 and pi, and '
                           'segments that bend about y only')
        super().__init__(arm)
        self.tendon = arm.tendons[RIGHT]
        """Properties that both tendons share."""
        self.joint_stiffness: Array = (np.repeat([s.stiffness_y for s in arm.segments],
                                          self.joints_per_segment) / self.joint_lengths)
        self.load_coefficients = -self.body_lengths[:, None] * self.forces[:, ::2]
        """Energy of all dead loads as sum(wx sin(theta) + wz cos(theta)): (bodies, 2), N m."""
        self.guides = np.array([[self.tendon.offset_at(s, part) for part in (0.0, 1.0)]
                                for s in range(self.segments)])
        self.straight_paths = np.full(2, np.hypot(
            [s.length for s in arm.segments], np.diff(self.guides)[:, 0]).sum())

    @property
    def disc_radii(self) -> Array:
        """Radius of every disc in drawings, (discs,), m."""
        return np.array([self.guides[max(0, k - 1):k + 1].max()
                         for k in range(self.segments + 1)])

    def configuration(self, joint_angles: Array, /) -> Array:
        """Return the joint angles, which are the configuration."""
        return joint_angles

    joint_angles = angles_at = joint_positions = configuration

    def rotations(self, configuration: Array) -> Array:
        """Return the orientation of every body in base_link, (bodies, 3, 3)."""
        angles = np.cumsum(configuration)
        turned = np.zeros((len(angles), 3, 3))
        turned[:, 0, 0] = turned[:, 2, 2] = np.cos(angles)
        turned[:, 0, 2], turned[:, 2, 0] = np.sin(angles), -np.sin(angles)
        turned[:, 1, 1] = 1.0
        return turned

    def spread(self, bending: Array) -> Array:
        """Return joint angles that bend segments, (segments, 2) or angles (segments,), rad."""
        angles = bending
        if angles.ndim == 2:
            if angles.shape[1] != 2 or angles[:, 0].any():
                raise ValueError('a planar arm bends about y only; needed: (segments, 2) rad, of '
                                 'which the first column is 0')
            angles = angles[:, 1]
        return np.repeat(angles / self.joints_per_segment, self.joints_per_segment)

    def bending_angles(self, joint_angles: Array) -> Array:
        """Return the bending angle of each segment, shape (..., segments), rad."""
        each: Array = joint_angles.reshape(
            *joint_angles.shape[:-1], self.segments, self.joints_per_segment).sum(axis=-1)
        return each

    def summed(self, joint_angles: Array, /) -> Array:
        """Return the bending (..., segments, 2), rad."""
        angles = self.bending_angles(joint_angles)
        return np.stack([np.zeros(angles.shape), angles], axis=-1)

    bending = summed

    def bending_rates(self, configuration: Array, turned: Array) -> Array:
        """Return the change of bending (segments, 2, k) for turns of the discs (discs, 3, k)."""
        return np.diff(turned[:, :2], axis=0)

    def sizes(self, bending: Array) -> Array:
        """Return the signed bending angles (segments,), rad."""
        return bending[:, 1]

    def directions(self, bending: Array) -> Array:
        """Return an empty array: the arm bends in one plane only."""
        return np.zeros(0)

    def plane_points(self, configuration: Array) -> Array:
        """
        Return (x, z, tangent angle) at the calculation points, shape (2 * discs, 3), m and rad.

        The points are the bottom and top centre of every disc, base first (paper, III-C).
        """
        points = self.along_discs(self.backbone(configuration))
        points[2::2, 2] = points[3::2, 2]
        return points

    def poses(self, configuration: Array) -> Array:
        """Return the points in space, with quaternions, (2 * discs, 7)."""
        return full_poses(self.plane_points(configuration))

    def backbone(self, joint_angles: Array) -> Array:
        """
        Return (x, z, angle) of the upper end of every body, shape (bodies + 1, 3), m and rad.

        The first row is the top of the base disc.
        """
        theta = np.cumsum(joint_angles)
        ends = np.empty((self.bodies + 1, 3))
        ends[0] = 0.0, self.arm.discs[0].height, 0.0
        ends[1:, 0] = np.cumsum(self.body_lengths * np.sin(theta))
        ends[1:, 1] = ends[0, 1] + np.cumsum(self.body_lengths * np.cos(theta))
        ends[1:, 2] = theta
        return ends

    def axes(self, configuration: Array) -> Array:
        """Return the directions of all bodies, (..., bodies, 3)."""
        theta = np.cumsum(configuration, axis=-1)
        return np.stack([np.sin(theta), 0.0 * theta, np.cos(theta)], axis=-1)

    def guide_points(self, joint_angles: Array) -> Array:
        """
        Return the tendons' guides, shape (2, 2 * discs, 2): right and left, base first; x, z in m.

        Inside the base and the tip disc the tendon runs parallel to the axis.
        """
        points = self.plane_points(joint_angles)
        offsets = self.guides.ravel()
        offsets = np.concatenate([offsets[:1], offsets, offsets[-1:]])
        across = np.stack([np.cos(points[:, 2]), -np.sin(points[:, 2])], axis=1)
        sides = np.array([1.0, -1.0])[:, None, None]
        guides: Array = points[:, :2] + sides * offsets[:, None] * across
        return guides

    def tendon_points(self, configuration: Array) -> list[Array]:
        """Return the guides with y, (2 * discs, 3) m for each tendon."""
        return [_in_space(guides) for guides in self.guide_points(configuration)]

    def paths(self, configuration: Array) -> Array:
        """Return the length of the right and left tendon through the segments, (2,), m."""
        guides = self.guide_points(configuration)
        spans = guides[:, 2::2][:, :self.segments] - guides[:, 1::2][:, :self.segments]
        lengths: Array = np.sqrt((spans**2).sum(axis=2)).sum(axis=1)
        return lengths

    def energy(self, joint_angles: Array) -> float:
        """Return the elastic and potential energy, J, of all segments soft (zero: straight up)."""
        theta = np.cumsum(joint_angles)
        wx, wz = self.load_coefficients.T
        elastic = 0.5 * self.joint_stiffness * joint_angles**2
        for s, segment in enumerate(self.arm.segments):
            if segment.soft_law is not None:
                for i in range(s * self.joints_per_segment, (s + 1) * self.joints_per_segment):
                    length = self.joint_lengths[i]
                    elastic[i] = length * segment.soft_law.work(joint_angles[i] / length)
        return float(elastic.sum()
                     + wx @ np.sin(theta) + wz @ (np.cos(theta) - 1.0))


def _in_space(points: Array) -> Array:
    """Return points x, z (k, 2) as x, y, z (k, 3)."""
    return np.insert(points, 1, 0.0, axis=1)
