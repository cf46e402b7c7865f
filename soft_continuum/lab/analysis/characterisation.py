# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Bending stiffness of a segment from force-displacement curves (paper, IV-A, Fig. 4, eqs. 6-8).

As in the paper: one linear regression over all repetitions, whose slope is k; but each may begin
at another displacement, such as the machine positions of several specimens.  Confidence
interval, linearity, hysteresis, settling and the moment-curvature table are not from the paper.

A segment of a spatial arm may differ in stiffness about x and y.  Pushing it along x bends it
about y, pushing it along y bends it about x.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from soft_continuum.lab.analysis.curves import Curve, read_curves
from soft_continuum.lab.analysis.delimited import MeasurementError
from soft_continuum.lab.analysis.verbs import (
    cell,
    described_arm,
    DPI,
    new_figure,
    reserve_outputs,
    run_verb,
    text_table,
)
from soft_continuum.mechanics.arm import Arm, ArmError, Array
from soft_continuum.mechanics.laws import MomentCurvature
from soft_continuum.mechanics.stiffness import bending_stiffness_from_slope, joint_stiffness
from soft_continuum.parameters.arguments import FOR_ANALYSIS, given_path, number_in, Parser
from soft_continuum.parameters.arm import arm_from_parameters, table_parameters
from soft_continuum.parameters.files import write_parameters
from soft_continuum.parameters.parameter import Value

CONFIDENCE = 0.95
NONLINEAR = 0.03  # of the largest force: linearity error that needs a table
MAX_SCATTER = 0.8  # scatter about a table over that about a line, for the table to be used
TABLE_ROWS = 5  # of a moment-curvature table, with (0, 0)
QUADRATURE = 32  # points along the spring
SOFT_OVER_LEAF = (0.6, 8.0)
"""Plausible E I of a soft segment over that of its leaf spring: a factor of 10 falls outside."""
STIFF_OVER_SOFT = (1.05, 60.0)
"""Plausible ratio K: published granular devices reach 4 to 20."""
ALIKE = 1.5  # largest slope of a repetition over the smallest, of one segment in one state
GREYS = ('0.0', '0.4', '0.65')
DASHES = ('-', '--', ':', '-.')
NAME = 'characterize'
COLUMNS = ('force', 'displacement', 'time', 'repetition')
UNITS = ('force', 'displacement')
SOFT, LATERAL, STIFF = 'soft', 'lateral', 'stiff'
REPLACED = {SOFT: 'arm.bending_stiffnesses', LATERAL: 'arm.lateral_bending_stiffnesses',
            STIFF: 'arm.stiffness_ratios'}


