# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The reachable states of one soft segment, as a table of its bendings.

A bending by the angle a towards the direction d is the complex number a e^(i d), rad: the disc
above leans towards it, with its real part along x and its imaginary part along y of the disc
below.  Pulls and tip are nearly linear in it, and interpolated between solved states: on
triangles, or on a line if the segment is a hinge, as in planar arms.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, degrees, pi, sqrt
from typing import Any

import numpy as np
import scipy

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Equilibrium, SLACK
from soft_continuum.mechanics.statics import SLACK_ALLOWANCE, StaticsError
from soft_continuum.planning.settings import MotionLimits

WAYS = np.round(np.exp(2j * pi * np.arange(16) / 16), 15)
"""Directions of the solved states; they include the axes exactly."""
STEP, LINE_STEP = pi / 15, pi / 30  # rad between two states in one direction, at most
INSIDE = 1.0 - 1e-9  # of the way to the edge, where triangles end
PARTS = 0.0, 0.2, 0.4, 0.6, 0.8, 0.95  # of the way to the edge, where a search may begin
SLACK_WEIGHT = 0.1  # of a tendon that does not carry: how slack it is, is of little interest
MAX_STEPS = 40  # of a search for the pulls or the tip nearest to given ones
CLOSE = 1e-5  # rad: a search ends
LOCAL = 1e-4  # rad, of differences


@dataclass(frozen=True)
class BendingLimits:
    """
    Limits of a state.

    pull_limits: m.  tension_limit: N.  antagonist_slack: m left in a tendon that does not carry
    the arm.  offsets: (tendons,) m by which each tendon is pulled in beyond its motor position, or
    one for all.
    """

    pull_limits: tuple[float, float] = MotionLimits.pull_limits
    tension_limit: float = MotionLimits.tension_limit
    antagonist_slack: float = MotionLimits.antagonist_slack
    offsets: tuple[float, ...] = (0.0,)

    def check(self, found: Equilibrium, pulls: Array) -> None:
        """Raise StaticsError if a state exceeds one of them with its pulls (tendons,), m."""
        low, high = self.pull_limits
        if found.jumped:
            raise StaticsError('beyond it the arm snaps to another equilibrium', found)
        if found.tensions.max() > self.tension_limit:
            raise StaticsError(f'the tension_limit of {self.tension_limit:g} N', found)
        if pulls.min() < low or pulls.max() > high:
            raise StaticsError(f'the pull_limits of {low:g} to {high:g} m', found)


