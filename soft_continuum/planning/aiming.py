# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Bendings to set, one segment after the other, so that the final shape is right.

A stiff segment is compliant: it springs back when the tendons move for the next one, and bends
under its load.  So its locking angle differs from its final angle.  The whole sequence is
predicted, and the locking angles are solved for the wanted final shape.  Not from the paper, whose
stiff segments are rigid.  For spatial arms a bending is two numbers, about x and y.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Chain, Equilibrium
from soft_continuum.mechanics.directions import bending_vectors, within_limits
from soft_continuum.mechanics.statics import PRETENSIONS, StaticsError
from soft_continuum.planning.planner import Planner, PlanSettings, soft_segments
from soft_continuum.planning.plans import Move, PlanError, Shape, WHOLE_ARM
from soft_continuum.planning.shape_plans import plans_to

ANGLE_SCALE = 0.05  # rad away from the wanted angle costs as much as
TIP_SCALE = 1e-4  # m away from the wanted tip
PRECISION = 1e-4  # of what is minimised, relative
STEP = 1e-3  # rad, for derivatives
LIMIT_SHARE = 0.999  # of the bending angle limit
FARTHEST = 0.5  # rad from a wanted angle: only a wrong model asks for more to get there
MIN_DURATION = 0.5  # s: a motion that is over before it arrives would be too fast
MIN_IMPROVEMENT = 0.7  # of the present error: what would not be less than that is left
LEAST_RATIO = 8.0  # of a jam: a softer estimate means that it yields, and loses its setting again


@dataclass(frozen=True, eq=False)
class Aim:
    """
    The target of a sequence.

    bending: (segments, 2) rad, as Equilibrium.bending.  tip: (3,) m.  on_tip: whether the tip is
    controlled, and the bending only selects among the shapes that reach it; otherwise the bending
    is controlled.
    """

    bending: Array
    tip: Array
    on_tip: bool = False

    def text(self, error: float) -> str:
        """Return an error, m of the tip or rad, as text."""
        return f'{error * 1e3:.1f} mm' if self.on_tip else f'{np.degrees(error):.1f} degrees'

    def error(self, state: Equilibrium) -> float:
        """Return the error of a state: m of the tip, or rad of the worst segment."""
        if self.on_tip:
            return self.tip_error(state)
        return float(np.linalg.norm(state.bending - self.bending, axis=1).max())

    def at(self, state: Equilibrium) -> 'Aim':
        """Return the aim that a state meets exactly, of the same kind."""
        return replace(self, bending=state.bending, tip=state.backbone[-1])

    def tip_error(self, state: Equilibrium) -> float:
        """Return the tip error of a state, m."""
        return float(np.linalg.norm(state.backbone[-1] - self.tip))

    def residuals(self, state: Equilibrium) -> Array:
        """Return the residuals to minimize."""
        away = (state.bending - self.bending).ravel()
        if not self.on_tip:
            return away
        return np.concatenate([(state.backbone[-1] - self.tip) / TIP_SCALE, away / ANGLE_SCALE])


def aim_of(shape: Shape, on_tip: bool, arm: Arm, settings: PlanSettings) -> Aim:
    """
    Return the aim of a planned shape; on_tip: as of Aim.

    The tip is that of its last tip goal; for angles, that of the described ``arm``, set from
    straight.
    """
    if shape.tips:
        return tip_aim(shape, arm)
    bending = bending_vectors(arm, shape.bending_angles, shape.bending_directions)
    state: Equilibrium
    try:
        state = plans_to(Planner(arm, settings), [shape])[0].state
    except PlanError:  # it can be reached from the present shape only
        state = Chain(arm).uniform(bending)
    return Aim(bending, state.backbone[-1], on_tip)


def tip_aim(shape: Shape, arm: Arm) -> Aim:
    """Return the aim of a shape planned to tip goals: the last of them."""
    return Aim(bending_vectors(arm, shape.bending_angles, shape.bending_directions),
               shape.tips[-1].position, on_tip=True)


