# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How far an arm is from the obstacles around it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.either import AnyArm, State
from soft_continuum.obstacles.body import Body, Cylinders, MIN_HALF_LENGTH
from soft_continuum.obstacles.obstacle import (
    Box,
    Capsule,
    Cylinder,
    Mesh,
    Obstacle,
    ObstacleError,
    Shape,
    Sphere,
)

TOLERANCE = 2e-6
"""m by which a distance is stated too small: coal searches until it is right to 1e-6."""
SEATED = 0.001
"""m that an obstacle may reach into the base disc: what the arm stands on may touch it."""
MAX_TO_ARM = 20.0
"""Largest extent of an obstacle over the length of the arm: beyond it the unit is wrong."""


@dataclass(frozen=True)
class Clearance:
    """
    How far an arm is from the nearest obstacle.

    distance: m; negative where they overlap (then by about how much); inf without obstacles.
    obstacle: the name of the nearest one, empty without any.
    """

    distance: float
    obstacle: str


class Surroundings:
    """
    The obstacles around an arm.

    Distances are those of the body that the module ``body`` describes, and never larger. Its base
    disc is not counted: an obstacle may be as near to it as it likes, so that the arm can stand on
    a table that is an obstacle, but not in it by more than 1 mm (SEATED). What is above the base
    disc counts, from its first millimetre on. Surroundings never change: make new ones.
    """

    def __init__(self, arm: AnyArm, obstacles: Iterable[Obstacle] = ()) -> None:
        """
        Take the obstacles (base_link, m) of an arm.

        Raises ObstacleError where two have one name, where one is in the base disc or many times
        as large as the arm, and without coal.
        """
        self.arm, self.obstacles = arm, tuple(obstacles)
        self._body = Body(arm)
        names = [obstacle.name for obstacle in self.obstacles]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ObstacleError(f'two obstacles are named {twice[0]}; give each its own name')
        if not names:
            return
        self._coal = _coal()
        self._request = self._coal.DistanceRequest()
        bounds = np.array([obstacle.shape.bounds for obstacle in self.obstacles])
        self._refuse_large(bounds)
        self._turns = np.array([obstacle.rotation for obstacle in self.obstacles])
        rounding = [_rounding(obstacle.shape) for obstacle in self.obstacles]
        self._round = np.array(rounding)
        self._half = 0.5 * np.ptp(bounds, axis=1) - self._round[:, None]
        positions = np.array([obstacle.position for obstacle in self.obstacles], dtype=float)
        self._middles = positions + np.einsum('kij,kj->ki', self._turns, bounds.mean(axis=1))
        self._shapes = [(_geometry(self._coal, obstacle.shape),
                         self._coal.Transform3s(turn, position)) for obstacle, turn, position in
                        zip(self.obstacles, self._turns, positions, strict=True)]
        self._refuse_on_base()

    def clearance(self, state: State) -> Clearance:
        """Return how far a state of the arm is from the nearest obstacle."""
        if not self.obstacles:
            return Clearance(inf, '')
        return self._nearest(self._body.parts(state))

    def clearances(self, states: Sequence[State]) -> list[Clearance]:
        """Return the same of many states."""
        return [self.clearance(state) for state in states]

    def at(self, position: Sequence[float] | Array) -> Clearance:
        """Return how far a point (3,), m, is from the nearest obstacle."""
        if not self.obstacles:
            return Clearance(inf, '')
        small = np.array([MIN_HALF_LENGTH])
        return self._nearest(Cylinders(
            np.array([position], dtype=float), np.array([[0.0, 0.0, 1.0]]), small, small))

    def _nearest(self, parts: Cylinders) -> Clearance:
        """Ask coal for the pairs whose bound is nearest, until no other can be nearer."""
        bounds = self._bounds(parts)
        order = np.argsort(bounds, axis=None)
        count = bounds.shape[1]
        least, nearest = inf, 0
        for pair, bound in zip(order.tolist(), bounds.ravel()[order].tolist(), strict=True):
            if bound >= least:
                break
            obstacle, part = divmod(pair, count)
            distance = self._distance(parts, part, obstacle)
            if distance < least:
                least, nearest = distance, obstacle
        return Clearance(least - TOLERANCE, self.obstacles[nearest].name)

    def _bounds(self, parts: Cylinders) -> Array:
        """
        Return for each obstacle and part a distance that theirs is not below, (obstacles, n), m.

        It is that of the ball around the part and the rounded box around the obstacle; where these
        overlap, it is below any depth.
        """
        balls = np.hypot(parts.half_lengths, parts.radii)
        local = (parts.centres[None] - self._middles[:, None]) @ self._turns
        beyond = np.abs(local) - self._half[:, None]
        outside = np.sqrt((np.maximum(beyond, 0.0)**2).sum(axis=2))
        bounds: Array = outside + np.minimum(beyond.max(axis=2), 0.0)
        bounds -= self._round[:, None] + balls[None]
        return bounds

    def _distance(self, parts: Cylinders, part: int, obstacle: int) -> float:
        coal, (shape, pose) = self._coal, self._shapes[obstacle]
        cylinder = coal.Cylinder(parts.radii[part], 2.0 * parts.half_lengths[part])
        placed = coal.Transform3s(_frame(parts.axes[part]), parts.centres[part])
        found: float = coal.distance(cylinder, placed, shape, pose, self._request,
                                     coal.DistanceResult())
        return found

    def _refuse_large(self, bounds: Array) -> None:
        for obstacle, extent in zip(self.obstacles, np.ptp(bounds, axis=1), strict=True):
            if extent.max() > MAX_TO_ARM * self.arm.length:
                size = ' x '.join(f'{length:.4g}' for length in extent.tolist())
                raise ObstacleError(
                    f'obstacle {obstacle.name} is {size} m, and the arm {self.arm.length:.3g} m '
                    f'long; allowed: {MAX_TO_ARM:g} times as much. If it is in millimetres, give '
                    'unit: mm, or, of a mesh alone, scale: 0.001')

    def _refuse_on_base(self) -> None:
        base = self._body.base()
        for number, obstacle in enumerate(self.obstacles):
            if self._distance(base, 0, number) < -SEATED:
                raise ObstacleError(
                    f'obstacle {obstacle.name} is in the base disc (radius '
                    f'{1e3 * self._body.base_radius:g} mm, from z = 0 to '
                    f'{1e3 * self._body.base_height:g} mm), so no shape of the arm is free; move '
                    'it, or leave it out if the arm is fixed to it')


