# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Pulls for the bending of soft segments with least tension, and shapes set segment by segment.

A bending has an angle and a direction, so it needs two or more tendons; with three or more, many
tensions hold the same bending.  Each step of Newton's method for the bending minimises the sum
of squared tensions with none below the pretension (a quadratic program, as for cable-driven
parallel robots: Pott, Cable-Driven Parallel Robots, 2018, ch. 3).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
import scipy

from soft_continuum.mechanics._checks import (
    bending_of,
    check_pretension,
    real_array,
    segment_order,
    soft_flags,
)
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import check_start, Equilibrium, SLACK
from soft_continuum.mechanics.directions import ONE_PLANE
from soft_continuum.mechanics.sensitivity import Linearisation
from soft_continuum.mechanics.statics import Booleans, SLACK_ALLOWANCE, Statics, StaticsError

SAME_BENDING, HELD = Statics.precision
STEP = 0.3  # rad of bending at first
CHANGE_TOLERANCE = 0.01  # of a change: tensions that miss it by less bring it about
LEAST_STEP = 1e-3  # of the way of Newton's method
CAUGHT, MAX_JUMPS = 0.05, 3  # rad of a jump at which another tendon holds the arm; how many
MAX_STEPS = 100
MAX_PASSES = 100  # over all segments, before elastic ones are taken not to fit together
WEIGHT = 1e6  # N/rad of an error of bending against the tensions, in the choice of tensions
NO_TENSION = 1e-6  # N above the pretension: a tendon this close does not carry
SETTLED = 1e-7  # of the tensions: they change no more


@dataclass(frozen=True, eq=False)
class BendingFit:
    """
    Pulls that give soft segments their bending.

    pulls: (tendons,) m at the motors (stretch included), SLACK for a tendon that does not carry.
    error: (segments, 2) rad, reached minus commanded; nan where nothing was commanded.
    """

    state: Equilibrium
    pulls: Array
    error: Array


def pulls_for_bending(statics: Statics, start: Equilibrium, bending: ArrayLike,
                      soft: Sequence[bool], *, pretension: float = 0.0) -> BendingFit:
    """
    Return the pulls that give soft segments their bending with the least tensions.

    statics: of any arm; for one segment of a planar arm Statics.bend does the same.
    bending: (segments, 2) rad about x and y, as Equilibrium.bending; nan leaves a component free.
    pretension: N, least tension of every tendon; with 0 a tendon may be slack.
    Among possible tensions the sum of their squares is least.  Solved from ``start``, with its
    vacuum and without friction of tendons.

    Raises StaticsError that names the cause: a segment that no tendon passes, a direction in
    which none bends it, more bendings than tendons; ValueError for other sizes.
    """
    check_start(start)
    wanted, chosen = _wanted(statics, bending, soft)
    check_pretension(pretension)
    _refuse_unreachable(statics, start, chosen)
    search = _Search(statics, wanted, chosen, tuple(soft), pretension)
    state = search.run(start)
    error = np.where(chosen, state.bending - wanted, np.nan)
    if largest(search.missed(state)) > HELD:
        raise StaticsError(search.why_not(state), state)
    return BendingFit(state, search.pulls(state), error)


def set_shape(statics: Statics, bending: ArrayLike, start: Equilibrium | None = None,
              order: Sequence[int] | None = None, *, pretension: float = 0.0, jamming: bool = True
              ) -> Any:
    """
    Return the arm with its segments set one after another, base first or in ``order``.

    statics: of any arm.  bending: (segments, 2) rad, used for segments in ``order`` only; for
    hinges about y also angles (segments,).  A segment that already has its bending is skipped.
    Where stiff segments give way, each is overbent so that it ends at its bending.
    pretension: as for pulls_for_bending.  Without jamming all segments are soft and set at once.
    Friction of tendons is neglected.  Raises StaticsError where a segment cannot be held at its
    bending or not all can have theirs, ValueError for a bending or an order that does not match
    the arm.
    """
    segments, free = statics.chain.segments, statics.chain.arm.bending_axes
    wanted = real_array(bending, 'bending must be numbers (rad)')
    if wanted.ndim == 1 and not free[:, 0].any():
        wanted = np.column_stack([np.zeros_like(wanted), wanted])
    turns = segment_order(order, segments)
    check_pretension(pretension)
    if wanted.shape != (segments, 2) or not np.isfinite(wanted[turns]).all():
        raise ValueError('bending must be two finite numbers in rad, about x and y, for each of '
                         f'the {segments} segments; given: {bending!r}')
    _refuse_across(free[turns], wanted[turns])
    straight = statics.chain.straight()
    begin = straight if start is None else start
    check_start(begin)
    goal, left, (same, held) = wanted.copy(), np.inf, statics.precision
    if not jamming:
        if largest(begin.bending - wanted) <= same:
            return begin
        state = statics.hold(begin, wanted, [True] * segments, pretensions=(pretension,)).state
        if largest(state.bending - wanted) > held:
            raise StaticsError('the tendons do not hold all segments at once', state)
        return state
    for _ in range(MAX_PASSES):
        state = begin
        for s in turns:
            if largest((state.bending[s] - goal[s]) * free[s]) > same:
                state = statics.hold(state, goal, [i == s for i in range(segments)],
                                     pretensions=(pretension,)).state
        missed = np.where(free, wanted - state.bending, 0.0)[turns]
        before, left = left, largest(missed)
        if left <= same or (left <= held and left > 0.5 * before):
            return state
        goal[turns] += missed
    raise StaticsError(
        f'segments {[s + 1 for s in turns]} give way to each other and are still '
        f'{np.degrees(missed[free[turns]]).round(3).tolist()} degrees from their bending after '
        f'{MAX_PASSES} passes; take smaller angles or stiffer jams', state)


