# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Bending for a tip position or pose of an arm set segment by segment.

Constant curvature is fitted to the tip.  The error of the statics is then subtracted from the
fitted tip until it converges.  Where this fails, near or beyond the edge of the workspace, the
statics are fitted, which takes longer.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics import constant_curvature
from soft_continuum.mechanics._checks import real_array
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import check_start, Equilibrium
from soft_continuum.mechanics.directions import own_axes, STRAIGHT, within_limits
from soft_continuum.mechanics.inverse import SAME_BENDING, set_shape
from soft_continuum.mechanics.statics import Statics, StaticsError

METRES_PER_RADIAN = 0.1  # what an orientation that is wanted as well counts
REACHED = 1e-6  # m: a tip this close is where it was wanted
TURNED = 1e-4  # rad: an orientation this close is the one wanted
BEYOND = 10.0  # m per rad by which a bending angle is beyond its limit
GUESSES, REFINED = 1000, 4  # shapes drawn, and the best of them that are fitted
HINGED = 0.6  # of its limit, to which a hinge is bent at first
MAX_EVALUATIONS = 60
FITTED = 1e-4  # m: a tip by constant curvature this close is as good as reached
NEAR = 0.05  # m: tips by constant curvature this close may be reached by the statics
FAR = 0.2  # m: so far out of reach the nearest tip need not be known to a millimetre
MAX_ROUNDS, MAX_FITS = 20, 16
MAX_SHAPES = 150  # that are set for one tip, so that no search is without an end
ROUGH, EXACT = 1e-6, 1e-13  # relative tolerances of fits by constant curvature
DIFFERENCE = 1e-5  # rad, of bending
INSIDE = 0.999  # of its limit, at which a fit may begin
FARTHEST = 1e4  # m: beyond, numbers have no digits left for an arm
SETTLED = 1e-8  # m: nearer need no tip be
SLOW = 0.9  # of the error before: it hardly falls any more


@dataclass(frozen=True, eq=False)
class TipFit:
    """
    Bending that brings the tip to its goal, or near.

    bending: (segments, 2) rad.  state: the arm with it.  distance: m from the tip to the goal.
    turn: rad from its orientation to the goal orientation, 0 without one.  softened: the segments
    (0-based) that must be softened, base first.
    """

    bending: Array
    state: Any
    distance: float
    turn: float
    softened: tuple[int, ...]

    @property
    def reached(self) -> bool:
        """Whether the tip is at its goal."""
        return self.distance <= REACHED


def bending_for_tip(statics: Statics, position: ArrayLike,
                    orientation: ArrayLike | None = None,
                    start: Any = None) -> TipFit:
    """
    Return bending within the limits that brings the tip to a position, with fewest softenings.

    position: (3,) m, of the top of the last disc in base_link.  orientation: (3, 3) of that disc,
    optional; weighted by 0.1 m per rad where both cannot be reached.  start: the present shape
    (default: straight); segments that keep their bending need not be softened.  Out of reach,
    the result is a local minimum of the distance; that takes seconds, and at most MAX_SHAPES
    settings of the arm.

    Raises StaticsError where no tendon holds the segments on the way, ValueError for other shapes
    or numbers.
    """
    goal = real_array(position, 'the tip wanted must be x, y and z in m')
    turn = None if orientation is None else real_array(
        orientation, 'the orientation wanted must be a (3, 3) rotation matrix')
    if goal.shape != (3,) or not np.all(np.abs(goal) < FARTHEST):
        raise ValueError('the tip wanted must be x, y and z in m, each within '
                         f'{FARTHEST:g} m; given: {position!r}')
    if turn is not None and (turn.shape != (3, 3) or not np.allclose(turn.T @ turn, np.eye(3))
                             or np.linalg.det(turn) < 0.0):
        raise ValueError('the orientation wanted must be a (3, 3) rotation matrix; given: '
                         f'{orientation!r}')
    straight = statics.chain.straight()
    begin = straight if start is None else start
    check_start(begin)
    best: TipFit | None = None
    far: list[tuple[float, _Fit]] = []
    tries = iter(range(MAX_SHAPES))
    for count in range(statics.chain.segments + 1):
        for segments in combinations(range(statics.chain.segments), count):
            search = _Fit(statics, begin, segments, goal, turn, tries)
            if not search.within_limits():
                continue
            error = search.by_arcs()
            if error > NEAR:
                far.append((error, search))
            else:
                best = _better(best, search.run())
        if best is not None and best.reached and best.turn < TURNED:
            return best
    if best is None:
        far.sort(key=lambda one: round(one[0] / REACHED))  # the fewest if equal
        best = next((fit for _, search in far if (fit := search.run()) is not None), None)
    if best is None:
        raise StaticsError('no tendon holds the segments on the way to that tip', begin)
    return _Fit(statics, begin, best.softened, goal, turn, tries).by_statics(best)