def predicted_state(statics: Any, state: Any, segments: Sequence[int], bending: Array,
                    known: dict[bytes, Any] | None = None) -> Any:
    """
    Return the state after segments (0-based), or WHOLE_ARM, were set one after the other.

    bending: of each of them, (k, 2) rad; of WHOLE_ARM that of all.  known: cache of states after
    the first ones, by their bendings, from the same state.  Raises StaticsError if no tendon holds
    one there.
    """
    known = {} if known is None else known
    goal = np.array(state.bending)
    goal[_rows(segments, len(goal))] = bending
    for count, segment in enumerate(segments, start=1):
        so_far = (bending if segment == WHOLE_ARM else bending[:count]).tobytes()
        if so_far not in known:
            soft = soft_segments(segment, len(goal))
            found = statics.hold(state, goal, soft, pretensions=PRETENSIONS[::-1]).state
            # It is locked by the full vacuum, not by what is left in it while it is soft.
            known[so_far] = replace(found, vacuum=tuple(
                1.0 if was_soft else part
                for was_soft, part in zip(soft, found.vacuum, strict=False)))
        state = known[so_far]
    return state


def angles_to_set(statics: Any, state: Any, segments: Sequence[int], aim: Aim,
                  check_wanted: Callable[[], None] = lambda: None) -> tuple[Array, Any]:
    """
    Return the bendings at which to lock segments, and the predicted state.

    segments: 0-based, or WHOLE_ARM, in the order in which they are set; the first may be soft
    already.  The bendings are (k, 2) rad.  check_wanted: called repeatedly, may raise to abandon
    the search, which may take seconds.  Raises StaticsError if the aim cannot be set.
    """
    from scipy.optimize import least_squares  # 0.3 s that a start need not wait for
    arm = statics.chain.arm
    rows = _rows(segments, len(arm.segments))
    most = LIMIT_SHARE * arm.bending_angle_limits[rows]
    free, limits = arm.bending_axes[rows], np.repeat(most[:, None], 2, axis=1)
    first = np.clip(np.asarray(aim.bending)[rows], -limits, limits)
    away = np.inf if aim.on_tip else FARTHEST
    bounds = (np.maximum(-limits, first - away)[free], np.minimum(limits, first + away)[free])
    known: dict[bytes, Any] = {}

    def locked(values: Array) -> Array:
        """Return bendings within the limits, with given values of the free ones."""
        bending = first.copy()
        bending[free] = values
        return within_limits(bending, most)

    def residuals(values: Array) -> Array:
        check_wanted()
        return aim.residuals(predicted_state(statics, state, segments, locked(values), known))

    def jacobian(values: Array) -> Array:
        """Return finite-difference derivatives that do not vanish for straight segments."""
        here = residuals(values)
        steps = np.where(values > 0.0, -STEP, STEP)  # towards the inside
        return np.column_stack([(residuals(values + step * unit) - here) / step
                                for step, unit in zip(steps, np.eye(len(values)), strict=True)])

    best = first[free]
    before = residuals(best)
    try:
        found = least_squares(
            residuals, best, jac=jacobian, bounds=bounds, x_scale=0.1, xtol=PRECISION,
            ftol=PRECISION)
        if found.cost <= 0.5 * before @ before:
            best = found.x
    except StaticsError:  # on the way: the wanted angles themselves can be set
        pass
    bending = locked(best)
    return bending, predicted_state(statics, state, segments, bending, known)


def _rows(segments: Sequence[int], count: int) -> list[int]:
    """Return the segments that are set; WHOLE_ARM stands for all."""
    return list(range(count)) if WHOLE_ARM in segments else list(segments)


@dataclass(frozen=True, eq=False)
class AimStep:
    """
    The next step with a soft segment.

    move: None when the segment is ready to be locked.  change: rad by which it must turn, not
    negative.
    error: present error.  predicted: error after all remaining steps, m or rad as Aim.error.
    """

    move: Move | None
    change: float
    error: float
    predicted: float


