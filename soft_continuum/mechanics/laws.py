# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Stiffness laws of a segment: measured moment-curvature tables, and the effect of jamming.

The paper models soft segments as linear and stiff ones as rigid, and names piecewise,
deformation-dependent stiffness in both states as future work (VI); these are not from the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics._checks import is_number

MAX_RATIO = 1e12  # beyond it rounding hides the soft springs


class LawError(ValueError):
    """A stiffness law is invalid; the message names the row or value."""


@dataclass(frozen=True)
class MomentCurvature:
    """
    A piecewise-linear, odd moment-curvature law.

    curvatures: 1/m, from 0, increasing.  moments: N m, from 0, increasing.  Beyond the last row
    the last slope continues.
    """

    curvatures: tuple[float, ...]
    moments: tuple[float, ...]

    def __post_init__(self) -> None:
        """Raise an error naming the row unless the table is a monotone law through zero."""
        for name, column in (('curvatures', self.curvatures), ('moments', self.moments)):
            if not (isinstance(column, Sequence) and all(is_number(value) for value in column)):
                raise LawError(f'{name} are {column!r}; give a tuple of numbers')
        rows = list(zip(self.curvatures, self.moments, strict=False))
        if len(self.curvatures) != len(self.moments) or len(rows) < 2:
            raise LawError(
                f'a moment-curvature table needs two or more rows of both; given: '
                f'{len(self.curvatures)} curvatures and {len(self.moments)} moments')
        if rows[0] != (0.0, 0.0):
            raise LawError(f'row 1 is {rows[0]}; a moment-curvature table starts at (0, 0)')
        for number, ((k0, m0), (k1, m1)) in enumerate(zip(rows, rows[1:], strict=False), start=2):
            if not (isfinite(k1) and isfinite(m1)):
                raise LawError(f'row {number} is ({k1:g}, {m1:g}); both must be finite')
            if k1 <= k0 or m1 <= m0:
                raise LawError(
                    f'row {number} is ({k1:g} 1/m, {m1:g} N m) after ({k0:g}, {m0:g}); curvature '
                    'and moment must both increase')

    @property
    def slopes(self) -> NDArray[np.float64]:
        """Bending stiffness between rows, (rows - 1,), N m^2."""
        slopes: NDArray[np.float64] = np.diff(self.moments) / np.diff(self.curvatures)
        return slopes

    def moment(self, curvature: float) -> float:
        """Return the moment in N m at a curvature in 1/m."""
        value = extended(abs(curvature), self.curvatures, self.moments)
        return value if curvature >= 0 else -value

    def work(self, curvature: float) -> float:
        """Return the work per length in J/m up to a curvature in 1/m."""
        size = abs(curvature)
        k = [*(x for x in self.curvatures if x < size), size]
        m = [self.moment(x) for x in k]
        return float(np.trapezoid(m, k))

    def minus(self, other: 'MomentCurvature') -> 'MomentCurvature':
        """Return the law that, added to ``other``, gives this one."""
        k = np.union1d(self.curvatures, other.curvatures)
        k = k[np.diff(k, prepend=-1.0) > 1e-9 * k[-1]]  # rows that are equal except for rounding
        moments = [self.moment(x) - other.moment(x) for x in k]
        for low, high, less, more in zip(k, k[1:], moments, moments[1:], strict=False):
            if more <= less:
                row = min(int(np.searchsorted(self.curvatures, high)), len(self.curvatures) - 1)
                raise LawError(
                    f'row {row + 1} of the stiff law: from {low:g} to {high:g} 1/m its moment '
                    'grows no more than that of the soft segment')
        return MomentCurvature(tuple(k.tolist()), tuple(moments))


def extended(x: float, given: ArrayLike, values: ArrayLike) -> float:
    """Interpolate linearly between rows; beyond the last row the last slope continues."""
    a, b = np.asarray(given), np.asarray(values)
    beyond = max(0.0, x - float(a[-1])) * (b[-1] - b[-2]) / (a[-1] - a[-2])
    return float(np.interp(x, a, b) + beyond)


def scaled(x: float, share: float, columns: NDArray[np.float64]) -> float:
    """Return where a law, columns (2, rows), has a share of the value that it has at x."""
    given, values = columns
    return extended(share * extended(x, given, values), values, given)


