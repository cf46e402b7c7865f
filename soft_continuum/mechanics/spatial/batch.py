# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Many equilibria of spatial arms in one call: independent ones, or one after the other on a path.

They are solved one by one: much of a solve is Python, which threads do not share.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics._batches import common_count, Masks, rows_of, Solutions
from soft_continuum.mechanics._checks import listed
from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.mechanics.spatial.chain import SpatialEquilibrium
from soft_continuum.mechanics.spatial.statics import SpatialStatics


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
    Solve many independent problems.

    Each of these is one for all problems or one for each: arms, with the same number of segments,
    bodies and tendons; start, the state that a problem is followed from; pulls, (tendons,) or
    (m, tendons), m; soft, a mask or m of them; tensions, as pulls.  All are as in
    SpatialStatics.solve.  Raises ValueError when sizes do not fit together.
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
    states: list[SpatialEquilibrium | None] = []
    for i in range(count):
        try:
            states.append(models[i % len(models)].solve(
                starts[i % len(starts)], wanted[i % len(wanted)], masks[i % len(masks)],
                tensions=given[i % len(given)]))
        except StaticsError:
            states.append(None)
    return _batch(models[0], states)


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
    return _batch(statics, states)


def _batch(statics: SpatialStatics, states: Sequence[SpatialEquilibrium | None]) -> SpatialBatch:
    chain = statics.chain
    tendons = len(chain.arm.tendons)

    def each(name: str, *shape: int) -> Array:
        missing = np.full(shape, np.nan)
        rows = [missing if state is None else getattr(state, name) for state in states]
        return np.array(rows).reshape(len(states), *shape)

    return SpatialBatch(
        each('rotations', chain.bodies, 3, 3), each('tensions', tendons), each('pulls', tendons),
        each('slack', tendons), each('tip', 3), each('bending', chain.segments, 2),
        np.array([state is not None for state in states], dtype=bool),
        np.array([state is not None and state.jumped for state in states], dtype=bool),
        states.__getitem__)
