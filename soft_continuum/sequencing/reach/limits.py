# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a plan by tip may cost, and what the arm must stay clear of."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Protocol

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.sequencing.plans import PlanError


class Distance(Protocol):
    """How near the arm is to what surrounds it."""

    @property
    def distance(self) -> float:
        """To the nearest obstacle, m; negative inside one, inf without any."""

    @property
    def obstacle(self) -> str:
        """Its name; empty without any."""


class CollisionScene(Protocol):
    """
    What the arm must not touch: soft_continuum.obstacles.CollisionScene, or any other.

    The body that it measures is that of the state; distances may be too small, never too large.
    """

    def clearance(self, state: Equilibrium) -> Distance:
        """Return the smallest distance between the arm and an obstacle."""

    def at(self, position: Array) -> Distance:
        """Return how far a point (3,), m, is from the nearest obstacle."""


@dataclass(frozen=True)
class Clear:
    """A distance to an obstacle, m, and its name."""

    distance: float = inf
    obstacle: str = ''


class NoObstacles:
    """A scene without an obstacle."""

    def clearance(self, state: Equilibrium) -> Clear:
        """Return that nothing is near."""
        return Clear()

    def at(self, position: Array) -> Clear:
        """Return that nothing is near."""
        return Clear()


@dataclass(frozen=True)
class ReachSettings:
    """
    What a plan must keep to, what is best, and how long to look for it.

    margin: m that the arm stays away from every obstacle.  lock_in: rad by which a segment may
    bend when it is stiffened: so much clearance is kept besides.  softening_time: s that it takes
    to soften a segment and to stiffen it again.  states: that a search judges at most.
    time_limit: s after which it ends whatever it has judged.  max_softenings: of one plan.
    weights: None for fewest softenings, then least time, then least tension; or what a softening,
    a second and a newton cost.  seed: of all that is drawn; plans of one seed are the
    same on every machine, but for those that time_limit cuts short.
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
        """Refuse numbers that mean nothing; raises PlanError."""
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
