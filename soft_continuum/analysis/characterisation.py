# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Bending stiffness of a segment from force-displacement curves (paper, IV-A, Fig. 4, eqs. 6-8).

As in the paper: one linear regression over all repetitions, whose slope is k.  Confidence
interval, linearity, hysteresis, settling and the moment-curvature table are not from the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

import numpy as np
import scipy

from soft_continuum.analysis.curves import Curve
from soft_continuum.analysis.delimited import MeasurementError
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.laws import MomentCurvature
from soft_continuum.mechanics.stiffness import bending_stiffness_from_slope

CONFIDENCE = 0.95
NONLINEAR = 0.03  # of the largest force: linearity error that needs a table
MAX_SCATTER = 0.8  # scatter about a table over that about a line, for the table to be used
TABLE_ROWS = 5  # of a moment-curvature table, with (0, 0)
QUADRATURE = 32  # points along the spring
SOFT_OVER_LEAF = (0.6, 8.0)
"""Plausible E I of a soft segment over that of its leaf spring: a factor of 10 falls outside."""
STIFF_OVER_SOFT = (1.05, 60.0)
"""Plausible ratio K: published granular devices reach 4 to 20."""


@dataclass(frozen=True, eq=False)
class Regression:
    """
    One line through the loading of all repetitions: force = slope * displacement + intercept.

    slope: k, N/m.  half_width: of its 95 % confidence interval, N/m; nan for one repetition.
    intercept: N.  each: (repetitions,) slope of each repetition, N/m.  residuals: of each
    repetition, N.  determination: R^2.
    """

    slope: float
    half_width: float
    intercept: float
    each: Array
    residuals: tuple[Array, ...]
    determination: float


@dataclass(frozen=True, eq=False)
class Characterisation:
    """
    Results from the curves of one segment in one state.

    bending_stiffness: E I, N m^2, by eq. 8; half_width: of its 95 % confidence interval; nan for
    one repetition, like spread and settling.
    linearity_error: largest distance of the best piecewise-linear law from the line, over the
    largest force; nan if no increasing law fits.  table: that law, if it describes the curves
    better than a line; else None.  table_curve: its displacements (m) and forces (N),
    (2, points).  spread: largest difference in force between repetitions, N.  settling: force at
    the largest common displacement in the last repetition over that in the first, less one.
    hysteresis: work lost over work done, for each repetition measured in both directions.
    """

    regression: Regression
    bending_stiffness: float
    half_width: float
    linearity_error: float
    table: MomentCurvature | None
    table_curve: Array | None
    spread: float
    settling: float
    hysteresis: tuple[float, ...]