@dataclass(frozen=True, eq=False)
class Regression:
    """
    One slope of all repetitions, in loading: force = slope * displacement + intercept.

    slope: k, N/m.  half_width: of its 95 % confidence interval, N/m; nan for one repetition.
    intercept: N, the mean of those of the repetitions, with which residuals are taken.  each:
    (repetitions,) slope of each repetition, N/m.  residuals: of each repetition, N.
    determination: R^2.
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
    Return the line through all repetitions (paper, IV-A), loading only, from their means.

    Points of one repetition are not independent: they share the packing of the powder.  So the
    confidence interval is the larger of two: from the scatter of the slopes between repetitions
    (Student, repetitions - 1 degrees of freedom), and from the autocorrelation of the residuals.
    One repetition gives none.
    """
    if not curves:
        raise MeasurementError('no force-displacement curve was given; name at least one file')
    f = np.concatenate([c.loading[1] for c in curves])
    means = [(u.mean(), force.mean()) for u, force in (c.loading for c in curves)]
    from_mean = [(c.loading[0] - u, c.loading[1] - force)
                 for c, (u, force) in zip(curves, means, strict=True)]
    slope = sum(u @ force for u, force in from_mean) / sum(u @ u for u, _ in from_mean)
    if slope <= 0.0:
        raise MeasurementError(
            f'{curves[0].name}: the force falls with displacement (slope {slope:.4g} N/m); check '
            'that the columns are not swapped and that both count in the same direction')
    each = np.array([np.polyfit(*c.loading, 1)[0] for c in curves])
    residuals = tuple(force - slope * u for u, force in from_mean)
    rest = np.concatenate(residuals)
    half = nan
    if len(curves) > 1:
        quantile = scipy.special.stdtrit(len(each) - 1, 0.5 + CONFIDENCE / 2)
        half = max(_half_width(curves),
                   quantile * float(np.std(each, ddof=1)) / np.sqrt(len(each)))
    return Regression(float(slope), float(half),
                      float(np.mean([force - slope * u for u, force in means])), each, residuals,
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
    loading = [(u - u[0], f) for u, f in (c.loading for c in curves)]
    low, high = max(u.min() for u, _ in loading), min(u.max() for u, _ in loading)
    if len(curves) == 1 or low >= high:
        return nan, nan
    grid = np.linspace(low, high, 101)
    forces = np.array([_along(grid, *each) for each in loading])
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


@dataclass(frozen=True, eq=False)
class MeasuredState:
    """The curves of one state of a segment (soft or stiff), and their results."""

    name: str
    curves: Sequence[Curve]
    result: Characterisation


def stiffness_figure(path: str | Path, states: Sequence[MeasuredState], title: str) -> None:
    """Write curves and residuals, one row of panels for each state; mm and N on the axes."""
    figure = new_figure(9.0, 3.6 * len(states) + 0.4)
    panels = figure.subplots(len(states), 2, squeeze=False)
    for (over, rest), state in zip(panels, states, strict=True):
        line = state.result.regression
        for k, (curve, residual) in enumerate(zip(state.curves, line.residuals, strict=True)):
            style = {'color': GREYS[k % len(GREYS)], 'linestyle': DASHES[k % len(DASHES)],
                     'linewidth': 1.0, 'label': f'repetition {k + 1}'}
            over.plot(1e3 * curve.displacement, curve.force, **style)
            rest.plot(1e3 * curve.loading[0], residual, **style)
        ends = np.array([min(c.displacement.min() for c in state.curves),
                         max(c.displacement.max() for c in state.curves)])
        over.plot(1e3 * ends, line.slope * ends + line.intercept, color='0.0', linewidth=2.2,
                  alpha=0.6, label=f'regression, k = {line.slope * 1e-3:.4g} N/mm')
        if state.result.table_curve is not None:
            displacement, force = state.result.table_curve
            over.plot(1e3 * displacement, force, 'o', color='0.0', markersize=4, markevery=10,
                      markerfacecolor='none', label='moment-curvature table')
        rest.axhline(0.0, color='0.0', linewidth=2.2, alpha=0.6)
        over.set_title(f'{title}, {state.name}', parse_math=False)
        rest.set_title('residuals on the way up')
        if len(state.curves) <= 8:
            over.legend(frameon=False, fontsize='small')
        for axes, label in ((over, 'force in N'), (rest, 'force less regression in N')):
            axes.set(xlabel='displacement in mm', ylabel=label)
            axes.grid(alpha=0.3)
    figure.savefig(path, dpi=DPI)


# The verb.


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = Parser(NAME, 'Bending stiffness E I of a segment, soft and stiff, from '
                    'force-displacement curves of a testing machine.', *FOR_ANALYSIS, '--decimal')
    parser.add_argument('soft', type=given_path, nargs='*', metavar='FILE',
                        help='CSV files of the soft segment, one repetition or more in each')
    parser.add_argument('--lateral', type=given_path, nargs='+', default=[], metavar='FILE',
                        help='CSV files of the soft segment of a spatial arm, pushed along y of '
                        'its lower disc; the other files: pushed along x')
    parser.add_argument('--stiff', type=given_path, nargs='+', default=[], metavar='FILE',
                        help='CSV files of the stiff segment')
    parser.add_argument('--segment', type=int, required=True, metavar='N',
                        help='number of the measured segment, 1 at the base')
    parser.add_argument('--lever-arm', type=number_in(1e-4, 1.0, 'm'), required=True,
                        metavar='M', help='l_k of eq. 8: distance from the end of the spring to '
                        'the force, m')
    parser.add_argument('--trust-stiffness', action='store_true',
                        help='accept a stiffness that looks like a wrong unit')
    for name in COLUMNS:
        parser.add_argument(f'--{name}-column', metavar='HEADER',
                            help=f'header of the column of {name}, if it is not recognised, or '
                            'its number')
    for name in UNITS:
        parser.add_argument(f'--{name}-unit', metavar='UNIT',
                            help=f'unit of {name}, overrides the header')
    return run_verb(parser, _run, argv, 'matplotlib')


def _run(options: argparse.Namespace) -> None:
    if not (options.soft or options.lateral or options.stiff):
        raise MeasurementError('no file given; name the CSV files of the soft segment, or of the '
                               'stiff one after --stiff')
    values, arm = described_arm(options)
    if not 1 <= options.segment <= len(arm.segments):
        raise ArmError(f'there is no segment {options.segment}; --segment is 1 to '
                       f'{len(arm.segments)} for this arm')
    index = options.segment - 1
    segment = arm.segments[index]
    described = _stiffnesses(arm, index)
    if options.lateral and LATERAL not in described:
        raise ArmError('--lateral is for spatial arms; this segment is a hinge, as all of a '
                       'planar arm, and does not bend to the side')
    leaf = None if LATERAL in described else _stiffnesses(arm_from_parameters(
        values | {'arm.bending_stiffnesses': (0.0,)}), index)[SOFT]
    files = {state: paths for state, paths in (
        (SOFT, options.soft), (LATERAL, options.lateral), (STIFF, options.stiff)) if paths}
    states = []
    for name, paths in files.items():
        _refuse_twice(paths)
        curves = read_curves(paths, _given(options, 'column'), _given(options, 'unit'),
                             options.decimal)
        states.append(MeasuredState(
            name, curves, characterise(curves, segment.length, options.lever_arm)))
    results = {state.name: state.result for state in states}
    soft = results[SOFT].bending_stiffness if SOFT in results else described[SOFT]
    if not options.trust_stiffness:
        _question(files, results, leaf, described, soft)
    parameters, tables = _parameters(results, values, arm, index, soft)
    arm_from_parameters(values | parameters)  # never write what the nodes would refuse
    figure, layer = reserve_outputs(options.output, [f'{NAME}.png', f'{NAME}.yaml'], options.force)

    print(f'Segment {options.segment}, bending length {segment.length:g} m, lever arm '
          f'{options.lever_arm:g} m\n')
    print(_table(states, arm.bodies_per_segment, leaf, segment.length))
    if STIFF in results:
        ratio = results[STIFF].bending_stiffness / soft
        over = 'the soft one' if SOFT in results else f'E I = {soft:.4g} N m^2 as described'
        print(f'\nStiffness ratio K over {over}: {ratio:.4g}')
    for state in (s for s in states if s.result.table):
        print(f'\nThe {state.name} segment is not linear: {100 * state.result.linearity_error:.1f}'
              f' % of the largest force off a line (more than {100 * NONLINEAR:g} % counts). Its '
              'moment over curvature is '
              + ('written as a table, which replaces '
                 f'{"K" if state.name == STIFF else "E I"}.' if state.name in tables else
                 'not written: a description has a single table, for the softer axis.'))
    for state in states:
        if not (state.result.table or state.result.linearity_error <= NONLINEAR):
            print(f'\nE I of the {state.name} segment is a mean only: its curves are no line '
                  f'(R^2 = {state.result.regression.determination:.3f}), and no law that rises '
                  'fits them. Look at the figure; leave out where it slips, holds or does not '
                  'touch.')
        if (each := state.result.regression.each).max() > ALIKE * each.min():
            print(f'\nThe repetitions of the {state.name} segment differ: k is '
                  f'{1e-3 * each.min():.4g} to {1e-3 * each.max():.4g} N/mm. Are they of one '
                  'segment, in one state, and of its own force?')
        if len(state.curves) == 1:
            print(f'\nThe {state.name} segment has a single repetition, so there is '
                  'no\nconfidence interval: measure three or more.')
    stiffness_figure(figure, states, f'segment {options.segment}')
    write_parameters(layer, parameters, [
        f'Stiffness of segment {options.segment}, by {NAME} from',
        *(f'  {path.name} ({name})' for name, paths in files.items() for path in paths),
        f'with a lever arm of {options.lever_arm:g} m.',
        *(f'E I {name}: {r.bending_stiffness:.4g} N m^2, +- {cell(r.half_width)} (95 %)'
          for name, r in results.items())])
    print(f'\nFigure: {figure}\nParameters: {layer}')


def _refuse_twice(paths: Sequence[Path]) -> None:
    """Refuse a file that is given twice: it would count as two independent measurements."""
    for i, path in enumerate(paths):
        if path.resolve() in [other.resolve() for other in paths[:i]]:
            raise MeasurementError(f'{path} is given twice; each repetition must be a separate '
                                   'measurement')


def _given(options: argparse.Namespace, what: str) -> dict[str, str]:
    """Return the headers or units that were given, by the names of their columns."""
    return {name: given for name in COLUMNS if (given := getattr(options, f'{name}_{what}', None))}


def _question(files: Mapping[str, Sequence[Path]], results: Mapping[str, Characterisation],
              leaf: float | None, described: Mapping[str, float], soft: float) -> None:
    """Raise MeasurementError when a stiffness looks like a wrong unit."""
    for name, paths in files.items():
        if name == STIFF:
            doubt = question_stiff(results[name], soft)
        elif leaf is not None:
            doubt = question_soft(results[name], leaf, 'the leaf spring alone')
        else:
            doubt = question_soft(results[name], described[name], 'the described segment')
        if doubt:
            raise MeasurementError(
                f'{", ".join(map(str, paths))}: {doubt}? State the right one with '
                '--force-unit, --displacement-unit or --lever-arm; --trust-stiffness accepts it')


def _stiffnesses(arm: Arm, index: int) -> dict[str, float]:
    """Return E I of a soft segment (0-based) about y and, if it bends so, about x, N m^2."""
    named = zip((SOFT, LATERAL), arm.segments[index].stiffnesses, strict=False)
    return {name: stiffness for name, stiffness in named if stiffness < inf}


def _table(states: Sequence[MeasuredState], bodies: int, leaf: float | None, length: float) -> str:
    alone = None if leaf is None else joint_stiffness(leaf, length, bodies)

    def column(state: MeasuredState) -> dict[str, str]:
        result = state.result
        line, stiffness = result.regression, result.bending_stiffness
        joint = joint_stiffness(stiffness, length, bodies)
        beside = {} if alone is None else {
            '  leaf spring alone, N m/rad': f'{alone:.4g}',
            '  error of the leaf spring alone': f'{100 * (1 - alone / joint):.3g} %'}
        return {
            'repetitions': str(len(state.curves)),
            'points on the way up': str(sum(len(c.loading[0]) for c in state.curves)),
            'k, N/mm': f'{1e-3 * line.slope:.4g}',
            '  95 % confidence, +- N/mm': cell(1e-3 * line.half_width),
            '  of each repetition, N/mm': _listed([f'{1e-3 * k:.4g}' for k in line.each]),
            '  R^2': f'{line.determination:.5f}',
            'E I, N m^2 (eq. 8)': f'{stiffness:.4g}',
            '  95 % confidence, +- N m^2': cell(result.half_width),
            'c_phi = E I / l, N m/rad': f'{stiffness / length:.4g}',
            f'c_phi_i, n = {bodies}, N m/rad (eq. 5)': f'{joint:.4g}',
            **beside,
            'deviation from line, of largest force': cell(100 * result.linearity_error, ' %'),
            'spread between repetitions, N': cell(result.spread),
            'settling, last over first force': cell(100 * result.settling, ' %', '+.2g'),
            'hysteresis, work lost':
                _listed([f'{100 * h:.2g} %' for h in result.hysteresis]) or '-',
        }

    columns = [column(state) for state in states]
    return text_table(['', *(s.name for s in states)],
                      [[label, *(c[label] for c in columns)] for label in columns[0]])


def _listed(items: Sequence[str]) -> str:
    """Return the items; if there are many, the first and last few."""
    return ' '.join(items if len(items) <= 6 else [*items[:3], '...', *items[-2:]])


def _parameters(results: Mapping[str, Characterisation], values: Mapping[str, Value],
                arm: Arm, index: int, soft: float
                ) -> tuple[dict[str, Value], tuple[str, ...]]:
    """
    Return the lists that replace those of the description, and the states with tables.

    Lists are whole.  The table of the soft segment is for its softer axis.
    """
    parameters: dict[str, Value] = {}
    for name, result in results.items():
        given: Any = values[REPLACED[name]]
        whole = [*given] if len(given) == len(arm.segments) else [*given] * len(arm.segments)
        whole[index] = result.bending_stiffness / (soft if name == STIFF else 1.0)
        parameters[REPLACED[name]] = tuple(whole)
    about = _stiffnesses(arm_from_parameters(
        {**values, **parameters, **{f'arm.{of}_{what}': (0.0,) for of in (SOFT, STIFF)
                                    for what in ('curvatures', 'moments')}}), index)
    softer = min(about, key=lambda name: about[name])
    laws = {SOFT: [s.soft_law for s in arm.segments], STIFF: [s.jam.law for s in arm.segments]}
    # Stiff, it was pushed along x alone.
    tables = [name for name in (softer, *([STIFF] if softer == SOFT else [])) if name in results]
    for name in tables:
        state = STIFF if name == STIFF else SOFT
        if laws[state][index] != results[name].table:
            laws[state][index] = results[name].table
            parameters |= table_parameters(laws[state], state)
    return parameters, tuple(tables)
