# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Many equilibria in one call: independent ones on all cores, or one after the other on a path."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics import _kernel, _newton
from soft_continuum.mechanics._active_set import NO_TENSION
from soft_continuum.mechanics._batches import common_count, in_parts, Masks, rows_of, Solutions
from soft_continuum.mechanics._checks import (
    check_start,
    listed,
    real_array,
    refuse_friction,
    sliding_signs,
)
from soft_continuum.mechanics._problem import Point, Problem, TURN_LIMIT_BOTH_TAUT
from soft_continuum.mechanics.chain import Array, Equilibrium
from soft_continuum.mechanics.statics import Statics, StaticsError

Kind = TypeVar('Kind')
Parts = Sequence[float] | Sequence[Sequence[float]] | Array


@dataclass(frozen=True, eq=False)
class Batch(Solutions):
    """
    Equilibria of m problems, as arrays and, by index, one by one.

    joint_angles: (m, joints) rad.  tensions, pulls, slack: (m, 2) N and m, as in Equilibrium.
    found: (m,) whether there is one; the other rows are nan, and their index raises LookupError.
    jumped: (m,).  residual: (m,) N m.
    """

    joint_angles: Array
    tensions: Array
    pulls: Array
    slack: Array
    found: NDArray[np.bool_]
    jumped: NDArray[np.bool_]
    residual: Array
    _models: Sequence[Statics] = field(repr=False)
    _state: Callable[[int], Equilibrium] = field(repr=False)

    @property
    def bending_angles(self) -> Array:
        """Bending angle of each segment, (m, segments), rad."""
        chain = self._models[0].chain
        each: Array = self.joint_angles.reshape(len(self), chain.segments, -1).sum(axis=2)
        return each

    @property
    def tips(self) -> Array:
        """Tips (x, z, tangent angle), (m, 3), m and rad, as Equilibrium.tip."""
        theta = np.cumsum(self.joint_angles, axis=1)
        lengths = np.array([m.chain.body_lengths for m in self._models])
        base = np.array([m.chain.arm.discs[0].height for m in self._models])
        return np.column_stack([(lengths * np.sin(theta)).sum(axis=1),
                                base + (lengths * np.cos(theta)).sum(axis=1), theta[:, -1]])


def solve_batch(arms: Statics | Sequence[Statics], start: Equilibrium | Sequence[Equilibrium],
                pulls: ArrayLike, soft: Masks, *, vacuum: Parts | None = None,
                sliding: Sequence[int] | Sequence[Sequence[int]] | None = None) -> Batch:
    """
    Solve many independent problems on all cores.

    Each of these is one for all problems or one for each: arms, with the same number of segments
    and bodies; start, the state that a problem is followed from; pulls, (2,) or (m, 2), m; soft,
    a mask or m of them; vacuum; sliding, for tendons with friction.  All are as in Statics.solve.

    What a full step does not reach is continued in small steps one by one, as Statics.solve does;
    so are all problems with friction, without a soft segment, or with arms whose moment-curvature
    tables differ.

    Raises ValueError when sizes do not fit together, or tendons have friction and ``sliding`` is
    not given.
    """
    models = [arms] if isinstance(arms, Statics) else listed(arms)
    starts = [start] if isinstance(start, Equilibrium) else listed(start)
    for one in starts or [start]:
        check_start(one, Equilibrium)
    if not (models and all(isinstance(m, Statics) for m in models)):
        raise ValueError(f'arms must be a Statics, or one for each problem; given: {arms!r}')
    wanted, masks = _pairs(pulls), rows_of(soft)
    parts = [None] if vacuum is None else rows_of(vacuum)
    slides = [sliding_signs(pair) for pair in ([(0, 0)] if sliding is None else rows_of(sliding))]
    friction = max(m.chain.tendon.friction for m in models)
    if sliding is None:
        refuse_friction(friction, 'a batch without sliding')
    sizes = {'arms': len(models), 'starts': len(starts), 'pairs of pulls': len(wanted),
             'soft masks': len(masks), 'rows of vacuum': len(parts),
             'pairs of sliding': len(slides)}
    count = common_count(sizes)
    if len({(m.chain.segments, m.chain.joints) for m in models}) != 1:
        raise ValueError('the arms of a batch need the same number of segments and bodies')

    kinds = count if max(len(models), len(starts), len(masks), len(parts)) > 1 else 1
    problems = [models[i % len(models)].problem(
        starts[i % len(starts)], masks[i % len(masks)], np.zeros(2), parts[i % len(parts)])
        for i in range(kinds)]
    wanted = np.broadcast_to(wanted, (count, 2))
    straight = np.array([m.chain.straight_length for m in models])[:, None]
    target = straight - wanted
    theta = np.broadcast_to(np.cumsum([s.joint_angles for s in starts], axis=1),
                            (count, models[0].chain.joints)).copy()
    tension = np.broadcast_to(np.nan_to_num([s.tensions for s in starts]), (count, 2)).copy()
    lengths, residual = np.full((count, 2), np.nan), np.full(count, np.nan)
    found = np.zeros(count, dtype=bool)

    tables = problems[0].system.tables
    alike = np.array([p.groups > 0 and np.array_equal(p.system.tables, tables) for p in problems])
    rubs = np.any(slides, axis=1) & (friction > 0.0)
    rows = np.flatnonzero(np.broadcast_to(alike, count) & ~np.broadcast_to(rubs, count))
    if rows.size:
        theta[rows], tension[rows], lengths[rows], residual[rows], found[rows] = _full_steps(
            _chosen(models, rows), _chosen(problems, rows), theta[rows], tension[rows],
            target[rows])

    def state(i: int) -> Equilibrium:
        if i in alone:
            return alone[i]
        problem = problems[i % kinds]
        return models[i % len(models)].continuation.result(
            Point(theta[i], tension[i], lengths[i], residual=residual[i]),
            problem._replace(drive=problem.drive._replace(target=target[i])))

    alone: dict[int, Equilibrium] = {}
    batch = Batch(
        np.diff(theta, axis=1, prepend=0.0), tension, straight - lengths,
        np.where(tension > 0.0, 0.0, np.maximum(target - lengths, 0.0)), found,
        np.zeros(count, dtype=bool), residual, models, state)
    for i in np.flatnonzero(~found).tolist():
        try:
            alone[i] = models[i % len(models)].solve(
                starts[i % len(starts)], wanted[i], masks[i % len(masks)],
                vacuum=parts[i % len(parts)], sliding=slides[i % len(slides)])
            _write(batch, i, alone[i])
        except StaticsError:
            for array in (batch.joint_angles, tension, batch.pulls, batch.slack, residual):
                array[i] = np.nan
    return batch


