# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
All states that one soft segment of a spatial arm can be brought to, as a table over a disc.

A bending by the angle a towards the direction d is the complex number a e^(i d), rad: the disc
above leans towards it, with its real part along x and its imaginary part along y of the disc
below.  Pulls and tip are nearly linear in it, and interpolated on triangles between states that
were solved for.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, degrees, pi

import numpy as np
import scipy

from soft_continuum.mechanics.chain import Array, SLACK
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.mechanics.spatial.chain import SpatialEquilibrium
from soft_continuum.mechanics.spatial.inverse import pulls_that_hold
from soft_continuum.mechanics.spatial.statics import SpatialStatics
from soft_continuum.sequencing.bending_curve import CurveLimits

DIRECTIONS = 16
STEP = pi / 15  # rad between two states in one direction, at most
INSIDE = 1.0 - 1e-9  # of the way to the edge, where triangles end
PARTS = 0.0, 0.2, 0.4, 0.6, 0.8, 0.95  # of the way to the edge, where a search may begin
MAX_STEPS = 40  # of a search for the pulls or the tip nearest to given ones
CLOSE = 1e-5  # rad: a search ends
LOCAL = 1e-4  # rad, of differences


@dataclass(frozen=True, eq=False)
class BendingDisc:
    """
    The states of one soft segment (0-based).

    edge: (DIRECTIONS,) complex, rad, the largest bending in each direction.  whys: why it is the
    largest.  table: of complex bendings (k,), returns pulls and tips (k, tendons + 3), m.  slope:
    largest change of a pull per change of the bending, m/rad.
    """

    segment: int
    edge: Array
    whys: tuple[str, ...]
    table: Callable[[Array], Array]
    slope: float

    def clipped(self, bending: complex) -> complex:
        """Return the bending of the disc in the same direction, as large as it can be, rad."""
        limit = self._limit(bending)
        return bending if abs(bending) <= limit else bending * (limit / abs(bending))

    def end(self, bending: complex) -> str:
        """Return why the disc ends in the direction of a bending."""
        return self.whys[int(np.abs(np.angle(self.edge / (bending or 1.0))).argmin())]

    def _limit(self, bending: complex) -> float:
        """Return how far it is to the edge, a polygon, in the direction of a bending, rad."""
        if not bending:
            return float(np.inf)
        towards = bending / abs(bending)
        k = int(np.angle(bending) % (2.0 * pi) // (2.0 * pi / DIRECTIONS)) % DIRECTIONS
        # Turned so that the direction is the real axis, which the edge crosses.
        one, other = self.edge[k] / towards, self.edge[(k + 1) % DIRECTIONS] / towards
        if one.imag == other.imag:
            return float(INSIDE * min(abs(one), abs(other)))
        part = one.imag / (one.imag - other.imag)
        return float(INSIDE * (one + part * (other - one)).real)

    def pulls_at(self, bending: complex) -> Array:
        """Return the pulls (tendons,) m at a bending (rad) of the disc."""
        found: Array = self.table(np.array([bending]))[0, :-3]
        return found

    def angle_for_pulls(self, pulls: Array, near: complex) -> complex:
        """Return the bending (rad) at which the tendons have pulls (tendons,), m, most nearly."""
        return self._nearest(np.asarray(pulls), slice(0, -3), near)

    def angle_for_tip(self, x: float, z: float, y: float = 0.0) -> complex:
        """Return the bending (rad) at which the tip is nearest to a point (m)."""
        return self._nearest(np.array([x, y, z]), slice(-3, None))

    def _nearest(self, wanted: Array, columns: slice, near: complex | None = None) -> complex:
        """Return where columns of the table are nearest to what is wanted; Gauss-Newton."""
        def off(bendings: Sequence[complex]) -> Array:
            found: Array = self.table(np.array([self.clipped(b) for b in bendings]))
            return found[:, columns] - wanted

        coarse = [part * edge for part in PARTS for edge in self.edge]
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


def bending_disc(statics: SpatialStatics, state: SpatialEquilibrium, segment: int,
                 limits: CurveLimits, jamming: bool = True) -> BendingDisc:
    """
    Return what ``segment`` (0-based) can be bent to from ``state``, the others as they are.

    jamming: whether the others are stiff; else tendons hold them where they are.  In each
    direction the disc ends as a BendingCurve does.  Raises StaticsError for a segment that is a
    hinge, that cannot be straight, or cannot be bent.
    """
    arm = statics.chain.arm
    if not arm.bending_axes[segment].all():
        raise StaticsError(f'segment {segment + 1} is a hinge; only one that bends to all sides '
                           'can be moved so', state)
    soft = [not jamming or i == segment for i in range(statics.chain.segments)]
    limit = arm.segments[segment].bending_angle_limit
    wanted = state.bending.copy()

    def solved(start: SpatialEquilibrium, bending: complex) -> tuple[SpatialEquilibrium, Array]:
        wanted[segment] = -bending.imag, bending.real
        fit = pulls_that_hold(statics, start, wanted, soft)
        carries = fit.pulls != SLACK
        slack = limits.antagonist_slack if carries.any() else 0.0
        pulls = np.where(carries, fit.pulls, fit.state.pulls - slack) - limits.offsets
        return fit.state, np.array([*pulls, *fit.state.tip])

    middle = bending_of(state.bending, segment)
    present = state
    for part in np.linspace(1.0, 0.0, ceil(abs(middle) / STEP) + 1):
        present, row = solved(present, middle * part)
    places, rows, edge, whys, slope = [0j], [row], [], [], 0.0
    for direction in np.exp(2j * pi * np.arange(DIRECTIONS) / DIRECTIONS):
        found, before, largest = present, row, 0.0
        why = f'the bending angle limit of {degrees(limit):.1f} degrees'
        for angle in np.linspace(0.0, limit, ceil(limit / STEP) + 1)[1:]:
            try:
                found, there = solved(found, angle * direction)
            except StaticsError as error:
                why = str(error)
                break
            if problem := limits.problem(found, there[:-3]):
                why = problem
                break
            slope = max(slope, float(np.abs(there - before)[:-3].max()) / (angle - largest))
            places.append(angle * direction)
            rows.append(there)
            before, largest = there, angle
        edge.append(largest * direction)
        whys.append(why)
    if not all(edge):
        raise StaticsError(f'segment {segment + 1} cannot be bent to all sides from here: '
                           f'{whys[edge.index(0j)]}', state)
    interpolate = scipy.interpolate.LinearNDInterpolator(_plane(np.array(places)), np.array(rows))
    return BendingDisc(segment, np.array(edge), tuple(whys),
                       lambda bendings: interpolate(_plane(bendings)), slope)


def bending_of(bending: Array, segment: int) -> complex:
    """Return the bending of a segment (0-based) as a complex number, of bending (segments, 2)."""
    about_x, about_y = bending[segment]
    return complex(about_y, -about_x)


def _plane(bendings: Array) -> Array:
    return np.column_stack([bendings.real, bendings.imag])
