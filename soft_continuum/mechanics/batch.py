# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Many equilibria in one call: of one arm under many pulls, or of many arms."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics import _newton
from soft_continuum.mechanics._active_set import NO_TENSION
from soft_continuum.mechanics._arrays import Drive, State, System
from soft_continuum.mechanics._checks import refuse_friction
from soft_continuum.mechanics._continuation import TURN_LIMIT_BOTH_TAUT
from soft_continuum.mechanics.chain import Array, Equilibrium
from soft_continuum.mechanics.statics import Statics, StaticsError


@dataclass(frozen=True, eq=False)
class Batch:
    """
    Equilibria of m problems.

    joint_angles: (m, joints) rad.  tensions, pulls: (m, 2) N and m, as in Equilibrium.  found:
    (m,) whether there is one; the other rows are nan.  jumped: (m,).  residual: (m,) N m.
    """

    joint_angles: Array
    tensions: Array
    pulls: Array
    found: NDArray[np.bool_]
    jumped: NDArray[np.bool_]
    residual: Array


def solve_batch(arms: Statics | Sequence[Statics], start: Equilibrium, pulls: ArrayLike,
                soft: Sequence[bool]) -> Batch:
    """
    Solve many independent problems, each followed from ``start``, on all cores.

    arms: one model for all problems, or one for each with the same number of segments and bodies
    and linear stiffness laws.  pulls: (m, 2), or (2,) for all, m, as in Statics.solve.  What a
    full step does not reach is continued in small steps one by one, as Statics.solve does.

    Raises ValueError when sizes do not fit together or tendons have friction.
    """
    models = [arms] if isinstance(arms, Statics) else list(arms)
    refuse_friction(max((m.chain.arm.tendon.friction for m in models), default=0.0), 'a batch')
    target = np.atleast_2d(np.asarray(pulls, dtype=float))
    count = max(len(models), len(target))
    if target.ndim != 2 or target.shape[1] != 2 or np.isnan(target).any():
        raise ValueError('pulls must have shape (m, 2): right and left in m, without nan')
    if len(models) not in (1, count) or len(target) not in (1, count):
        raise ValueError(f'{len(models)} arms and {len(target)} pairs of pulls do not go together')
    shapes = {(m.chain.segments, m.chain.joints,
               tuple(s.jam.rigid for s in m.chain.arm.segments)) for m in models}
    if len(shapes) != 1 or any(len(m.laws.tables) > 1 or np.any(m.laws.tables) for m in models):
        raise ValueError('the arms of a batch need the same number of segments and bodies, and '
                         'linear stiffness laws')
    target = np.broadcast_to(target, (count, 2))
    straight = np.array([m.chain.straight_length for m in models])[:, None]
    problems = [m.problem(start, soft, np.zeros(2)) for m in models]
    systems, groups = [p.system for p in problems], problems[0].groups
    if groups == 0:
        raise ValueError('every segment is stiff; a batch needs a soft one')
    theta = np.tile(np.cumsum(start.joint_angles), (count, 1))
    # One layout whatever is shared: another would be compiled anew.
    lengths_wanted = np.ascontiguousarray(straight - target)
    tension = np.tile(np.nan_to_num(start.tensions), (count, 1))
    lengths, residual, turned = np.empty((count, 2)), np.empty(count), np.empty(count)
    status = np.empty(count, dtype=np.int64)
    _newton.newton_batch(
        State(theta, tension, lengths),
        System(np.array([s.bodies for s in systems]), np.array([s.joints for s in systems]),
               systems[0].tables, np.array([s.guides for s in systems]), systems[0].ratios,
               systems[0].group[None, :]),
        np.array([groups]),
        Drive(problems[0].drive.mode, lengths_wanted,
              np.array([m.compliance for m in models]), problems[0].drive.segment),
        np.array([p.tolerance for p in problems]), status, residual, turned)
    limit = np.where((tension > NO_TENSION).all(axis=1), TURN_LIMIT_BOTH_TAUT,
                     [p.turn_limit for p in problems])
    found = (status == _newton.CONVERGED) & (turned <= limit)
    batch = Batch(np.diff(theta, axis=1, prepend=0.0), tension, straight - lengths, found,
                  np.zeros(count, dtype=bool), residual)
    for i in np.flatnonzero(~found):
        _solve_one(batch, int(i), models[i % len(models)], start, target[i], soft)
    return batch


def _solve_one(batch: Batch, i: int, statics: Statics, start: Equilibrium, pulls: Array,
               soft: Sequence[bool]) -> None:
    """Write the equilibrium of one problem into its row, or nan."""
    try:
        state = statics.solve(start, pulls, soft)
    except StaticsError:
        for rows in (batch.joint_angles, batch.tensions, batch.pulls, batch.residual):
            rows[i] = np.nan
        return
    batch.joint_angles[i], batch.tensions[i] = state.joint_angles, state.tensions
    batch.pulls[i], batch.residual[i] = state.pulls, state.residual
    batch.found[i], batch.jumped[i] = True, state.jumped
