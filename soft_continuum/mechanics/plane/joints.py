# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Moments in the joints from springs, jams and their held shapes; and friction at the guides.

Columns of the joints array, which _assembly.py reads: soft stiffness, soft table, jam stiffness,
jam table, held angle, yield moment, length of spring.
"""

from collections.abc import Sequence

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.laws import (
    extended,
    Jam,
    linear,
    MomentCurvature,
    refuse_parts,
    scaled,
    stacked,
)
from soft_continuum.mechanics.plane.chain import PlaneChain

SOFT, SOFT_TABLE, JAM, JAM_TABLE, HELD, YIELD, LENGTH = range(7)


class JointLaws:
    """The laws of all joints of a chain, for any set of stiff segments and vacuum."""

    def __init__(self, chain: PlaneChain) -> None:
        """Collect stiffness and tables of every segment, soft and jammed."""
        self._segments = chain.arm.segments
        self._per_segment = chain.joints_per_segment
        tables: list[MomentCurvature] = []
        soft = np.zeros((chain.bodies, 7))
        soft[:, SOFT] = chain.joint_stiffness
        soft[:, [SOFT_TABLE, JAM_TABLE]] = -1.0
        soft[:, YIELD] = np.inf
        soft[:, LENGTH] = chain.joint_lengths
        jam = np.zeros((chain.bodies, 2))
        jam[:, 1] = -1.0
        for s, segment in enumerate(self._segments):
            rows = self._rows(s)
            if segment.soft_law is not None:
                soft[rows, SOFT], soft[rows, SOFT_TABLE] = 1.0, len(tables)
                tables.append(segment.soft_law)
            if segment.jam.law is not None:
                jam[rows] = 1.0, len(tables)
                tables.append(segment.jam.law.minus(
                    segment.soft_law or linear(segment.stiffness_y)))
            elif not segment.jam.rigid and segment.soft_law is None:
                jam[rows, 0] = (segment.jam.ratio - 1.0) * chain.joint_stiffness[rows]
            elif not segment.jam.rigid:
                jam[rows] = segment.jam.ratio - 1.0, len(tables) - 1
        self.soft, self._jam = soft, jam
        """The joints array where no segment is stiff."""
        self.least_stiffness = np.repeat(
            [(s.soft_law or linear(s.stiffness_y)).slopes.min() for s in self._segments],
            self._per_segment) / chain.joint_lengths
        """Smallest tangent stiffness of each joint of soft segments, (bodies,), N m/rad."""
        self.rigid_only = all(s.jam.rigid for s in self._segments)
        """Whether no stiff segment can bend."""
        self.linear = self.rigid_only and not tables
        """Whether moments grow in proportion to angles, whatever is stiff."""
        self.tables = stacked([(t.curvatures, t.moments) for t in tables or [linear(1.0)]])

    def greatest_stiffness(self, stiff: Sequence[bool]) -> float:
        """Return the largest tangent stiffness of any joint, spring and jam together, N m/rad."""
        greatest = 0.0
        for s, segment in enumerate(self._segments):
            jam = segment.jam if stiff[s] and not segment.jam.rigid else Jam()
            slope = (jam.law or segment.soft_law or linear(segment.stiffness_y)).slopes.max()
            factor = 1.0 if jam.rigid or jam.law else jam.ratio
            greatest = max(greatest, factor * slope / self.soft[self._rows(s), LENGTH].min())
        return float(greatest)

    def _rows(self, segment: int) -> slice:
        return slice(segment * self._per_segment, (segment + 1) * self._per_segment)

    def joints(self, start: Equilibrium, stiff: Sequence[bool],
               vacuum: Sequence[float] | None) -> Array:
        """
        Return the joints array for the given stiff segments, followed from ``start``.

        A segment that was soft in ``start`` holds its shape there.  vacuum: 0 to 1 per segment,
        None or empty for full.  Raises ValueError where a rigid jam has partial vacuum.
        """
        refuse_parts([s.jam for s in self._segments], stiff, vacuum or ())
        if self.rigid_only:
            return self.soft
        joints = self.soft.copy()
        for s, segment in enumerate(self._segments):
            if not stiff[s] or segment.jam.rigid:
                continue
            part = vacuum[s] if vacuum else 1.0
            rows = self._rows(s)
            joints[rows, JAM:JAM_TABLE + 1] = self._jam[rows]
            joints[rows, JAM] *= part**segment.jam.stiffness_exponent
            if segment.jam.yield_moment < np.inf:
                joints[rows, YIELD] = segment.jam.yield_moment * part
            if not start.stiff[s]:
                joints[rows, HELD] = start.configuration[rows]
                continue
            joints[rows, HELD] = start.held[rows]
            before = start.vacuum[s] if start.vacuum else 1.0
            if before < part:  # what is added holds the present shape: no moment changes
                share = (before / part)**segment.jam.stiffness_exponent
                for i in range(rows.start, rows.stop):
                    offset = start.configuration[i] - start.held[i]
                    joints[i, HELD] = start.configuration[i] - self._rescaled(
                        joints[i], offset, share)
        return joints

    def _rescaled(self, row: Array, offset: float, share: float) -> float:
        """Return the offset (rad) at which the jam bears ``share`` of what it bears at one."""
        if row[JAM_TABLE] < 0:
            return share * offset
        found = scaled(abs(offset) / row[LENGTH], share, self.tables[int(row[JAM_TABLE])])
        return float(np.sign(offset) * found * row[LENGTH])

    def held(self, angles: Array, joints: Array, stiff: Sequence[bool]) -> Array:
        """Return the angles (joints,) rad held by jams after creep; others are unchanged."""
        if self.rigid_only:
            return angles
        held_after = self.plastic_update(angles, joints)[:, HELD]
        jammed = np.repeat([s and not segment.jam.rigid for s, segment in
                            zip(stiff, self._segments, strict=True)], self._per_segment)
        held: Array = np.where(jammed, held_after, angles)
        return held

    def plastic_update(self, angles: Array, joints: Array) -> Array:
        """
        Return the joints array with held angles updated where the jam yields.

        The jam then bears just its yield moment (perfect plasticity).  If nothing yields the same
        array is returned.
        """
        if self.rigid_only or np.isinf(joints[:, YIELD]).all():
            return joints
        offset = angles - joints[:, HELD]
        limit = self._yield_offsets(joints)
        beyond = np.abs(offset) > limit
        if not beyond.any():
            return joints
        after = joints.copy()
        after[beyond, HELD] += np.sign(offset[beyond]) * (np.abs(offset) - limit)[beyond]
        return after

    def _yield_offsets(self, joints: Array) -> Array:
        """Return the offset (joints,) rad from the held angle at which the jam yields."""
        limit = np.full(len(joints), np.inf)
        for i, row in enumerate(joints):
            if row[JAM] <= 0.0 or np.isinf(row[YIELD]):
                continue
            if row[JAM_TABLE] < 0:
                limit[i] = row[YIELD] / row[JAM]
            else:
                curvatures, moments = self.tables[int(row[JAM_TABLE])]
                limit[i] = extended(row[YIELD] / row[JAM], moments, curvatures) * row[LENGTH]
        return limit


def tension_ratios(chain: PlaneChain, joint_angles: Array, sliding: Sequence[int]) -> Array:
    """
    Return the tension of every span over that at the base, (2, segments), by the Capstan formula.

    A tendon loses exp(-mu beta) at every guide where it turns by beta, seen in the direction in
    which it slides: 1 towards the base (it is pulled), -1 towards the tip, 0 without friction.
    """
    ratios: Array = _run_ratios(chain, joint_angles, sliding)[:, 1::2].copy()
    return ratios


def compliances(chain: PlaneChain, joint_angles: Array, sliding: Sequence[int]) -> Array:
    """Return the compliance (2,) m/N of the tendons at the base, friction included."""
    tendon = chain.tendon
    if not np.isfinite(tendon.axial_stiffness):
        return np.zeros(2)
    carried = _run_ratios(chain, joint_angles, sliding) @ _straight_runs(chain)
    stretches: Array = (tendon.free_length + carried) / tendon.axial_stiffness
    return stretches


def friction_gradients(chain: PlaneChain, joint_angles: Array, sliding: Sequence[int]
                       ) -> tuple[Array, Array]:
    """
    Return derivatives of ``tension_ratios`` and ``compliances`` by the bodies' absolute angles.

    (2, segments, bodies) per rad and (2, bodies) m/N per rad.
    """
    heading, rates = _headings(chain, joint_angles)
    bend = wrapped(np.diff(heading, axis=1))
    passed = np.cumsum(np.sign(bend)[..., None] * np.diff(rates, axis=1), axis=1)
    direction = np.asarray(sliding, dtype=float)[:, None, None]
    ratios = _run_ratios(chain, joint_angles, sliding)[:, 1:, None]
    change = -chain.tendon.friction * direction * ratios * passed
    stretches: Array = (np.einsum('tri,r->ti', change, _straight_runs(chain)[1:])
                        / chain.tendon.axial_stiffness)
    return change[:, ::2], stretches


def _straight_runs(chain: PlaneChain) -> Array:
    """Return the lengths of a tendon through discs and spans of the straight arm in turn, m."""
    runs = np.empty(2 * chain.segments + 1)
    runs[0::2] = [d.height for d in chain.arm.discs]
    runs[1::2] = np.hypot([s.length for s in chain.arm.segments], np.diff(chain.guides)[:, 0])
    return runs


def _headings(chain: PlaneChain, joint_angles: Array) -> tuple[Array, Array]:
    """
    Return the headings of each tendon through discs and spans in turn, (2, runs), rad.

    And their derivatives by the bodies' absolute angles, (2, runs, bodies).
    """
    theta = np.cumsum(joint_angles)
    runs = np.diff(chain.guide_points(joint_angles), axis=1)
    # A body turned by dtheta moves the end of its span by its length across; a disc its guides.
    rates = np.zeros((2, runs.shape[1], chain.bodies))
    square = (runs**2).sum(axis=2)
    for s in range(chain.segments):
        rows = slice(s * chain.joints_per_segment, (s + 1) * chain.joints_per_segment)
        disc, run = rows.stop - 1, 2 * s + 1
        rates[:, run + 1, disc] = 1.0
        for t, side in enumerate((1.0, -1.0)):
            moved = [(i, 0.0, chain.body_lengths[i]) for i in range(rows.start, disc)]
            moved.append((disc, side * chain.guides[s, 1], 0.0))
            if s > 0:
                moved.append((rows.start - 1, -side * chain.guides[s, 0], 0.0))
            for i, across, along in moved:
                dx = along * np.cos(theta[i]) - across * np.sin(theta[i])
                dz = -along * np.sin(theta[i]) - across * np.cos(theta[i])
                x, z = runs[t, run]
                rates[t, run, i] = (z * dx - x * dz) / square[t, run]
    return np.arctan2(runs[:, :, 0], runs[:, :, 1]), rates


def wrapped(angles: Array) -> Array:
    """Return angles in -pi to pi: headings come back after a full turn."""
    inside: Array = (angles + np.pi) % (2.0 * np.pi) - np.pi
    return inside


def _run_ratios(chain: PlaneChain, joint_angles: Array, sliding: Sequence[int]) -> Array:
    """Return the tension over that at the base through discs and spans in turn, base first."""
    if chain.tendon.friction == 0.0:
        return np.ones((2, 2 * chain.segments + 1))
    runs = np.diff(chain.guide_points(joint_angles), axis=1)
    heading = np.arctan2(runs[:, :, 0], runs[:, :, 1])
    # At the guides, from the top of the base disc.
    turn = np.abs(wrapped(np.diff(heading, axis=1)))
    passed = np.cumsum(np.insert(turn, 0, 0.0, axis=1), axis=1)
    direction = np.asarray(sliding, dtype=float)[:, None]
    ratios: Array = np.exp(-chain.tendon.friction * direction * passed)
    return ratios