def next_step(planner: Planner, state: Any, pulls: Sequence[float],
              segments: Sequence[int], aim: Aim, dead_band: float) -> AimStep:
    """
    Return the next step towards an aim.

    segments: 0-based, still to be locked in this order, the first one soft; or WHOLE_ARM.
    dead_band: m of pull, below which friction prevents motion. Raises PlanError beyond a limit, or
    when no tendon holds the arm on the way.
    """
    first = segments[0]
    try:
        bending, after = angles_to_set(
            planner.statics, state, segments, aim, planner.check_wanted)
        goal = np.array(state.bending)
        goal[_rows(segments, len(goal))] = bending
        change = _change(goal, state.bending, first)
        move = None
        if change > planner.settings.angle_tolerance:
            move, _ = planner.move(state, np.asarray(pulls, dtype=float), first, goal)
            if np.abs(move.pulls - move.pulls[0]).max() <= dead_band:
                move = None
            elif move.duration < MIN_DURATION:
                move = replace(move, times=move.times * (MIN_DURATION / move.duration))
    except (StaticsError, PlanError) as error:
        what = 'the arm' if first == WHOLE_ARM else f'segment {first + 1}'
        raise PlanError(f'{what}: {error}') from None
    return AimStep(move, change, aim.error(state), aim.error(after))


def _change(goal: Array, now: Array, segment: int) -> float:
    """Return the angle by which a segment, or the worst of WHOLE_ARM, must turn, rad."""
    turns = np.linalg.norm(goal - now, axis=1)
    return float(turns.max() if segment == WHOLE_ARM else turns[segment])


def segments_worth_correcting(planner: Planner, state: Any, pulls: Sequence[float],
                        segments: Sequence[int], aim: Aim, lock_in: float,
                        release_limit: float = inf) -> tuple[int, ...]:
    """
    Return the segments to set again; none if it would not help.

    pulls: (tendons,) of the motors, m.  segments: 0-based, in their order; the last ones of them
    are returned, as many as pay off.  lock_in: standard deviation, rad, of the random bend of a
    segment when it is stiffened.  release_limit: m by which the tip may move when one of them is
    softened.
    """
    statics = planner.statics
    if not aim.on_tip and any(
            s != WHOLE_ARM and statics.chain.arm.segments[s].jam.ratio < LEAST_RATIO
            for s in segments):
        return ()
    now = aim.error(state)
    best: tuple[int, ...] = ()
    least = MIN_IMPROVEMENT * now
    for first in range(len(segments) - 1, -1, -1):
        again = segments[first:]
        if release_limit < inf and _released(planner, state, pulls, again[0]) > release_limit:
            break
        try:
            _, after = angles_to_set(statics, state, again, aim, planner.check_wanted)
        except StaticsError:
            continue
        left = float(np.hypot(aim.error(after), lock_in * _lever(state, again, aim)))
        if left < least:  # a longer list has to be better by a good part
            best, least = tuple(again), MIN_IMPROVEMENT * left
    return best


def _released(planner: Planner, state: Any, pulls: Sequence[float], segment: int) -> float:
    """Return the motion of the tip when a segment is softened, m; inf if unknown."""
    try:
        there = planner.held(state, pulls, segment)
    except StaticsError:
        return inf
    return float(np.linalg.norm(there.backbone[-1] - state.backbone[-1]))


def _lever(state: Equilibrium, segments: Sequence[int], aim: Aim) -> float:
    """Return the derivatives of the error by the angles of locked segments."""
    if not aim.on_tip:
        return 1.0
    # What the first ones do is made up for by the later ones, but for one direction.
    points = state.poses[:, :3]
    middles = (points[1::2][:-1] + points[2::2]) / 2.0
    levers = np.linalg.norm(points[-1] - middles, axis=1)[list(segments)]
    return float(np.hypot(levers[-1], 0.5 * levers[-2])) if len(levers) > 1 else float(levers[0])
