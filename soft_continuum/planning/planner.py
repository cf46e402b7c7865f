# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Moves: tendon motions that bend a soft segment to its goal.

Segments are set from the base to the tip, one soft at a time (paper, IV-B).  The model, under
gravity, gives for every bending angle on the path the tendon that carries the arm and its pull;
the others follow with a little slack; for spatial arms it gives the pulls with the least tensions.
Without jamming all segments are soft and go to their goals at once.  ``timed`` makes a smooth
motion of such a path, within limits of speed and acceleration.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from math import ceil, sqrt
from typing import Any, TypeVar

import numpy as np

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.directions import bending_vectors, within_limits
from soft_continuum.mechanics.statics import Statics
from soft_continuum.planning.plans import Move, PlanError, Shape, WHOLE_ARM
from soft_continuum.planning.settings import MotionLimits, RunnerSettings

SLACK_DEVIATIONS = 2.0
"""Extra slack of tendons that do not carry, in standard deviations of their length."""
MAX_SOFTENING_TILT = 0.1
"""Largest tilt (rad) of a segment when it becomes soft, until its tendons hold it."""
Time = TypeVar('Time', float, Array)


@dataclass(frozen=True)
class PlanSettings(MotionLimits):
    """
    Limits and resolution of a plan.

    angle_step: rad between two points.  angle_tolerance: rad, a segment this close is not set
    again.  jamming: whether segments can be stiffened; else all are soft, and a shape is one move.
    full_vacuum: Pa below ambient at which jams are as described.
    """

    angle_step: float = np.radians(2.0)
    angle_tolerance: float = np.radians(0.1)
    jamming: bool = True
    full_vacuum: float = RunnerSettings.full_vacuum

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> 'PlanSettings':
        """Return the settings in the parameters of shape_sequencer."""
        low, high = values['pull_limits']
        return cls((low, high), values['tension_limit'], values['antagonist_slack'],
                   values['tendon_speed'], values['tendon_acceleration'], values['angle_step'],
                   values['angle_tolerance'], values['arm.jamming'], values['full_vacuum'])

    def with_slack_for(self, stddevs: Sequence[float] | Array) -> 'PlanSettings':
        """
        Return the same with more slack, for tendons whose lengths are estimated.

        stddevs: (tendons,) m, of their lengths.
        """
        more = SLACK_DEVIATIONS * float(np.max(stddevs))
        return replace(self, antagonist_slack=self.antagonist_slack + more)


