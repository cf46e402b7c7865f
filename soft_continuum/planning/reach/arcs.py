# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tips of many shapes at once, by constant curvature, and shapes for a tip.

It is fast enough for thousands of calls in a search; the statics verify the result.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
import scipy

from soft_continuum.mechanics import constant_curvature
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Chain, Equilibrium
from soft_continuum.mechanics.directions import within_limits
from soft_continuum.planning.plans import TipGoal, WHOLE_ARM

ITERATIONS = 30  # of Levenberg and Marquardt's method
FITTED = 1e-3  # of the tolerances: nearer need no tip be
STEP = 1e-5  # rad, for derivatives
LEAST_DAMPING = 1e-8  # of many bendings with one tip the nearest is taken
STUCK = 1e8  # damping at which a fit gets no nearer


class TipResidual:
    """Errors of tips from a goal, relative to its tolerances."""

    def __init__(self, goal: TipGoal) -> None:
        """Take the goal."""
        self.goal = goal

    def of(self, positions: Array, rotations: Array) -> Array:
        """Return the residuals (m, 3 or 6) of tips (m, 3), m, and (m, 3, 3)."""
        goal = self.goal
        away: Array = (positions - goal.position) / goal.position_tolerance
        if goal.kind == 'position':
            return away
        assert goal.rotation is not None
        if goal.kind == 'pose':
            turned = scipy.spatial.transform.Rotation.from_matrix(
                rotations @ goal.rotation.T).as_rotvec()
        else:
            axes, wanted = rotations[..., 2], goal.rotation[:, 2]
            turned = np.cross(wanted, axes)
            sines = np.linalg.norm(turned, axis=-1)
            angles = np.arctan2(sines, axes @ wanted)
            turned *= (angles / np.maximum(sines, 1e-12))[..., None]
        return np.concatenate([away, turned / goal.angle_tolerance], axis=-1)

    def of_state(self, state: Equilibrium) -> Array:
        """Return the same of one state, (3 or 6,)."""
        there: Array = self.of(state.backbone[None, -1], state.rotations[None, -1])[0]
        return there

    def errors(self, state: Equilibrium) -> tuple[float, float]:
        """Return the errors of the tip of a state, m and rad."""
        miss = self.of_state(state)
        return (float(np.linalg.norm(miss[:3])) * self.goal.position_tolerance,
                float(np.linalg.norm(miss[3:])) * self.goal.angle_tolerance)


def size(miss: Array) -> Array:
    """Return the largest part of residuals (..., 3 or 6): up to 1 is within tolerance."""
    parts: Array = np.maximum(np.linalg.norm(miss[..., :3], axis=-1),
                              np.linalg.norm(miss[..., 3:], axis=-1))
    return parts


class Arcs:
    """
    One arm of constant curvature; bending is (segments, 2) rad, as Equilibrium.bending.

    free: axes about which it bends, as bending.  limits: (segments,) rad.
    """

    def __init__(self, chain: Chain) -> None:
        """Take its chain."""
        self.arm, self.chain = chain.arm, chain
        self.limits, self.free = chain.arm.bending_angle_limits, chain.arm.bending_axes

    @property
    def dimensions(self) -> int:
        """Number of bending axes: 1 for a tip that stays in a plane, otherwise 2."""
        return int(self.free.any(axis=0).sum())

    def tips(self, bending: Array) -> tuple[Array, Array]:
        """Return tip positions (m, 3) m and orientations (m, 3, 3) of bendings (m, ...) rad."""
        return constant_curvature.tips(self.arm, bending)

    def columns(self, movers: Sequence[int]) -> NDArray[np.intp]:
        """Return the components of a bending that some segments, or WHOLE_ARM, set."""
        chosen = np.zeros_like(self.free)
        for mover in movers:
            rows = slice(None) if mover == WHOLE_ARM else mover
            chosen[rows] = self.free[rows]
        return np.flatnonzero(chosen)

    def within(self, bending: Array) -> Array:
        """Return bendings (m, segments, 2) within the limits, the nearest to those given."""
        return within_limits(bending, self.limits)

    def fit(self, bending: Array, movers: Sequence[int], miss: TipResidual) -> tuple[Array, Array]:
        """
        Fit tips to a goal by the bendings of some segments, or WHOLE_ARM.

        bending: (m, segments, 2) rad, initial.  Returns the bendings and residuals, as
        TipResidual.of; by the method of Levenberg and Marquardt, all at once.
        """
        columns, bent = self.columns(movers), self.within(bending)
        left = miss.of(*self.tips(bent))
        damping = np.full(len(bent), 1e-3)
        for _ in range(ITERATIONS):
            going = np.flatnonzero((size(left) > FITTED) & (damping < STUCK))
            if not going.size:
                break
            here, rest = bent[going], left[going]
            there = self.within(here - self._change(here, rest, columns, damping[going], miss))
            after = miss.of(*self.tips(there))
            better = (after**2).sum(axis=1) < (rest**2).sum(axis=1)
            bent[going[better]], left[going[better]] = there[better], after[better]
            damping[going] = np.maximum(
                damping[going] * np.where(better, 0.2, 8.0), LEAST_DAMPING)
        return bent, left

    def jacobian(self, bending: Array, columns: NDArray[np.intp], miss: TipResidual) -> Array:
        """Return the Jacobian (m, k, n) of the residuals by some columns of bendings (m, ...)."""
        count = len(columns)
        flat = np.repeat(bending.reshape(1, len(bending), -1), count + 1, axis=0)
        flat[np.arange(count), :, columns] += STEP
        missed = miss.of(*self.tips(flat.reshape(count + 1, *bending.shape)))
        return np.moveaxis((missed[:-1] - missed[-1]) / STEP, 0, -1)

    def _change(self, bending: Array, left: Array, columns: NDArray[np.intp], damping: Array,
                miss: TipResidual) -> Array:
        """Return the Levenberg-Marquardt step to subtract from bendings (m, ...); left: (m, k)."""
        count, jacobian = len(columns), self.jacobian(bending, columns, miss)
        square = jacobian.swapaxes(1, 2) @ jacobian
        scale = np.trace(square, axis1=1, axis2=2) / count + 1e-12
        square += (damping * scale)[:, None, None] * np.eye(count)
        found = np.linalg.solve(square, jacobian.swapaxes(1, 2) @ left[..., None])[..., 0]
        change = np.zeros((len(bending), self.free.size))
        change[:, columns] = found
        return change.reshape(bending.shape)

    def drawn(self, draw: np.random.Generator, count: int) -> Array:
        """Return bendings within the limits, drawn evenly, (count, segments, 2) rad."""
        parts = draw.uniform(size=(count, len(self.limits)))
        drawn: Array = ((2.0 * parts - 1.0) * self.limits)[..., None] * self.free
        both: NDArray[np.bool_] = np.logical_and(*self.free.T)
        if both.any():
            ways = draw.uniform(0.0, 2.0 * np.pi, parts.shape)
            sizes = np.sqrt(parts) * self.limits
            disc = np.stack([sizes * np.cos(ways), sizes * np.sin(ways)], axis=-1)
            drawn = np.where(both[:, None], disc, drawn)
        return drawn
