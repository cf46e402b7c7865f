# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
How an equilibrium changes with pulls and stiffness, by differentiating it implicitly.

At an equilibrium F(angles, tensions; p) = 0, so d(angles, tensions)/dp = -K^-1 dF/dp with K the
matrix of the last Newton step.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soft_continuum.mechanics import _assembly
from soft_continuum.mechanics._checks import sliding_signs
from soft_continuum.mechanics.chain import Array, Equilibrium
from soft_continuum.mechanics.joints import (
    friction_gradients,
    HELD,
    JAM,
    JAM_TABLE,
    LENGTH,
    SOFT,
    SOFT_TABLE,
    YIELD,
)
from soft_continuum.mechanics.statics import Statics


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """
    Derivatives of an equilibrium with respect to k parameters.

    joint_angles: (joints, k) rad per unit.  tensions: (2, k) N per unit.  tip: (3, k), of x, z
    (m) and tangent angle (rad) of the top of the tip disc.
    """

    joint_angles: Array
    tensions: Array
    tip: Array


class Linearisation:
    """
    The linearised statics at one equilibrium, for the stiff segments it was found with.

    A slack tendon stays slack and a taut one taut: at the point where that changes, the
    derivatives are one-sided.  So they are where a jam yields.
    """

    def __init__(self, statics: Statics, state: Equilibrium,
                 sliding: Sequence[int] = (0, 0), *, loading: bool = True) -> None:
        """
        Assemble the matrix; ``sliding`` as in Statics.solve.

        loading: whether joints whose jam bears just its yield moment go on to yield, or all turn
        back and are elastic.
        """
        self._chain = chain = statics.chain
        sliding = sliding_signs(sliding)
        self._state = state
        problem = statics.problem(
            state, [not s for s in state.stiff], np.zeros(2), state.vacuum or None)
        problem = problem.with_friction(chain, state.joint_angles, sliding)
        self._groups = groups = problem.groups
        self._system, compliance = problem.system, problem.drive.compliance
        joints = self._system.joints
        # Rounding must not decide which joints yield: they go a little beyond, or back.
        at_yield = np.abs(self._jam_moments()) >= (1.0 - 1e-9) * joints[:, YIELD]
        offset = state.joint_angles - joints[:, HELD]
        joints[at_yield, HELD] -= (1e-7 if loading else -1e-7) * offset[at_yield]
        self.theta = np.cumsum(state.joint_angles)
        self.tensions = np.nan_to_num(state.tensions)
        self.hessian, self._force, self._reach = _assembly.dense_system(
            self.theta, self.tensions, self._system, groups)
        self._stretch_rates = np.zeros((groups, 2))
        if chain.arm.tendon.friction > 0.0 and any(sliding):
            self._add_friction(sliding)
        self._taut = [t for t in (0, 1) if self.tensions[t] > 0.0
                      and (compliance[t] > 0.0 or self._reach[:, t].any())]
        size = groups + len(self._taut)
        self._matrix = np.zeros((size, size))
        self._matrix[:groups, :groups] = self.hessian
        for row, t in enumerate(self._taut, start=groups):
            self._matrix[:groups, row] = self._force[:, t]
            self._matrix[row, :groups] = self._reach[:, t] - self._stretch_rates[:, t]
            self._matrix[row, row] = -compliance[t]

    def _add_friction(self, sliding: Sequence[int]) -> None:
        """Add what a turn changes of the tension that arrives at each span, and of the stretch."""
        chain, group, free = self._chain, self._system.group, self._system.group >= 0
        ratios, stretches = friction_gradients(chain, self._state.joint_angles, sliding)
        gather = np.eye(self._groups)[group[free]]  # from bodies to rigid groups
        alone = np.zeros_like(self._system.ratios)
        for t in (0, 1):
            self._stretch_rates[:, t] = self.tensions[t] * (stretches[t, free] @ gather)
            for s in range(chain.segments):
                alone[:] = 0.0
                alone[t, s] = 1.0
                _, force, _ = _assembly.dense_system(
                    self.theta, self.tensions, self._system._replace(ratios=alone), self._groups)
                self.hessian += self.tensions[t] * np.outer(
                    force[:, t], ratios[t, s, free] @ gather)

    def pulls(self) -> Sensitivity:
        """Return the derivatives with respect to the pulls (right, left), per m."""
        groups = self._groups
        right_side = np.zeros((len(self._matrix), 2))
        for row, t in enumerate(self._taut, start=groups):
            right_side[row, t] = -1.0
        return self._solve(right_side)

    def bending_stiffness(self) -> Sensitivity:
        """Return the derivatives with respect to E I of every segment's soft law, per N m^2."""
        joints = self._system.joints
        if np.any(joints[:, SOFT_TABLE] >= 0):
            raise ValueError('a segment with a moment-curvature table has no single E I')
        offset = self._state.joint_angles - joints[:, HELD]
        # Joint stiffness is proportional to E I, and a jam's, K - 1 times it, as well.
        jam = np.clip(joints[:, JAM] * offset, -joints[:, YIELD], joints[:, YIELD])
        # A jam's table is a whole stiff segment's less the soft one's.
        table = joints[:, JAM_TABLE] >= 0
        jam[table] = -(joints[:, JAM] * self._chain.joint_stiffness * offset)[table]
        jam[np.abs(self._jam_moments()) >= joints[:, YIELD]] = 0.0
        moments = joints[:, SOFT] * self._state.joint_angles + jam
        return self._solve(self._by_segment(
            moments, [s.bending_stiffness for s in self._chain.arm.segments]))

    def stiffness_ratio(self) -> Sensitivity:
        """Return the derivatives with respect to the ratio K of every stiff segment."""
        moments = self._jam_moments()
        elastic = np.abs(moments) < self._system.joints[:, YIELD]
        return self._solve(self._by_segment(
            np.where(elastic, moments, 0.0),
            [s.jam.ratio - 1.0 for s in self._chain.arm.segments]))

    def _jam_moments(self) -> Array:
        """Return what the jams would bear without a limit, (joints,), N m."""
        joints = self._system.joints
        return np.array([
            _assembly.law(angle - row[HELD], row[JAM], row[JAM_TABLE], row[LENGTH],
                          self._system.tables)[0]
            for angle, row in zip(self._state.joint_angles, joints, strict=True)])

    def _by_segment(self, moments: Array, parameters: Sequence[float] | Array) -> Array:
        """Return minus the change of the moment balance per parameter of each segment."""
        chain, group = self._chain, self._system.group
        right_side = np.zeros((len(self._matrix), chain.segments))
        for i, moment in enumerate(moments):
            s = i // chain.joints_per_segment
            below = group[i - 1] if i > 0 else -1
            if group[i] != below:
                right_side[group[i], s] -= moment / parameters[s]
                if below >= 0:
                    right_side[below, s] += moment / parameters[s]
        return right_side

    def _solve(self, right_side: Array) -> Sensitivity:
        chain, group = self._chain, self._system.group
        solution = np.linalg.solve(self._matrix, right_side)
        moved = np.zeros((chain.joints, right_side.shape[1]))
        free = group >= 0
        moved[free] = solution[group[free]]
        tensions = np.zeros((2, right_side.shape[1]))
        tensions[self._taut] = solution[self._groups:]
        lengths, theta = chain.body_lengths[:, None], self.theta[:, None]
        tip = np.stack([(lengths * np.cos(theta) * moved).sum(axis=0),
                        (-lengths * np.sin(theta) * moved).sum(axis=0), moved[-1]])
        return Sensitivity(np.diff(moved, axis=0, prepend=0.0), tensions, tip)
