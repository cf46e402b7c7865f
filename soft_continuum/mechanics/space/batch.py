# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Many equilibria of spatial arms in few compiled calls."""

from collections.abc import Hashable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.batch import Batch, in_parts, Problems
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.space._laws import HELD
from soft_continuum.mechanics.space.chain import Integers
from soft_continuum.mechanics.space.statics import ConstraintState, slack_of, SpaceStatics
from soft_continuum.mechanics.statics import driven, LOCKED_TOLERANCE


def together(given: Problems) -> Batch:
    """
    Return the equilibria found by one compiled call for each kind of problem.

    Not found: problems with yielding joints, with friction of tendons, or without a soft segment.
    """
    models: Sequence[SpaceStatics] = given.models
    starts, masks, parts, count = given.starts, given.masks, given.vacuum, given.count
    tendons, rub = len(models[0].compliance), given.rub
    pulls, tensions = (
        np.broadcast_to(rows, (count, tendons)) for rows in (given.pulls, given.tensions))
    problems: dict[tuple[int, ...], _Problem] = {}
    alike: dict[Hashable, tuple[list[int], list[_Problem]]] = {}
    for i in range(count):
        which = i % len(models), i % len(starts), i % len(masks), i % len(parts)
        if which not in problems:
            model, start, soft, part = which
            problems[which] = _problem(
                models[model], *models[model].begin(starts[start], masks[soft], parts[part]))
        rows, each = alike.setdefault(None if rub[i] else problems[which].kind, ([], []))
        rows.append(i)
        each.append(problems[which])
    states: dict[int, Equilibrium] = {}
    tension, ends, slack = np.full((3, count, tendons), np.nan)
    batch = Batch(
        np.full((count, models[0].chain.bodies, 3, 3), np.nan), tension, ends, slack,
        np.zeros(count, dtype=bool),
        np.zeros(count, dtype=bool), np.full(count, np.nan), models, states.__getitem__)
    for kind, (rows, each) in alike.items():
        if kind is not None:
            _follow(each[:1] if len(problems) == 1 else each, pulls[rows], tensions[rows],
                    np.array(rows), batch, states)
    return batch


class _Problem(NamedTuple):
    """
    An arm, its start with the new stiff segments, and what those lock.

    kind: equal for problems that one compiled call solves; None for those solved one by one.
    """

    model: SpaceStatics
    start: Equilibrium
    locks: ConstraintState
    kind: Hashable


def _problem(model: SpaceStatics, start: Equilibrium, locks: ConstraintState) -> _Problem:
    _, tendons, begins, bodies, _ = model.chain.layout[3]
    kind = None if locks.yields or not locks.free.any() else tuple(
        each.tobytes() for each in (locks.link, tendons, begins, bodies, model.chain.laws.tables))
    return _Problem(model, start, locks, kind)


def _follow(problems: Sequence[_Problem], pulls: Array, tensions: Array, rows: Integers,
            batch: Batch, states: dict[int, Equilibrium]) -> None:
    """
    Solve problems of one kind; write those found into their rows of the batch, and the states.

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
        for name in ('configuration', 'pulls', 'slack', 'tensions'))
    joints = np.array([each.joints for each in locks])
    for each, start, one in zip(joints, starts, locks, strict=False):
        each[:, HELD] = start.held[one.free]
    compliance = np.array([model.compliance for model in models])
    by_force, goal, never = driven(pulls, tensions)

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
    loose[never] = np.inf
    for name, array in (('configurations', bodies), ('tensions', tension[:, 0]), ('pulls', ends),
                        ('slack', loose), ('residual', residual), ('jumped', done < 1.0)):
        getattr(batch, name)[rows[rests]] = array[rests]
    batch.found[rows] = rests
    for i in np.flatnonzero(rests).tolist():
        start = starts[i % len(starts)]
        states[int(rows[i])] = Equilibrium(
            bodies[i], tension[i, 0], ends[i], loose[i], float(residual[i]), int(total[i]),
            start.stiff, start.held, bool(done[i] < 1.0), start.vacuum, chain=start.chain)
