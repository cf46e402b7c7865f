# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes and tip goals, and the plans made for them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import degrees, inf, isfinite, pi, radians
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.planning import TIP_KINDS, TipKind

WHOLE_ARM = -1
"""In place of a segment (0-based): the whole arm without jamming, set at once."""
FINEST, FINEST_TURN = 1e-5, 1e-4  # m, rad: tolerances below what friction and springs allow
ORTHONORMAL = 1e-6


class PlanError(ValueError):
    """
    A shape cannot be set from the present state within the limits; the message says why.

    limit: the limiting parameter, empty for none.
    """

    def __init__(self, message: str, limit: str = '') -> None:
        """Store the message and the limit."""
        super().__init__(message)
        self.limit = limit


class ObstructedError(PlanError):
    """An obstacle blocks the way."""


def failure_text(error: BaseException) -> str:
    """Return why planning failed: that there is no plan, or an error of the program."""
    return str(error) if isinstance(error, PlanError) else f'{type(error).__name__}: {error}'


@dataclass(frozen=True, eq=False)
class TipGoal:
    """
    A tip goal, in base_link.

    position: (3,) m, of the centre of the top of the last disc; y is 0 for a planar arm.
    rotation: (3, 3) of that disc, of which 'direction' needs the z axis only; None for a position.
    kind: 'position', 'direction' (also the direction of the tip) or 'pose'.  position_tolerance:
    m.  angle_tolerance: rad.  Raises PlanError for an invalid goal.
    """

    position: Array
    rotation: Array | None = None
    kind: TipKind = 'position'
    position_tolerance: float = 1e-3
    angle_tolerance: float = radians(2.0)

    def __post_init__(self) -> None:
        """Refuse an invalid goal."""
        position = np.array(self.position, dtype=float)
        object.__setattr__(self, 'position', position)
        if position.shape != (3,) or not np.all(np.isfinite(position)):
            raise PlanError(f'the tip goal is at {position.tolist()}; needed: three finite '
                            'numbers x, y, z in m')
        if self.kind not in TIP_KINDS:
            raise PlanError(f'the kind of the tip goal is {self.kind!r}; '
                            f'allowed: {", ".join(TIP_KINDS)}')
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
        """Raise PlanError if a planar ``arm`` cannot reach the goal outside of its plane."""
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

    def text(self, away: float, turn: float) -> str:
        """Return errors of the tip, m and rad, as text."""
        return f'{away * 1e3:.1f} mm' + (
            '' if self.kind == 'position' else f' and {degrees(turn):.1f} degrees')


@dataclass(frozen=True)
class Shape:
    """
    A shape: its name, the bending angle of every segment (rad), how long to hold it (s).

    bending_directions: of every segment of a spatial arm, rad; empty for 0 of all.  tips: one tip
    goal, or several as a path; the angles are then empty until it is planned.
    vacuums: of every segment while the shape is held, Pa below ambient; empty for all stiff.
    """

    name: str
    bending_angles: tuple[float, ...]
    hold_time: float = 0.0
    bending_directions: tuple[float, ...] = ()
    tips: tuple[TipGoal, ...] = ()
    vacuums: tuple[float, ...] = ()

    def at(self, state: Any) -> 'Shape':
        """Return the same with the bending of a state of the arm."""
        return replace(self, bending_angles=tuple(state.bending_angles.tolist()),
                       bending_directions=tuple(state.bending_directions.tolist()))


@dataclass(frozen=True, eq=False)
class Move:
    """
    One segment (0-based) softened, bent and stiffened, or WHOLE_ARM bent.

    goal: as State.bending, rad; only soft segments count.  times: (points,) s from the start of
    the motion.  pulls: (points, tendons) m.  largest_tension: N, as the model predicts.
    sliding: of each tendon through its guides, as in Statics.solve.
    """

    segment: int
    goal: Array
    times: Array
    pulls: Array
    largest_tension: float
    sliding: tuple[int, ...] = ()

    @property
    def duration(self) -> float:
        """Time for which the tendons move, s."""
        return float(self.times[-1])


