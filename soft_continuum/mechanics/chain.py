# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The arm as a chain of rigid bodies and torsion springs, and the geometry of its states.

A soft segment is n bodies of length l/n between n + 1 equal springs (paper, III-B); discs are
rigid.  A state is the vector of all joint angles, (n + 1) per segment, base first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics._checks import real_array
from soft_continuum.mechanics.arm import Arm, ArmError, PAPER

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

RIGHT, LEFT = 0, 1

SLACK = -np.inf
"""A pull that leaves the tendon slack in every shape."""


@dataclass(frozen=True, eq=False, init=False)
class Equilibrium:
    """
    A state of the arm in which all moments balance.

    joint_angles: (joints,) rad.  tensions: (2,) N of the right and left tendon at the base; nan
    where no soft segment is there to determine it.  pulls: (2,) m, by how much the path of each
    tendon is shorter than in the straight arm.  slack: (2,) m by which each tendon is longer than
    its path.  residual: largest unbalanced moment, N m.  jumped: the equilibrium followed from the
    start ceased to exist on the way and the arm went over to the next stable one.  stiff: which
    segments were stiff.  held_angles: (joints,) rad, the shape that the jam of each stiff segment
    holds.  vacuum: of each segment, 0 to 1; empty for full.  chain: the arm.
    """

    joint_angles: Array
    tensions: Array
    pulls: Array
    slack: Array
    residual: float
    iterations: int
    stiff: tuple[bool, ...]
    held_angles: Array
    jumped: bool = False
    vacuum: tuple[float, ...] = ()
    chain: 'RigidChain' = field(kw_only=True, repr=False)

    def __init__(self, joint_angles: Array, tensions: Array, pulls: Array, slack: Array,
                 residual: float, iterations: int, stiff: tuple[bool, ...], held_angles: Array,
                 jumped: bool = False, vacuum: tuple[float, ...] = (), *, chain: 'RigidChain'
                 ) -> None:
        """Take all values at once: one by one, as dataclass does, takes as long as a solve."""
        vars(self).update(
            joint_angles=joint_angles, tensions=tensions, pulls=pulls, slack=slack,
            residual=residual, iterations=iterations, stiff=stiff, held_angles=held_angles,
            jumped=jumped, vacuum=vacuum, chain=chain)

    @property
    def bending_angles(self) -> Array:
        """Bending angle of each segment, (segments,), rad."""
        return self.chain.bending_angles(self.joint_angles)

    @property
    def bending(self) -> Array:
        """How far each segment bends about x, which is 0, and y, (segments, 2), rad."""
        return np.column_stack([np.zeros(self.chain.segments), self.bending_angles])

    @property
    def bending_directions(self) -> Array:
        """Those of spatial arms; none, since a planar one bends in one plane only."""
        return np.zeros(0)

    @property
    def points(self) -> Array:
        """Bottom and top centre of every disc as RigidChain.points: (2 * discs, 3), m and rad."""
        return self.chain.points(self.joint_angles)

    @property
    def poses(self) -> Array:
        """The calculation points in space: x, y, z (m), quaternion x, y, z, w, (2 * discs, 7)."""
        return full_poses(self.points)

    @property
    def backbone(self) -> Array:
        """Upper end of every body, the base disc first, in space, (joints + 1, 3), m."""
        return _in_space(self.chain.backbone(self.joint_angles)[:, :2])

    @property
    def rotations(self) -> Array:
        """Orientation of every body in base_link, (joints, 3, 3)."""
        angles = np.cumsum(self.joint_angles)
        turned = np.zeros((len(angles), 3, 3))
        turned[:, 0, 0] = turned[:, 2, 2] = np.cos(angles)
        turned[:, 0, 2], turned[:, 2, 0] = np.sin(angles), -np.sin(angles)
        turned[:, 1, 1] = 1.0
        return turned

    @property
    def tendon_points(self) -> list[Array]:
        """Guides of each tendon in space, base first, (2 * discs, 3), m."""
        return [_in_space(guides) for guides in self.chain.guide_points(self.joint_angles)]

    @property
    def coordinates(self) -> Array:
        """Numbers that tell the shape: the joint angles, (joints,), rad."""
        return self.joint_angles

    @property
    def held_coordinates(self) -> Array:
        """The same of what the jams of stiff segments hold, (joints,), rad."""
        return self.held_angles

    @property
    def jam_deflection(self) -> Array:
        """By how much each segment is bent from what its jam holds, (segments, 2), rad."""
        away = self.chain.bending_angles(self.joint_angles - self.held_angles)
        return np.column_stack([np.zeros(self.chain.segments), away])

    def with_held(self, chain: 'RigidChain', change: Array) -> 'Equilibrium':
        """
        Return the state on another chain of the arm, its jams holding another bending.

        change: as ``bending``, by which they hold more, spread evenly over the joints.
        """
        per = chain.joints_per_segment
        return replace(self, held_angles=self.held_angles + np.repeat(change[:, 1] / per, per),
                       chain=chain)

    @property
    def joint_positions(self) -> Array:
        """Angles of the joints of the URDF, in the order of its joint_names, rad."""
        return self.joint_angles

    @property
    def tip(self) -> Array:
        """The tip: (x, z, tangent angle) of the top of the last disc, (3,), m and rad."""
        tip: Array = self.points[-1]
        return tip

    def plot(self, axes: 'Axes | None' = None) -> 'Axes':
        """
        Draw the arm in mm, soft segments in colour, and return the axes.

        axes: of Matplotlib, which pip install 'soft_continuum[plots]' brings; default: the
        present ones.
        """
        from matplotlib import pyplot

        from soft_continuum.analysis.figures import draw_arm
        axes = axes or pyplot.gca()
        draw_arm(axes, self, [s for s, stiff in enumerate(self.stiff) if not stiff])
        axes.set_ylabel('z in mm')
        return axes

    @property
    def taut(self) -> tuple[bool, bool]:
        """Whether the right and the left tendon carry tension."""
        return bool(self.tensions[RIGHT] > 0.0), bool(self.tensions[LEFT] > 0.0)


