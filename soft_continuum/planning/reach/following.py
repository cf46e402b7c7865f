# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Plans that move the tip through several goals.

A segment that stays soft moves the tip along a curve.  So the search looks for shapes from which
one segment alone passes near all goals; otherwise others take over on the way.  The path between
two goals is compared with the straight line between them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import scipy

from soft_continuum.mechanics.arm import Array
from soft_continuum.planning.plans import (
    Move,
    PlanError,
    PlannedStep,
    PlanResult,
    Shape,
    TipGoal,
    WHOLE_ARM,
)
from soft_continuum.planning.reach.arcs import Arcs, TipResidual
from soft_continuum.planning.reach.candidates import Candidate
from soft_continuum.planning.reach.passage import BlockedError, MotionValidator, Node
from soft_continuum.planning.reach.search import Budget, check_goal, NAME, Search

WIDTH = 3  # plans that are carried on from goal to goal
PAIRS = 4  # ways to set two segments that are tried where one does not come near enough
BEGIN_PART = 0.3  # of the budget, to get to the first goal
FIT_STARTS = 2  # shapes that the fit of a whole path begins at
MAX_GOALS = 200
TIPS = 10  # that a fit of a whole path looks at count as one state judged


def follow(validator: MotionValidator, start: Node, goals: Sequence[TipGoal]
           ) -> Iterator[PlanResult]:
    """
    Yield plans through goals of the tip, each better than the one before it; the last is the best.

    The others are those of ``reach``.  tip_error of a plan is the largest distance of the tip from
    the line through the goals, from the first of them on, and of each goal from the tip;
    turn_error that of its orientation at the goals.  Plans are compared by their excess over the
    tolerances, then by softenings, then by duration.  Successive moves of one segment are joined,
    with a short rest at each goal.
    """
    if not 2 <= len(goals) <= MAX_GOALS:
        raise PlanError(f'a path has {len(goals)} goals; allowed: 2 to {MAX_GOALS}')
    for goal in goals:
        check_goal(validator, goal, 'a goal of the path')
    yield from _Following(validator, start, goals).run()


@dataclass(frozen=True, eq=False)
class _Track:
    """A plan up to a goal: errors of its tip, m and rad, and excess over the tolerances."""

    node: Node
    away: float = 0.0
    turn: float = 0.0
    beyond: float = 0.0

    @property
    def cost(self) -> tuple[float, ...]:
        moves, steps = merged_moves(self.node.moves, self.node.steps)
        return (round(self.beyond, 2), len(moves), sum(step.duration for step in steps))