def _better(one: TipFit | None, other: TipFit | None) -> TipFit | None:
    """Return the fit with the smaller error, or the first if equal."""
    if one is None or (other is not None and _error(other) < _error(one) - REACHED):
        return other
    return one


def _error(fit: TipFit) -> float:
    return float(np.hypot(fit.distance, METRES_PER_RADIAN * fit.turn))


class _Fit:
    """Bending of some segments for one tip."""

    def __init__(self, statics: Statics, begin: Equilibrium,
                 segments: Sequence[int], goal: Array, turn: Array | None,
                 tries: Iterator[int]) -> None:
        arm, self.tries = statics.chain.arm, tries
        self.statics, self.begin, self.segments = statics, begin, tuple(segments)
        self.goal, self.turn = goal, turn
        self.present = begin.bending
        self.limits = arm.bending_angle_limits
        self.free = np.zeros_like(self.present, dtype=bool)
        self.free[list(segments)] = arm.bending_axes[list(segments)]

    def within_limits(self) -> bool:
        """Return whether the segments that keep their bending are within their limits."""
        kept = [s not in self.segments for s in range(len(self.limits))]
        beyond = np.linalg.norm(self.present, axis=1) > self.limits + SAME_BENDING
        return not np.any(beyond & kept)

    def by_arcs(self) -> float:
        """Fit the bending by constant curvature; return the error, m."""
        guesses = self.guesses()
        if len(guesses) > 2 * REFINED:
            errors = np.linalg.norm(self.missed(guesses, self.goal, self.turn), axis=1)
            guesses = guesses[np.argsort(errors, kind='stable')[:REFINED]]
        self.bending, least = self.present, np.inf
        for guess in guesses:
            bending, error = self.arc(guess, self.goal, self.turn, ROUGH)
            if error < least - ROUGH:
                self.bending, least = bending, error
            if least < FITTED:
                break
        return least

    def run(self) -> TipFit | None:
        """Return the fit of the statics near the arc fit; None where no tendon holds it."""
        try:
            fit = self.correct(self.bending) if self.segments else self.fit(self.begin)
        except StaticsError:
            return None
        return fit if self.allowed(fit) else None  # segments that are kept may give way

    def allowed(self, fit: TipFit) -> bool:
        """Return whether all segments of a fit are within their limits."""
        return bool(np.all(np.linalg.norm(fit.bending, axis=1) <= self.limits
                           + 2.0 * self.statics.precision[1]))

    def guesses(self) -> Array:
        """
        Return initial bendings (m, segments, 2), rad, drawn uniformly within the limits.

        They turn and are mirrored with the arm.  Hinges about y are bent to either side, first to
        that of the goal.
        """
        if not self.free.any():
            return np.array(self.present[None])
        if not self.free[:, 0].any():
            some = list(self.segments)
            side = -HINGED if (self.goal[0], self._leant()) < (0.0, 0.0) else HINGED
            sides = np.stack(np.meshgrid(*[[side, -side]] * len(some)), axis=-1)
            found = np.repeat(self.present[None], 2**len(some), axis=0)
            found[:, some, 1] = sides.reshape(-1, len(some)) * self.limits[some]
            return found
        draw = np.random.default_rng(0)
        size = np.sqrt(draw.uniform(size=(GUESSES, len(self.limits)))) * self.limits
        way = draw.uniform(0.0, 2.0 * np.pi, size.shape)
        drawn = np.stack([size * np.cos(way), size * np.sin(way)], axis=-1)
        return np.where(self.free, drawn @ own_axes(self.statics.chain.arm), self.present)

    def _leant(self) -> float:
        """Return the tilt of the goal towards x as a sine; 0 without an orientation."""
        return 0.0 if self.turn is None else float(self.turn[0, 2])

    def missed(self, bending: Array, goal: Array, turn: Array | None) -> Array:
        """Return the errors of tips by constant curvature, (..., 3 or 6), m."""
        tips, turns = constant_curvature.tips(self.statics.chain.arm, bending)
        away: Array = tips - goal
        if turn is None:
            return away
        turned = Rotation.from_matrix((turn.T @ turns).reshape(-1, 3, 3))
        return np.concatenate(
            [away, METRES_PER_RADIAN * turned.as_rotvec().reshape(away.shape)], axis=-1)

    def coordinates(self, near: Array) -> tuple[Array, Callable[[Array], Array]]:
        """
        Return the coordinates (k,) of a bending (segments, 2), and the bending of others (..., k).

        Those of a segment are across its bending and along it, and turn and are mirrored with the
        arm; a hinge has its own axes.  What is not free stays as it is.
        """
        own = own_axes(self.statics.chain.arm)
        sizes = np.linalg.norm(near, axis=1, keepdims=True)
        along = np.where(sizes > STRAIGHT, near / np.maximum(sizes, STRAIGHT), own[1])
        across = np.linalg.det(own) * along[:, ::-1] * (1.0, -1.0)
        axes = np.stack([across, along], axis=1)
        axes[~self.free.all(axis=1)] = np.eye(2)

        def bent(values: Array) -> Array:
            given = np.zeros((*values.shape[:-1], *near.shape))
            given[..., self.free] = values
            return np.where(self.free, np.einsum('...si,sij->...sj', given, axes), near)

        return np.einsum('sj,sij->si', near, axes)[self.free], bent

    def arc(self, guess: Array, goal: Array, turn: Array | None, tolerance: float
            ) -> tuple[Array, float]:
        """Return bending within the limits by constant curvature, and the error, m."""
        some = list(self.segments)
        begin, bent = self.coordinates(guess)
        unknown = len(begin)
        steps = DIFFERENCE * np.concatenate([np.eye(unknown), -np.eye(unknown)])

        def left(values: Array) -> Array:
            bending = bent(values)
            over = np.linalg.norm(bending[..., some, :], axis=-1) - self.limits[some]
            return np.concatenate([self.missed(bending, goal, turn),
                                   BEYOND * np.maximum(over, 0.0)], axis=-1)

        def jacobian(values: Array) -> Array:
            more, less = np.split(left(values + steps), 2)
            found: Array = (more - less).T / (2.0 * DIFFERENCE)
            return found

        bending = guess.copy()
        if unknown:
            bending = bent(least_squares(left, begin, jacobian, xtol=tolerance, ftol=tolerance,
                                         gtol=tolerance, max_nfev=MAX_EVALUATIONS).x)
        bending[some] = within_limits(bending[some], self.limits[some])
        return bending, float(np.linalg.norm(self.missed(bending, goal, turn)))

    def correct(self, bending: Array) -> TipFit:
        """Return the fit of the statics near a constant-curvature fit."""
        arm, goal, turn, best = self.statics.chain.arm, self.goal, self.turn, None
        for _ in range(MAX_ROUNDS):
            try:
                fit = self.set(bending)
            except StaticsError:
                if best is None:
                    raise
                break
            state = fit.state
            before = np.inf if best is None else _error(best)
            if _error(fit) < before:
                best = fit
            if _error(fit) < SETTLED or _error(fit) > SLOW * before:  # there, or out of reach
                break
            tip, turned = constant_curvature.tips(arm, bending)
            goal = self.goal - (state.poses[-1, :3] - tip)
            if self.turn is not None:
                turn = turned @ state.rotations[-1].T @ self.turn
            bending, _ = self.arc(bending, goal, turn, EXACT)
        assert best is not None
        return best

    def by_statics(self, near: TipFit) -> TipFit:
        """Return the fit of the statics from a nearby fit, by finite differences of solves."""
        best = near
        begin, bent = self.coordinates(np.where(self.free, near.bending, self.present))

        def left(values: Array) -> Array:
            nonlocal best
            bending = bent(values)
            fit = self.set(bending)
            over = np.linalg.norm(bending, axis=1) - self.limits
            if over.max() <= SAME_BENDING and self.allowed(fit) and _error(fit) < _error(best):
                best = fit
            away = fit.state.poses[-1, :3] - self.goal
            if self.turn is not None:
                away = np.concatenate([away, METRES_PER_RADIAN * Rotation.from_matrix(
                    self.turn.T @ fit.state.rotations[-1]).as_rotvec()])
            return np.concatenate([away, BEYOND * np.maximum(over, 0.0)])

        def jacobian(values: Array) -> Array:
            here = left(values)
            return np.column_stack([(left(values + step) - here) / DIFFERENCE
                                    for step in DIFFERENCE * np.eye(len(values))])

        if not self.segments or (best.reached and best.turn < TURNED) or _error(best) > FAR:
            return best
        most = np.broadcast_to(self.limits[:, None], self.free.shape)[self.free]
        with suppress(StaticsError):  # what was found before that stays
            least_squares(left, np.clip(begin, -INSIDE * most, INSIDE * most), jacobian,
                          bounds=(-most, most), xtol=1e-9, ftol=1e-9, gtol=1e-12,
                          max_nfev=MAX_FITS)
        return best

    def set(self, bending: Array) -> TipFit:
        """Return the fit of the segments set to a bending; raises StaticsError."""
        if next(self.tries, None) is None:
            raise StaticsError(f'no nearer tip was found with {MAX_SHAPES} shapes', self.begin)
        return self.fit(set_shape(self.statics, bending, self.begin, self.segments))

    def fit(self, state: Any) -> TipFit:
        """Return a state as a fit."""
        turn = 0.0 if self.turn is None else float(
            Rotation.from_matrix(self.turn.T @ state.rotations[-1]).magnitude())
        return TipFit(state.bending, state, float(np.linalg.norm(state.poses[-1, :3] - self.goal)),
                             turn, self.segments)
