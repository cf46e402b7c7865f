# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Costs and limits of plans by tip, and the collision scene."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Protocol

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.sequencing.plans import PlanError


class Distance(Protocol):
    """Distance of the arm from the nearest obstacle."""

    @property
    def distance(self) -> float:
        """To the nearest obstacle, m; negative inside one, inf without any."""

    @property
    def obstacle(self) -> str:
        """Its name; empty without any."""


class CollisionScene(Protocol):
    """
    Obstacles of the arm: soft_continuum.obstacles.CollisionScene, or another implementation.

    Distances are from the body in that state; they may be too small, never too large.
    """

    def clearance(self, state: Equilibrium) -> Distance:
        """Return the smallest distance between the arm and an obstacle."""

    def at(self, position: Array) -> Distance:
        """Return the distance of a point (3,), m, from the nearest obstacle."""


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
