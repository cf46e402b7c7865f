# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Inverse problems: pulls for angles, angles for a tip pose, the workspace.

An arm is set segment by segment (paper, IV-B): each is bent while the others are stiff.  None of
these inverse problems is in the paper.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
import scipy

from soft_continuum.mechanics import constant_curvature
from soft_continuum.mechanics._checks import (
    check_start,
    finite,
    real_array,
    refuse_friction,
    segment_order,
    soft_flags,
    whole,
)
from soft_continuum.mechanics.chain import Array, Equilibrium, LEFT, RIGHT
from soft_continuum.mechanics.sensitivity import Linearisation
from soft_continuum.mechanics.spatial.inverse import set_shape as set_bending
from soft_continuum.mechanics.statics import SLACK, Statics, StaticsError

METRES_PER_RADIAN = 0.1  # what a tangent that is wanted as well counts
SAME_ANGLE = Statics.precision[0]  # rad: a segment this close has its angle
GUESSES = 8  # to either side, of all segments: the best of them that are fitted
MAX_EVALUATIONS = 40  # of a fit by constant curvature
NEAR = 0.05  # m: tips by constant curvature this close may be reached by the statics
EXACT, OUT_OF_REACH = 1e-14, 1e-8  # relative tolerances of fits by the statics
MAX_FITS = 60  # evaluations of such a fit
Fit = TypeVar('Fit')

SAME_COST = 1e-12  # rad^2 or m^2: fits this close are equally good
REACHED = 1e-6  # m: a tip this close is where it was wanted


@dataclass(frozen=True, eq=False)
class AngleFit:
    """
    Pulls that bring soft segments closest to their bending angles.

    pulls: (2,) m, SLACK for the tendon that does not carry.  error: (segments,) rad, reached
    minus wanted; nan where nothing was wanted.
    """

    state: Equilibrium
    pulls: Array
    error: Array


def pulls_for_angles(statics: Statics, start: Equilibrium, bending_angles: ArrayLike,
                     soft: Sequence[bool]) -> AngleFit:
    """
    Return the pull of one tendon at which the soft segments come closest to given angles.

    bending_angles: (segments,) rad, nan for a segment that may take any.  One pair of tendons
    bends all soft segments together: it sets one angle exactly; for more, the sum of the squared
    errors is least.  The tendon that does better carries, the other is slack.  Followed from
    ``start``; raises StaticsError where no equilibrium exists.
    """
    refuse_friction(statics.chain.tendon.friction, 'pulls_for_angles')
    check_start(start, Equilibrium)
    wanted = real_array(bending_angles, 'bending_angles must be numbers (rad), or nan')
    soft = soft_flags(soft, statics.chain.segments)
    chosen = np.flatnonzero(np.isfinite(wanted) & soft) if wanted.shape == (len(soft),) else None
    if chosen is None or not chosen.size:
        raise ValueError('bending_angles must have one number (or nan) for each segment and one '
                         f'for a soft segment at least; given: {bending_angles!r}')
    full = np.where(np.isfinite(wanted), wanted, 0.0)
    locked = start.bending_angles
    guess = constant_curvature.pulls(
        statics.chain.arm, np.where(np.asarray(soft, dtype=bool), full, locked).tolist())
    first = (RIGHT, LEFT) if wanted[chosen].sum() >= 0.0 else (LEFT, RIGHT)
    fits = [_fit_pull(statics, start, wanted, chosen, soft, tendon, guess[tendon])
            for tendon in first]
    found = [fit for fit in fits if isinstance(fit, AngleFit)]
    if not found:
        raise next(fit for fit in fits if isinstance(fit, StaticsError))
    return _best(found, lambda fit: float(np.nansum(fit.error**2)))


def _best(fits: Sequence[Fit], cost: Callable[[Fit], float]) -> Fit:
    """Return the first of the fits that are best: rounding must not decide between two."""
    least = min(cost(fit) for fit in fits)
    return next(fit for fit in fits if cost(fit) <= least + SAME_COST)


