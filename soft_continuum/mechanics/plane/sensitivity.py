# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Derivatives of an equilibrium of a planar arm, friction of its tendons included."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
import scipy

from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics._checks import sliding_signs, tensions_of
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.plane._assembly import law
from soft_continuum.mechanics.plane.joints import (
    friction_gradients,
    HELD,
    JAM,
    JAM_TABLE,
    LENGTH,
    SOFT,
    SOFT_TABLE,
    YIELD,
)
from soft_continuum.mechanics.plane.statics import PlaneStatics
from soft_continuum.mechanics.sensitivity import Linearisation, Sensitivity


class PlaneLinearisation(Linearisation):
    """The linearised statics of a planar arm, with friction of sliding tendons."""

    def __init__(self, statics: PlaneStatics, state: Equilibrium, sliding: Sequence[int] = (), *,
                 tensions: ArrayLike | None = None, loading: bool = True) -> None:
        """Assemble the matrix; arguments as in Linearisation."""
        given = np.full(2, np.nan) if tensions is None else tensions_of(tensions, 2, True)
        self._by_force = ~np.isnan(given)
        self._chain = chain = statics.chain
        sliding = sliding_signs(sliding)
        self._state = state
        problem = statics.problem(
            state, [not s for s in state.stiff], np.zeros(2), state.vacuum or None)
        friction = chain.tendon.friction > 0.0 and any(sliding)
        if friction:
            problem = problem.with_friction(chain, state.configuration, sliding)
        self._groups = groups = problem.groups
        self._system, compliance = problem.system, problem.drive.compliance
        joints = self._system.joints
        # Rounding must not decide which joints yield: they go a little beyond, or back.
        at_yield = np.abs(self._find_jams()[0]) >= (1.0 - 1e-9) * joints[:, YIELD]
        offset = state.configuration - joints[:, HELD]
        joints[at_yield, HELD] -= (1e-7 if loading else -1e-7) * offset[at_yield]
        self._jams = self._find_jams()
        self.theta = np.cumsum(state.configuration)
        self._carried = np.nan_to_num(state.tensions)
        self.hessian, self._force, self._reach = _kernel.functions().dense_system(
            self.theta, self._carried, tuple(self._system), groups)
        self._stretch_rates = np.zeros((groups, 2))
        if friction:
            self._add_friction(sliding)
        self._taut = [t for t in (0, 1) if self._carried[t] > 0.0 and not self._by_force[t]
                      and (compliance[t] > 0.0 or self._reach[:, t].any())]
        size = groups + len(self._taut)
        self._matrix = np.zeros((size, size))
        self._matrix[:groups, :groups] = self.hessian
        for row, t in enumerate(self._taut, start=groups):
            self._matrix[:groups, row] = self._force[:, t]
            self._matrix[row, :groups] = self._reach[:, t] - self._stretch_rates[:, t]
            self._matrix[row, row] = -compliance[t]
        self._factors = scipy.linalg.lu_factor(self._matrix, check_finite=False)

    def _add_friction(self, sliding: Sequence[int]) -> None:
        """Add what a turn changes of the tension that arrives at each span, and of the stretch."""
        chain, group, free = self._chain, self._system.group, self._system.group >= 0
        ratios, stretches = friction_gradients(chain, self._state.configuration, sliding)
        gather = np.eye(self._groups)[group[free]]  # from bodies to rigid groups
        alone = np.zeros_like(self._system.ratios)
        for t in (0, 1):
            self._stretch_rates[:, t] = self._carried[t] * (stretches[t, free] @ gather)
            for s in range(chain.segments):
                alone[:] = 0.0
                alone[t, s] = 1.0
                _, force, _ = _kernel.functions().dense_system(
                    self.theta, self._carried, tuple(self._system._replace(ratios=alone)),
                    self._groups)
                self.hessian += self._carried[t] * np.outer(
                    force[:, t], ratios[t, s, free] @ gather)

    def pulls(self) -> Sensitivity:
        """Return the derivatives by the pulls (right, left), per m; 0 where tension is given."""
        return self._solve(self._by_pulls())

    def tensions(self) -> Sensitivity:
        """Return the derivatives by the tensions (right, left), per N; 0 where length is given."""
        right_side = np.zeros((len(self._matrix), 2))
        right_side[:self._groups] = -self._force * self._by_force
        return self._solve(right_side, np.diag(self._by_force.astype(float)))

    def bending_stiffness(self) -> Sensitivity:
        """Return the derivatives with respect to E I of every segment's soft law, per N m^2."""
        if np.any(self._system.joints[:, SOFT_TABLE] >= 0):
            raise ValueError('a segment with a moment-curvature table has no single E I')
        return self._solve(self._by_bending_stiffness())

    def stiffness_ratio(self) -> Sensitivity:
        """Return the derivatives with respect to the ratio K of every stiff segment."""
        return self._solve(self._by_stiffness_ratio())

    def held_shape(self) -> Sensitivity:
        """Return the derivatives by held bending; 0 about x."""
        return self._solve(self._by_held_bending())

    def payload(self) -> Sensitivity:
        """Return the derivatives with respect to a mass at the tip, per kg."""
        return self._solve(self._by_payload())

    def all(self) -> Sensitivity:
        """
        Return all derivatives at once.

        Those by stiffness factors are 0 where bending_stiffness raises ValueError.
        """
        segments = self._chain.arm.segments
        stiffness = self._by_bending_stiffness() * [s.stiffness_y for s in segments]
        if np.any(self._system.joints[:, SOFT_TABLE] >= 0):
            stiffness[:] = 0.0
        return self._solve(np.hstack([
            self._by_held_bending(), stiffness, self._by_stiffness_ratio(),
            self._by_pulls(), self._by_payload()]))

    def _by_pulls(self) -> Array:
        right_side = np.zeros((len(self._matrix), 2))
        for row, t in enumerate(self._taut, start=self._groups):
            right_side[row, t] = -1.0
        return right_side

    def _by_bending_stiffness(self) -> Array:
        joints = self._system.joints
        offset = self._state.configuration - joints[:, HELD]
        # Joint stiffness is proportional to E I, and a jam's, K - 1 times it, as well.
        jam = np.clip(joints[:, JAM] * offset, -joints[:, YIELD], joints[:, YIELD])
        # A jam's table is a whole stiff segment's less the soft one's.
        table = joints[:, JAM_TABLE] >= 0
        jam[table] = -(joints[:, JAM] * self._chain.joint_stiffness * offset)[table]
        jam[np.abs(self._jams[0]) >= joints[:, YIELD]] = 0.0
        moments = joints[:, SOFT] * self._state.configuration + jam
        return self._by_segment(
            moments, [s.stiffness_y for s in self._chain.arm.segments])

    def _by_stiffness_ratio(self) -> Array:
        moments = self._jams[0]
        elastic = np.abs(moments) < self._system.joints[:, YIELD]
        return self._by_segment(np.where(elastic, moments, 0.0),
                                [s.jam.ratio - 1.0 for s in self._chain.arm.segments])

    def _by_held_bending(self) -> Array:
        moments, slopes = self._jams
        slopes = np.where(np.abs(moments) < self._system.joints[:, YIELD], slopes, 0.0)
        about_y = self._by_segment(
            -slopes / self._chain.joints_per_segment, np.ones(self._chain.segments))
        return np.column_stack([np.zeros(len(about_y)) if axis == 0 else about_y[:, s]
                                for s in range(self._chain.segments) for axis in (0, 1)])

    def _by_payload(self) -> Array:
        chain, free = self._chain, self._system.group >= 0
        along_x, _, along_z = chain.arm.gravity
        turning = chain.body_lengths * (
            along_z * np.sin(self.theta) - along_x * np.cos(self.theta))
        right_side = np.zeros((len(self._matrix), 1))
        np.subtract.at(right_side[:, 0], self._system.group[free], turning[free])
        return right_side

    def forces(self) -> Sensitivity:
        """Return the derivatives by forces on the discs; 0 along y."""
        chain, free = self._chain, self._system.group >= 0
        bodies = np.arange(chain.bodies)
        right_side = np.zeros((len(self._matrix), 3 * chain.segments))
        for disc in range(chain.segments):
            last = chain.last_body[disc]
            part = (bodies < last) + 0.5 * (bodies == last)
            for axis, lever in ((0, np.cos(self.theta)), (2, -np.sin(self.theta))):
                np.add.at(right_side[:, 3 * disc + axis], self._system.group[free],
                          (part * chain.body_lengths * lever)[free])
        return self._solve(right_side)

    def _find_jams(self) -> tuple[Array, Array]:
        """Return moments (N m) and tangents (N m/rad) of the jams without a limit, (joints,)."""
        joints = self._system.joints
        offset = self._state.configuration - joints[:, HELD]
        if np.all(joints[:, JAM_TABLE] < 0):
            return joints[:, JAM] * offset, joints[:, JAM]
        found = np.array([law(angle, row[JAM], row[JAM_TABLE], row[LENGTH], self._system.tables)
                          for angle, row in zip(offset, joints, strict=True)])
        return found[:, 0], found[:, 1]

    def _by_segment(self, moments: Array, parameters: Sequence[float] | Array) -> Array:
        """Return minus the change of the moment balance per parameter of each segment."""
        chain, group = self._chain, self._system.group
        size, segments = len(self._matrix), chain.segments
        segment = np.arange(len(moments)) // chain.joints_per_segment
        change = moments / np.asarray(parameters)[segment]
        below = np.concatenate([[-1], group[:-1]])
        turns = group != below
        right_side: Array = np.zeros(size * segments)
        right_side -= np.bincount(
            (group * segments + segment)[turns], change[turns], len(right_side))
        turns &= below >= 0
        right_side += np.bincount(
            (below * segments + segment)[turns], change[turns], len(right_side))
        return right_side.reshape(size, segments)

    def _solve(self, right_side: Array, change: Array | None = None) -> Sensitivity:
        """Return what follows; change: (2, k) N, of tensions that are given."""
        group, count = self._system.group, right_side.shape[1]
        solution = scipy.linalg.lu_solve(self._factors, right_side, check_finite=False)
        turned, free = np.zeros((self._chain.bodies, 3, count)), group >= 0
        turned[free, 1] = solution[group[free]]
        tensions = np.zeros((2, count)) if change is None else change
        tensions[self._taut] = solution[self._groups:]
        return Sensitivity(
            turned, tensions, self._reach.T @ solution[:self._groups], self._state)
