# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Costs and limits of plans by tip, and the budget of a search."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from time import monotonic

from soft_continuum.sequencing.plans import PlanError


@dataclass(frozen=True)
class ReachSettings:
    """
    Limits, costs and budget of a search.

    margin: m that the arm stays away from every obstacle.  lock_in: rad by which a segment may
    bend when it is stiffened, which needs extra clearance.  softening_time: s that it takes to
    soften a segment and to stiffen it again.  states: largest number that a search evaluates.
    time_limit: of a search, s.  max_softenings: of one plan.
    weights: None for fewest softenings, then least time, then least tension; or what a softening,
    a second and a newton cost.  seed: of random candidates; plans of one seed are the same on
    every machine, unless time_limit ends the search.
    """

    margin: float = 0.005
    lock_in: float = 0.006
    softening_time: float = 4.0
    states: int = 10_000
    time_limit: float = 120.0
    max_softenings: int = 6
    weights: tuple[float, float, float] | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse invalid numbers; raises PlanError."""
        for name, low in (('margin', 0.0), ('lock_in', 0.0), ('softening_time', 0.0),
                          ('states', 0), ('time_limit', 0.0)):
            value = getattr(self, name)
            if not value >= low or (name != 'time_limit' and not isfinite(value)):
                raise PlanError(f'{name} is {value}; allowed: {low:g} and more')
        if self.max_softenings < 1:
            raise PlanError(f'max_softenings is {self.max_softenings}; allowed: 1 and more')
        weights: Sequence[float] = self.weights or ()
        if self.weights is not None and (
                len(weights) != 3 or not all(isfinite(w) and w >= 0.0 for w in weights)
                or not any(weights)):
            raise PlanError(f'weights are {self.weights}; needed: what a softening, a second and '
                            'a newton cost, none below 0 and one above')


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
