# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
One move of a plan, as the statics predict it: obstacles and limits.

The pulls of the move are followed as by the motors.  Between two states a point of the arm moves
by at most ``moved``, so it can come closer to an obstacle than in both states by at most half of
that; if that is too close, intermediate states are solved.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.statics import StaticsError
from soft_continuum.planning.obstacles import Clearance, CollisionScene
from soft_continuum.planning.planner import Planner
from soft_continuum.planning.plans import (
    Move,
    PlanError,
    PlannedStep,
    Shape,
    ShapePlan,
    WHOLE_ARM,
)
from soft_continuum.planning.settings import ReachSettings

DETOUR = 1.2
"""Largest ratio of path length to distance between neighbouring states."""
SNAP = 0.02  # m between two states of a motion that were followed: farther, and it is no motion
SHORT = 1e-3  # of the way between two pulls: no two states are nearer in time
AWAY = 0.8
"""Share of a too small clearance at the start that the first move keeps."""
VACUUM_STEPS = 5
"""Smallest number of states while a vacuum is lowered, as jams may yield."""
BEYOND = 2e-3  # rad beyond its bending angle limit, for the compliance of a segment


class BlockedError(Exception):
    """
    A move is blocked by an obstacle or a limit.

    obstacle: its name.  limit: name of the parameter; both may be empty.
    """

    def __init__(self, message: str, obstacle: str = '', limit: str = '') -> None:
        super().__init__(message)
        self.obstacle, self.limit = obstacle, limit


@dataclass(frozen=True, eq=False)
class Node:
    """
    The state after some moves: all segments stiff again, if the arm has jamming.

    pulls: (tendons,) m of the motors.  near: distance of obstacles.  locked: the segments
    (0-based) that were stiffened on the way here.  relaxing: how the arm relaxed at last, when
    vacuums were lowered; None if they were not.
    """

    state: Any
    pulls: Array
    near: Clearance
    moves: tuple[Move, ...] = ()
    steps: tuple[PlannedStep, ...] = ()
    locked: frozenset[int] = frozenset()
    relaxing: PlannedStep | None = None

    def plan(self, shape: Shape, warning: str = '') -> ShapePlan:
        """Return the plan that leads here, of a shape."""
        return ShapePlan(shape, self.moves, self.state, self.steps, self.relaxing, warning)


@dataclass(frozen=True, eq=False)
class BodyFrames:
    """Poses of the bodies of a state: backbone and rotations, as in Equilibrium."""

    backbone: Array
    rotations: Array


def moved(one: Equilibrium | BodyFrames, other: Equilibrium | BodyFrames, radius: float) -> float:
    """Return a bound of the displacement, m, of points within ``radius`` (m) of the backbone."""
    ends = np.linalg.norm(one.backbone[1:] - other.backbone[1:], axis=1)
    turns = np.linalg.norm(one.rotations - other.rotations, axis=(1, 2)) / np.sqrt(2.0)
    return float((ends + radius * turns).max())


def body_radius(chain: Any) -> float:
    """Return the radius of the body of an arm around its backbone, m."""
    # Bodies are longer than their radius at joints: a corner is sqrt(2) of it away.
    return float(np.sqrt(2.0) * max(
        chain.disc_radii.max(), max(s.outer_diameter for s in chain.arm.segments) / 2))


def between(one: Equilibrium | BodyFrames, near_one: Clearance, other: Equilibrium | BodyFrames,
            near_other: Clearance, radius: float) -> tuple[Clearance, float]:
    """Return the clearance between two neighbouring states, and the displacement of points, m."""
    way = DETOUR * moved(one, other, radius)
    nearest = min(near_one, near_other, key=lambda near: near.distance)
    return Clearance((near_one.distance + near_other.distance - way) / 2.0,
                     nearest.obstacle), way