@dataclass(frozen=True, eq=False)
class BendingMap:
    """
    The states of one soft segment (0-based).

    free: whether it leans along x and y.  middle: rad, straight, or the nearest reachable bending.
    edge: (WAYS,) complex, rad, the largest change from there in each direction.
    limit_reasons: why it is the largest; empty in directions that a hinge does not have.
    table: of complex bendings (k,), returns pulls, which tendons carry, 0 to 1, and tips,
    (k, 2 * tendons + 3), m.  slope: largest
    change of a pull per change of the bending, m/rad.
    """

    segment: int
    free: tuple[bool, bool]
    middle: complex
    edge: Array
    limit_reasons: tuple[str, ...]
    table: Callable[[Array], Array]
    slope: float

    def along(self, bending: complex) -> complex:
        """Return the part of a bending along the axes of the segment, rad."""
        return _along(self.free, bending)

    def clipped(self, bending: complex) -> complex:
        """Return the bending, limited to the map in its direction, rad."""
        bending = self.along(bending)
        away = bending - self.middle
        limit = self._limit(away)
        return bending if abs(away) <= limit else self.middle + away * (limit / abs(away))

    def end(self, bending: complex) -> str:
        """Return why the map ends in the direction of a bending."""
        away = self.along(bending) - self.middle
        return self.limit_reasons[int(np.abs(np.angle(WAYS / (away or 1.0))).argmin())]

    def _limit(self, away: complex) -> float:
        """Return the distance to the edge, a polygon, in a direction from the middle, rad."""
        if not away:
            return float(np.inf)
        towards, count = away / abs(away), len(WAYS)
        k = int(np.angle(away) % (2.0 * pi) // (2.0 * pi / count)) % count
        # Turned so that the direction is the real axis, which the edge crosses.
        one, other = self.edge[k] / towards, self.edge[(k + 1) % count] / towards
        if one.imag == other.imag:
            return float(INSIDE * max(abs(one), abs(other)))
        part = one.imag / (one.imag - other.imag)
        return float(INSIDE * (one + part * (other - one)).real)

    def pulls_at(self, bending: complex) -> Array:
        """Return the pulls (tendons,) m at a bending (rad) of the map."""
        row: Array = self.table(np.array([bending]))[0]
        return row[:len(row) // 2 - 1]

    def angle_for_pulls(self, pulls: Array, near: complex) -> complex:
        """
        Return the bending (rad) at which the tendons have pulls (tendons,), m, most nearly.

        Those that carry the arm at a bending ``near`` count most.
        """
        carries = self.table(np.array([self.clipped(near)]))[0, len(pulls):-3]
        return self._nearest(np.asarray(pulls), slice(len(pulls)), near,
                             np.maximum(carries, SLACK_WEIGHT))

    def angle_for_tip(self, x: float, z: float, y: float = 0.0) -> complex:
        """Return the bending (rad) at which the tip is nearest to a point (m)."""
        return self._nearest(np.array([x, y, z]), slice(-3, None))

    def _nearest(self, wanted: Array, columns: slice, near: complex | None = None,
                 weights: Array | float = 1.0) -> complex:
        """Return where columns of the table are nearest to what is wanted; Gauss-Newton."""
        def off(bendings: Sequence[complex]) -> Array:
            found = self.table(np.array([self.clipped(b) for b in bendings]))
            return np.asarray(weights * (found[:, columns] - wanted))

        coarse = [self.middle + part * edge for part in PARTS for edge in self.edge]
        starts = coarse if near is None else [near, *coarse]
        at = self.clipped(starts[int((off(starts)**2).sum(axis=1).argmin())])
        for _ in range(MAX_STEPS):
            here, right, up = off([at, at + LOCAL, at + 1j * LOCAL])
            jacobian = np.column_stack([right - here, up - here]) / LOCAL
            real, imaginary = np.linalg.lstsq(jacobian, -here, rcond=1e-6)[0]
            step, better = complex(real, imaginary), at
            while abs(step) > CLOSE and better == at:  # the edge, and other triangles
                there = self.clipped(at + step)
                if (off([there])**2).sum() < (here**2).sum():
                    better = there
                step *= 0.5
            if abs(better - at) <= CLOSE:
                break
            at = better
        return at


def bending_map(statics: Any, state: Any, segment: int, limits: BendingLimits,
                jamming: bool = True) -> BendingMap:
    """
    Return the reachable bendings of ``segment`` (0-based) from ``state``, the others unchanged.

    jamming: whether the others are stiff; else tendons hold them where they are.  In each
    direction the map ends at the bending angle limit of the segment, or where a limit of tension
    or pull is reached, or the arm has no stable state.  Raises StaticsError if the range is empty.
    """
    arm = statics.chain.arm
    about_x, about_y = arm.bending_axes[segment].tolist()
    free = about_y, about_x
    soft = [not jamming or i == segment for i in range(statics.chain.segments)]
    limit = arm.segments[segment].bending_angle_limit
    longest = STEP if all(free) else LINE_STEP

    def solved(start: Any, bending: complex) -> tuple[Any, Array]:
        goal, change = state.bending.copy(), np.zeros_like(state.bending)
        goal[segment] = -bending.imag, bending.real
        change[segment] = goal[segment] - start.bending[segment]
        held = statics.hold(start, goal, soft, sliding=statics.sliding_towards(change))
        slack = limits.antagonist_slack  # about a hinge, tendons that are all just taut fight
        pulls = held.eased(slack, 0.0 if all(free) else min(slack, SLACK_ALLOWANCE))
        pulls -= limits.offsets
        limits.check(held.state, pulls)
        return held.state, np.concatenate(
            [pulls, held.pulls != SLACK, held.state.backbone[-1]])

    present = _along(free, complex_bending(state.bending, segment))
    present *= min(1.0, limit / max(abs(present), limit))
    places, rows, begin, why = list[complex](), list[Array](), state, ''
    for part in np.linspace(1.0, 0.0, ceil(abs(present) / longest) + 1):
        try:
            begin, row = solved(begin, present * part)
            places, rows = [present * part], [row]
        except StaticsError as error:
            why = str(error)
            if rows:  # then it cannot be straighter
                break
    edge, limit_reasons, slope = limit * WAYS, [''] * len(WAYS), 0.0
    for k, way in enumerate(WAYS if rows else []):
        if _along(free, way) != way:
            continue
        found, before, largest, across = begin, rows[0], 0.0, places[0] / way
        reach = sqrt(max(0.0, limit**2 - across.imag**2)) - across.real
        limit_reasons[k] = f'the bending angle limit of {degrees(limit):.1f} degrees'
        step = reach / max(1, ceil(reach / longest))
        while largest < INSIDE * reach:
            away = min(largest + step, reach)
            try:
                found, there = solved(found, places[0] + away * way)
            except StaticsError as error:
                limit_reasons[k] = why = str(error)
                step *= 0.5
                if step < 0.4 * longest:
                    break
                continue
            change = np.abs(there - before)[:there.size // 2 - 1].max() / (away - largest)
            slope = max(slope, float(change))
            places.append(places[0] + away * way)
            rows.append(there)
            before, largest = there, away
        edge[k] = largest * way
    at = np.array(places)
    if not rows or np.linalg.matrix_rank(_plane(at - at[0])) < sum(free):
        raise StaticsError(f'segment {segment + 1} cannot be bent from here: {why}', state)
    return BendingMap(
        segment, free, places[0], edge, tuple(limit_reasons), _table(free, at, rows), slope)


def complex_bending(bending: Array, segment: int) -> complex:
    """Return the bending of a segment (0-based) as a complex number, of bending (segments, 2)."""
    about_x, about_y = bending[segment]
    return complex(about_y, -about_x)


def _along(free: tuple[bool, bool], bending: complex) -> complex:
    """Return the part of a bending along those of x and y that are free."""
    return complex(bending.real * free[0], bending.imag * free[1])


def _table(free: tuple[bool, bool], places: Array, rows: list[Array]) -> Callable[[Array], Array]:
    """Return rows (m, columns) at complex bendings (m,), from those at places (k,)."""
    if all(free):
        found = scipy.interpolate.LinearNDInterpolator(_plane(places), np.array(rows))
        return lambda bendings: np.asarray(found(_plane(bendings)))
    line = places.real if free[0] else places.imag
    order = np.argsort(line)
    line, known = line[order], np.array(rows)[order]
    slopes = np.diff(known, axis=0) / np.diff(line)[:, None]

    def on_line(bendings: Array) -> Array:  # SciPy's takes 40 MB that planar arms do not need
        at = bendings.real if free[0] else bendings.imag
        k = np.clip(np.searchsorted(line, at) - 1, 0, len(slopes) - 1)
        return np.asarray(known[k] + (at - line[k])[:, None] * slopes[k])
    return on_line


def _plane(bendings: Array) -> Array:
    return np.column_stack([bendings.real, bendings.imag])
