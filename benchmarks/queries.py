# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Random goals of the tip that can be reached by construction, and a checker of plans to them.

A random motion is made first; then obstacles are put beside it.  The checker shares no distances
with the suite: it measures points on the surface of the arm against formulas of the shapes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import pi
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.lab import Description
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.statics import StaticsError
from soft_continuum.planning.obstacles import Box, Capsule, Cylinder, Obstacle, Sphere
from soft_continuum.planning.planner import Planner, soft_segments
from soft_continuum.planning.plans import Move, PlanError, TipGoal

MARGIN = 0.005  # m that plans keep
ASIDE = 0.015  # m that obstacles are away from the motion by which a goal is known to be reached
SIZES = 0.01, 0.05  # m
NEAR = 0.10  # m from a point of the motion to the middle of an obstacle, at most
MOST_OBSTACLES = 6
BENT = 0.9  # of the bending angle limits
AROUND = 24  # points on the rim of a body
DENSE = 0.01  # s between the states in which a plan is checked
LOST = 0.02  # m by which a body may move between two of these
EXACT = 1e-4  # N, rad: rounding of limits


@dataclass(frozen=True)
class Query:
    """
    Where an arm is, where its tip shall be, and what is around it.

    before: the moves that led to the state.  known: softenings of a motion to the goal.
    """

    state: Any
    pulls: Array
    before: tuple[Move, ...]
    goal: TipGoal
    obstacles: tuple[Obstacle, ...]
    known: int


@dataclass
class Verdict:
    """What a checker found: problems, empty for none; clearance m; tip_error m; turn_error rad."""

    problems: list[str] = field(default_factory=list)
    clearance: float = float('inf')
    tip_error: float = 0.0
    turn_error: float = 0.0


def random_query(description: Description, seed: int) -> Query:
    """Return the query of a seed."""
    draw = np.random.default_rng([seed, 16])
    planner = Planner(description.arm, description.settings)
    while True:
        state: Any = planner.statics.chain.straight()
        pulls = np.zeros(len(description.arm.tendon_names))
        try:
            state, before, _ = _moved(description, planner, draw, state, pulls,
                                      int(draw.integers(0, 3)))
            pulls = before[-1].pulls[-1] if before else pulls
            end, moves, ways = _moved(description, planner, draw, state, pulls,
                                      int(draw.integers(1, 4)))
        except (PlanError, StaticsError):
            continue
        return Query(state, pulls, before, _goal(draw, end),
                     _obstacles(description.arm, draw, [state, *ways],
                                seed % (MOST_OBSTACLES + 1)), len(moves))


def _moved(description: Description, planner: Any, draw: np.random.Generator, state: Any,
           pulls: Array, count: int) -> tuple[Any, tuple[Move, ...], list[Any]]:
    """Return where some random moves lead, the moves, and the states on the way."""
    limits = description.arm.bending_angle_limits
    ways: list[Any] = []
    moves: list[Move] = []
    last = -1
    for _ in range(count):
        segment = int(draw.choice([s for s in range(len(limits)) if s != last]))
        last = segment
        goal = np.array(state.bending)
        if description.arm.planar:
            goal[segment, 1] = BENT * limits[segment] * draw.uniform(-1.0, 1.0)
        else:
            way = draw.uniform(-pi, pi)
            goal[segment] = BENT * limits[segment] * np.sqrt(draw.random()) * np.array(
                [-np.sin(way), np.cos(way)])
        move, _ = planner.move(state, pulls, segment, goal)
        there = list(states_of(planner, state, pulls, move))
        if any(one.jumped for one in there):
            raise PlanError('it jumps')
        ways += there
        moves.append(move)
        state, pulls = there[-1], move.pulls[-1]
    return state, tuple(moves), ways


def states_of(planner: Any, state: Any, pulls: Array, move: Move) -> Iterator[Any]:
    """Yield the states of a move by the statics, one for each DENSE s, the softened one first."""
    soft = soft_segments(move.segment, planner.statics.chain.segments)
    state = planner.statics.solve(state, pulls, soft)
    yield state
    times = np.linspace(0.0, move.times[-1], max(2, int(np.ceil(move.times[-1] / DENSE))))
    for time in times[1:]:
        row = np.array([np.interp(time, move.times, tendon) for tendon in move.pulls.T])
        state = planner.statics.solve(state, row, soft)
        yield state


def _goal(draw: np.random.Generator, end: Any) -> TipGoal:
    position, rotation = end.poses[-1, :3], end.rotations[-1]
    if draw.random() < 2.0 / 3.0:
        return TipGoal(position)
    return TipGoal(position, rotation, 'direction')


