# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Many equilibria of spatial arms in one call: independent ones on all cores, or along a path."""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics._batches import common_count, in_parts, Masks, rows_of, Solutions
from soft_continuum.mechanics._checks import listed, pulls_of, tensions_of
from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.mechanics.spatial._laws import HELD
from soft_continuum.mechanics.spatial.chain import SpatialEquilibrium
from soft_continuum.mechanics.spatial.orientations import bending_between
from soft_continuum.mechanics.spatial.statics import (
    driven,
    LOCKED_TOLERANCE,
    Locks,
    slack_of,
    SpatialStatics,
)


@dataclass(frozen=True, eq=False)
class SpatialBatch(Solutions):
    """
    Equilibria of m problems, as arrays and, by index, one by one.

    rotations: (m, bodies, 3, 3).  tensions, pulls, slack: (m, tendons) N and m, as in
    SpatialEquilibrium.  tips: (m, 3) m.  bending: (m, segments, 2) rad.  found: (m,) whether there
    is one; the other rows are nan, and their index raises LookupError.  jumped: (m,).
    """

    rotations: Array
    tensions: Array
    pulls: Array
    slack: Array
    tips: Array
    bending: Array
    found: NDArray[np.bool_]
    jumped: NDArray[np.bool_]
    _state: Callable[[int], SpatialEquilibrium | None] = field(repr=False)


def solve_batch(arms: SpatialStatics | Sequence[SpatialStatics],
                start: SpatialEquilibrium | Sequence[SpatialEquilibrium], pulls: ArrayLike,
                soft: Masks, *, tensions: ArrayLike | None = None) -> SpatialBatch:
    """
    Solve many independent problems on all cores.

    Each of these is one for all problems or one for each: arms, with the same number of segments,
    bodies and tendons; start, the state that a problem is followed from; pulls, (tendons,) or
    (m, tendons), m; soft, a mask or m of them; tensions, as pulls.  All are as in
    SpatialStatics.solve.  Problems whose joints yield, whose start does not balance, or without a
    soft segment are solved one by one.  Raises ValueError when sizes do not fit together.
    """
    models = [arms] if isinstance(arms, SpatialStatics) else listed(arms)
    starts = [start] if isinstance(start, SpatialEquilibrium) else listed(start)
    if not (models and all(isinstance(m, SpatialStatics) for m in models)):
        raise ValueError('arms must be a SpatialStatics, or one for each problem; given: '
                         f'{arms!r}')
    if not (starts and all(isinstance(s, SpatialEquilibrium) for s in starts)):
        raise ValueError('the start must be a SpatialEquilibrium, or one for each problem; given: '
                         f'{start!r}')
    wanted, masks, given = rows_of(pulls), rows_of(soft), rows_of(tensions)
    sizes = {'arms': len(models), 'starts': len(starts), 'rows of pulls': len(wanted),
             'soft masks': len(masks), 'rows of tensions': len(given)}
    count = common_count(sizes)
    if len({(m.chain.segments, m.chain.bodies, len(m.chain.arm.tendons)) for m in models}) != 1:
        raise ValueError('the arms of a batch need the same number of segments, bodies and '
                         'tendons')
    tendons = len(models[0].chain.arm.tendons)
    pull_rows = np.array([pulls_of(row, tendons) for row in wanted])
    tension_rows = np.array([
        np.full(tendons, np.nan) if row is None else tensions_of(row, tendons, optional=True)
        for row in given])
    pull_rows, tension_rows = (
        np.broadcast_to(rows, (count, tendons)) for rows in (pull_rows, tension_rows))
    problems: dict[tuple[int, int, int], _Problem] = {}
    alike: dict[Hashable, tuple[list[int], list[_Problem]]] = {}
    for i in range(count):
        which = i % len(models), i % len(starts), i % len(masks)
        if which not in problems:
            problems[which] = _problem(models[which[0]], starts[which[1]], masks[which[2]])
        rows, each = alike.setdefault(problems[which].kind, ([], []))
        rows.append(i)
        each.append(problems[which])
    states: list[SpatialEquilibrium | None] = [None] * count
    for kind, (rows, each) in alike.items():
        if kind is not None:
            found = _follow(each[:1] if len(problems) == 1 else each, pull_rows[rows],
                            tension_rows[rows])
            for i, state in zip(rows, found, strict=True):
                states[i] = state
    for i in [i for i, state in enumerate(states) if state is None]:
        try:
            states[i] = models[i % len(models)].solve(
                starts[i % len(starts)], wanted[i % len(wanted)], masks[i % len(masks)],
                tensions=given[i % len(given)])
        except StaticsError:
            continue
    return _batch([models[0]] if len(models) == 1 else models, states)


class _Problem(NamedTuple):
    """
    An arm, a state of it with the segments that are stiff from now on, and what those lock.

    kind: the same of problems that one compiled call solves; None of those solved one by one.
    """

    model: SpatialStatics
    start: SpatialEquilibrium
    locks: Locks
    kind: Hashable


def _problem(model: SpatialStatics, start: SpatialEquilibrium, soft: Any) -> _Problem:
    start, locks = model.begin(start, soft)
    _, tendons, begins, bodies, _ = model.chain.layout[3]
    kind = None if locks.yields or not locks.free.any() else tuple(
        each.tobytes() for each in (locks.link, tendons, begins, bodies, model.chain.laws.tables))
    return _Problem(model, start, locks, kind)


