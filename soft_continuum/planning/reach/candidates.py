# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Sequences of settings that reach the goal by constant curvature, the most promising first.

The last settings of a sequence, as many as the goal determines, are fitted to it, and the one
before them takes values from a grid.  Longer sequences are too many: they are drawn at random,
with a known end and earlier settings from the grid.  A segment may be set twice.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations, product
from math import ceil

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.planning.planner import PlanSettings
from soft_continuum.planning.plans import WHOLE_ARM
from soft_continuum.planning.reach.arcs import Arcs, size, TipResidual

AXIS_VALUES = 17  # bendings of a segment about its only axis, between its limits
RINGS, SPOKES = (0.35, 0.7, 1.0), 8  # of one that bends to all sides: parts of its limit, ways
WHOLE_VALUES = 60  # shapes of an arm without jamming
STARTS, FEW_STARTS = 24, 3  # shapes that fits in space begin at; the latter after given settings
NEAR, NEAR_TURN = 0.01, 0.1  # m, rad: what arcs reach so nearly may be reached by the statics
SAME_SHAPE = 0.02  # rad: shapes that differ by less are one
CHUNK, CHUNKS = 100, 400  # sequences drawn at a time, and how often
PEAK = 15 / 8  # of the speed of a minimum-jerk motion over the mean
NUMBERS = {'position': (2, 3), 'direction': (3, 5), 'pose': (3, 6)}
"""Number of components that a goal determines, for planar and for spatial tips."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """
    A sequence of settings and its estimated cost.

    movers: the segments (0-based), or WHOLE_ARM, that are set.  shapes: (movers + 1, segments, 2)
    rad, the bending before, and after each.  fitted: how many of the last were fitted to the goal.
    seconds: of motion.  near: error of the tip, relative to the tolerances of the goal.
    """

    movers: tuple[int, ...]
    shapes: Array
    fitted: int
    seconds: float
    near: float


class Candidates:
    """Candidates for one goal from one shape."""

    def __init__(self, arcs: Arcs, settings: PlanSettings, miss: TipResidual, start: Array,
                 draw: np.random.Generator) -> None:
        """Take the arm, the limits of its motions, the goal, and the bending at present, rad."""
        self.arcs, self.miss, self.start, self.draw = arcs, miss, start, draw
        segments = len(arcs.limits)
        self.movers = tuple(range(segments)) if settings.jamming else (WHOLE_ARM,)
        self._pace = PEAK * np.array(
            [max(arcs.chain.disc_radii)] * segments) / settings.speed  # s per rad
        numbers = NUMBERS[miss.goal.kind][arcs.dimensions - 1]
        each = min(len(arcs.columns([mover])) for mover in self.movers) or 1
        self._grid = {mover: self._values(mover) for mover in self.movers}
        self._ends: list[Array] = []  # shapes whose tip is at the goal
        self.determining = min(len(self.movers), ceil(numbers / each))

    def of(self, count: int) -> Iterator[list[Candidate]]:
        """Yield candidates of so many settings in parts, the best ones of each part first."""
        last = min(count, self.determining)
        first = count - last
        if first == 0:
            yield self._ended([((), self.start[None])], last, STARTS)
        elif first == 1:
            yield self._ended(
                [((mover,), np.stack([self.start, self._set(self.start, mover, value)]))
                 for mover in self.movers for value in self._grid[mover]], last, FEW_STARTS)
        else:
            for _ in range(CHUNKS * bool(self._ends)):
                yield [self._drawn(count) for _ in range(CHUNK)]

    def nearest(self) -> list[Candidate]:
        """Return the nearest candidates that set each segment once, whether they arrive or not."""
        every = len(self.movers)
        found = self._ended([((), self.start[None])], every, 4 * STARTS, np.inf)
        return sorted(found, key=lambda one: (round(one.near, 1), one.seconds))

    def beside(self, best: Candidate, width: float) -> list[Candidate]:
        """Return candidates whose first settings and initial shapes are near to others, rad."""
        first = len(best.movers) - best.fitted
        shapes = best.shapes[:first + 1].copy()
        for k, mover in enumerate(best.movers[:first]):
            aside = best.shapes[k + 1] + width * self.draw.normal(size=self.start.shape)
            shapes[k + 1] = self._set(shapes[k], mover, self.arcs.within(aside))
        seed = best.shapes[-1] + width * self.draw.normal(size=self.start.shape)
        last = best.movers[first:]
        rows = self._set(shapes[-1], last, self.arcs.within(seed))[None]
        bent, left = self.arcs.fit(rows, last, self.miss)
        return self._kept([(best.movers[:first], shapes)], [last], [0], bent, left, NEAR)

    def _values(self, mover: int) -> Array:
        """Return bendings of all segments, of which those of the mover count, (n, ...) rad."""
        limits = self.arcs.limits
        if mover == WHOLE_ARM:
            return self.arcs.drawn(self.draw, WHOLE_VALUES)
        if not (axes := self.arcs.free[mover]).all():
            return np.asarray(np.linspace(-limits, limits, AXIS_VALUES)[..., None] * axes)
        ways = 2.0 * np.pi * np.arange(SPOKES) / SPOKES
        return np.array([np.zeros_like(self.start), *(
            bending_vectors(self.arcs.arm, ring * limits, np.full(len(limits), way))  # type: ignore[arg-type]
            for ring in RINGS for way in ways)])

    def _set(self, shape: Array, movers: int | Sequence[int], values: Array) -> Array:
        """Return a shape of which movers take other values."""
        some = self.arcs.columns([movers] if isinstance(movers, int) else movers)
        there = shape.copy().reshape(-1)
        there[some] = values.reshape(-1)[some]
        return there.reshape(shape.shape)

    def _drawn(self, count: int) -> Candidate:
        """Return that many settings by chance, the last ones of which lead to a known end."""
        movers: list[int] = []
        while len(movers) < count:  # backwards; those fitted are different ones
            near = movers[-1:] if len(movers) >= self.determining else movers
            others = [m for m in self.movers if len(self.movers) == 1 or m not in near]
            movers.append(others[self.draw.integers(len(others))])
        movers.reverse()
        end = self._ends[self.draw.integers(len(self._ends))]
        shapes = [self.start]
        for k, mover in enumerate(movers):
            values = end
            if mover in movers[k + 1:]:
                some = self._grid[mover]
                values = some[self.draw.integers(len(some))]
            shapes.append(self._set(shapes[-1], mover, values))
        return Candidate(tuple(movers), np.array(shapes), self.determining,
                         self._seconds(np.array(shapes)), 0.0)

    def _ended(self, first: Sequence[tuple[tuple[int, ...], Array]], last: int, starts: int,
               near: float = NEAR) -> list[Candidate]:
        """Return first settings with last ones that are fitted to the goal, the best first."""
        found: list[Candidate] = []
        for group in combinations(self.movers, last):
            seeds = self._seeds(group, starts)
            rows = np.array([self._set(shapes[-1], group, seed)
                             for _, shapes in first for seed in (shapes[-1], *seeds)])
            bent, left = self.arcs.fit(rows, group, self.miss)
            which = np.repeat(np.arange(len(first)), len(seeds) + 1).tolist()
            found += self._kept(first, list(permutations(group)), which, bent, left, near)
        return sorted(found, key=lambda one: (one.near > 1.0, one.seconds))

    def _seeds(self, group: Sequence[int], starts: int) -> Array:
        """Return shapes that fits begin at, (n, ...) rad."""
        some, axes = list(group), self.arcs.free[list(group)]
        if WHOLE_ARM in group or axes.all(axis=1).any():
            return self.arcs.drawn(self.draw, starts)
        signs = np.array(list(product((-0.5, 0.5), repeat=len(group))))
        seeds = np.zeros((len(signs), *self.start.shape))
        seeds[:, some] = (signs * self.arcs.limits[some])[..., None] * axes
        return seeds

    def _kept(self, first: Sequence[tuple[tuple[int, ...], Array]],
              orders: Sequence[tuple[int, ...]], which: Sequence[int], bent: Array, left: Array,
              near: float) -> list[Candidate]:
        """Return what arrives, each shape once, in all orders."""
        goal = self.miss.goal
        away = np.linalg.norm(left[:, :3], axis=1) * goal.position_tolerance
        turn = np.linalg.norm(left[:, 3:], axis=1) * goal.angle_tolerance
        arrives = near == np.inf or (away <= near + goal.position_tolerance) & (
            turn <= NEAR_TURN + goal.angle_tolerance)
        parts = size(left)
        seen, found = set(), []
        for row in np.flatnonzero(np.broadcast_to(arrives, away.shape)).tolist():
            key = (which[row], *np.rint(bent[row].ravel() / SAME_SHAPE).astype(int).tolist())
            if key in seen:
                continue
            seen.add(key)
            self._ends.append(bent[row])
            movers, shapes = first[which[row]]
            for order in orders:
                if movers and movers[-1] == order[0] != WHOLE_ARM:
                    continue
                after = [*shapes]
                for mover in order:
                    after.append(self._set(after[-1], mover, bent[row]))
                way = np.array(after)
                found.append(Candidate((*movers, *order), way, len(order), self._seconds(way),
                                       float(parts[row])))
        return found

    def _seconds(self, shapes: Array) -> float:
        turns = np.diff(shapes, axis=0).reshape(len(shapes) - 1, len(self._pace), -1)
        return float((np.linalg.norm(turns, axis=2) @ self._pace).sum())