class RigidChain:
    """
    The rigid multibody model of an arm: its joints, loads and tendon guides as arrays.

    Joint angles have shape (joints,), joints = segments * (bodies_per_segment + 1).
    """

    joint_axes = ('y',)
    """About which the URDF turns each joint, one after another."""

    def __init__(self, arm: Arm) -> None:
        """Discretise ``arm``; raises ArmError for one that is not planar."""
        if not arm.planar:
            raise ArmError('this arm is a spatial one, for SpatialStatics and SpatialChain: a '
                           'planar one has a right and a left tendon that are alike, at 0 and '
                           'pi, and segments that bend about y only')
        self.arm = arm
        self.tendon = arm.tendons[RIGHT]
        """What both are made of."""
        n = arm.bodies_per_segment
        self.segments = len(arm.segments)
        self.joints_per_segment = n + 1
        self.joints = self.segments * (n + 1)
        lengths, masses, joint_lengths, stiffness = [], [], [], []
        for segment, disc in zip(arm.segments, arm.discs[1:], strict=True):
            lengths += [segment.length / n] * n + [disc.height]
            masses += [segment.mass / n] * n + [disc.mass]
            parts = joint_lengths_of(segment.length, n, arm.discretisation)
            joint_lengths += parts
            stiffness += [segment.stiffness_y / part for part in parts]
        self.body_lengths = np.array(lengths)
        self.body_masses = np.array(masses)
        self.joint_lengths = np.array(joint_lengths)
        self.joint_stiffness = np.array(stiffness)
        self.guides = np.array([[self.tendon.offset_at(s, part) for part in (0.0, 1.0)]
                                for s in range(self.segments)])
        self.straight_length = np.hypot([s.length for s in arm.segments],
                                        np.diff(self.guides)[:, 0]).sum()
        self.last_joint = np.arange(1, self.segments + 1) * (n + 1) - 1

    @property
    def coordinate_count(self) -> int:
        """How many coordinates a state has."""
        return self.joints

    @property
    def disc_radii(self) -> Array:
        """Radius of every disc as views draw it, (discs,), m."""
        return np.array([self.guides[max(0, k - 1):k + 1].max()
                         for k in range(self.segments + 1)])

    @property
    def load_coefficients(self) -> Array:
        """
        Energy of all dead loads as sum(wx sin(theta) + wz cos(theta)): (joints, 2), N m.

        A body carries its own weight at its middle and all weights above at its end.
        """
        above = np.cumsum(self.body_masses[::-1])[::-1] - self.body_masses + self.arm.payload
        lever = self.body_lengths * (0.5 * self.body_masses + above)
        coefficients: Array = -lever[:, None] * self.arm.gravity[::2]
        for wrench in self.arm.wrenches:
            if wrench.disc > 0:  # the base does not move
                body = self.last_joint[wrench.disc - 1]
                arms = self.body_lengths[:body + 1].copy()
                arms[-1] *= 0.5
                coefficients[:body + 1] -= arms[:, None] * wrench.force[::2]
        return coefficients

    def straight(self) -> Equilibrium:
        """Return the straight arm with both tendons just taut, nothing pulled."""
        return self._straight

    @cached_property
    def _straight(self) -> Equilibrium:
        return self.state(np.zeros(self.joints))

    def state(self, joint_angles: ArrayLike) -> Equilibrium:
        """Return joint angles (joints,) rad as a held state: tendons along it, no tension."""
        wanted = (f'joint angles must be {self.joints} finite numbers (rad), '
                  f'{self.joints_per_segment} for each segment')
        angles = real_array(joint_angles, wanted)
        if angles.shape != (self.joints,) or not np.all(np.isfinite(angles)):
            raise ValueError(wanted)
        return Equilibrium(angles, np.zeros(2), self.straight_length - self.tendon_lengths(angles),
                           np.zeros(2), 0.0, 0, (True,) * self.segments, angles, chain=self)

    def state_of(self, coordinates: Array, held: Array, stiff: Sequence[bool],
                 vacuum: Sequence[float] = ()) -> Equilibrium:
        """
        Return a state without tension: coordinates, what stiff segments hold, which are stiff.

        vacuum: as in Equilibrium.
        """
        return replace(self.state(coordinates), held_angles=held, stiff=tuple(stiff),
                       vacuum=tuple(vacuum))

    def at(self, joint_positions: Array) -> Equilibrium:
        """Return the held state of joint_positions (joints,), rad, as joint_states have it."""
        return self.state(joint_positions)

    def uniform(self, bending: ArrayLike) -> Equilibrium:
        """
        Return the held state whose segments bend evenly over their joints.

        bending: angles (segments,), rad, or as Equilibrium.bending.
        """
        angles = real_array(bending, 'bending angles must be numbers (rad)')
        if angles.ndim == 2:
            if angles.shape[1] != 2 or angles[:, 0].any():
                raise ValueError('a planar arm bends about y only; needed: (segments, 2) rad, of '
                                 'which the first column is 0')
            angles = angles[:, 1]
        return self.state(np.repeat(angles / self.joints_per_segment, self.joints_per_segment))

    def bending_angles(self, joint_angles: Array) -> Array:
        """Return the bending angle of each segment, shape (segments,), rad."""
        each: Array = joint_angles.reshape(self.segments, self.joints_per_segment).sum(axis=1)
        return each

    def points(self, joint_angles: Array) -> Array:
        """
        Return (x, z, tangent angle) at the calculation points, shape (2 * discs, 3), m and rad.

        The points are the bottom and top centre of every disc, base first (paper, III-C).
        """
        ends = self.backbone(joint_angles)
        points = np.zeros((2 * self.segments + 2, 3))
        points[1] = ends[0]
        points[3::2] = ends[self.last_joint + 1]
        points[2::2, :2] = ends[self.last_joint, :2]
        points[2::2, 2] = points[3::2, 2]
        return points

    def backbone(self, joint_angles: Array) -> Array:
        """
        Return (x, z, angle) of the upper end of every body, shape (joints + 1, 3), m and rad.

        The first row is the top of the base disc.
        """
        theta = np.cumsum(joint_angles)
        ends = np.empty((self.joints + 1, 3))
        ends[0] = 0.0, self.arm.discs[0].height, 0.0
        ends[1:, 0] = np.cumsum(self.body_lengths * np.sin(theta))
        ends[1:, 1] = ends[0, 1] + np.cumsum(self.body_lengths * np.cos(theta))
        ends[1:, 2] = theta
        return ends

    def guide_points(self, joint_angles: Array) -> Array:
        """
        Return the tendons' guides, shape (2, 2 * discs, 2): right and left, base first; x, z in m.

        Inside the base and the tip disc the tendon runs parallel to the axis.
        """
        points = self.points(joint_angles)
        offsets = self.guides.ravel()
        offsets = np.concatenate([offsets[:1], offsets, offsets[-1:]])
        across = np.stack([np.cos(points[:, 2]), -np.sin(points[:, 2])], axis=1)
        sides = np.array([1.0, -1.0])[:, None, None]
        guides: Array = points[:, :2] + sides * offsets[:, None] * across
        return guides

    def tendon_lengths(self, joint_angles: Array) -> Array:
        """Return the length of the right and left tendon through the segments, (2,), m."""
        guides = self.guide_points(joint_angles)
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


def joint_lengths_of(length: float, bodies: int, discretisation: str) -> list[float]:
    """Return the length of spring (m) that each of the n + 1 joints of a segment stands for."""
    if discretisation == PAPER:
        return [length / (bodies + 1)] * (bodies + 1)
    return [length / (2 * bodies), *[length / bodies] * (bodies - 1), length / (2 * bodies)]


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


def _in_space(points: Array) -> Array:
    """Return points x, z (k, 2) as x, y, z (k, 3)."""
    return np.insert(points, 1, 0.0, axis=1)