class MotionValidator:
    """Validates moves of one arm among obstacles."""

    def __init__(self, planner: Planner, scene: CollisionScene, settings: ReachSettings
                 ) -> None:
        """Prepare; settings: of which margin, lock_in and softening_time count."""
        self.planner, self.scene, self.settings = planner, scene, settings
        chain = planner.statics.chain
        arm = chain.arm
        self.radius = body_radius(chain)
        self._limits = arm.bending_angle_limits + BEYOND
        beyond = np.cumsum([s.length + d.height for s, d in zip(
            arm.segments[::-1], arm.discs[:0:-1], strict=True)])[::-1]
        halves = np.array([s.length / 2 for s in arm.segments])
        self._levers = np.hypot(beyond - halves, chain.disc_radii.max())
        self._jamming = planner.settings.jamming

    def until(self, spent: Callable[[], bool]) -> 'MotionValidator':
        """Return the same within a budget, as of Planner.until."""
        return MotionValidator(self.planner.until(spent), self.scene, self.settings)

    def within(self, states: float, seconds: float) -> 'MotionValidator':
        """Return the same with another budget of a search."""
        return MotionValidator(self.planner, self.scene, replace(
            self.settings, states=int(states), time_limit=seconds))

    def start(self, state: Any, pulls: Sequence[float] | Array) -> Node:
        """Return the start node; raises PlanError if it is in an obstacle."""
        near = self.scene.clearance(state)
        if near.distance <= 0.0:
            raise PlanError(f'the arm touches {near.obstacle} already: they overlap by '
                            f'{-near.distance * 1e3:.1f} mm; move one of them away first')
        return Node(state, np.array(pulls, dtype=float), near)

    def go(self, node: Node, mover: int, goal: Array) -> Node:
        """
        Return the node after setting one segment (0-based), or WHOLE_ARM.

        goal: as Equilibrium.bending, rad.  Raises BlockedError.
        """
        try:
            move, _ = self.planner.move(node.state, node.pulls, mover, goal)
            return self._followed(node, move)
        except PlanError as error:
            self.planner.check_wanted()  # an abandoned plan is not one that is blocked
            raise BlockedError(str(error), limit=error.limit) from None
        except StaticsError as error:
            raise BlockedError(str(error), limit='held') from None

    def relaxed(self, node: Node, vacuums: Sequence[float]) -> Node:
        """
        Return the node after the vacuums are lowered, one segment after the other.

        vacuums: of every segment in the end, Pa below ambient; empty for all stiff.  The first
        state of ``relaxing`` has every segment stiff.  Raises BlockedError.
        """
        if not vacuums:
            return node
        try:
            relaxing = self._relaxing(node, vacuums)
        except BlockedError as error:
            raise BlockedError(f'as the arm relaxes under its vacuums, {error}', error.obstacle,
                               error.limit) from None
        return replace(node, state=relaxing.states[-1], relaxing=relaxing)

    def _relaxing(self, node: Node, vacuums: Sequence[float]) -> PlannedStep:
        planner = self.planner
        way = _ClearanceChecker(self, self.needed(node.locked, None),
                   lambda state, parts: planner.jammed(state, node.pulls, parts))
        parts = np.ones(len(vacuums))
        try:
            state = planner.jammed(node.state, node.pulls)
            near = way.check(state)
            for segment, vacuum in enumerate(vacuums):
                part = min(1.0, vacuum / planner.settings.full_vacuum)
                for lowered in np.linspace(1.0, part, VACUUM_STEPS + 1)[1:] if part < 1.0 else ():
                    planner.check_wanted()
                    before, parts = parts, parts.copy()
                    parts[segment] = lowered
                    state, near = way.to(state, near, before, parts)
        except StaticsError as error:
            raise BlockedError(str(error), limit='held') from None
        return PlannedStep(tuple(way.states), way.least.distance, way.least.obstacle,
                           way.tension, 0.0)

    def bent(self, state: Any, mover: int, goal: Array) -> Any:
        """Return the state after a segment, or WHOLE_ARM, is set; raises BlockedError."""
        self.planner.check_wanted()
        try:
            return self.planner.bent(state, mover, goal)
        except StaticsError as error:
            raise BlockedError(str(error), limit='held') from None

    def free(self, state: Any, needed: float) -> None:
        """Raise BlockedError if an obstacle is closer to a state than needed, m."""
        near = self.scene.clearance(state)
        if near.distance < needed:
            raise _too_near(near, needed)

    def needed(self, locked: frozenset[int], soft: int | None) -> float:
        """
        Return the needed clearance, m.

        A segment that bends when it is stiffened moves everything distal.  The tendons compensate
        in the soft segment, which moves everything distal of it at most as much the other way.
        """
        shift = 0.0
        if self._jamming:
            shift = sum(max(self._levers[s], 0.0 if soft is None else self._levers[soft])
                        for s in locked if s != soft)
        return self.settings.margin + self.settings.lock_in * shift

    def _followed(self, node: Node, move: Move) -> Node:
        """Follow the pulls of a move, from a node on."""
        soft = None if move.segment == WHOLE_ARM else move.segment
        state = self.planner.held(node.state, node.pulls, move.segment)
        way = _ClearanceChecker(
            self, self.needed(node.locked, soft), lambda state, pulls: self.planner.held(
                state, pulls, move.segment, move.sliding))
        if not node.moves:  # from where the arm is nearer to something it may go away
            near = self.scene.clearance(state)
            clear = min(node.near.distance, near.distance) - DETOUR * moved(
                node.state, state, self.radius)
            if clear < way.needed:
                way.needed = AWAY * max(0.0, clear)
        near = way.check(state)
        way.between(node.state, node.near, state, near)
        for before, pulls in zip(move.pulls, move.pulls[1:], strict=False):
            state, near = way.to(state, near, before, pulls)
        locked = node.locked | ({move.segment} if self._jamming else set())
        needed = self.needed(locked, None)
        if near.distance < needed:
            raise _too_near(near, needed)
        duration = move.duration + (self.settings.softening_time if self._jamming else 0.0)
        step = PlannedStep(tuple(way.states), way.least.distance, way.least.obstacle,
                           way.tension, duration)
        return Node(state, move.pulls[-1], near, (*node.moves, move), (*node.steps, step), locked)


