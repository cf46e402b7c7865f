# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Many equilibria in one call: independent ones on all cores, or successive ones on a path."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
import os
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
from soft_continuum.mechanics.chain import check_start, Equilibrium
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.mechanics.statics import Statics

SMALLEST_PART = 50  # problems that a thread takes at a time

Masks = Sequence[bool] | Sequence[Sequence[bool]] | NDArray[np.bool_]
Parts = Sequence[float] | Sequence[Sequence[float]] | Array
Slides = Sequence[int] | Sequence[Sequence[int]]


@dataclass(frozen=True, eq=False)
class Batch(Sequence[Any]):
    """
    Equilibria of m problems, as arrays; an index gives one Equilibrium.

    configurations: (m, ...), tensions, pulls, slack: (m, tendons) N and m, as in Equilibrium.
    found: (m,), whether one was found; other rows are nan, and their index raises LookupError.
    jumped: (m,).  residual: (m,) N m.
    """

    configurations: Array
    tensions: Array
    pulls: Array
    slack: Array
    found: NDArray[np.bool_]
    jumped: NDArray[np.bool_]
    residual: Array
    _models: Sequence[Statics] = field(repr=False)
    _state: Callable[[int], Equilibrium] = field(repr=False)

    def __len__(self) -> int:
        """Return the number of problems."""
        return len(self.found)

    def __getitem__(self, index: Any) -> Any:
        """Return one state, or a list for a slice; raises LookupError where none was found."""
        rows = range(len(self))[index]
        if isinstance(rows, range):
            return [self[i] for i in rows]
        if not self.found[rows]:
            raise LookupError(f'no equilibrium was found for problem {rows}')
        return self._state(rows)

    @property
    def bending(self) -> Array:
        """Bending of each segment about x and y of the disc below it, (m, segments, 2), rad."""
        return self._models[0].chain.bending(self.configurations)

    @property
    def tips(self) -> Array:
        """The centre of the top of the last disc, (m, 3), m."""
        chains = [model.chain for model in self._models]
        axes = chains[0].axes(self.configurations)
        lengths = np.broadcast_to(
            np.array([chain.body_lengths for chain in chains]), axes.shape[:2])
        tips: Array = np.einsum('mb,mbi->mi', lengths, axes)
        tips[:, 2] += [chain.arm.discs[0].height for chain in chains]
        return tips


@dataclass(frozen=True)
class Problems:
    """
    The problems to solve; each field is shared by all or has ``count`` rows.

    pulls, tensions: m and N, as in Statics.solve, the latter with nan.  ways: sliding.  friction:
    the largest coefficient of the tendons.
    """

    models: Sequence[Any]
    starts: Sequence[Equilibrium]
    masks: Sequence[Sequence[bool]]
    pulls: Array
    tensions: Array
    vacuum: Sequence[Sequence[float] | None]
    ways: Sequence[tuple[int, ...]]
    friction: float
    count: int

    @property
    def rub(self) -> NDArray[np.bool_]:
        """Whether tendons slide with friction, (count,)."""
        return np.broadcast_to(np.any(self.ways, axis=1) & (self.friction > 0.0), self.count)

    def solve(self, i: int) -> Equilibrium:
        """Return the equilibrium of one of them; raises what Statics.solve raises."""
        tensions = self.tensions[i % len(self.tensions)]
        found: Equilibrium = self.models[i % len(self.models)].solve(
            self.starts[i % len(self.starts)], self.pulls[i % len(self.pulls)],
            self.masks[i % len(self.masks)],
            tensions=None if np.isnan(tensions).all() else tensions,
            vacuum=self.vacuum[i % len(self.vacuum)], sliding=self.ways[i % len(self.ways)])
        return found


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
                 residual, [statics], states.__getitem__)


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


def in_parts(solve_part: Callable[[int, int], object], count: int) -> None:
    """Call a compiled function for parts of ``count`` problems (first, last), on all cores."""
    workers = len(os.sched_getaffinity(0))
    parts = min(4 * workers, 1 + count // SMALLEST_PART)
    bounds = np.linspace(0, count, parts + 1).astype(int).tolist()
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(solve_part, bounds[:-1], bounds[1:]))