def stacked(tables: Sequence[ArrayLike]) -> NDArray[np.float64]:
    """Return columns (2, rows) as (k, 2, most rows); shorter ones go on with their last slope."""
    columns = [np.array(table) for table in tables]
    most = max((c.shape[1] for c in columns), default=2)
    return np.array([
        np.hstack([c, c[:, -1:] + np.arange(1, most - c.shape[1] + 1) * (c[:, -1:] - c[:, -2:-1])])
        for c in columns]).reshape(-1, 2, most)


def linear(bending_stiffness: float) -> MomentCurvature:
    """Return the law of a linear beam, E I in N m^2."""
    return MomentCurvature((0.0, 1.0), (0.0, bending_stiffness))


@dataclass(frozen=True)
class Jam:
    """
    The stiffness that a jammed filling adds to the leaf spring of a stiff segment.

    ratio: K, bending stiffness of the stiff segment over that of the soft one; inf (the default)
    is the paper's rigid segment.  law: measured moment of the whole stiff segment over curvature
    relative to the held shape, instead of a ratio.  yield_moment: N m that the jam bears at full
    vacuum before its held shape creeps.  stiffness_exponent: the jam's stiffness grows with
    vacuum to this power, usually 0.5 to 1; its yield moment is proportional to vacuum.
    """

    ratio: float = inf
    law: MomentCurvature | None = None
    yield_moment: float = inf
    stiffness_exponent: float = 1.0

    def __post_init__(self) -> None:
        """Raise an error for an invalid jam."""
        for name, value in (('ratio', self.ratio), ('yield moment', self.yield_moment),
                            ('stiffness exponent', self.stiffness_exponent)):
            if not is_number(value):
                raise LawError(f'{name} of a jam is {value!r}; give a number')
        if not isinstance(self.law, MomentCurvature | None):
            raise LawError(f'law of a jam is {self.law!r}; give a MomentCurvature or none')
        if self.ratio != inf and self.law is not None:
            raise LawError(f'a jam has a ratio K ({self.ratio:g}) or a law, not both')
        if not (1.0 < self.ratio <= MAX_RATIO or self.ratio == inf):
            raise LawError(f'stiffness ratio K is {self.ratio:g}; allowed: above 1 to '
                           f'{MAX_RATIO:g}, or inf for a rigid segment')
        if not self.yield_moment > 0.0:
            raise LawError(f'yield moment is {self.yield_moment:g} N m; it must be above 0')
        if not 0.0 <= self.stiffness_exponent <= 5.0:
            raise LawError(
                f'stiffness exponent is {self.stiffness_exponent:g}; allowed: 0 to 5')
        if self.ratio == inf and self.law is None and self.yield_moment != inf:
            raise LawError('a rigid segment does not yield; give a ratio K or a law as well')

    @property
    def rigid(self) -> bool:
        """Whether a stiff segment is locked (paper, III-A)."""
        return self.ratio == inf and self.law is None


def refuse_parts(jams: Sequence[Jam], stiff: Sequence[bool], vacuum: Sequence[float]) -> None:
    """
    Raise ValueError where a rigid jam of a stiff segment has partial vacuum.

    vacuum: 0 to 1 per segment, empty for full.
    """
    for s, part in enumerate(vacuum):
        if stiff[s] and jams[s].rigid and part < 1.0:
            raise ValueError(
                f'vacuum of segment {s + 1} is {part:g}; its jam is rigid and accepts only 0 '
                '(soft) and 1 (stiff); give the jam a ratio K or a law')


def outweigh(springs: NDArray[np.float64], loads: NDArray[np.float64]) -> bool:
    """
    Return whether springs outweigh loads in every shape, so that the energy is convex.

    springs: (links,) N m/rad, below each link.  loads: (links,) N m, largest moment of the loads
    that turn with a link.  The criterion is that all pivots of the Hessian are positive.
    """
    pivot = np.inf
    for below, above, load in zip(springs, np.append(springs, 0.0)[1:], loads, strict=True):
        pivot = below + above - load - below * below / pivot
        if pivot <= 0.0:
            return False
    return True
