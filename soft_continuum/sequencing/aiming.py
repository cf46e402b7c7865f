# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Bending angles to set, one segment after the other, so that the shape in the end is right.

A stiff segment gives: when the tendons change for the next one it springs back, and what hangs on
it bends it.  So the angle at which it is locked is not the angle that it has in the end.  The
whole sequence is predicted, and the angles are those whose prediction ends where it should.  Not
from the paper, whose stiff segments are rigid.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from soft_continuum.mechanics.chain import Array, Equilibrium
from soft_continuum.mechanics.statics import Statics, StaticsError
from soft_continuum.sequencing.planner import Move, PlanError, Planner

ANGLE_SCALE = 0.05  # rad away from the wanted angle costs as much as
TIP_SCALE = 1e-4  # m away from the wanted tip
PRECISION = 1e-4  # of what is minimised, relative
STEP = 1e-3  # rad, for derivatives
LIMIT_SHARE = 0.999  # of the bending angle limit
MIN_DURATION = 0.5  # s: a motion that is over before it arrives would be too fast
WORTH = 0.7  # of the present error: what would not be less than that is left
LEAST_RATIO = 8.0  # of a jam: one that seems softer yields, and loses again what it is set to


@dataclass(frozen=True, eq=False)
class Aim:
    """
    What a sequence is to end in.

    bending_angles: (segments,) rad.  tip: (x, z) m.  on_tip: whether the tip is to be right, and
    the angles only choose among the shapes that bring it there; otherwise the angles are.
    """

    bending_angles: Array
    tip: Array
    on_tip: bool = False

    def text(self, error: float) -> str:
        """Return an error, m of the tip or rad, as people read it."""
        return f'{error * 1e3:.1f} mm' if self.on_tip else f'{np.degrees(error):.1f} degrees'

    def error(self, state: Equilibrium) -> float:
        """Return how far a state is off: m of the tip, or rad of the worst segment."""
        if self.on_tip:
            return self.tip_error(state)
        return float(np.abs(state.bending_angles - self.bending_angles).max())

    def tip_error(self, state: Equilibrium) -> float:
        """Return how far the tip of a state is off, m."""
        return float(np.linalg.norm(state.tip[:2] - self.tip))

    def residuals(self, state: Equilibrium) -> Array:
        """Return what is to be small."""
        away = state.bending_angles - self.bending_angles
        if not self.on_tip:
            return away
        return np.concatenate([(state.tip[:2] - self.tip) / TIP_SCALE, away / ANGLE_SCALE])


def predicted(statics: Statics, state: Equilibrium, segments: Sequence[int],
              angles: Sequence[float]) -> Equilibrium:
    """
    Return the state after segments (0-based) were set to angles (rad) one after the other.

    Raises StaticsError where no tendon holds one there.
    """
    for segment, angle in zip(segments, angles, strict=True):
        state = statics.bend(state, segment, float(angle))
    return state


def angles_to_set(statics: Statics, state: Equilibrium, segments: Sequence[int], aim: Aim
                  ) -> tuple[Array, Equilibrium]:
    """
    Return the angles (rad) at which segments are to be locked, and the state that is predicted.

    segments: 0-based, in the order in which they are set; the first may be soft already.  Raises
    StaticsError when the wanted angles cannot be set.
    """
    from scipy.optimize import least_squares  # 0.3 s that a start need not wait for
    limits = LIMIT_SHARE * np.array(
        [statics.chain.arm.segments[s].bending_angle_limit for s in segments])
    first = np.clip(np.asarray(aim.bending_angles)[list(segments)], -limits, limits)

    def residuals(angles: Array) -> Array:
        return aim.residuals(predicted(statics, state, segments, angles.tolist()))

    best = first
    before = residuals(first)
    try:
        found = least_squares(residuals, first, bounds=(-limits, limits), diff_step=STEP,
                              x_scale=0.1, xtol=PRECISION, ftol=PRECISION)
        if found.cost <= 0.5 * before @ before:
            best = found.x
    except StaticsError:  # on the way: the wanted angles themselves can be set
        pass
    return best, predicted(statics, state, segments, best.tolist())