def _fit_pull(statics: Statics, start: Equilibrium, wanted: Array, chosen: NDArray[np.intp],
              soft: Sequence[bool], tendon: int, guess: float) -> AngleFit | StaticsError:
    """Fit the pull of one tendon, with the other slack."""
    per_segment = statics.chain.joints_per_segment

    def both(pull: Array) -> Array:
        pulls = np.full(2, SLACK)
        pulls[tendon] = pull[0]
        return pulls

    def solve(pull: Array) -> Equilibrium:
        return statics.solve(start, both(pull), soft, vacuum=start.vacuum or None)

    def error(pull: Array) -> Array:
        state = solve(pull)
        rest: Array = (state.bending_angles - wanted)[chosen]
        return rest

    def slope(pull: Array) -> Array:
        state = solve(pull)
        angles = Linearisation(statics, state).pulls().joint_angles[:, tendon]
        rows: Array = angles.reshape(-1, per_segment).sum(axis=1)[chosen][:, None]
        return rows

    # A slack tendon has no slope to follow: one of the guesses bends each segment its way.
    side = 1.0 if tendon == RIGHT else -1.0
    fits, failed = [], None
    for begin in dict.fromkeys([guess, *(
            _single(statics, start, s, side * abs(wanted[s]), tendon) for s in chosen)]):
        try:
            fits.append(scipy.optimize.least_squares(
                error, [begin], jac=slope, xtol=1e-14, ftol=1e-14, gtol=1e-14, x_scale=0.01))
        except StaticsError as failure:
            failed = failure
    if not fits:
        assert failed is not None
        return failed
    fit = _best(fits, lambda one: float(one.cost))
    state = solve(fit.x)
    rest = np.full(statics.chain.segments, np.nan)
    rest[chosen] = error(fit.x)
    return AngleFit(state, both(fit.x), rest)


def _single(statics: Statics, start: Equilibrium, segment: int, angle: float, tendon: int
            ) -> float:
    """Return the pull by constant curvature that bends one segment from ``start`` on."""
    angles = start.bending_angles
    angles[segment] = angle
    return constant_curvature.pulls(statics.chain.arm, angles.tolist())[tendon]


def set_shape(statics: Statics, bending_angles: Sequence[float],
              start: Equilibrium | None = None, order: Sequence[int] | None = None
              ) -> Equilibrium:
    """
    Return the arm with its segments set one after the other, base first unless ``order`` says so.

    bending_angles: (segments,) rad, of which only those of the segments in ``order`` count.  For
    the rest see spatial.set_shape, which takes bending about x and y, of any arm.
    """
    refuse_friction(statics.chain.tendon.friction, 'set_shape')
    segments = statics.chain.segments
    wanted = real_array(bending_angles, 'bending_angles must be finite numbers (rad)')
    if wanted.shape != (segments,) or not np.isfinite(
            wanted[segment_order(order, segments)]).all():
        raise ValueError(f'bending_angles must be one finite number in rad for each of the '
                         f'{segments} segments; given: {bending_angles!r}')
    return set_bending(statics, np.column_stack([np.zeros(segments), wanted]), start, order)


def _begin(statics: Statics, start: Equilibrium | None) -> Equilibrium:
    """Return where to begin: by default at the straight arm."""
    if start is None:
        return statics.chain.straight()
    check_start(start, Equilibrium)
    return start


@dataclass(frozen=True, eq=False)
class TipFit:
    """
    Bending angles that bring the tip where it is wanted, or as near as the arm reaches.

    bending_angles: (segments,) rad.  state: the arm with these angles.  tip: (x, z, tangent) of
    the top of the tip disc, m and rad.  distance: m from the tip to where it was wanted.
    softened: the segments (0-based) that must be softened, base first.
    """

    bending_angles: Array
    state: Equilibrium
    tip: Array
    distance: float
    softened: tuple[int, ...]

    @property
    def reached(self) -> bool:
        """Whether the tip is where it was wanted."""
        return self.distance <= REACHED


def angles_for_tip(statics: Statics, x: float, z: float, tangent: float | None = None,
                   start: Equilibrium | None = None) -> TipFit:
    """
    Return bending angles within the limits whose tip is at (x, z), m, with the fewest softenings.

    tangent: angle of the tip wanted as well, rad; it counts as 0.1 m per rad where both cannot be
    had.  start: the present shape (default: straight); segments that keep their angle need not be
    softened.  Out of reach, a tip is returned that no small change brings nearer, with its
    distance: that of the segments which come nearest by constant curvature.
    """
    refuse_friction(statics.chain.tendon.friction, 'angles_for_tip')
    given = (x, z, 0.0 if tangent is None else tangent)
    if not all(finite(number) for number in given):
        raise ValueError(f'the tip wanted must be finite numbers; given: {x}, {z}, {tangent}')
    begin = _begin(statics, start)
    present = begin.bending_angles
    wanted = (x, z, tangent)
    best: TipFit | None = None
    far: list[tuple[float, tuple[int, ...], Array]] = []
    for count in range(statics.chain.segments + 1):
        for segments in combinations(range(statics.chain.segments), count):
            near = _by_arcs(statics, present, segments, wanted)
            if near is None:
                continue
            if near[0] > NEAR:
                far.append((near[0], segments, near[1]))
                continue
            fit = _fit_tip(statics, begin, present, segments, wanted, near[1])
            if fit is not None and (best is None or _tip_error(fit, tangent)
                                    < _tip_error(best, tangent) - REACHED):
                best = fit
        if best is not None and best.reached and _turned(best, tangent) < 1e-4:
            break
    if best is None:
        far.sort(key=lambda one: round(one[0] / REACHED))  # of equal ones the fewest
        best = next((fit for _, segments, some in far if (fit := _fit_tip(
            statics, begin, present, segments, wanted, some, OUT_OF_REACH)) is not None), None)
    if best is None:
        raise StaticsError('no tendon holds the segments on the way to that tip', begin)
    return best