def _follow(problems: Sequence[_Problem], pulls: Array, tensions: Array
            ) -> list[SpatialEquilibrium | None]:
    """
    Return the equilibria of problems of one kind, None for those that are to be solved alone.

    problems: one for all, or one for each.  pulls, tensions: (m, tendons) m and N, as of a solve.
    """
    count, tendons = pulls.shape
    models = [problem.model for problem in problems]
    starts = [problem.start for problem in problems]
    locks = [problem.locks for problem in problems]
    layouts = [model.chain.layout for model in models]
    lengths, forces, torques, straight, nudge = (
        np.array([layout[i] for layout in layouts]) for i in (0, 1, 2, 4, 5))
    routing = [layout[3] for layout in layouts]
    rotations, before, slack, carried = (
        np.array([getattr(start, name) for start in starts])
        for name in ('rotations', 'pulls', 'slack', 'tensions'))
    joints = np.array([each.joints for each in locks])
    for each, start, one in zip(joints, starts, locks, strict=False):
        each[:, HELD] = start.held[one.free]
    compliance = np.array([model.compliance for model in models])
    by_force, goal = driven(pulls, tensions)

    tension = np.empty((count, 2, tendons))
    tension[:] = np.nan_to_num(carried)[:, None]
    targets = np.empty((count, 4, tendons))
    targets[:, 1] = goal
    bodies = np.empty((count, *rotations.shape[1:]))
    done, residual = np.empty(count), np.empty(count)
    total, rests = np.empty(count, np.int64), np.empty(count, bool)
    in_parts(partial(
        _kernel.functions().spatial_follow_batch, (rotations, before, slack),
        (lengths, forces, torques,
         (np.array([r[0] for r in routing]), *routing[0][1:4], np.array([r[4] for r in routing])),
         straight, nudge),
        (locks[0].link, joints, models[0].chain.laws.tables,
         np.ones(len(models[0].chain.span_tendons))),
        (tension, tension > 0.0, bodies), (by_force.astype(np.int64), compliance, targets),
        np.array([one.direct for one in locks]), (done, total, residual, rests)), count)

    short = np.where(by_force | (compliance > 0.0) | ~np.array([one.still for one in locks]), 0.0,
                     goal - before)
    rests &= (done >= 0.0) & (short.max(axis=1, initial=0.0) <= LOCKED_TOLERANCE)
    ends = straight - targets[:, 3]
    loose = slack_of(ends, goal, compliance, tension[:, 0], by_force)
    return [SpatialEquilibrium(
        bodies[i], tension[i, 0], ends[i], loose[i], float(residual[i]), int(total[i]),
        start.stiff, start.held, bool(done[i] < 1.0), start.vacuum, chain=start.chain)
        if rests[i] else None
        for i in range(count) for start in [starts[i % len(starts)]]]


def solve_path(statics: SpatialStatics, start: SpatialEquilibrium, pulls: ArrayLike, soft: Masks,
               *, tensions: ArrayLike | None = None) -> SpatialBatch:
    """
    Return the equilibria along a path of pulls, each followed from the one before it.

    pulls: (m, tendons) m.  soft: one mask, or m of them; tensions: none, (tendons,) or
    (m, tendons).  Otherwise as SpatialStatics.solve.  Raises StaticsError, which names the row,
    where the path ends before its end; ValueError when sizes do not fit together.
    """
    wanted, masks, given = rows_of(pulls), rows_of(soft), rows_of(tensions)
    if any(len(rows) not in (1, len(wanted)) for rows in (masks, given)):
        raise ValueError(
            f'{len(wanted)} rows of pulls need one soft mask and row of tensions, or as many; '
            f'given: {len(masks)} and {len(given)}')
    states: list[SpatialEquilibrium | None] = []
    for i, row in enumerate(wanted):
        try:
            start = statics.solve(start, row, masks[i % len(masks)],
                                  tensions=given[i % len(given)])
        except StaticsError as error:
            raise type(error)(f'row {i} of {len(wanted)}: {error}', error.state) from None
        states.append(start)
    return _batch([statics], states)


def _batch(models: Sequence[SpatialStatics], states: Sequence[SpatialEquilibrium | None]
           ) -> SpatialBatch:
    """models: one for all states, or one for each."""
    chain = models[0].chain
    tendons = len(chain.arm.tendons)

    def each(name: str, *shape: int) -> Array:
        missing = np.full(shape, np.nan)
        rows = [missing if state is None else getattr(state, name) for state in states]
        return np.array(rows).reshape(len(states), *shape)

    rotations = each('rotations', chain.bodies, 3, 3)
    lengths = np.array([model.chain.lengths for model in models])
    tips = np.einsum('mb,mbi->mi', np.broadcast_to(lengths, rotations.shape[:2]),
                     rotations[..., 2])
    tips[:, 2] += [model.chain.arm.discs[0].height for model in models]
    discs = np.empty((len(states), chain.segments + 1, 3, 3))
    discs[:, 0], discs[:, 1:] = np.eye(3), rotations[:, chain.last_body]
    return SpatialBatch(
        rotations, each('tensions', tendons), each('pulls', tendons), each('slack', tendons), tips,
        bending_between(discs),
        np.array([state is not None for state in states], dtype=bool),
        np.array([state is not None and state.jumped for state in states], dtype=bool),
        states.__getitem__)