@dataclass(frozen=True, eq=False)
class Step:
    """
    What is to be done next with a segment that is soft.

    move: None when the segment is where it should be locked.  change: rad by which it is to turn.
    error: how far the arm is from its aim now.  predicted: how far it will be after all that is
    left, m or rad as Aim.error.
    """

    move: Move | None
    change: float
    error: float
    predicted: float


def next_step(planner: Planner, state: Equilibrium, pulls: Sequence[float],
              segments: Sequence[int], aim: Aim, dead_band: float) -> Step:
    """
    Return the next step towards an aim.

    segments: 0-based, that are still to be locked, in this order; the first is soft.  dead_band: m
    of pull: less than friction lets through is not worth a motion.  Raises PlanError beyond a
    limit, or when no tendon holds the arm on the way.
    """
    first = segments[0]
    try:
        angles, after = angles_to_set(planner.statics, state, segments, aim)
        change = float(angles[0] - state.bending_angles[first])
        move = None
        if abs(change) > planner.settings.angle_tolerance:
            move, _ = planner.move(state, np.asarray(pulls, dtype=float), first, float(angles[0]))
            if np.abs(move.pulls - move.pulls[0]).max() <= dead_band:
                move = None
            elif move.duration < MIN_DURATION:
                move = replace(move, times=move.times * (MIN_DURATION / move.duration))
    except (StaticsError, PlanError) as error:
        raise PlanError(f'segment {first + 1}: {error}') from None
    return Step(move, change, aim.error(state), aim.error(after))


def worth_setting_again(planner: Planner, state: Equilibrium, pulls: Sequence[float],
                        segments: Sequence[int], aim: Aim, lock_in: float,
                        release_limit: float = inf) -> tuple[int, ...]:
    """
    Return the segments that are to be set once more; none where it would not help.

    pulls: (tendons,) of the motors, m.  segments: 0-based, in their order: the last ones of them,
    as many as pay off.  lock_in: standard deviation, rad, of the angle by which a segment bends
    when it is stiffened, which nothing foresees.  release_limit: m by which the tip may move when
    one of them is softened.
    """
    statics = planner.statics
    if not aim.on_tip and any(
            statics.chain.arm.segments[s].jam.ratio < LEAST_RATIO for s in segments):
        return ()
    now = aim.error(state)
    best: tuple[int, ...] = ()
    least = WORTH * now
    for first in range(len(segments) - 1, -1, -1):
        again = segments[first:]
        if release_limit < inf and _released(planner, state, pulls, again[0]) > release_limit:
            break
        try:
            _, after = angles_to_set(statics, state, again, aim)
        except StaticsError:
            continue
        left = float(np.hypot(aim.error(after), lock_in * _lever(state, again, aim)))
        if left < least:  # a longer list has to be better by a good part
            best, least = tuple(again), WORTH * left
    return best


def _released(planner: Planner, state: Equilibrium, pulls: Sequence[float], segment: int) -> float:
    """Return by how much the tip moves when a segment is softened, m; inf where nobody knows."""
    try:
        there = planner.softened(state, pulls, segment)
    except StaticsError:
        return inf
    return float(np.linalg.norm(there.tip[:2] - state.tip[:2]))


def _lever(state: Equilibrium, segments: Sequence[int], aim: Aim) -> float:
    """Return by how much the error grows with the angles of segments that are locked."""
    if not aim.on_tip:
        return 1.0
    # What the first ones do is made up for by the later ones, but for one direction.
    middles = (state.points[1::2, :2][:-1] + state.points[2::2, :2]) / 2.0
    levers = np.linalg.norm(state.tip[:2] - middles, axis=1)[list(segments)]
    return float(np.hypot(levers[-1], 0.5 * levers[-2])) if len(levers) > 1 else float(levers[0])
