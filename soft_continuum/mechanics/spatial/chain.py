# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A spatial arm as a chain of rigid bodies with springs between them, and the geometry of its states.

As in the plane (RigidChain) a segment is n bodies between n + 1 springs, and a disc is a body.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.spatial._rotations import rotate
from soft_continuum.mechanics.spatial.directions import bending_directions
from soft_continuum.mechanics.spatial.joints import SpatialLaws
from soft_continuum.mechanics.spatial.orientations import (
    angles_about_axes,
    bending_between,
    quaternions,
    rotation_vectors,
    turned_about_axes,
)

ONE_LINE = 1e-6  # rad: ways this close to each other are the same, or opposite
Integers = NDArray[np.int64]
System = tuple[Any, ...]
"""The arrays of _newton."""


@dataclass(frozen=True, eq=False)
class SpatialEquilibrium:
    """
    A state in which all forces and moments balance.

    rotations: (bodies, 3, 3), of every body in base_link.  tensions: (tendons,) N at the base; nan
    where no soft segment is there to determine it.  pulls: (tendons,) m, by how much the path of
    each is shorter than in the straight arm.  slack: (tendons,) m by which each tendon is longer
    than its path.  residual: largest unbalanced moment, N m.  stiff: which segments were.  held:
    (bodies, 3) rotation vectors that jams and friction of the joints hold.  jumped: the arm went
    over to another equilibrium, since the one followed from the start ceased to exist.  vacuum: of
    each segment, 0 to 1; empty for full.  chain: the arm.
    """

    rotations: Array
    tensions: Array
    pulls: Array
    slack: Array
    residual: float
    iterations: int
    stiff: tuple[bool, ...]
    held: Array
    jumped: bool = False
    vacuum: tuple[float, ...] = ()
    chain: 'SpatialChain' = field(kw_only=True, repr=False)

    @property
    def points(self) -> Array:
        """Bottom and top centre of every disc, base first, (2 * discs, 3), m."""
        return self.chain.points(self.rotations)

    @property
    def orientations(self) -> Array:
        """Orientation of every disc, base first, (discs, 3, 3)."""
        found: Array = np.concatenate([np.eye(3)[None], self.rotations[self.chain.last_body]])
        return found

    @property
    def tip(self) -> Array:
        """The centre of the top of the last disc, (3,), m."""
        tip: Array = self.points[-1]
        return tip

    @property
    def bending(self) -> Array:
        """
        How far each segment bends about x and y of the disc below it, (segments, 2), rad.

        Its length is the bending angle: that between the axes of the discs.
        """
        return bending_between(self.orientations)

    # What every state has, planar or spatial.

    @property
    def taut(self) -> tuple[bool, ...]:
        """Whether each tendon carries tension."""
        return tuple((self.tensions > 0.0).tolist())

    @property
    def bending_angles(self) -> Array:
        """Angle between the axes of the discs below and above each segment, (segments,), rad."""
        angles: Array = np.linalg.norm(self.bending, axis=1)
        return angles

    @property
    def bending_directions(self) -> Array:
        """Direction of each segment, about z from x of the disc below, (segments,), rad."""
        return bending_directions(self.bending)

    @property
    def poses(self) -> Array:
        """The points, and quaternions x, y, z, w of their discs, (2 * discs, 7), m."""
        return np.column_stack([self.points, np.repeat(quaternions(self.orientations), 2, 0)])

    @property
    def backbone(self) -> Array:
        """Upper end of every body, the base disc first, (bodies + 1, 3), m."""
        return self.chain.ends(self.rotations)

    @property
    def tendon_points(self) -> list[Array]:
        """Guides of each tendon, base first, (guides, 3), m."""
        return self.chain.guide_points(self.rotations)

    @property
    def coordinates(self) -> Array:
        """Numbers that tell the shape: the rotation vectors of all joints, (3 * bodies,), rad."""
        return self.chain.joints(self.rotations).ravel()

    @property
    def held_coordinates(self) -> Array:
        """The same of what the jams of stiff segments hold, (3 * bodies,), rad."""
        return self.held.ravel()

    @property
    def jam_deflection(self) -> Array:
        """By how much each segment is bent from what its jam holds, (segments, 2), rad."""
        away = (self.chain.joints(self.rotations) - self.held)[:, :2]
        bent: Array = away.reshape(self.chain.segments, -1, 2).sum(axis=1)
        return bent

    def with_held(self, chain: 'SpatialChain', change: Array) -> 'SpatialEquilibrium':
        """
        Return the state on another chain of the arm, its jams holding another bending.

        change: as ``bending``, by which they hold more, spread evenly over the joints.
        """
        per = chain.joints_per_segment
        more = np.column_stack([change, np.zeros(chain.segments)])
        return replace(self, held=self.held + np.repeat(more / per, per, axis=0), chain=chain)

    @property
    def joint_positions(self) -> Array:
        """Angles of the joints of the URDF, in the order of its joint_names, rad."""
        return angles_about_axes(_turns(self.rotations)).ravel()


