# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Many equilibria of planar arms in one compiled call."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics._linear_algebra import NO_TENSION
from soft_continuum.mechanics.batch import Batch, in_parts, Problems
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.plane import _newton
from soft_continuum.mechanics.plane._continuation import Point, TURN_LIMIT_BOTH_TAUT
from soft_continuum.mechanics.plane.statics import PlaneStatics


def full_steps(given: Problems) -> Batch:
    """
    Return the equilibria that full steps find.

    Not found: problems that they do not reach, with friction of tendons, given tensions or no
    soft segment, and arms whose moment-curvature tables differ from those of the first.
    """
    models: Sequence[PlaneStatics] = given.models
    starts, count = given.starts, given.count
    kinds = count if max(len(models), len(starts), len(given.masks), len(given.vacuum)) > 1 else 1
    none = np.zeros(2)  # each row has its own target
    problems = [models[i % len(models)].problem(
        starts[i % len(starts)], given.masks[i % len(given.masks)], none,
        given.vacuum[i % len(given.vacuum)]) for i in range(kinds)]
    straight = np.array([m.chain.straight_paths for m in models])
    target = np.ascontiguousarray(straight - np.broadcast_to(given.pulls, (count, 2)))
    theta = np.broadcast_to(np.cumsum([s.configuration for s in starts], axis=1),
                            (count, models[0].chain.bodies)).copy()
    tension = np.broadcast_to(np.nan_to_num([s.tensions for s in starts]), (count, 2)).copy()
    lengths, residual = np.full((count, 2), np.nan), np.full(count, np.nan)
    systems, tables = [p.system for p in problems], problems[0].system.tables
    groups, group = np.array([p.groups for p in problems]), np.array([s.group for s in systems])
    linear = all(model.laws.linear for model in models)
    alike = linear or np.array([np.array_equal(s.tables, tables) for s in systems])
    rows = np.flatnonzero((groups > 0) & alike & ~given.rub & np.isnan(given.tensions).all(axis=1))
    status, turned = np.full(count, _newton.FAILED), np.zeros(count)
    arguments = (
        (theta, tension, lengths),
        (np.array([s.bodies for s in systems]), np.array([s.joints for s in systems]), tables,
         np.array([s.guides for s in systems]), systems[0].ratios, group), groups,
        (problems[0].drive.mode, target, np.array([m.compliance for m in models]),
         problems[0].drive.segment),
        np.array([p.tolerance for p in problems]), status, residual, turned)
    if linear:
        # Those side by side need the same rigid groups and the same driven tendons.
        kind = np.column_stack([np.broadcast_to(group, (count, group.shape[1])),
                                np.isfinite(target)])[rows]
        while len(rows):
            same = (kind == kind[0]).all(axis=1)
            in_parts(partial(_kernel.functions().newton_lanes, *arguments, rows[same]),
                     int(np.count_nonzero(same)))
            rows, kind = rows[~same], kind[~same]
    else:
        in_parts(partial(_kernel.functions().newton_batch, *arguments, rows), len(rows))
    limit = np.where((tension > NO_TENSION).all(axis=1), TURN_LIMIT_BOTH_TAUT,
                     [p.turn_limit for p in problems])
    found = (status == _newton.CONVERGED) & (turned <= limit)

    def state(i: int) -> Equilibrium:
        problem = problems[i % kinds]
        return models[i % len(models)].continuation.result(
            Point(theta[i], tension[i], lengths[i], residual=residual[i]),
            problem._replace(drive=problem.drive._replace(target=target[i])))

    return Batch(
        np.diff(theta, axis=1, prepend=0.0), tension, straight - lengths,
        np.where(tension > 0.0, 0.0, np.maximum(target - lengths, 0.0)), found,
        np.zeros(count, dtype=bool), residual, models, state)
