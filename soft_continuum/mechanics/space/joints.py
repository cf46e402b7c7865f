# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Moments in the joints of a spatial arm from springs, jams, friction and held shapes.

A measured law is for bending about the softer axis; about the other it is scaled by the
stiffness ratio of the description.  Twist is linear, with the torsional stiffness, and a jam
scales it like the initial bending stiffness.
"""

from collections.abc import Sequence

import numpy as np

from soft_continuum.mechanics.arm import Arm, Array, Segment
from soft_continuum.mechanics.chain import joint_lengths_of
from soft_continuum.mechanics.laws import linear, MomentCurvature, scaled, stacked
from soft_continuum.mechanics.space._laws import (
    bend,
    HELD,
    JAM,
    JAM_TABLE,
    LAW,
    parts_of_law,
    SPRING_TABLE,
    STIFFNESS,
    YIELD,
)

RIGID = 1e6
"""Times the smallest bending stiffness of a joint: of what is described as infinitely stiff."""


class SpaceLaws:
    """The laws of all joints of a spatial arm, for any set of stiff segments and vacuum."""

    def __init__(self, arm: Arm) -> None:
        """Collect stiffness and tables of every segment, soft and jammed."""
        self._segments, self._per_segment = arm.segments, arm.bodies_per_segment + 1
        self._tables: list[tuple[Array, Array]] = []
        bodies = len(arm.segments) * self._per_segment
        self._soft, self._jam = np.zeros((bodies, 4, 3)), np.zeros((bodies, 4, 3))
        for laws in (self._soft, self._jam):
            laws[:, LAW] = np.inf, -1.0, -1.0
        for s, segment in enumerate(arm.segments):
            parts = joint_lengths_of(segment.length, arm.bodies_per_segment, arm.discretisation)
            for i, part in enumerate(parts, start=s * self._per_segment):
                self._lay_out(segment, part, self._soft[i], self._jam[i])
        self.tables = stacked(self._tables)
        """(k, 2, rows), as _assembly has them."""
        self.stiffness = self._soft[:, STIFFNESS]
        """Stiffness of the springs about x, y and z, (bodies, 3), N m/rad; initial one of laws."""

    def _lay_out(self, segment: Segment, part: float, soft: Array, jam: Array) -> None:
        """Write the joint of a ``part`` of the spring, m, soft and what a jam adds to that."""
        least = min(segment.stiffness_x, segment.stiffness_y)
        law = segment.soft_law
        first = least if law is None else law.slopes[0]
        soft[STIFFNESS] = np.array([
            first * min(segment.stiffness_x / least, RIGID),
            first * min(segment.stiffness_y / least, RIGID),
            min(segment.torsional_stiffness, RIGID * first)]) / part
        if law is not None:
            soft[LAW, SPRING_TABLE] = self._table(law, part)
        if segment.friction:
            soft[JAM] = segment.friction / (segment.presliding * part) * np.array([1.0, 1.0, 0.0])
            soft[LAW, YIELD] = segment.friction
        jam[STIFFNESS], jam[LAW, SPRING_TABLE] = soft[STIFFNESS], soft[LAW, SPRING_TABLE]
        if segment.jam.rigid:
            return
        more = segment.jam.ratio - 1.0
        jam[LAW, JAM_TABLE] = soft[LAW, SPRING_TABLE]
        if segment.jam.law is not None:
            added = segment.jam.law.minus(law or linear(least))
            more = added.slopes[0] / first
            jam[LAW, JAM_TABLE] = self._table(added, part)
        jam[JAM] = more * soft[STIFFNESS]
        jam[LAW, YIELD] = segment.jam.yield_moment

    def _table(self, law: MomentCurvature, part: float) -> float:
        """Note the law of a part of the spring, m; return its number."""
        self._tables.append((np.array(law.curvatures) * part,
                             np.array(law.moments) * part / law.slopes[0]))
        return len(self._tables) - 1.0

    def joints(self, stiff: Sequence[bool], vacuum: Sequence[float], held: Array) -> Array:
        """
        Return the joints of all bodies, (bodies, 4, 3), as _laws has them; rigid ones as soft.

        stiff: per segment.  vacuum: per segment, 0 to 1, or none for full.  held: (bodies, 3) rad.
        """
        joints = self._soft.copy()
        for s, segment in enumerate(self._segments):
            if not stiff[s] or segment.jam.rigid:
                continue
            rows = slice(s * self._per_segment, (s + 1) * self._per_segment)
            joints[rows] = self._jam[rows]
            if vacuum and vacuum[s] < 1.0:
                joints[rows, JAM] *= vacuum[s]**segment.jam.stiffness_exponent
                joints[rows, LAW, YIELD] *= vacuum[s]
        joints[:, HELD] = held
        return joints

    def least_stiffness(self) -> Array:
        """Return the smallest tangent stiffness of each spring about any axis, (bodies,)."""
        slopes = np.diff(self.tables[:, 1]) / np.diff(self.tables[:, 0])
        least = np.append(slopes.min(axis=1), 1.0)  # last: of linear ones
        found: Array = self.stiffness.min(axis=1) * least[self._soft[:, LAW, SPRING_TABLE]
                                                          .astype(int)]
        return found

    def rescaled(self, segment: int, away: Array, share: float) -> Array:
        """
        Return the offset from the held shape, (joints, 3) rad, for a share of the jams' moment.

        away: the offset for all of it.
        """
        rows = slice(segment * self._per_segment, (segment + 1) * self._per_segment)
        found: Array = share * away
        for joint, far, near in zip(self._jam[rows], away, found, strict=True):
            least = float(min(joint[JAM, :2]))
            angle = bend(joint[JAM], far, least)
            if (table := int(joint[LAW, JAM_TABLE])) < 0 or angle == 0.0:
                continue
            near[:2] = far[:2] * scaled(angle, share, self.tables[table]) / angle
        return found


def parts_of_laws(stiffness: Array, angles: Array, table: Array, tables: Array, most: Array
                  ) -> tuple[Array, Array]:
    """
    Return secant and tangent stiffness of joints, each over the first one, (joints,).

    stiffness, angles: (joints, 3), N m/rad and rad.  table, most: (joints,), as of _assembly.
    """
    parts = np.ones((2, len(angles)))
    for i in np.flatnonzero((table >= 0.0) | np.isfinite(most)):
        least = float(min(stiffness[i, :2]))
        parts[:, i] = parts_of_law(
            bend(stiffness[i], angles[i], least), least, table[i], tables, most[i])
    return parts[0], parts[1]