def _tip_error(fit: TipFit, tangent: float | None) -> float:
    return float(np.hypot(fit.distance, METRES_PER_RADIAN * _turned(fit, tangent)))


def _turned(fit: TipFit, tangent: float | None) -> float:
    return 0.0 if tangent is None else abs(float(fit.tip[2]) - tangent)


Goal = tuple[float, float, float | None]
"""Of a tip: x, z, m, and its tangent, rad, if that is wanted too."""


def _missed(tip: Array, wanted: Goal) -> Array:
    """Return by how much a tip misses a goal, (2 or 3,), m."""
    away = [tip[0] - wanted[0], tip[1] - wanted[1]]
    if wanted[2] is not None:
        away.append(METRES_PER_RADIAN * (tip[2] - wanted[2]))
    return np.array(away)


def _by_arcs(statics: Statics, present: Array, segments: tuple[int, ...], wanted: Goal
             ) -> tuple[float, Array] | None:
    """Fit the angles of some segments by constant curvature; return the error, m, and them."""
    all_limits = statics.chain.arm.bending_angle_limits
    beyond = np.abs(present) > all_limits + SAME_ANGLE
    if beyond[[s not in segments for s in range(len(present))]].any():
        return None
    limits = all_limits[list(segments)]

    def missed(some: Array) -> Array:
        angles = present.copy()
        angles[list(segments)] = some
        return _missed(constant_curvature.poses(statics.chain.arm, angles.tolist())[-1], wanted)

    if not segments:
        return float(np.linalg.norm(missed(np.zeros(0)))), np.zeros(0)
    side = -0.6 if (wanted[0], wanted[2] or 0.0) < (0.0, 0.0) else 0.6
    guesses = np.array(np.meshgrid(*[[side, -side]] * len(segments))).reshape(
        len(segments), -1).T * limits
    if len(guesses) > GUESSES:
        errors = [np.linalg.norm(missed(guess)) for guess in guesses]
        guesses = guesses[np.argsort(errors, kind='stable')[:GUESSES]]
    arcs = [scipy.optimize.least_squares(
        missed, guess, bounds=(-limits, limits), max_nfev=MAX_EVALUATIONS) for guess in guesses]
    arc = _best(arcs, lambda fit: float(fit.cost))
    return float(np.linalg.norm(missed(arc.x))), np.clip(arc.x, -0.999 * limits, 0.999 * limits)


def _fit_tip(statics: Statics, begin: Equilibrium, present: Array, segments: tuple[int, ...],
             wanted: Goal, some: Array, tolerance: float = EXACT) -> TipFit | None:
    """Fit the angles of some segments by the model, from those by constant curvature on."""
    all_limits = statics.chain.arm.bending_angle_limits
    limits = all_limits[list(segments)]

    def shape(values: Array) -> Equilibrium:
        angles = present.copy()
        angles[list(segments)] = values
        return set_shape(statics, angles.tolist(), begin, segments)

    try:
        if segments:
            some = scipy.optimize.least_squares(
                lambda values: _missed(shape(values).tip, wanted), some, bounds=(-limits, limits),
                xtol=100.0 * tolerance, ftol=tolerance, gtol=tolerance, diff_step=1e-5,
                max_nfev=MAX_FITS).x
        state = shape(some)
    except StaticsError:
        return None
    tip = state.tip
    angles = state.bending_angles  # those kept may have given way
    if np.any(np.abs(angles) > all_limits + 2.0 * SAME_ANGLE):
        return None
    distance = float(np.hypot(tip[0] - wanted[0], tip[1] - wanted[1]))
    return TipFit(angles, state, tip, distance, segments)


def workspace(statics: Statics, per_segment: int = 9) -> tuple[Array, Array]:
    """
    Return tips that the arm reaches when it is set base first, and their bending angles.

    tips: (m, 3), x, z in m and tangent in rad.  angles: (m, segments) rad, ``per_segment`` values
    between the limits of every segment.  Shapes that no tendon holds are left out.
    """
    refuse_friction(statics.chain.tendon.friction, 'the workspace')
    if not whole(per_segment) or per_segment < 2:
        raise ValueError(
            f'per_segment is {per_segment!r}; a whole number, at least 2, is needed')
    from soft_continuum.mechanics.spatial.grid import bends, set_each
    chain = statics.chain
    found = [state for state, _ in set_each(
        statics, [bends(chain.arm, s, per_segment, 2) for s in range(chain.segments)])]
    tips = np.array([s.tip for s in found]).reshape(-1, 3)
    angles = np.array([s.bending_angles for s in found])
    return tips, angles.reshape(-1, chain.segments)