class Planner:
    """
    Plans moves of one arm; states are those of its statics, a goal is as State.bending.

    statics: of the arm.
    """

    def __init__(self, arm: Arm, settings: PlanSettings,
                 abandoned: Callable[[], bool] = lambda: False,
                 offsets: Sequence[float] | None = None) -> None:
        """
        Prepare to plan for ``arm``.

        abandoned: whether the plan is no longer wanted.  offsets: (tendons,) m by which each
        tendon is pulled in beyond its motor position.
        """
        self.statics: Any = Statics(arm)
        self.settings = settings
        self._abandoned = abandoned
        self._offsets = np.zeros(len(arm.tendon_names)) if offsets is None else np.array(offsets)

    def jammed(self, state: Any, pulls: Sequence[float] | Array,
               vacuum: Sequence[float] | Array | None = None) -> Any:
        """
        Return the state in which every segment is jammed, with parts of the full vacuum.

        pulls: (tendons,) of the motors, m.  Raises StaticsError.
        """
        count = self.statics.chain.segments
        return self.statics.solve(state, np.asarray(pulls) + self._offsets, [False] * count,
                                  vacuum=[1.0] * count if vacuum is None else list(vacuum))

    def goals_of(self, shape: Shape, shift: Array | None = None
                 ) -> Sequence[tuple[int, Array, str]]:
        """
        Return the segments to set in order, their goals, and the prefixes of error messages.

        shift: added to the goals, as State.bending, rad; they stay within the limits of the arm.
        """
        arm = self.statics.chain.arm
        goal = bending_vectors(arm, shape.bending_angles, shape.bending_directions)
        if shift is not None:
            goal = within_limits(goal + shift, arm.bending_angle_limits)
        if not self.settings.jamming:
            return [(WHOLE_ARM, goal, '')]
        texts = [f'segment {i} to {np.degrees(angle):.1f} degrees'
                 for i, angle in enumerate(shape.bending_angles, start=1)]
        if shape.bending_directions:
            texts = [f'{text} in the direction {np.degrees(direction):.1f} degrees'
                     for text, direction in zip(texts, shape.bending_directions, strict=True)]
        return [(i, goal, f'{text}: ') for i, text in enumerate(texts)]

    def away(self, state: Any, segment: int, goal: Array) -> float:
        """Return the error of a segment, or of the worst of WHOLE_ARM, from its goal, rad."""
        left = np.linalg.norm(goal - state.bending, axis=1)
        return float(left[self._soft(segment)].max())

    def move(self, state: Any, start: Array, segment: int, goal: Array) -> tuple[Move, Any]:
        """
        Plan one segment (0-based), or WHOLE_ARM; return the move and the state at its end.

        start: (tendons,) the present pulls of the motors, m.  Only the bending of soft segments
        counts in the goal; the path to it is straight.  Raises PlanError beyond a limit,
        StaticsError if no tendon holds the segment at its goal.
        """
        bent = self.held(state, start, segment)
        if bent.jumped and np.abs(bent.bending - state.bending).max() > MAX_SOFTENING_TILT:
            raise PlanError('the arm would snap to another equilibrium when this segment softens, '
                            'because its tendons do not hold it; pull them in, or straighten the '
                            'arm by `soft_continuum home`')
        present, change = bent.bending, self._change(bent, segment, goal)
        sliding = self.statics.sliding_towards(change)
        steps = max(1, ceil(np.linalg.norm(change, axis=1).max() / self.settings.angle_step))
        points, tension = [start], float(bent.tensions.max())
        for part in np.arange(1, steps + 1) / steps:
            self.check_wanted()
            held = self.statics.hold(bent, present + part * change, self._soft(segment),
                                     sliding=sliding)
            bent = held.state
            tension = max(tension, float(bent.tensions.max()))
            points.append(held.eased(self.settings.antagonist_slack) - self._offsets)
        pulls = np.array(points)
        self.check_limits(pulls, tension)
        end = self.held(bent, pulls[-1], segment, sliding)
        times, pulls = timed(pulls, self.settings.speed, self.settings.acceleration)
        return Move(segment, goal, times, pulls, tension, sliding), end

    def bent(self, state: Any, segment: int, goal: Array) -> Any:
        """
        Return the state at the end of a move, without its path.

        segment, goal: as of ``move``.  Raises StaticsError.
        """
        sliding = self.statics.sliding_towards(self._change(state, segment, goal))
        return self.statics.hold(state, goal, self._soft(segment), sliding=sliding).state

    def _change(self, state: Any, segment: int, goal: Array) -> Array:
        """Return the change of bending of soft segments to a goal, as State.bending."""
        chosen = self.statics.chain.arm.bending_axes & np.array(self._soft(segment))[:, None]
        return np.where(chosen, goal - state.bending, 0.0)

    def until(self, spent: Callable[[], bool]) -> 'Planner':
        """
        Return the same planner, whose plans are abandoned also once a budget is spent.

        spent: called before every state that is solved.
        """
        limited = copy(self)
        limited._abandoned = lambda: self._abandoned() or spent()
        return limited

    def held(self, state: Any, pulls: Sequence[float] | Array, segment: int,
             sliding: Sequence[int] = ()) -> Any:
        """
        Return the state at which pulls hold the arm while a segment (0-based) is soft.

        state: to continue from.  pulls, sliding: of the motors, m, as of a Move.  Raises
        StaticsError.
        """
        self.check_wanted()
        slides = {'sliding': sliding} if sliding else {}
        return self.statics.solve(state, np.asarray(pulls) + self._offsets, self._soft(segment),
                                  vacuum=state.vacuum or None, **slides)

    def _soft(self, segment: int) -> list[bool]:
        """Return which segments are soft while one is set."""
        return soft_segments(segment, self.statics.chain.segments)

    def check_wanted(self) -> None:
        """Raise PlanError once the plan is abandoned."""
        if self._abandoned():
            raise PlanError('the plan was abandoned')

    def check_limits(self, pulls: Array, tension: float) -> None:
        """Refuse pulls (points, tendons) m, and a tension, N, that are beyond the limits."""
        settings = self.settings
        low, high = settings.pull_limits
        if pulls.min() < low or pulls.max() > high:
            raise PlanError(
                f'needs tendon pulls from {pulls.min():.4f} to {pulls.max():.4f} m; '
                f'pull_limits: {low:g} to {high:g} m', 'pull_limits')
        if tension > settings.tension_limit:
            raise PlanError(f'needs a tendon tension of {tension:.1f} N; '
                            f'tension_limit: {settings.tension_limit:g} N', 'tension_limit')