class _Following:
    """One search."""

    def __init__(self, validator: MotionValidator, start: Node, goals: Sequence[TipGoal]) -> None:
        planner, settings = validator.planner, validator.settings
        self.planner, self.start, self.goals, self.settings = planner, start, goals, settings
        self.arcs = Arcs(planner.statics.chain)
        self.budget = Budget(settings.states, settings.time_limit)
        self.validator = validator.until(self.budget.judge)
        self.movers = tuple(range(len(self.arcs.limits))) if planner.settings.jamming else (
            WHOLE_ARM,)

    def run(self) -> Iterator[PlanResult]:
        """Yield better and better plans."""
        settings = self.settings
        search = Search(self.validator.within(BEGIN_PART * settings.states,
                                              BEGIN_PART * settings.time_limit),
                        self.start, self.goals[0])
        for found in search.run():
            if not found.why and found.softenings:
                break
        if found.why:
            yield replace(found, why=f'the first goal of the path: {found.why}')
            return
        best: _Track | None = None
        begins = [search.last]
        for nodes in (begins, self._begins()):
            for track in self._tracks(nodes):
                if best is None or track.cost < best.cost:
                    best = track
                    with self.budget.paused():
                        yield self._result(track)
        late = self.budget.late
        if best is None:
            why = ('the path is blocked or out of reach: found no path from its first goal to its '
                   'last') + self.budget.ended_by_time
            yield PlanResult(None, why, *search.miss.errors(self.start.state), cut_short=late)
        elif late:
            yield replace(self._result(best), cut_short=True)

    def _begins(self) -> Iterator[Node]:
        """Yield nodes at the first goal from which one segment may do it all."""
        if self.movers == (WHOLE_ARM,):
            return
        shapes = [shape for mover in self.movers for shape in self._fitted(mover)]
        for _, shape in sorted(shapes, key=lambda one: one[0]):
            search = Search(self.validator, self.start, self.goals[0])
            for order in permutations(self.movers):
                way = [np.array(self.start.state.bending)]
                for mover in order:
                    way.append(way[-1].copy())
                    way[-1][mover] = shape[mover]
                try:
                    yield search.planned(Candidate(order, np.array(way), len(order), 0.0, 0.0))
                    break
                except BlockedError:
                    continue

    def _fitted(self, mover: int) -> list[tuple[float, Array]]:
        """Return shapes from which a segment passes near all goals, and the remaining errors."""
        arcs, goals = self.arcs, [TipResidual(goal) for goal in self.goals]
        own = arcs.columns([mover])
        others = np.setdiff1d(arcs.columns(self.movers), own)

        def shapes(values: Array) -> Array:
            rows = np.zeros((len(goals), arcs.free.size))
            rows[:, others] = values[:len(others)]
            rows[:, own] = values[len(others):].reshape(len(goals), -1)
            return arcs.within(rows.reshape(len(goals), *arcs.free.shape))

        def missed(values: Array) -> Array:
            for _ in range(1 + len(goals) // TIPS):
                self.validator.planner.check_wanted()
            places, turns = arcs.tips(shapes(values))
            return np.concatenate([goal.of(place[None], turn[None])[0] for goal, place, turn in
                                   zip(goals, places, turns, strict=True)])

        found = []
        begins = arcs.drawn(np.random.default_rng(self.settings.seed), FIT_STARTS)
        for begin in (np.array(self.start.state.bending), *begins):
            flat = begin.reshape(-1)
            fit = scipy.optimize.least_squares(missed, np.concatenate(
                [flat[others], np.tile(flat[own], len(goals))]), max_nfev=40, x_scale=0.1)
            found.append((float(fit.cost), shapes(fit.x)[0]))
        return sorted(found, key=lambda one: one[0])[:1]

    def _tracks(self, nodes: Sequence[Node] | Iterator[Node]) -> Iterator[_Track]:
        """Yield where each of some nodes at the first goal leads."""
        try:
            for node in nodes:
                tracks = [self._seen(_Track(self.start), node, 0)]
                for number in range(1, len(self.goals)):
                    after = [one for track in tracks for one in self._next(track, number)]
                    tracks = sorted(after, key=lambda one: one.cost)[:WIDTH]
                yield from tracks[:1]
        except PlanError:
            self.planner.check_wanted()  # else the budget is spent

    def _next(self, track: _Track, number: int) -> list[_Track]:
        """Return what leads from a track to the next goal."""
        search = Search(self.validator, track.node, self.goals[number])
        present = track.node.state.bending
        found = []

        def note(candidate: Candidate) -> None:
            try:
                found.append(self._seen(track, search.planned(candidate, anyway=True), number))
            except BlockedError:
                return

        for mover in self.movers:
            bent, _ = self.arcs.fit(present[None], [mover], search.miss)
            note(Candidate((mover,), np.stack([present, bent[0]]), 1, 0.0, 0.0))
        room = self.settings.max_softenings - len(
            merged_moves(track.node.moves, track.node.steps)[0])
        if room > 1 and not any(one.beyond <= track.beyond for one in found):
            pairs = [c for part in search.candidates.of(2) for c in part]
            for candidate in sorted(pairs, key=lambda one: one.seconds)[:PAIRS]:
                note(candidate)
        return [one for one in found if one.cost[1] <= self.settings.max_softenings]

    def _seen(self, track: _Track, node: Node, number: int) -> _Track:
        """Return a track that goes on to a node, at a goal of that number."""
        goal = self.goals[number]
        away, turn = TipResidual(goal).errors(node.state)
        if number:
            tips = np.array([state.backbone[-1] for step in node.steps[len(track.node.steps):]
                             for state in step.states])
            away = max(away, _farthest(tips, self.goals[number - 1].position, goal.position))
        beyond = max(away / goal.position_tolerance, turn / goal.angle_tolerance) - 1.0
        return _Track(node, max(track.away, away), max(track.turn, turn),
                      max(track.beyond, beyond, 0.0))

    def _result(self, track: _Track) -> PlanResult:
        moves, steps = merged_moves(track.node.moves, track.node.steps)
        why = ''
        if track.beyond > 0.0:
            why = ('the path is followed within '
                   f'{self.goals[0].text(track.away, track.turn)} at best, which is more than its '
                   'tolerances')
        node = replace(track.node, moves=moves, steps=steps)
        return PlanResult(node.plan(Shape(NAME, ()).at(node.state)), why, track.away, track.turn)


def _farthest(points: Array, one: Array, other: Array) -> float:
    """Return the largest distance of points (m, 3) from the line between two others, m."""
    along = other - one
    part = np.clip((points - one) @ along / max(float(along @ along), 1e-18), 0.0, 1.0)
    return float(np.linalg.norm(points - one - part[:, None] * along, axis=1).max(initial=0.0))


def merged_moves(moves: Sequence[Move], steps: Sequence[PlannedStep]
                 ) -> tuple[tuple[Move, ...], tuple[PlannedStep, ...]]:
    """Return moves and their steps, those after another of the same segment as one with it."""
    some: list[Move] = []
    seen: list[PlannedStep] = []
    for move, step in zip(moves, steps, strict=True):
        if not some or some[-1].segment != move.segment:
            some.append(move)
            seen.append(step)
            continue
        before = some[-1]
        pause = step.duration - move.duration
        some[-1] = replace(
            move, times=np.concatenate([before.times, before.duration + move.times[1:]]),
            pulls=np.concatenate([before.pulls, move.pulls[1:]]),
            largest_tension=max(before.largest_tension, move.largest_tension))
        seen[-1] = seen[-1].then(step, pause)
    return tuple(some), tuple(seen)
