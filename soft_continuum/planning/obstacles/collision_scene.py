# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Distance of an arm from the obstacles around it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.planning.obstacles.body import Body, Cylinders, MIN_HALF_LENGTH
from soft_continuum.planning.obstacles.geometry import distance, placed
from soft_continuum.planning.obstacles.mesh import Mesh
from soft_continuum.planning.obstacles.obstacle import Obstacle, Shape
from soft_continuum.planning.obstacles.shapes import Capsule, IN_MM, ObstacleError, Sphere

SEATED = 0.001
"""m that an obstacle may reach into the base disc, so that the arm can stand on it."""
MAX_TO_ARM = 20.0
"""Largest extent of an obstacle over the length of the arm: beyond it the unit is wrong."""


@dataclass(frozen=True)
class Clearance:
    """
    Distance of an arm from the nearest obstacle.

    distance: m; inf without obstacles.  Negative for overlaps, then only approximately the depth.
    obstacle: the name of the nearest one, empty without any.
    """

    distance: float = inf
    obstacle: str = ''


class CollisionScene:
    """
    The obstacles around an arm.

    Distances are those of the cylinders in the module ``body``, and never larger. The base disc is
    excluded, so that the arm can stand on a table that is an obstacle. Obstacles may reach into it
    by at most 1 mm (SEATED). Everything above the base disc counts. A scene is immutable.
    """

    def __init__(self, arm: Arm, obstacles: Iterable[Obstacle] = ()) -> None:
        """
        Take the obstacles (base_link, m) of an arm.

        Raises ObstacleError for duplicate names, for an obstacle in the base disc or many times
        as large as the arm, and without coal.
        """
        self.arm, self.obstacles = arm, tuple(obstacles)
        self._body = Body(arm)
        names = [obstacle.name for obstacle in self.obstacles]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ObstacleError(f'two obstacles are named {twice[0]}; give each its own name')
        if not names:
            return
        bounds = np.array([obstacle.shape.bounds for obstacle in self.obstacles])
        self._refuse_large(bounds)
        self._turns = np.array([obstacle.rotation for obstacle in self.obstacles])
        self._round = np.array([_rounding(obstacle.shape) for obstacle in self.obstacles])
        self._half = 0.5 * np.ptp(bounds, axis=1) - self._round[:, None]
        positions = np.array([obstacle.position for obstacle in self.obstacles], dtype=float)
        self._middles = positions + np.einsum('kij,kj->ki', self._turns, bounds.mean(axis=1))
        self._placed = [placed(obstacle) for obstacle in self.obstacles]
        self._refuse_on_base()

    def clearance(self, state: Equilibrium) -> Clearance:
        """
        Return the distance of a state of the arm from the nearest obstacle.

        Pairs of a part and an obstacle are checked in the order of their lower bounds, until no
        other pair can be nearer.
        """
        if not self.obstacles:
            return Clearance()
        return self._nearest(self._body.parts(state))

    def _nearest(self, parts: Cylinders) -> Clearance:
        bounds = self._bounds(parts)
        order = np.argsort(bounds, axis=None)
        least, nearest = inf, 0
        for pair, bound in zip(order.tolist(), bounds.ravel()[order].tolist(), strict=True):
            if bound >= least:
                break
            obstacle, part = divmod(pair, bounds.shape[1])
            found = self._distance(parts, part, obstacle, least)
            if found < least:
                least, nearest = found, obstacle
        return Clearance(least, self.obstacles[nearest].name)

    def clearances(self, states: Sequence[Equilibrium]) -> list[Clearance]:
        """Return the distances for many states."""
        return [self.clearance(state) for state in states]

    def at(self, position: Sequence[float] | Array) -> Clearance:
        """Return the distance of a point (3,), m, from the nearest obstacle."""
        if not self.obstacles:
            return Clearance()
        small = np.array([MIN_HALF_LENGTH])
        return self._nearest(Cylinders(
            np.array([position], dtype=float), np.array([[0.0, 0.0, 1.0]]), small, small))

    def _bounds(self, parts: Cylinders) -> Array:
        """
        Return a lower bound of the distance for each obstacle and part, (obstacles, n), m.

        It is the distance of the ball around the part from the rounded box around the obstacle;
        negative where these overlap.
        """
        local = (parts.centres[None] - self._middles[:, None]) @ self._turns
        beyond = np.abs(local) - self._half[:, None]
        outside = np.maximum(beyond, 0.0)
        bounds: Array = np.sqrt(np.einsum('kni,kni->kn', outside, outside))
        bounds += np.minimum(beyond.max(axis=2), 0.0)
        bounds -= self._round[:, None] + np.hypot(parts.half_lengths, parts.radii)
        return bounds

    def _distance(self, parts: Cylinders, part: int, obstacle: int, most: float = inf) -> float:
        return distance(parts.centres[part], parts.axes[part], 2.0 * parts.half_lengths[part],
                        parts.radii[part], self._placed[obstacle], most)

    def _refuse_large(self, bounds: Array) -> None:
        for obstacle, extent in zip(self.obstacles, np.ptp(bounds, axis=1), strict=True):
            if extent.max() > MAX_TO_ARM * self.arm.length:
                size = ' x '.join(f'{length:.4g}' for length in extent.tolist())
                raise ObstacleError(
                    f'obstacle {obstacle.name} is {size} m, and the arm {self.arm.length:.3g} m '
                    f'long; allowed: up to {MAX_TO_ARM:g} times as much. {IN_MM}')

    def _refuse_on_base(self) -> None:
        base = self._body.base()
        for number, obstacle in enumerate(self.obstacles):
            shape, middle = obstacle.shape, base.centres[0] - obstacle.position
            if self._distance(base, 0, number) < -SEATED or (
                    isinstance(shape, Mesh) and shape.encloses(middle @ obstacle.rotation)):
                raise ObstacleError(
                    f'obstacle {obstacle.name} is in the base disc, which has a radius of '
                    f'{1e3 * base.radii[0]:g} mm and is from z = 0 to '
                    f'{2e3 * base.half_lengths[0]:g} mm, so no shape of the arm is clear of it; '
                    'move it, or omit the mount of the arm')


def _rounding(shape: Shape) -> float:
    """Return the edge radius of the box around a shape, m."""
    return shape.radius if isinstance(shape, Sphere | Capsule) else 0.0
