# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where the tip shall be, what a plan to it may cost, and what the arm must stay clear of."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, inf, isfinite, pi, radians
from typing import Literal, Protocol

import numpy as np

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.sequencing.planner import PlanError

Kind = Literal['position', 'direction', 'pose']
KINDS: tuple[Kind, ...] = ('position', 'direction', 'pose')
FINEST, FINEST_TURN = 1e-5, 1e-4  # m, rad: tolerances below what friction and springs allow
ORTHONORMAL = 1e-6


class Distance(Protocol):
    """How near the arm is to what surrounds it."""

    @property
    def distance(self) -> float:
        """To the nearest obstacle, m; negative inside one, inf without any."""

    @property
    def obstacle(self) -> str:
        """Its name; empty without any."""


class Surroundings(Protocol):
    """
    What the arm must not touch: soft_continuum.obstacles.Surroundings, or any other.

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
    """Surroundings without an obstacle."""

    def clearance(self, state: Equilibrium) -> Clear:
        """Return that nothing is near."""
        return Clear()

    def at(self, position: Array) -> Clear:
        """Return that nothing is near."""
        return Clear()


@dataclass(frozen=True, eq=False)
class TipGoal:
    """
    Where the tip shall be, in base_link.

    position: (3,) m, of the centre of the top of the last disc; y is 0 for a planar arm.
    rotation: (3, 3) of that disc, of which 'direction' needs the z axis only; None for a position.
    kind: what counts: 'position', 'direction' (also where the tip points) or 'pose'.
    position_tolerance: m, angle_tolerance: rad, that the tip may be away and turned.
    Raises PlanError for what is no such goal.
    """

    position: Array
    rotation: Array | None = None
    kind: Kind = 'position'
    position_tolerance: float = 1e-3
    angle_tolerance: float = radians(2.0)

    def __post_init__(self) -> None:
        """Refuse what is no goal."""
        position = np.array(self.position, dtype=float)
        object.__setattr__(self, 'position', position)
        if position.shape != (3,) or not np.all(np.isfinite(position)):
            raise PlanError(f'the tip goal is at {position.tolist()}; needed: three finite '
                            'numbers x, y, z in m')
        if self.kind not in KINDS:
            raise PlanError(f'the kind of the tip goal is {self.kind!r}; '
                            f'allowed: {", ".join(KINDS)}')
        for name, value, low, high, unit in (
                ('position', self.position_tolerance, FINEST, 1.0, 'm'),
                ('angle', self.angle_tolerance, FINEST_TURN, pi, 'rad')):
            if not (isfinite(value) and low <= value <= high):
                raise PlanError(f'the {name} tolerance of the tip goal is {value:g} {unit}; '
                                f'allowed: {low:g} to {high:.4g} {unit}')
        if self.kind == 'position':
            return
        if self.rotation is None:
            raise PlanError(f'a tip goal of kind {self.kind} needs a rotation')
        rotation = np.array(self.rotation, dtype=float)
        object.__setattr__(self, 'rotation', rotation)
        if rotation.shape != (3, 3) or not np.allclose(
                rotation.T @ rotation, np.eye(3), atol=ORTHONORMAL) or (
                np.linalg.det(rotation) < 0.0):
            raise PlanError('the rotation of the tip goal is not a (3, 3) rotation matrix; its '
                            'columns must be right-handed, orthogonal and of length 1')

    def check(self, arm: Arm) -> None:
        """Raise PlanError if the tip of ``arm`` cannot be there for lack of a dimension."""
        for k in np.flatnonzero(~arm.pose_axes[:3]):  # the axis across the plane of the arm
            if abs(self.position[k]) > self.position_tolerance:
                raise PlanError(
                    f'the tip goal has {"xyz"[k]} = {self.position[k]:g} m; a planar arm moves at '
                    f'{"xyz"[k]} = 0, and the tolerance is {self.position_tolerance:g} m')
            if self.kind == 'position' or self.rotation is None:
                continue
            turned = float(np.arccos(np.clip(self.rotation[k, k], -1.0, 1.0))
                           if self.kind == 'pose' else
                           np.arcsin(min(abs(self.rotation[k, 2]), 1.0)))
            if turned > self.angle_tolerance:
                raise PlanError(
                    f'the tip goal is turned out of the plane of the arm by {degrees(turned):.1f} '
                    f'degrees; the tolerance is {degrees(self.angle_tolerance):.1f} degrees')


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
