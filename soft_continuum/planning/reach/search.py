# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The search for plans to a tip goal: arcs propose, the statics verify.

Candidates with one softening come first, then those with two, and so on.  Each is evaluated by
constant curvature, then corrected and followed by the statics; common beginnings are evaluated
once.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from math import inf
from time import monotonic
from typing import Any

import numpy as np

from soft_continuum.mechanics import constant_curvature
from soft_continuum.mechanics.arm import Array
from soft_continuum.planning.obstacles import Clearance
from soft_continuum.planning.plans import PlanError, PlanResult, Shape, TipGoal
from soft_continuum.planning.reach.arcs import Arcs, size, TipResidual
from soft_continuum.planning.reach.candidates import Candidate, Candidates
from soft_continuum.planning.reach.passage import (
    BlockedError,
    BodyFrames,
    MotionValidator,
    moved,
    Node,
)

ARC_ERROR = 0.01  # m by which arcs may be nearer to an obstacle than the arm is, at least
ARC_FACTOR = 1.5  # on the error of arcs in one shape: it may be larger in others
PULL_ERROR = 0.003  # m by which tendons of arcs may be pulled in or paid out too far
FINE = 0.004  # m: points of arcs that move by less are not looked at in between
CORRECTIONS = 8  # of bendings, by the statics
AIM = 0.3  # of the tolerances: so near the correction ends
DIVERGED = 3.0  # times what was missed at best: a correction does not come back from there
RANK = 1e-6  # of singular values of a Jacobian: less is nothing
TIME_TOLERANCE = 0.1  # s: durations that differ by less are one, and the tension decides
KEPT = 0.15  # of the budget, to look for the nearest when there is no plan
IMPROVEMENTS = 40  # candidates beside the best that are tried
WIDTHS = (0.3, 0.1, 0.03)  # rad by which they are beside it
NEAREST = 30  # shapes that are tried to come near
NAME = 'tip goal'


def reach(validator: MotionValidator, start: Node, goal: TipGoal) -> Iterator[PlanResult]:
    """
    Yield plans to a goal of the tip, each better than the one before it; the last is the best.

    start: the arm at rest, with all segments stiff if it has jamming.  If no plan is found, one
    Reach has the reason and the nearest plan.  Raises PlanError for an invalid goal, or when the
    plan is abandoned.
    """
    check_goal(validator, goal)
    yield from Search(validator, start, goal).run()


def check_goal(validator: MotionValidator, goal: TipGoal, name: str = 'the tip goal') -> None:
    """Raise PlanError for a goal off the plane of the arm, or in an obstacle."""
    goal.check(validator.planner.statics.chain.arm)
    inside = validator.scene.at(goal.position)
    if inside.distance <= 0.0:
        raise PlanError(f'{name} is in {inside.obstacle}, {-inside.distance * 1e3:.1f} mm deep; '
                        'move one of them')