def _obstacles(arm: Any, draw: np.random.Generator, ways: Sequence[Any], count: int
               ) -> tuple[Obstacle, ...]:
    """Return obstacles beside a motion, none nearer than ASIDE."""
    surfaces = np.concatenate([surface(arm, state) for state in ways[::5]])
    found: list[Obstacle] = []
    while len(found) < count:
        size = float(draw.uniform(*SIZES))
        shape = (Sphere(size), Box((size, 3.0 * size, float(draw.uniform(*SIZES)))),
                 Capsule(0.5 * size, 2.0 * size), Cylinder(size, size))[int(draw.integers(4))]
        offset = draw.normal(size=3) * (1.0, 0.3, 1.0)
        offset *= draw.uniform(0.0, NEAR) / np.linalg.norm(offset)
        turn = Rotation.random(rng=draw).as_quat()
        x, y, z = surfaces[draw.integers(len(surfaces))] + offset
        one = Obstacle(f'obstacle_{len(found) + 1}', shape, (float(x), float(y), float(z)),
                       tuple(turn.tolist()))
        base = max(s.outer_diameter for s in arm.segments)
        if z > base and distances(one, surfaces).min() >= ASIDE:
            found.append(one)
    return tuple(found)


def surface(arm: Any, state: Any) -> Array:
    """Return points on the surface of an arm, without its base disc, (n, 3), m."""
    chain = state.chain
    half = np.array([segment.outer_diameter / 2 for segment in arm.segments])
    radii = np.repeat(half, chain.joints_per_segment)
    turn = np.linspace(0.0, 2.0 * pi, AROUND, endpoint=False)
    rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(AROUND)])
    rims = np.einsum('bij,kj->bki', state.rotations, rim) * radii[:, None, None]
    lower, upper = state.backbone[:-1, None], state.backbone[1:, None]
    return np.concatenate([(lower + rims).reshape(-1, 3), (upper + rims).reshape(-1, 3),
                           upper[:, 0], (0.5 * (lower + upper) + rims).reshape(-1, 3)])


def distances(obstacle: Obstacle, points: Array) -> Array:
    """Return how far points (n, 3) are from an obstacle, (n,), m; negative inside."""
    local: Array = (points - np.array(obstacle.position)) @ Rotation.from_quat(
        obstacle.orientation).as_matrix()
    shape = obstacle.shape
    if isinstance(shape, Sphere):
        away: Array = np.linalg.norm(local, axis=1)
        away -= shape.radius
        return away
    if isinstance(shape, Box):
        beyond = np.abs(local) - 0.5 * np.array(shape.size)
    elif isinstance(shape, Capsule):
        along = np.clip(local[:, 2], -0.5 * shape.length, 0.5 * shape.length)
        local = local - np.column_stack([np.zeros((len(local), 2)), along])
        away = np.linalg.norm(local, axis=1)
        away -= shape.radius
        return away
    elif isinstance(shape, Cylinder):
        beyond = np.column_stack([np.hypot(local[:, 0], local[:, 1]) - shape.radius,
                                  np.abs(local[:, 2]) - 0.5 * shape.length])
    else:
        raise TypeError(f'no formula for {shape}')
    outside: Array = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    outside += np.minimum(beyond.max(axis=1), 0.0)
    return outside


def nearest(obstacles: Sequence[Obstacle], points: Array) -> float:
    """Return how far points are from the nearest obstacle, m."""
    return min((float(distances(one, points).min()) for one in obstacles), default=float('inf'))


def check(description: Description, query: Query, moves: Sequence[Move]) -> Verdict:
    """Return what is wrong with moves from the start of a query, followed densely."""
    arm, settings = description.arm, description.settings
    planner = Planner(arm, settings)
    limits = arm.bending_angle_limits
    found, state, pulls = Verdict(), query.state, np.array(query.pulls)
    found.clearance = nearest(query.obstacles, surface(arm, state))

    def wrong(text: str) -> None:
        if text not in found.problems:
            found.problems.append(text)

    for move in moves:
        if np.abs(move.pulls[0] - pulls).max() > 1e-6:
            wrong('it begins elsewhere')
        if move.pulls.min() < settings.pull_limits[0] or (
                move.pulls.max() > settings.pull_limits[1]):
            wrong('pull_limits')
        before = state
        for number, there in enumerate(states_of(planner, state, pulls, move)):
            state = there
            way = np.linalg.norm(state.backbone - before.backbone, axis=1).max()
            if state.jumped or (number > 0 and way > LOST):
                wrong('jump')
            if state.tensions.max() > settings.tension_limit + EXACT:
                wrong('tension_limit')
            if np.any(state.bending_angles > limits + 0.01) or (
                    np.any(state.bending_angles < -limits - 0.01)):
                wrong('bending_angle_limits')
            found.clearance = min(found.clearance, nearest(
                query.obstacles, surface(arm, state)))
            before = state
        pulls = move.pulls[-1]
    if found.clearance <= 0.0:
        wrong('collision')
    goal = query.goal
    found.tip_error = float(np.linalg.norm(state.poses[-1, :3] - goal.position))
    if found.tip_error > goal.position_tolerance:
        wrong('tip')
    if goal.rotation is not None:
        found.turn_error = float(np.arccos(np.clip(
            goal.rotation[:, 2] @ state.rotations[-1][:, 2], -1.0, 1.0)))
        if found.turn_error > goal.angle_tolerance:
            wrong('direction')
    return found