def characterise(curves: Sequence[Curve], length: float, lever_arm: float) -> Characterisation:
    """
    Return E I of a segment of bending length l (m), loaded ``lever_arm`` l_k (m) beyond its end.

    Raises MeasurementError when there is no curve or the force does not grow with displacement.
    """
    line = regress(curves)
    shift, spread = _settling(curves)
    return Characterisation(
        line,
        bending_stiffness_from_slope(line.slope, length, lever_arm),
        bending_stiffness_from_slope(line.half_width, length, lever_arm),
        *_fit_law(curves, line, length, lever_arm), spread, shift,
        tuple(_hysteresis(c) for c in curves if len(c.unloading[0]) > len(c.loading[0]) // 2))


def regress(curves: Sequence[Curve]) -> Regression:
    """
    Return the line through all repetitions (paper, IV-A), loading only.

    Points of one repetition are not independent: they share the packing of the powder.  So the
    confidence interval is the larger of two: from the scatter of the slopes between repetitions
    (Student, repetitions - 1 degrees of freedom), and from the autocorrelation of the residuals.
    One repetition gives none.
    """
    if not curves:
        raise MeasurementError('no force-displacement curve was given; name at least one file')
    u = np.concatenate([c.loading[0] for c in curves])
    f = np.concatenate([c.loading[1] for c in curves])
    slope, intercept = np.polyfit(u, f, 1)
    if slope <= 0.0:
        raise MeasurementError(
            f'{curves[0].name}: the force falls with displacement (slope {slope:.4g} N/m); check '
            'that the columns are not swapped and that both count in the same direction')
    each = np.array([np.polyfit(*c.loading, 1)[0] for c in curves])
    residuals = tuple(c.loading[1] - slope * c.loading[0] - intercept for c in curves)
    rest = np.concatenate(residuals)
    half = nan
    if len(curves) > 1:
        quantile = scipy.special.stdtrit(len(each) - 1, 0.5 + CONFIDENCE / 2)
        half = max(_half_width(curves),
                   quantile * float(np.std(each, ddof=1)) / np.sqrt(len(each)))
    return Regression(float(slope), float(half), float(intercept), each, residuals,
                      1.0 - float(rest @ rest / np.sum((f - f.mean())**2)))


def _half_width(curves: Sequence[Curve]) -> float:
    """Return the confidence of the slope (N/m) from the scatter about a line per repetition."""
    own = [c.loading[1] - np.polyval(np.polyfit(*c.loading, 1), c.loading[0]) for c in curves]
    total = sum(float(a @ a) for a in own)
    if total == 0.0:
        return 0.0
    points = sum(len(a) for a in own)
    # Of an AR(1) process with correlation r, (1 + r) / (1 - r) points count as one.
    r = float(np.clip(sum(a[1:] @ a[:-1] for a in own) / total, 0.0, 0.999))
    count = max(3.0, points * (1.0 - r) / (1.0 + r))
    about = sum(float(np.sum((c.loading[0] - c.loading[0].mean())**2)) for c in curves)
    variance = total / points * count / (count - 2.0) / (about / points * count)
    return float(scipy.special.stdtrit(count - 2.0, 0.5 + CONFIDENCE / 2) * np.sqrt(variance))


def _settling(curves: Sequence[Curve]) -> tuple[float, float]:
    """Return the relative change of force from first to last, and the spread (N) of all."""
    low = max(float(c.loading[0].min()) for c in curves)
    high = min(float(c.loading[0].max()) for c in curves)
    if len(curves) == 1 or low >= high:
        return nan, nan
    grid = np.linspace(low, high, 101)
    forces = np.array([_along(grid, *c.loading) for c in curves])
    return float(forces[-1, -1] / forces[0, -1] - 1.0), float(np.ptp(forces, axis=0).max())


def _along(grid: Array, u: Array, f: Array) -> Array:
    """Return forces at displacements; repeated crossings are ordered by displacement."""
    order = np.argsort(u, kind='stable')
    values: Array = np.interp(grid, u[order], f[order])
    return values


def _hysteresis(curve: Curve) -> float:
    """Return the work lost over the work done, for a repetition up and down."""
    (up_u, up_f), (down_u, down_f) = curve.loading, curve.unloading
    low, high = max(up_u.min(), down_u.min()), min(up_u.max(), down_u.max())
    grid = np.linspace(low, high, 201)
    put_in = np.trapezoid(_along(grid, up_u, up_f), grid)
    back = np.trapezoid(_along(grid, down_u, down_f), grid)
    return float((put_in - back) / put_in)


def _fit_law(curves: Sequence[Curve], line: Regression, length: float, lever_arm: float
             ) -> tuple[float, MomentCurvature | None, Array | None]:
    """
    Return linearity error, table and its curve by the moment-curvature law that fits best.

    The moment is F s at a distance s from the force, so the displacement of the force is
    u(F) = integral of kappa(F s) s ds over the spring, s from l_k to l_k + l.  For a
    piecewise-linear kappa that is linear in its slopes, which are found by non-negative least
    squares: the law rises by construction.
    """
    f = np.concatenate([c.loading[1] for c in curves])
    u = np.concatenate([c.loading[0] for c in curves])
    if f.max() <= 0.0:
        return nan, None, None
    nodes = np.linspace(0.0, f.max() * (lever_arm + length), TABLE_ROWS)
    x, weight = np.polynomial.legendre.leggauss(QUADRATURE)
    s = lever_arm + 0.5 * length * (x + 1.0)
    weight = weight * 0.5 * length * s

    def displacements(forces: Array) -> Array:
        """Return u per slope of each piece of kappa, (forces, pieces)."""
        moments = forces[:, None] * s
        parts = [np.clip(np.abs(moments) - a, 0.0, b - a) * np.sign(moments)
                 for a, b in zip(nodes, nodes[1:], strict=False)]
        result: Array = np.stack([part @ weight for part in parts], axis=1)
        return result

    # Repetitions may start at different displacements: use differences from their means.
    ends = np.cumsum([len(c.loading[0]) for c in curves])[:-1]

    def centred(values: Array) -> Array:
        return np.concatenate([part - part.mean(axis=0) for part in np.split(values, ends)])

    pieces = displacements(f)
    columns = centred(pieces)
    scale = np.linalg.norm(columns, axis=0)
    if np.any(scale == 0.0):
        return nan, None, None
    slopes = scipy.optimize.nnls(columns / scale, centred(u))[0] / scale
    if np.any(slopes <= 0.0):
        return nan, None, None
    starts = [part.mean() for part in np.split(u - pieces @ slopes, ends)]
    scatter = np.std(centred(u - pieces @ slopes))
    of_line = np.std(np.concatenate([
        np.polyval(np.polyfit(c.loading[1], c.loading[0], 1), c.loading[1]) - c.loading[0]
        for c in curves]))
    forces = np.linspace(max(0.0, f.min()), f.max(), 101)
    bent = displacements(forces) @ slopes + np.mean(starts)
    error = float(np.abs(bent * line.slope + line.intercept - forces).max() / f.max())
    if not (error > NONLINEAR and scatter < MAX_SCATTER * of_line):
        return error, None, None
    curvatures = np.concatenate([[0.0], np.cumsum(slopes * np.diff(nodes))])
    return (error, MomentCurvature(tuple(curvatures.tolist()), tuple(nodes.tolist())),
            np.array([bent, forces]))


def question_soft(result: Characterisation, expected: float, of: str) -> str:
    """
    Return why E I of a soft segment suggests a wrong unit; empty if it does not.

    expected: another E I, N m^2, and its source, such as the leaf spring inside, to which the
    filling only adds stiffness.
    """
    low, high = SOFT_OVER_LEAF
    ratio = result.bending_stiffness / expected
    if low <= ratio <= high:
        return ''
    return (f'E I = {result.bending_stiffness:.4g} N m^2 is {ratio:.3g} times that of '
            f'{of} ({expected:.4g}); {low:g} to {high:g} times would be usual'
            + _power_of_ten(ratio / 2.2))


def question_stiff(result: Characterisation, soft: float) -> str:
    """Return why E I of a stiff segment is implausible for that of the soft one, N m^2."""
    low, high = STIFF_OVER_SOFT
    ratio = result.bending_stiffness / soft
    if low <= ratio <= high:
        return ''
    return (f'the stiff segment is {ratio:.3g} times as stiff as the soft one; ' + (
        'have the files of the two states been swapped, or their units' if ratio < low else
        'granular jamming reaches 4 to 20' + _power_of_ten(ratio / 10.0)))


def _power_of_ten(off: float) -> str:
    power = round(np.log10(off))
    if power == 0:
        return ''
    return (f': off by about {10.0**abs(power):g}; are force (N, mN, kN), displacement (mm, m) '
            'and lever arm (m) in the units that are stated')