class SpatialChain:
    """The bodies, springs, loads and guides of a spatial arm, as arrays."""

    joint_axes = ('x', 'y', 'z')
    """About which the URDF turns each joint, one after another."""

    def __init__(self, arm: Arm) -> None:
        """Discretise ``arm``."""
        self.arm = arm
        n = arm.bodies_per_segment
        self.segments, self.joints_per_segment = len(arm.segments), n + 1
        self.bodies = self.segments * (n + 1)
        self.last_body = np.arange(1, self.segments + 1) * (n + 1) - 1
        """Of each segment: the disc above it."""
        lengths, masses = [], []
        for segment, disc in zip(arm.segments, arm.discs[1:], strict=True):
            lengths += [segment.length / n] * n + [disc.height]
            masses += [segment.mass / n] * n + [disc.mass]
        self.lengths, self.masses = np.array(lengths), np.array(masses)
        self.laws = SpatialLaws(arm)
        self.forces, self.moments = self._loads()
        self.guides = [self._guides(t) for t in range(len(arm.tendons))]
        self._spans()
        self.straight_paths = self.paths(np.tile(np.eye(3), (self.bodies, 1, 1)))
        self.layout = (self.lengths, self.forces, self.moments, self._routing,
                       self.straight_paths, self._nudge())
        """As _path.follow takes it."""

    def _loads(self) -> tuple[Array, Array]:
        """Return the force that acts at the end of each body's vector, and its dead moment."""
        arm, bodies = self.arm, self.bodies
        above = np.cumsum(self.masses[::-1])[::-1] - self.masses + arm.payload
        forces = (0.5 * self.masses + above)[:, None] * np.array(arm.gravity)
        moments = np.zeros((bodies, 3))
        for wrench in arm.wrenches:
            if wrench.disc > 0:  # the base does not move
                body = self.last_body[wrench.disc - 1]
                forces[:body] += wrench.force
                forces[body] += 0.5 * np.array(wrench.force)
                moments[body] += wrench.moment
        return forces, moments

    def _guides(self, number: int) -> list[tuple[int, Array, bool]]:
        """Return body (-1: base), place from its lower end (3,), whether a span ends there."""
        arm, tendon, n = self.arm, self.arm.tendons[number], self.arm.bodies_per_segment
        found: list[tuple[int, Array, bool]] = []
        height = arm.discs[0].height
        for s, segment in enumerate(arm.segments[:tendon.end]):
            for k in range(arm.spacers + 2):
                part = k / (arm.spacers + 1)
                z = height + part * segment.length
                angle, offset = tendon.angle + tendon.twist * z, tendon.offset_at(s, part)
                place = np.array([offset * np.cos(angle), offset * np.sin(angle), 0.0])
                body = s * (n + 1) + round(part * n)
                if k == 0:  # on top of the disc below
                    body -= 1
                    place[2] = arm.discs[0].height if s == 0 else self.lengths[body]
                found.append((body, place, k > 0))
            height += segment.length + arm.discs[s + 1].height
        return found

    def _spans(self) -> None:
        """Lay out the spans: each a sum of vectors of bodies, and of one in base_link."""
        tendons: list[int] = []
        of_span: list[int] = []
        bodies: list[int] = []
        fixed: list[Array] = []
        vectors: list[Array] = []
        for t, guides in enumerate(self.guides):
            for (low, start, _), (high, end, is_end) in zip(guides, guides[1:], strict=False):
                if not is_end:
                    continue
                span = len(tendons)
                tendons.append(t)
                fixed.append(np.zeros(3) if low >= 0 else
                             np.array([0.0, 0.0, self.arm.discs[0].height]) - start)
                for j in range(max(low, 0), high + 1):
                    along = np.array([0.0, 0.0, self.lengths[j]]) if j < high else end
                    of_span.append(span)
                    bodies.append(j)
                    vectors.append(along - start if j == low else along)
        self.span_tendons = np.array(tendons, dtype=np.int64)
        self.span_fixed = np.array(fixed, dtype=float).reshape(-1, 3)
        self.entry_spans = np.array(of_span, dtype=np.int64)
        self.entry_bodies = np.array(bodies, dtype=np.int64)
        self.entry_vectors = np.array(vectors, dtype=float).reshape(-1, 3)
        self._routing = (
            self.span_fixed, self.span_tendons,
            np.searchsorted(self.entry_spans, np.arange(len(tendons) + 1)).astype(np.int64),
            self.entry_bodies, self.entry_vectors)  # as _path has it

    def _nudge(self) -> Array:
        """
        Return what turns a body off an unstable balance, about x and y, (2,), of length root 2.

        It goes with the arm: towards the first tendon or load beside the axis, and across that,
        to the side of the next one, so that an arm that is turned or mirrored falls alike.
        """
        arm = self.arm
        beside = [np.array(place) for place in (
            *(arm.places(t, (0.0,))[0, 0] for t in range(len(arm.tendons))),
            *(wrench.force[:2] for wrench in arm.wrenches),
            *((wrench.moment[1], -wrench.moment[0]) for wrench in arm.wrenches),
            arm.gravity[:2])]
        ways = [way / np.linalg.norm(way) for way in beside if np.linalg.norm(way) > 0.0]
        x, y = ways[0] if ways else (1.0, 0.0)
        sides = [side for way in ways if abs(side := x * way[1] - y * way[0]) > ONE_LINE]
        side = np.copysign(1.0, sides[0]) if sides else -1.0
        return np.array([-y - side * x, x - side * y])

    def straight(self) -> SpatialEquilibrium:
        """Return the straight arm with all tendons just taut, nothing pulled."""
        return self._straight

    @cached_property
    def _straight(self) -> SpatialEquilibrium:
        return self.state(np.zeros((self.bodies, 3)))

    def state(self, joints: Array) -> SpatialEquilibrium:
        """Return joints (bodies, 3), rotation vectors in rad, as a held state without tension."""
        joints = np.array(joints, dtype=float)
        if joints.shape != (self.bodies, 3) or not np.all(np.isfinite(joints)):
            raise ValueError(f'joints must be {self.bodies} rotation vectors (rad), '
                             f'{self.joints_per_segment} for each segment')
        rotations, turned = np.empty((self.bodies, 3, 3)), np.eye(3)
        for k, joint in enumerate(joints):
            rotate(turned, *joint)
            rotations[k] = turned
        tendons = len(self.arm.tendons)
        return SpatialEquilibrium(
            rotations, np.zeros(tendons), self.straight_paths - self.paths(rotations),
            np.zeros(tendons), 0.0, 0, (True,) * self.segments, joints, chain=self)

    @property
    def coordinate_count(self) -> int:
        """How many coordinates a state has."""
        return 3 * self.bodies

    @property
    def disc_radii(self) -> Array:
        """Radius of every disc as views draw it: of the segment below, (discs,), m."""
        diameters = [segment.outer_diameter for segment in self.arm.segments]
        return np.array([diameters[0], *diameters]) / 2

    def state_of(self, coordinates: Array, held: Array, stiff: Sequence[bool],
                 vacuum: Sequence[float] = ()) -> SpatialEquilibrium:
        """
        Return a state without tension: coordinates, what stiff segments hold, which are stiff.

        vacuum: as in SpatialEquilibrium.
        """
        return replace(self.state(coordinates.reshape(-1, 3)), held=held.reshape(-1, 3),
                       stiff=tuple(stiff), vacuum=tuple(vacuum))

    def at(self, joint_positions: Array) -> SpatialEquilibrium:
        """Return the held state of joint_positions (3 * bodies,), rad, as joint_states have it."""
        turns = turned_about_axes(np.reshape(joint_positions, (-1, 3)))
        return self.state(rotation_vectors(turns))

    def uniform(self, bending: Sequence[Sequence[float]] | Array) -> SpatialEquilibrium:
        """Return the held state whose segments bend evenly about x and y, (segments, 2) rad."""
        each = np.column_stack([np.asarray(bending, dtype=float), np.zeros(self.segments)])
        return self.state(np.repeat(each / self.joints_per_segment, self.joints_per_segment, 0))

    def joints(self, rotations: Array) -> Array:
        """Return the rotation vector of every joint, (bodies, 3), rad."""
        return rotation_vectors(_turns(rotations))

    def ends(self, rotations: Array) -> Array:
        """Return the upper end of every body, the base disc first, (bodies + 1, 3), m."""
        steps = np.concatenate([[[0.0, 0.0, self.arm.discs[0].height]],
                                self.lengths[:, None] * rotations[:, :, 2]])
        found: Array = np.cumsum(steps, axis=0)
        return found

    def points(self, rotations: Array) -> Array:
        """Return bottom and top centre of every disc, base first, (2 * discs, 3), m."""
        ends = self.ends(rotations)
        points = np.zeros((2 * self.segments + 2, 3))
        points[1], points[2::2], points[3::2] = (
            ends[0], ends[self.last_body], ends[self.last_body + 1])
        return points

    def guide_points(self, rotations: Array) -> list[Array]:
        """Return where the guides of each tendon are, base first, (guides, 3), m."""
        turned = np.concatenate([np.eye(3)[None], rotations])
        lower = np.concatenate([np.zeros((1, 3)), self.ends(rotations)[:-1]])
        return [np.array([lower[body + 1] + turned[body + 1] @ place for body, place, _ in guides])
                for guides in self.guides]

    def paths(self, rotations: Array) -> Array:
        """Return the length of the path of each tendon through the segments, (tendons,), m."""
        spans = self.span_fixed.copy()
        np.add.at(spans, self.entry_spans, np.einsum(
            'eij,ej->ei', rotations[self.entry_bodies], self.entry_vectors))
        return sums(self.span_tendons, np.linalg.norm(spans, axis=1), len(self.arm.tendons))

    def rigid(self, stiff: Sequence[bool]) -> NDArray[np.bool_]:
        """Return which joints are locked, (bodies,)."""
        return np.repeat([is_stiff and s.jam.rigid for s, is_stiff in zip(
            self.arm.segments, stiff, strict=True)], self.joints_per_segment)

    def system(self, rotations: Array, link: Integers, joints: Array, ratios: Array
               ) -> tuple[System, Array]:
        """
        Return the arrays of _newton, and what of each path nothing changes, (tendons,) m.

        rotations: (bodies, 3, 3).  link: (bodies,), as of ``links``.  joints: (links, 4, 3).
        ratios: (spans,), tension over that at the base.
        """
        *parts, moving, unchanged = _kernel.functions().spatial_lay_out(
            rotations, link, *self.layout[:4], len(self.arm.tendons))
        return (joints, *parts, self.laws.tables, ratios[moving]), unchanged


def _turns(rotations: Array) -> Array:
    """Return by how much each body is turned from the one below it, (bodies, 3, 3)."""
    before = np.concatenate([np.eye(3)[None], rotations[:-1]])
    turns: Array = before.transpose(0, 2, 1) @ rotations
    return turns


def sums(of_tendon: Integers, lengths: Array, tendons: int) -> Array:
    """Return the sum of the lengths of each tendon's spans, (tendons,), m."""
    return np.bincount(of_tendon, lengths, tendons).astype(np.float64)
