# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Many equilibria in one call: independent ones on all cores, or successive ones on a path."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics._checks import (
    listed,
    pulls_of,
    sliding_signs,
    tensions_of,
)
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Batch, check_start, Equilibrium
from soft_continuum.mechanics.statics import Problems, Statics, StaticsError

Masks = Sequence[bool] | Sequence[Sequence[bool]] | NDArray[np.bool_]
Parts = Sequence[float] | Sequence[Sequence[float]] | Array
Slides = Sequence[int] | Sequence[Sequence[int]]


def solve_batch(arms: Statics | Sequence[Statics], start: Equilibrium | Sequence[Equilibrium],
                pulls: ArrayLike, soft: Masks, *, tensions: ArrayLike | None = None,
                vacuum: Parts | None = None, sliding: Slides | None = None) -> Batch:
    """
    Solve many independent problems on all cores.

    Each argument is shared by all problems or has one value per problem: arms, with the same
    number of segments, bodies and tendons; start, the initial state; pulls, (tendons,) or
    (m, tendons), m; soft, one mask or m masks; tensions, as pulls; vacuum; sliding, for tendons
    with friction.  All are as in Statics.solve.

    These problems are solved one by one: with friction, without a soft segment, planar ones that
    a full step does not reach, and spatial ones whose joints yield.

    Raises ValueError when sizes do not match, or tendons have friction and ``sliding`` is not
    given.
    """
    models = [arms] if isinstance(arms, Statics) else listed(arms)
    starts = [start] if isinstance(start, Equilibrium) else listed(start)
    if not (models and all(isinstance(m, Statics) for m in models)):
        raise ValueError(f'arms must be a Statics, or one for each problem; given: {arms!r}')
    for one in starts or [start]:
        check_start(one)
    tendons = len(models[0].compliance)
    if len({(type(m), m.chain.segments, m.chain.bodies, len(m.compliance)) for m in models}) != 1:
        raise ValueError('the arms of a batch need the same number of segments, bodies and '
                         'tendons')
    friction = max(t.friction for model in models for t in model.chain.arm.tendons)
    if sliding is None and friction > 0.0:
        raise ValueError('a batch without sliding is frictionless, but the tendons have a '
                         f'coefficient of {friction:g}; leave it out with '
                         'arm.without_friction()')
    masks, parts = rows_of(soft), [None] if vacuum is None else rows_of(vacuum)
    ways = [sliding_signs(each, tendons) for each in rows_of(() if sliding is None else sliding)]
    wanted = pulls_of(pulls, tendons, rows=True)
    given = np.full((1, tendons), np.nan) if tensions is None else tensions_of(
        tensions, tendons, optional=True, rows=True)
    problems = Problems(models, starts, masks, wanted, given, parts, ways, friction, common_count(
        {'arms': len(models), 'starts': len(starts), 'rows of pulls': len(wanted),
         'soft masks': len(masks), 'rows of tensions': len(given), 'rows of vacuum': len(parts),
         'rows of sliding': len(ways)}))
    batch = models[0].solve_together(problems)
    alone: dict[int, Equilibrium] = {}
    for i in np.flatnonzero(~batch.found).tolist():
        try:
            alone[i] = problems.solve(i)
        except StaticsError:
            for array in (batch.configurations, batch.tensions, batch.pulls, batch.slack,
                          batch.residual):
                array[i] = np.nan
        else:
            _write(batch, i, alone[i])
    together = batch._state
    return replace(batch, _state=lambda i: alone[i] if i in alone else together(i))


def solve_path(statics: Statics, start: Equilibrium, pulls: ArrayLike, soft: Masks, *,
               tensions: ArrayLike | None = None, vacuum: Parts | None = None,
               sliding: Slides = ()) -> Batch:
    """
    Return the equilibria along a path of pulls, each solved from the previous one.

    pulls: (m, tendons) m.  soft: one mask or m masks; tensions, vacuum and sliding likewise.
    Otherwise as Statics.solve.  Raises StaticsError, which names the row, where no equilibrium
    is found; ValueError when sizes do not match.
    """
    rows: dict[str, list[Any]] = {
        'rows of pulls': rows_of(pulls), 'soft masks': rows_of(soft),
            'rows of tensions': rows_of(tensions),
            'rows of vacuum': [None] if vacuum is None else rows_of(vacuum),
            'rows of sliding': rows_of(sliding)}
    wanted, masks, given, parts, ways = rows.values()
    if any(len(each) not in (1, len(wanted)) for each in rows.values()):
        raise ValueError('a path needs one value for all rows of pulls, or one per row; given: '
                         + ', '.join(f'{len(each)} {name}' for name, each in rows.items()))
    states: list[Equilibrium] = []
    for i, row in enumerate(wanted):
        try:
            start = statics.solve(
                start, row, masks[i % len(masks)], tensions=given[i % len(given)],
                vacuum=parts[i % len(parts)], sliding=ways[i % len(ways)])
        except StaticsError as error:
            raise type(error)(f'row {i} of {len(wanted)}: {error}', error.state) from None
        states.append(start)
    shapes, tensions, pulls, slack, jumped, residual = (
        np.array([getattr(state, name) for state in states]) for name in (
            'configuration', 'tensions', 'pulls', 'slack', 'jumped', 'residual'))
    return Batch(shapes, tensions, pulls, slack, np.ones(len(states), dtype=bool), jumped,
                 residual, [statics.chain], states.__getitem__)


def _write(batch: Batch, i: int, state: Equilibrium) -> None:
    """Write an equilibrium into its row."""
    batch.configurations[i], batch.tensions[i] = state.configuration, state.tensions
    batch.pulls[i], batch.slack[i] = state.pulls, state.slack
    batch.residual[i], batch.found[i], batch.jumped[i] = state.residual, True, state.jumped


def rows_of(given: Any) -> list[Any]:
    """Return the rows of a list of lists, or one list as the only row."""
    rows = listed(given)
    return rows if rows and isinstance(rows[0], Sequence | np.ndarray) else [given]


def common_count(sizes: Mapping[str, int]) -> int:
    """Return the number of problems; sizes: rows of each argument, 1 if shared."""
    count = max(sizes.values())
    if any(size not in (1, count) for size in sizes.values()):
        raise ValueError(' and '.join(f'{n} {name}' for name, n in sizes.items() if n != 1)
                         + ' do not go together')
    return count
