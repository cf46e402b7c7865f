# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Many equilibria of planar arms in one compiled call."""

from collections.abc import Sequence
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics._linear_algebra import NO_TENSION
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.batch import Batch, in_parts, Problems
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.plane import _newton
from soft_continuum.mechanics.plane._problem import Point, Problem, TURN_LIMIT_BOTH_TAUT
from soft_continuum.mechanics.plane.statics import PlaneStatics

Kind = TypeVar('Kind')


def full_steps(given: Problems) -> Batch:
    """
    Return the equilibria that full steps find.

    Not found: problems that they do not reach, with friction of tendons, given tensions or no
    soft segment, and arms whose moment-curvature tables differ from those of the first.
    """
    models: Sequence[PlaneStatics] = given.models
    starts, count = given.starts, given.count
    kinds = count if max(len(models), len(starts), len(given.masks), len(given.vacuum)) > 1 else 1
    problems = [models[i % len(models)].problem(
        starts[i % len(starts)], given.masks[i % len(given.masks)], np.zeros(2),
        given.vacuum[i % len(given.vacuum)]) for i in range(kinds)]
    straight = np.array([m.chain.straight_paths for m in models])
    target = straight - np.broadcast_to(given.pulls, (count, 2))
    theta = np.broadcast_to(np.cumsum([s.configuration for s in starts], axis=1),
                            (count, models[0].chain.bodies)).copy()
    tension = np.broadcast_to(np.nan_to_num([s.tensions for s in starts]), (count, 2)).copy()
    lengths, residual = np.full((count, 2), np.nan), np.full(count, np.nan)
    found = np.zeros(count, dtype=bool)
    tables = problems[0].system.tables
    alike = np.array([p.groups > 0 and np.array_equal(p.system.tables, tables) for p in problems])
    rows = np.flatnonzero(alike & ~given.rub & np.isnan(given.tensions).all(axis=1))
    if rows.size:
        theta[rows], tension[rows], lengths[rows], residual[rows], found[rows] = _full_steps(
            _chosen(models, rows), _chosen(problems, rows), theta[rows], tension[rows],
            target[rows])

    def state(i: int) -> Equilibrium:
        problem = problems[i % kinds]
        return models[i % len(models)].continuation.result(
            Point(theta[i], tension[i], lengths[i], residual=residual[i]),
            problem._replace(drive=problem.drive._replace(target=target[i])))

    return Batch(
        np.diff(theta, axis=1, prepend=0.0), tension, straight - lengths,
        np.where(tension > 0.0, 0.0, np.maximum(target - lengths, 0.0)), found,
        np.zeros(count, dtype=bool), residual, models, state)


def _chosen(values: Sequence[Kind], rows: NDArray[np.intp]) -> Sequence[Kind]:
    """Return what belongs to the rows, of one value for all or one for each."""
    return values if len(values) == 1 else [values[i] for i in rows]


def _full_steps(models: Sequence[PlaneStatics], problems: Sequence[Problem], theta: Array,
                tension: Array, target: Array
                ) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
    """Return the results of full steps: angles, tensions, lengths, residual, accepted."""
    count, systems = len(theta), [p.system for p in problems]
    lengths, residual, turned = np.empty((count, 2)), np.empty(count), np.empty(count)
    status = np.empty(count, dtype=np.int64)
    arguments = (
        (theta, tension, lengths),
        (np.array([s.bodies for s in systems]), np.array([s.joints for s in systems]),
         systems[0].tables, np.array([s.guides for s in systems]), systems[0].ratios,
         np.array([s.group for s in systems])),
        np.array([p.groups for p in problems]),
        (problems[0].drive.mode, target, np.array([m.compliance for m in models]),
         problems[0].drive.segment),
        np.array([p.tolerance for p in problems]), status, residual, turned)
    in_parts(partial(_kernel.functions().newton_batch, *arguments), count)
    limit = np.where((tension > NO_TENSION).all(axis=1), TURN_LIMIT_BOTH_TAUT,
                     [p.turn_limit for p in problems])
    return (theta, tension, lengths, residual,
            (status == _newton.CONVERGED) & (turned <= limit))