def largest(bending: Array) -> float:
    """Return the largest angle of bending (..., 2), rad, which no turn of the frame changes."""
    return float(np.linalg.norm(bending, axis=-1).max(initial=0.0))


def _wanted(statics: Statics, bending: ArrayLike, soft: Sequence[bool]
            ) -> tuple[Array, Booleans]:
    """Return the goal bending and which components are used: (segments, 2) each."""
    arm, segments = statics.chain.arm, statics.chain.segments
    wanted, flags = bending_of(bending, segments), np.array(soft_flags(soft, segments))
    chosen = np.isfinite(wanted) & flags[:, None]
    _refuse_across(arm.bending_axes, np.where(chosen, wanted, 0.0))
    chosen &= arm.bending_axes
    if not chosen.any():
        raise ValueError('bending must have a number for at least one soft segment; given: '
                         f'{bending!r}')
    return wanted, chosen


def _refuse_across(free: Booleans, wanted: Array) -> None:
    """Raise ValueError for bending about a rigid axis of a segment."""
    for s, axis in np.argwhere(~free & (wanted != 0.0)):
        raise ValueError(f'segment {s + 1} does not bend about {"xy"[axis]}: its stiffness is '
                         'infinite')


def _refuse_unreachable(statics: Statics, start: Equilibrium, chosen: Booleans
                        ) -> None:
    """Raise StaticsError for bending that no tensions can set."""
    tendons = statics.chain.arm.tendons
    for s in np.flatnonzero(chosen.any(axis=1)):
        if not any(tendon.end > s for tendon in tendons):
            raise StaticsError(f'no tendon passes segment {s + 1}, so its bending cannot be '
                               'set', start)
    if chosen.sum() > len(tendons):
        raise StaticsError(
            f'{len(tendons)} tendons cannot set {chosen.sum()} bendings; make fewer '
            'segments soft, or give nan for free components', start)