class _ClearanceChecker:
    """
    The states on a way; least: the smallest clearance up to now.

    solve: returns the state that follows from another one, by pulls or by parts of the vacuum.
    """

    def __init__(self, validator: MotionValidator, needed: float,
                 solve: Callable[[Any, Array], Any]) -> None:
        self.validator, self.needed, self.solve = validator, needed, solve
        self.states: list[Any] = []
        self.least: Clearance = Clearance()
        self.tension = 0.0

    def check(self, state: Any) -> Clearance:
        """Record a state; return the distance of obstacles; raises BlockedError beyond limits."""
        validator, settings = self.validator, self.validator.planner.settings
        if state.jumped:
            raise BlockedError('the arm would snap to another equilibrium', limit='jump')
        tension = float(np.nanmax(state.tensions, initial=0.0))
        if tension > settings.tension_limit:
            raise BlockedError(f'needs a tendon tension of {tension:.1f} N; tension_limit: '
                               f'{settings.tension_limit:g} N', limit='tension_limit')
        over = np.linalg.norm(state.bending, axis=1)
        if np.any(over > validator._limits):
            worst = int(np.argmax(over - validator._limits))
            raise BlockedError(
                f'segment {worst + 1} would bend by {np.degrees(over[worst]):.1f} degrees, beyond '
                'its bending_angle_limits', limit='bending_angle_limits')
        near = validator.scene.clearance(state)
        if near.distance < self.needed:
            raise _too_near(near, self.needed)
        self.states.append(state)
        self.tension = max(self.tension, tension)
        return near

    def between(self, one: Any, near_one: Clearance, other: Any, near_other: Clearance) -> float:
        """Record the clearance between two states; return the displacement of points, m."""
        least, way = between(one, near_one, other, near_other, self.validator.radius)
        if least.distance < self.needed:
            raise _too_near(least, self.needed)
        if least.distance < self.least.distance:
            self.least = least
        return way

    def to(self, state: Any, near: Clearance, before: Array, after: Array, part: float = 1.0
           ) -> tuple[Any, Clearance]:
        """Go to the next argument of ``solve``, with intermediate states as needed."""
        there = self.solve(state, after)
        count = len(self.states)
        near_there = self.check(there)
        least, tension = self.least, self.tension
        try:
            if self.between(state, near, there, near_there) > SNAP:
                raise BlockedError('the arm would snap to another equilibrium on the '
                                   'way', limit='jump')
            return there, near_there
        except BlockedError:
            if part < SHORT:
                raise
        del self.states[count:]
        self.least, self.tension = least, tension
        middle = 0.5 * (before + after)
        state, near = self.to(state, near, before, middle, part / 2.0)
        return self.to(state, near, middle, after, part / 2.0)


def _too_near(near: Clearance, needed: float) -> BlockedError:
    far = near.distance * 1e3
    where = f'{far:.1f} mm away' if far >= 0.0 else f'the arm would be {-far:.1f} mm in it'
    return BlockedError(f'{near.obstacle} is in the way: {where}; needed clearance: '
                        f'{needed * 1e3:.1f} mm', obstacle=near.obstacle)