def soft_segments(segment: int, count: int) -> list[bool]:
    """Return which of ``count`` segments are soft while one (0-based), or WHOLE_ARM, is set."""
    return [segment in (i, WHOLE_ARM) for i in range(count)]


# Smooth motion along a path.


def minimum_jerk(t: Time) -> Time:
    """
    Return the completed part of the path at a part of the time, both 0 to 1.

    The minimum-jerk profile, from rest to rest (Flash and Hogan, 1985).
    """
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)


def minimum_jerk_duration(length: float, speed: float, acceleration: float) -> float:
    """Return the time (s) for a distance (m) within a speed (m/s) and an acceleration (m/s^2)."""
    # Their peaks: 15/8 and 10/sqrt(3) of the mean.
    return max(15 / 8 * length / speed, sqrt(10 / sqrt(3) * length / acceleration))


def timed(points: Array, speed: float, acceleration: float,
          interval: float = 0.05) -> tuple[Array, Array]:
    """
    Return times (k,) s and pulls (k, tendons) m of a smooth motion through points (m, tendons).

    The path through the points is smooth in space and follows a minimum-jerk profile in time,
    just slow enough to keep each tendon within ``speed`` (m/s) and ``acceleration`` (m/s^2).
    """
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points, axis=0)).max(axis=1))])
    keep = np.concatenate([[True], np.diff(path) > 1e-12])
    path, points = path[keep], points[keep]
    total = path[-1]
    if total == 0.0:
        return np.array([0.0]), points[:1].copy()
    smooth = monotone_cubic(path, points)
    duration = minimum_jerk_duration(total, speed, acceleration)
    for _ in range(50):
        times = np.linspace(0.0, duration, max(3, ceil(duration / interval) + 1))
        t = times / duration
        pulls: Array = smooth(total * minimum_jerk(t))
        speeds = np.diff(pulls, axis=0) / times[1]
        accelerations = np.diff(speeds, axis=0, prepend=0.0, append=0.0) / times[1]
        excess = max(np.abs(speeds).max() / speed,
                     sqrt(np.abs(accelerations).max() / acceleration))
        if excess <= 1.0:
            break
        duration *= max(1.01, excess)  # corners of the path, which the profile ignores
    pulls[0], pulls[-1] = points[0], points[-1]
    return times, pulls


def monotone_cubic(x: Array, y: Array) -> Callable[[Array], Array]:
    """
    Return the cubic curve through points with extrema only at the points.

    SciPy has it too, but importing that would take 20 MB and a second at every start.

    x: (k,), rising, k of at least 2.  y: (k, n).  The curve takes (m,) and returns (m, n).
    F. N. Fritsch and J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300; at the ends as SciPy's
    PchipInterpolator.
    """
    h = np.diff(x)[:, None]
    slopes = np.diff(y, axis=0) / h
    d = np.broadcast_to(slopes[0], y.shape).copy()
    if len(h) > 1:
        before, after = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
        with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
            mean = (before + after) / (before / slopes[:-1] + after / slopes[1:])
        d[1:-1] = np.where(slopes[:-1] * slopes[1:] > 0.0, mean, 0.0)
        d[0] = _end_slope(h[0], h[1], slopes[0], slopes[1])
        d[-1] = _end_slope(h[-1], h[-2], slopes[-1], slopes[-2])
    bend = (d[:-1] + d[1:] - 2 * slopes) / h
    rise = (slopes - d[:-1]) / h - bend

    def curve(at: Array) -> Array:
        i = np.clip(np.searchsorted(x, at, side='right') - 1, 0, len(h) - 1)
        t = (at - x[i])[:, None]
        values: Array = y[i] + t * (d[i] + t * (rise[i] + t * bend[i] / h[i]))
        return values
    return curve


def _end_slope(h: Array, next_h: Array, slope: Array, next_slope: Array) -> Array:
    end = ((2 * h + next_h) * slope - h * next_slope) / (h + next_h)
    turns = (slope * next_slope < 0.0) & (np.abs(end) > 3 * np.abs(slope))
    return np.where(end * slope <= 0.0, 0.0, np.where(turns, 3 * slope, end))