class Search:
    """A search for plans from a node to one goal."""

    def __init__(self, validator: MotionValidator, start: Node, goal: TipGoal) -> None:
        """Prepare."""
        planner, settings = validator.planner, validator.settings
        self.planner, self.start, self.goal, self.settings = planner, start, goal, settings
        self.budget = Budget((1.0 - KEPT) * settings.states, (1.0 - KEPT) * settings.time_limit)
        self.validator = validator.until(self.budget.judge)
        self.miss = TipResidual(goal)
        self.arcs = Arcs(planner.statics.chain)
        self.bending = np.array(start.state.bending)
        self.candidates = Candidates(self.arcs, planner.settings, self.miss, self.bending,
                                     np.random.default_rng(self.settings.seed))
        self.best: PlanResult | None = None
        self.best_candidate: Candidate | None = None
        self.nearest = self.last = start  # the end of the last plan
        self.blocked: Counter[tuple[str, str]] = Counter()  # obstacle or limit, and how often
        self._arc_error = ARC_ERROR
        self._shapes: dict[bytes, tuple[BodyFrames, Clearance]] = {}
        self._too_far: dict[bytes, bool] = {}
        self._lines: dict[tuple[bytes, bytes], str] = {}
        self._nodes: dict[tuple[bytes, ...], Node | BlockedError] = {}

    def run(self) -> Iterator[PlanResult]:
        """Yield better and better plans."""
        if size(self.miss.of_state(self.start.state)) <= 1.0:
            yield self._result(self.start)
            return
        every = self.candidates.nearest()[:NEAREST]
        if self.start.near.distance < inf:
            self._arc_error = self._found_arc_error(every[0])
        out_of_reach = every[0].near > 1.0
        if out_of_reach:  # of arcs; the statics may differ
            yield from self._tried(iter(every), anyway=True)
        if self.best is not None or not out_of_reach:
            for count in range(1, self.settings.max_softenings + 1):
                if self._bound(count, 0.0) >= self._best_cost():
                    break
                yield from self._tried(c for part in self.candidates.of(count) for c in part)
        self.budget.add(KEPT * self.settings.states, KEPT * self.settings.time_limit)
        if self.best is None and not out_of_reach:
            yield from self._tried(iter(every), anyway=True)
        if self.best is None:
            yield self._nearest(out_of_reach)
        else:
            yield from self._tried(
                c for width in WIDTHS for _ in range(IMPROVEMENTS // len(WIDTHS))
                for c in self.candidates.beside(self._known_best(), width))
            if self.budget.late:
                yield replace(self.best, cut_short=True)

    def _tried(self, candidates: Iterator[Candidate], anyway: bool = False
               ) -> Iterator[PlanResult]:
        """Yield what is better than all before it, until the budget is spent."""
        try:
            while not self.budget.over and (candidate := next(candidates, None)) is not None:
                self.validator.planner.check_wanted()
                if self._bound(len(candidate.movers), candidate.seconds) >= self._best_cost():
                    continue
                if (node := self._ended(candidate, anyway)) is None:
                    continue
                found = self._result(node)
                if self._cost(found) < self._best_cost():
                    self.best, self.best_candidate, self.last = found, candidate, node
                    with self.budget.paused():
                        yield found
        except PlanError:
            self.planner.check_wanted()  # else the budget is spent

    def _ended(self, candidate: Candidate, anyway: bool) -> Node | None:
        """Return where a candidate leads if that is the goal, or note what is in the way."""
        try:
            node = self.planned(candidate, anyway)
            if size(self.miss.of_state(node.state)) <= 1.0:
                return node
            self.blocked['', 'tip'] += 1
        except BlockedError as error:
            self.blocked[error.obstacle, error.limit] += 1
        return None

    def _known_best(self) -> Candidate:
        assert self.best_candidate is not None
        return self.best_candidate

    # What a plan costs.

    def _cost(self, found: PlanResult) -> tuple[float, ...]:
        return self._weighed(found.softenings, found.duration, found.tension)

    def _best_cost(self) -> tuple[float, ...]:
        return (inf,) if self.best is None else self._cost(self.best)

    def _bound(self, softenings: int, seconds: float) -> tuple[float, ...]:
        pause = self.settings.softening_time if self.planner.settings.jamming else 0.0
        return self._weighed(softenings, softenings * pause + seconds, 0.0)

    def _weighed(self, softenings: int, seconds: float, tension: float) -> tuple[float, ...]:
        if not any(self.settings.weights):
            return (softenings, round(seconds / TIME_TOLERANCE), tension)
        one, second, newton = self.settings.weights
        return (one * softenings + second * seconds + newton * tension,)

    # One candidate.

    def planned(self, candidate: Candidate, anyway: bool = False) -> Node:
        """Return the node after the settings of a candidate; anyway: even off the goal."""
        if not anyway:
            self._look(candidate)
        movers, first = candidate.movers, len(candidate.movers) - candidate.fitted
        node, path = self.start, tuple[bytes, ...]()
        for mover, shape in zip(movers[:first], candidate.shapes[1:first + 1], strict=True):
            node, path = self._gone(node, path, mover, shape)
        bending = self._corrected(node, movers[first:], candidate.shapes[-1], anyway)
        for mover in movers[first:]:
            node, path = self._gone(node, path, mover, bending)
        return node

    def _gone(self, node: Node, path: tuple[bytes, ...], mover: int, bending: Array
              ) -> tuple[Node, tuple[bytes, ...]]:
        """Go on from a node, unless it is known where that leads."""
        key = (*path, bytes([mover % 256]) + bending.reshape(-1)[
            self.arcs.columns([mover])].tobytes())
        known = self._nodes.get(key)
        if known is None:
            try:
                known = self.validator.go(node, mover, bending)
                self._note(known)
            except BlockedError as error:
                known = error
            self._nodes[key] = known
        if isinstance(known, BlockedError):
            raise known
        return known, key

    def _corrected(self, node: Node, movers: Sequence[int], bending: Array, anyway: bool) -> Array:
        """
        Return the bending that the statics need so that the tip is at the goal.

        Broyden's method, which begins with the derivatives of arcs.
        """
        columns = self.arcs.columns(movers)
        jacobian = self.arcs.jacobian(bending[None], columns, self.miss)[0]
        states = self._predicted(node, movers, bending)
        left = self.miss.of_state(states[-1])
        best = bending, states, left
        for _ in range(CORRECTIONS):
            if size(left) <= AIM:
                break
            there = bending.copy().reshape(-1)
            there[columns] -= np.linalg.lstsq(jacobian, left, rcond=RANK)[0]
            there = self.arcs.within(there.reshape(bending.shape))
            change = (there - bending).reshape(-1)[columns]
            if not change.any():
                break
            before, bending = left, there
            states = self._predicted(node, movers, bending)
            left = self.miss.of_state(states[-1])
            jacobian = jacobian + np.outer(
                left - before - jacobian @ change, change) / (change @ change)
            if size(left) < size(best[2]):
                best = bending, states, left
            elif size(left) > DIVERGED * size(best[2]):
                break
        bending, states, left = best
        if size(left) > 1.0 and not anyway:
            raise BlockedError('the tip does not get there', limit='tip')
        least = min(self.settings.margin, self.start.near.distance)
        for state in states:
            self.validator.free(state, least)
        return bending

    def _predicted(self, node: Node, movers: Sequence[int], bending: Array) -> list[Any]:
        """Return the states after settings, without the way there."""
        states = [node.state]
        for mover in movers:
            states.append(self.validator.bent(states[-1], mover, bending))
        return states[1:]

    # A look at arcs.

    def _found_arc_error(self, candidate: Candidate) -> float:
        """Return the possible error of the arcs, m, by the statics of one candidate."""
        try:
            state = self._predicted(self.start, candidate.movers, candidate.shapes[-1])[-1]
        except (BlockedError, PlanError):
            return ARC_ERROR
        arcs = self.arcs.chain.uniform(state.bending)
        return max(ARC_ERROR, ARC_FACTOR * moved(state, arcs, 0.0))

    def _look(self, candidate: Candidate) -> None:
        """Raise BlockedError where an obstacle, or the travel, is far in the way of arcs."""
        for shape in candidate.shapes[1:]:
            if self._is_too_far(shape):
                raise BlockedError('the tendons do not go so far', limit='pull_limits')
        if self.start.near.distance == inf:
            return
        shapes = candidate.shapes
        for shape in shapes[:0:-1]:
            self._free(self._shape(shape)[1])
        for one, other in zip(shapes, shapes[1:], strict=False):
            key = one.tobytes(), other.tobytes()
            if key not in self._lines:
                self._lines[key] = self._line(one, other)
            if self._lines[key]:
                raise BlockedError('an obstacle is in the way', self._lines[key])

    def _is_too_far(self, bending: Array) -> bool:
        key = bending.tobytes()
        if key not in self._too_far:
            low, high = self.planner.settings.pull_limits
            pulls = constant_curvature.pulls(self.arcs.arm, bending)
            self._too_far[key] = bool(
                pulls.min() < low - PULL_ERROR or pulls.max() > high + PULL_ERROR)
        return self._too_far[key]

    def _shape(self, bending: Array) -> tuple[BodyFrames, Clearance]:
        key = bending.tobytes()
        if key not in self._shapes:
            self.validator.planner.check_wanted()
            state = self.arcs.chain.uniform(bending)
            self._shapes[key] = (BodyFrames(state.backbone, state.rotations),
                                 self.validator.scene.clearance(state))
        return self._shapes[key]

    def _free(self, near: Clearance) -> None:
        if near.distance < min(self.settings.margin, self.start.near.distance) - self._arc_error:
            raise BlockedError('an obstacle is in the way', near.obstacle)

    def _line(self, one: Array, other: Array) -> str:
        """Return which obstacle is in the way between two shapes; empty for none."""
        (state, near), (there, near_there) = self._shape(one), self._shape(other)
        way = moved(state, there, self.validator.radius)
        least = min(self.settings.margin, self.start.near.distance) - self._arc_error
        if way < FINE or near.distance + near_there.distance - way > 2.0 * least:
            return ''
        middle = 0.5 * (one + other)
        near = self._shape(middle)[1]
        if near.distance < least:
            return near.obstacle
        return self._line(one, middle) or self._line(middle, other)

    # What comes of it.

    def _result(self, node: Node, why: str = '') -> PlanResult:
        state = node.state
        plan = node.plan(Shape(NAME, ()).at(state)) if node.moves or not why else None
        return PlanResult(plan, why, *self.miss.errors(state))

    def _note(self, node: Node) -> None:
        """Keep the node whose tip is nearest to the goal."""
        if size(self.miss.of_state(node.state)) < size(self.miss.of_state(self.nearest.state)):
            self.nearest = node

    def _nearest(self, out_of_reach: bool) -> PlanResult:
        """Return the nearest plan, and why none reaches the goal."""
        self.last = self.nearest
        away, turn = self.miss.errors(self.nearest.state)
        left = self.goal.text(away, turn)
        why = f'the goal is out of reach: the nearest tip found is {left} from it'
        if not out_of_reach:
            why = (f'no plan was found: {self._in_the_way()}; the nearest tip found is {left} '
                   'from the goal')
        why += self.budget.ended_by_time
        names = dict.fromkeys(name for (name, _), _ in self.blocked.most_common() if name)
        return replace(self._result(self.nearest, why), blocked_by=tuple(names),
                       cut_short=self.budget.late)

    def _in_the_way(self) -> str:
        """Return what blocked the candidates, the most frequent first."""
        said = []
        for (obstacle, limit), _ in self.blocked.most_common(3):
            if obstacle:
                said.append(f'{obstacle} is in the way')
            elif limit in ('tension_limit', 'pull_limits', 'bending_angle_limits'):
                said.append(f'{limit} would be exceeded')
            elif limit == 'jump':
                said.append('the arm would snap to another equilibrium')
            elif limit == 'held':
                said.append('the tendons do not hold the arm on the way')
        return ', '.join(dict.fromkeys(said)) or (
            'reach.states was too small')


class Budget:
    """
    The number of states that a search may evaluate, and a time limit.

    Counted in work, a budget is independent of the machine's speed.  A state counts when it is
    solved or evaluated by constant curvature.  states and seconds are totals; ``judged`` counts
    states.  late: whether the time limit ended the search.
    """

    def __init__(self, states: float, seconds: float) -> None:
        """Begin now."""
        self.states, self.judged, self.late = states, 0, False
        self._end = monotonic() + seconds

    def judge(self) -> bool:
        """Count a state; return whether it exceeds the budget."""
        self.judged += 1
        return self.over

    def add(self, states: float, seconds: float) -> None:
        """Allow so much more."""
        self.states += states
        self._end += seconds

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Take no account of the time until the search goes on."""
        begin = monotonic()
        yield
        self._end += monotonic() - begin

    @property
    def over(self) -> bool:
        """Whether the search must end."""
        if monotonic() > self._end:
            self.late = True
        return self.late or self.judged > self.states

    @property
    def ended_by_time(self) -> str:
        """Text if no plan was found within the time limit; otherwise empty."""
        return (f'; reach.time_limit ended the search after {self.judged} of {self.states:.0f} '
                'states: more time may give a plan') if self.late else ''

    @property
    def left(self) -> tuple[float, float]:
        """The states and the seconds that are left."""
        return (max(0.0, self.states - self.judged),
                max(0.0, self._end - monotonic()))
