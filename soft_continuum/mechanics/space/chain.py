# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A spatial arm as a chain of rigid bodies with springs between them, and the geometry of its states.

As in PlaneChain a segment is n bodies between n + 1 springs, and a disc is a body.
"""

from typing import Any

import numpy as np

from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Chain
from soft_continuum.mechanics.directions import own_axes
from soft_continuum.mechanics.rotations import (
    angles_about_axes,
    rotation_vectors,
    turned_about_axes,
)
from soft_continuum.mechanics.space._assembly import Integers
from soft_continuum.mechanics.space._rotations import rotate
from soft_continuum.mechanics.space.joints import SpaceLaws

System = tuple[Any, ...]
"""The arrays of _newton."""


class SpaceChain(Chain):
    """The bodies, springs, loads and guides of a spatial arm."""

    joint_axes = ('x', 'y', 'z')

    def __init__(self, arm: Arm) -> None:
        """Discretise ``arm``."""
        super().__init__(arm)
        self.laws = SpaceLaws(arm)
        self.moments = np.zeros((self.bodies, 3))  # N m, dead ones
        for wrench in arm.wrenches:
            if wrench.disc > 0:  # the base does not move
                self.moments[self.last_body[wrench.disc - 1]] += wrench.moment
        self.guides = [self._guides(t) for t in range(len(arm.tendons))]
        self._spans()
        self.straight_paths = self.paths(np.tile(np.eye(3), (self.bodies, 1, 1)))
        across, towards = own_axes(arm)
        self.layout = (self.body_lengths, self.forces, self.moments, self._routing,
                       self.straight_paths, towards - across)
        """As _path.follow takes it."""

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
                    place[2] = arm.discs[0].height if s == 0 else self.body_lengths[body]
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
                    along = np.array([0.0, 0.0, self.body_lengths[j]]) if j < high else end
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

    @property
    def disc_radii(self) -> Array:
        """Radius of every disc in drawings: that of the segment below, (discs,), m."""
        diameters = [segment.outer_diameter for segment in self.arm.segments]
        return np.array([diameters[0], *diameters]) / 2

    def configuration(self, joint_angles: Array) -> Array:
        """Return the orientations of all bodies, (bodies, 3, 3), of rotation vectors, rad."""
        rotations, turned = np.empty((self.bodies, 3, 3)), np.eye(3)
        for k, joint in enumerate(joint_angles):
            rotate(turned, *joint)
            rotations[k] = turned
        return rotations

    def rotations(self, configuration: Array) -> Array:
        """Return the orientations, which are the configuration."""
        return configuration

    def joint_angles(self, configuration: Array) -> Array:
        """Return the rotation vector of every joint, (bodies, 3), rad."""
        return rotation_vectors(_turns(configuration))

    def joint_positions(self, configuration: Array) -> Array:
        """Return the angles about x, y and z of every joint in turn, (3 * bodies,), rad."""
        return angles_about_axes(_turns(configuration)).ravel()

    def angles_at(self, joint_positions: Array) -> Array:
        """Return the rotation vectors of angles about x, y and z, rad."""
        return rotation_vectors(turned_about_axes(np.reshape(joint_positions, (-1, 3))))

    def spread(self, bending: Array) -> Array:
        """Return joint angles that bend segments, (segments, 2) rad, evenly over their joints."""
        each = np.column_stack([bending, np.zeros(self.segments)])
        return np.repeat(each / self.joints_per_segment, self.joints_per_segment, 0)

    def summed(self, joint_angles: Array) -> Array:
        """Return the sum of joint angles over each segment about x and y, (segments, 2), rad."""
        each: Array = joint_angles[:, :2].reshape(self.segments, -1, 2).sum(axis=1)
        return each

    def axes(self, configuration: Array) -> Array:
        """Return the directions of all bodies, (..., bodies, 3)."""
        axes: Array = configuration[..., 2]
        return axes

    def tendon_points(self, rotations: Array) -> list[Array]:
        """Return the guides of each tendon, base first, (guides, 3), m."""
        turned = np.concatenate([np.eye(3)[None], rotations])
        lower = np.concatenate([np.zeros((1, 3)), self.ends(rotations)[:-1]])
        return [np.array([lower[body + 1] + turned[body + 1] @ place for body, place, _ in guides])
                for guides in self.guides]

    def spans(self, configuration: Array) -> tuple[Array, Array]:
        """Return the parts of spans that turn with bodies, (entries, 3), and all, (spans, 3) m."""
        parts = np.einsum('eij,ej->ei', configuration[self.entry_bodies], self.entry_vectors)
        spans = self.span_fixed.copy()
        np.add.at(spans, self.entry_spans, parts)
        return parts, spans

    def paths(self, configuration: Array) -> Array:
        """Return the length of the path of each tendon through the segments, (tendons,), m."""
        _, spans = self.spans(configuration)
        return sums(self.span_tendons, np.linalg.norm(spans, axis=1), len(self.arm.tendons))

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
    """Return the rotation of each body relative to the one below, (bodies, 3, 3)."""
    before = np.concatenate([np.eye(3)[None], rotations[:-1]])
    turns: Array = before.transpose(0, 2, 1) @ rotations
    return turns


def sums(of_tendon: Integers, lengths: Array, tendons: int) -> Array:
    """Return the sum of the lengths of each tendon's spans, (tendons,), m."""
    return np.bincount(of_tendon, lengths, tendons).astype(np.float64)