def _frame(axis: Array) -> Array:
    """Return any rotation (3, 3) whose z is a unit vector (3,)."""
    x, y, z = axis.tolist()
    if z < 0.0:  # a cylinder has no direction
        x, y, z = -x, -y, -z
    a = 1.0 / (1.0 + z)  # the turn about the axis across z and the vector
    return np.array([[1.0 - a * x * x, -a * x * y, x],
                     [-a * x * y, 1.0 - a * y * y, y],
                     [-x, -y, z]])


def _rounding(shape: Shape) -> float:
    """Return the radius with which the box around a shape is round, m."""
    return shape.radius if isinstance(shape, Sphere | Capsule) else 0.0


def _geometry(coal: Any, shape: Shape) -> Any:
    """Return a shape as coal has it."""
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius)
    if isinstance(shape, Box):
        return coal.Box(*shape.size)
    if isinstance(shape, Capsule):  # before Cylinder, of which it is one
        return coal.Capsule(shape.radius, shape.length)
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, shape.length)
    assert isinstance(shape, Mesh)
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(shape.triangles), len(shape.vertices))
    model.addVertices(np.asarray(shape.vertices, dtype=float))
    model.addTriangles(np.asarray(shape.triangles, dtype=np.uint64))
    model.endModel()
    return model


def _coal() -> Any:
    """Return coal, which takes a moment to load and is not needed without obstacles."""
    try:
        import coal
    except ImportError:
        raise ObstacleError('distances to obstacles need coal; install it with: pip install '
                            "'soft_continuum[obstacles]'") from None
    return coal