@dataclass(frozen=True, eq=False)
class PlannedStep:
    """
    One Move of a plan, as the model predicts it.

    states: from softening the segment to stiffening it, all in equilibrium with the pulls of the
    move.  clearance: m, the smallest at and between these states.  obstacle: the name of the
    nearest, empty for none.  tension: N, the largest.
    duration: s, of the motion and of softening and stiffening.
    """

    states: tuple[Any, ...]
    clearance: float
    obstacle: str
    tension: float
    duration: float

    def then(self, other: 'PlannedStep', pause: float = 0.0) -> 'PlannedStep':
        """Return this step and another one, less a pause (s), as one."""
        nearest = min(self, other, key=lambda one: one.clearance)
        return PlannedStep(self.states + other.states, nearest.clearance, nearest.obstacle,
                           max(self.tension, other.tension),
                           self.duration + other.duration - pause)


@dataclass(frozen=True, eq=False)
class ShapePlan:
    """
    The moves that set one shape, and the state of the model after them.

    steps: one for each move, from soft to stiffened.  relaxing: relaxation of the arm when the
    shape's vacuums are lowered, None without vacuums.  warning: error of the shape with its
    vacuums; empty if small.
    """

    shape: Shape
    moves: tuple[Move, ...]
    state: Any
    steps: tuple[PlannedStep, ...] = ()
    relaxing: PlannedStep | None = None
    warning: str = ''

    @property
    def paths(self) -> tuple[PlannedStep, ...]:
        """The steps, and last the relaxation, if there is one."""
        return self.steps if self.relaxing is None else (*self.steps, self.relaxing)

    def pulls(self, start: Array) -> Array:
        """Return the pulls of the motors after the moves from those at the start, m."""
        return self.moves[-1].pulls[-1] if self.moves else start

    @property
    def stiff(self) -> Any:
        """The state before the shape's vacuums are lowered, None without vacuums."""
        return None if self.relaxing is None else self.relaxing.states[0]

    @property
    def as_set(self) -> Shape:
        """The shape that is set before its vacuums are lowered."""
        if self.stiff is None:
            return self.shape
        tip = self.stiff.backbone[-1]
        return replace(self.shape.at(self.stiff), vacuums=(),
                       tips=tuple(replace(goal, position=tip) for goal in self.shape.tips))


@dataclass(frozen=True, eq=False)
class PlanResult:
    """
    A plan by tip.

    plan: its moves and the state after them; None if no plan improves on the present state.  why:
    empty; or why the goal is not reached, and then the plan leads to the nearest known state.
    tip_error: m from the tip to the goal in the end, of a path the largest distance of the tip
    from it on the way.  turn_error: rad, likewise.  blocked_by: the names of obstacles
    that blocked candidates, the most frequent first, if there is no plan.  cut_short: whether
    time_limit ended the search: with more time it may find another plan.  better: what the rest of
    the search yields, if it was interrupted.
    """

    plan: ShapePlan | None
    why: str = ''
    tip_error: float = 0.0
    turn_error: float = 0.0
    blocked_by: tuple[str, ...] = ()
    cut_short: bool = False
    better: 'Iterator[PlanResult] | None' = None

    def best(self) -> 'PlanResult':
        """Return the best plan of an interrupted search, which goes on once; it may take long."""
        found = self
        for found in self.better or ():  # noqa: B007  (the last one is the best)
            pass
        return found

    @property
    def steps(self) -> tuple[PlannedStep, ...]:
        """One for each move; the last one includes the relaxation under vacuums."""
        if self.plan is None or self.plan.relaxing is None or not self.plan.steps:
            return () if self.plan is None else self.plan.steps
        *before, last = self.plan.steps
        return (*before, last.then(self.plan.relaxing))

    @property
    def softenings(self) -> int:
        """Number of softenings; without jamming, of moves."""
        return len(self.steps)

    @property
    def duration(self) -> float:
        """How long all steps take, s."""
        return sum(step.duration for step in self.steps)

    @property
    def tension(self) -> float:
        """The largest tension on the way, N."""
        return max((step.tension for step in self.steps), default=0.0)

    @property
    def clearance(self) -> tuple[float, str]:
        """The smallest distance to an obstacle on the way, m, and its name."""
        nearest = min(self.steps, key=lambda step: step.clearance, default=None)
        return (inf, '') if nearest is None else (nearest.clearance, nearest.obstacle)