class _Search:
    """Newton's method for the chosen components of bending (segments, 2), rad."""

    def __init__(self, statics: Statics, wanted: Array, chosen: Booleans,
                 soft: tuple[bool, ...], pretension: float) -> None:
        self.statics, self.wanted, self.chosen, self.soft = statics, wanted, chosen, soft
        self.pretension, self.jumps = pretension, MAX_JUMPS

    def run(self, start: Equilibrium) -> Equilibrium:
        """Return the state with the goal bending, or the nearest that the tendons reach."""
        # Tendons that are all just taut block each other: a little slack shows which carry.
        state = self.statics.solve(
            start, self.statics.commanded_pulls(start) - start.slack - SLACK_ALLOWANCE, self.soft,
            vacuum=start.vacuum or None)
        part = 1.0
        for _ in range(MAX_STEPS):
            left = (self.wanted - state.bending)[self.chosen]
            most = min(1.0, STEP / max(largest(self.missed(state)), 1e-300))
            whole = min(part, most) == 1.0
            tensions, pulls, reaches = self.step(state, min(part, most) * left)
            allowed = SETTLED * (1.0 + np.abs(tensions).max())
            settled = np.abs(tensions - state.tensions).max() <= allowed
            try:
                there = self.solve(state, tensions, pulls)
            except StaticsError as error:
                if not reaches:
                    raise StaticsError(self.why_not(state), state) from None
                part = 0.25 * min(part, most)
                if part < LEAST_STEP:
                    raise StaticsError(f'on the way to that bending: {error}', state) from None
                continue
            # Tendons side by side may share their tension in any way: it does not settle.
            settled |= whole and np.abs(there.tensions - state.tensions).max() <= allowed and (
                largest(there.bending - state.bending) <= SAME_BENDING)
            part, state = min(1.0, 2.0 * part), there
            if settled:
                break
        return state

    def pulls(self, state: Equilibrium) -> Array:
        """Return the pulls at the motors, (tendons,), m, SLACK without tension."""
        return np.where(state.tensions > NO_TENSION, self.statics.commanded_pulls(state), SLACK)

    def by_tensions(self, state: Equilibrium) -> tuple[Array, Array]:
        """Return derivatives of bendings (k, tendons) and paths (tendons, tendons) by tensions."""
        found = Linearisation(self.statics, state, tensions=state.tensions).tensions()
        return found.bending[self.chosen], found.paths

    def step(self, state: Equilibrium, change: Array) -> tuple[Array, Array, bool]:
        """
        Return least tensions (tendons,) N for a change (k,) rad, and pulls at the motors, m.

        The last value is whether they give that change to first order.
        """
        slopes, paths = self.by_tensions(state)
        needed = change + slopes @ state.tensions
        tensions: Array = scipy.optimize.lsq_linear(
            np.vstack([WEIGHT * slopes, np.eye(len(self.statics.compliance))]),
            np.concatenate([WEIGHT * needed, np.zeros(len(self.statics.compliance))]),
            (self.pretension, np.inf), method='bvls').x
        # Exact for the tendons that carry; those at the pretension stay there.
        carries = tensions > self.pretension + NO_TENSION
        tensions[~carries] = self.pretension
        tensions[carries] = np.linalg.lstsq(
            slopes[:, carries], needed - slopes[:, ~carries] @ tensions[~carries])[0]
        more = tensions - state.tensions
        missed = np.linalg.norm(slopes @ tensions - needed)
        pulls = self.statics.commanded_pulls(state) - paths @ more + self.statics.compliance * more
        return (tensions, pulls, bool(missed <= CHANGE_TOLERANCE * np.linalg.norm(change)))

    def solve(self, state: Equilibrium, tensions: Array, pulls: Array
              ) -> Equilibrium:
        """Solve for lengths of the tendons that carry: fewer states are stable by tension."""
        carries = tensions > self.pretension + NO_TENSION
        there = self.statics.solve(state, pulls, self.soft, vacuum=state.vacuum or None,
                                   tensions=np.where(carries, np.nan, self.pretension))
        if there.jumped:
            # Where one tendon takes over from another, the arm may tilt between them.
            if largest(there.bending - state.bending) > CAUGHT or not self.jumps:
                raise StaticsError('the tendons can bend the arm to this shape but not hold '
                                   'it: the equilibrium is not stable', state)
            self.jumps -= 1
        return there

    def missed(self, state: Equilibrium) -> Array:
        """Return the error of bending (segments, 2), rad, 0 where nothing was commanded."""
        return np.where(self.chosen, state.bending - self.wanted, 0.0)

    def why_not(self, state: Equilibrium) -> str:
        """Return a message that names what cannot be held, from the last state of the search."""
        arm = self.statics.chain.arm
        missed = self.missed(state)
        worst = int(np.argmax(np.linalg.norm(missed, axis=1)))
        passing = [t for t, end in enumerate(arm.tendon_ends) if end > worst]
        places = np.array([arm.places(t, (0.5,))[worst, 0] for t in passing])
        names = ', '.join(f'{arm.tendon_names[t]} at {_degrees(place):.0f}'
                          for t, place in zip(passing, places, strict=True))
        off = (f'segment {worst + 1} cannot be held at its bending: '
               f'the error is {np.degrees(np.linalg.norm(missed[worst])):.2f} degrees')
        values = np.linalg.svd(places, compute_uv=False)
        if len(passing) < 2 or values[1] < ONE_PLANE * values[0]:
            return (f'{off}, and the tendons that pass it lie in one plane ({names} degrees about '
                    'z from x); another plane needs a tendon beside it')
        if self.chosen.any(axis=1).sum() > 1:
            return (f'{off}; the tendons do not hold all soft segments at once, so make fewer '
                    'segments soft')
        towards = _degrees(np.array([-missed[worst, 1], missed[worst, 0]]))
        return (f'{off}, and no tendon pulls it towards {towards:.0f} degrees about z from x; '
                f'those that pass it are {names}')


def _degrees(across: Array) -> float:
    """Return the angle about z from x of (x, y), degrees from 0 to 360."""
    return float(np.degrees(np.arctan2(across[1], across[0]))) % 360.0