def solve_path(statics: Statics, start: Equilibrium, pulls: ArrayLike, soft: Masks, *,
               vacuum: Parts | None = None,
               sliding: Sequence[int] | Sequence[Sequence[int]] = (0, 0)) -> Batch:
    """
    Return the equilibria along a path of pulls, each followed from the one before it.

    pulls: (m, 2) m.  soft: one mask, or m of them; vacuum and sliding likewise.  Otherwise as
    Statics.solve.  Raises StaticsError, which names the row, where the path ends before its end;
    ValueError when sizes do not fit together.
    """
    wanted, masks, slides = _pairs(pulls), rows_of(soft), rows_of(sliding)
    parts = [None] if vacuum is None else rows_of(vacuum)
    if any(len(rows) not in (1, len(wanted)) for rows in (masks, parts, slides)):
        raise ValueError(
            f'{len(wanted)} pairs of pulls need one soft mask, row of vacuum and pair of sliding, '
            f'or as many; given: {len(masks)}, {len(parts)} and {len(slides)}')
    states: list[Equilibrium] = []
    for i, pair in enumerate(wanted):
        try:
            start = statics.solve(start, pair, masks[i % len(masks)],
                                  vacuum=parts[i % len(parts)], sliding=slides[i % len(slides)])
        except StaticsError as error:
            raise type(error)(f'row {i} of {len(wanted)}: {error}', error.state) from None
        states.append(start)
    return Batch(
        np.array([s.joint_angles for s in states]), np.array([s.tensions for s in states]),
        np.array([s.pulls for s in states]), np.array([s.slack for s in states]),
        np.ones(len(states), dtype=bool), np.array([s.jumped for s in states]),
        np.array([s.residual for s in states]), [statics], states.__getitem__)


def _pairs(pulls: ArrayLike) -> Array:
    wanted = np.atleast_2d(real_array(pulls, 'pulls must be numbers in m'))
    if wanted.ndim != 2 or wanted.shape[1] != 2 or not np.all(wanted < np.inf):
        raise ValueError('pulls must have shape (m, 2): right and left in m, without nan or inf')
    return wanted


def _chosen(values: Sequence[Kind], rows: NDArray[np.intp]) -> Sequence[Kind]:
    """Return what belongs to the rows, of one value for all or one for each."""
    return values if len(values) == 1 else [values[i] for i in rows]


def _write(batch: Batch, i: int, state: Equilibrium) -> None:
    """Write an equilibrium into its row."""
    batch.joint_angles[i], batch.tensions[i] = state.joint_angles, state.tensions
    batch.pulls[i], batch.slack[i] = state.pulls, state.slack
    batch.residual[i], batch.found[i], batch.jumped[i] = state.residual, True, state.jumped


def _full_steps(models: Sequence[Statics], problems: Sequence[Problem], theta: Array,
                tension: Array, target: Array
                ) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
    """Return where full steps end: angles, tensions, lengths, residual, whether to be accepted."""
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
