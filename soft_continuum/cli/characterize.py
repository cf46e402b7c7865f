# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Stiffness of a segment from force-displacement curves (paper, IV-A)."""

import argparse
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path

from soft_continuum.analysis.characterisation import (
    Characterisation,
    characterise,
    NONLINEAR,
    question_soft,
    question_stiff,
)
from soft_continuum.analysis.curves import read_curves
from soft_continuum.analysis.delimited import MeasurementError
from soft_continuum.analysis.result_figures import MeasuredState, stiffness_figure
from soft_continuum.analysis.results import claim, text_table, write_parameters
from soft_continuum.arguments import number_in
from soft_continuum.cli.common import described_arm, guarded, new_parser
from soft_continuum.mechanics.arm import Arm, ArmError, Segment
from soft_continuum.mechanics.stiffness import joint_stiffness
from soft_continuum.parameters.arm import arm_from_parameters, table_parameters

NAME = 'characterize'
COLUMNS = ('force', 'displacement', 'time', 'repetition')
UNITS = ('force', 'displacement', 'time')


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = new_parser(NAME, 'Bending stiffness E I of a segment, soft and stiff, from '
                        'force-displacement curves of a testing machine.')
    parser.add_argument('soft', type=Path, nargs='*', metavar='FILE',
                        help='CSV files of the soft segment, one repetition or more in each')
    parser.add_argument('--stiff', type=Path, nargs='+', default=[], metavar='FILE',
                        help='CSV files of the stiff segment')
    parser.add_argument('--segment', type=int, required=True, metavar='N',
                        help='which segment was measured, 1 is the lowest')
    parser.add_argument('--lever-arm', type=number_in(1e-4, 1.0, 'm'), required=True,
                        metavar='M', help='l_k of eq. 8: from the end of the spring to where the '
                        'force acts, m')
    parser.add_argument('--trust-stiffness', action='store_true',
                        help='accept a stiffness that looks like a wrong unit')
    for name in COLUMNS:
        parser.add_argument(f'--{name}-column', metavar='HEADER',
                            help=f'header of the column of {name}, where it is not recognised')
    for name in UNITS:
        parser.add_argument(f'--{name}-unit', metavar='UNIT',
                            help=f'unit of {name}, in place of what the header says')
    options = parser.parse_args(argv)
    if not options.soft and not options.stiff:
        parser.error('no file given; name the CSV files of the soft segment, or of the stiff one '
                     'after --stiff')
    return guarded(NAME, _run, options)


def _run(options: argparse.Namespace) -> None:
    values, arm = described_arm(options)
    if not 1 <= options.segment <= len(arm.segments):
        raise ArmError(f'there is no segment {options.segment}; --segment is 1 to '
                       f'{len(arm.segments)} for this arm')
    index = options.segment - 1
    segment = arm.segments[index]
    leaf = arm_from_parameters(values | {'arm.bending_stiffnesses': (0.0,)}).segments[index]
    columns = {n: getattr(options, f'{n}_column') for n in COLUMNS
               if getattr(options, f'{n}_column')}
    units = {n: getattr(options, f'{n}_unit') for n in UNITS if getattr(options, f'{n}_unit')}
    states = []
    for name, files in (('soft', options.soft), ('stiff', options.stiff)):
        if files:
            curves = read_curves(files, columns, units)
            states.append(MeasuredState(
                name, curves, characterise(curves, segment.length, options.lever_arm)))
    results = {state.name: state.result for state in states}
    soft = (results['soft'].bending_stiffness if 'soft' in results
            else segment.bending_stiffness)
    if not options.trust_stiffness:
        _question(options, results, leaf.bending_stiffness, soft)
    parameters = _parameters(results, values, arm, index, soft)
    # What the nodes would refuse is not written.
    arm_from_parameters(values | {f'arm.{name}': value for name, value in parameters.items()})
    figure, layer = claim(options.output, [f'{NAME}.png', f'{NAME}.yaml'], options.force)

    print(f'Segment {options.segment}, bending length {segment.length:g} m, lever arm '
          f'{options.lever_arm:g} m\n')
    print(_table(states, arm.bodies_per_segment, leaf, segment))
    if 'stiff' in results:
        ratio = results['stiff'].bending_stiffness / soft
        over = 'the soft one' if 'soft' in results else f'E I = {soft:.4g} N m^2 as described'
        print(f'\nStiffness ratio K over {over}: {ratio:.4g}')
    for state in (s for s in states if s.result.table):
        print(f'\nThe {state.name} segment is not linear: {100 * state.result.linearity_error:.1f}'
              f' % of the largest force off a line (more than {100 * NONLINEAR:g} % counts). Its '
              'moment over curvature is written as a table, which takes the place of '
              + {'soft': 'E I.', 'stiff': 'K.'}[state.name])
    for state in states:
        if not isfinite(state.result.linearity_error):
            print(f'\nE I of the {state.name} segment is a mean only: its curves are no line '
                  f'(R^2 = {state.result.regression.determination:.3f}), and no law that rises '
                  'fits them. Look at the figure; leave out where it slips.')
    stiffness_figure(figure, states, f'segment {options.segment}')
    write_parameters(layer, parameters, [
        f'Stiffness of segment {options.segment}, by {NAME} from',
        *(f'  {file.name} ({name})' for name, files in (
            ('soft', options.soft), ('stiff', options.stiff)) for file in files),
        f'with a lever arm of {options.lever_arm:g} m.',
        *(f'E I {name}: {r.bending_stiffness:.4g} +- {r.half_width:.2g} N m^2 (95 %)'
          for name, r in results.items())])
    print(f'\nFigure: {figure}\nParameters: {layer}')


def _question(options: argparse.Namespace, results: dict[str, Characterisation], leaf: float,
              soft: float) -> None:
    """Raise MeasurementError when a stiffness looks like a wrong unit."""
    for name, files in (('soft', options.soft), ('stiff', options.stiff)):
        if not files:
            continue
        doubt = (question_soft(results[name], leaf) if name == 'soft'
                 else question_stiff(results[name], soft))
        if doubt:
            raise MeasurementError(
                f'{", ".join(str(f) for f in files)}: {doubt}? State the right one with '
                '--force-unit, --displacement-unit or --lever-arm; --trust-stiffness accepts it')


def _table(states: Sequence[MeasuredState], bodies: int, leaf: Segment, segment: Segment) -> str:
    alone = joint_stiffness(leaf.bending_stiffness, segment.length, bodies)
    rows = [['repetitions', *(str(len(s.curves)) for s in states)],
            ['points on the way up',
             *(str(sum(len(c.loading[0]) for c in s.curves)) for s in states)]]

    def row(label: str, value: list[str]) -> None:
        rows.append([label, *value])

    results = [s.result for s in states]
    stiffness = [joint_stiffness(r.bending_stiffness, segment.length, bodies) for r in results]
    row('k, N/mm', [f'{1e-3 * r.regression.slope:.4g}' for r in results])
    row('  95 % confidence, +- N/mm', [f'{1e-3 * r.regression.half_width:.2g}' for r in results])
    row('  of each repetition, N/mm',
        [_listed([f'{1e-3 * k:.4g}' for k in r.regression.each]) for r in results])
    row('  R^2', [f'{r.regression.determination:.5f}' for r in results])
    row('E I, N m^2 (eq. 8)', [f'{r.bending_stiffness:.4g}' for r in results])
    row('  95 % confidence, +- N m^2', [f'{r.half_width:.2g}' for r in results])
    row('c_phi = E I / l, N m/rad', [f'{r.bending_stiffness / segment.length:.4g}'
                                     for r in results])
    row(f'c_phi_i, n = {bodies}, N m/rad (eq. 5)', [f'{c:.4g}' for c in stiffness])
    row('  leaf spring alone, N m/rad', [f'{alone:.4g}'] * len(results))
    row('  error of the leaf spring alone', [f'{100 * (1 - alone / c):.3g} %' for c in stiffness])
    row('furthest from a line, of largest force',
        [f'{100 * r.linearity_error:.2g} %' if isfinite(r.linearity_error) else 'not determined'
         for r in results])
    row('spread between repetitions, N', [f'{r.spread:.2g}' for r in results])
    row('settling, last over first force', [f'{100 * r.settling:+.2g} %' for r in results])
    row('hysteresis, work lost',
        [_listed([f'{100 * h:.2g} %' for h in r.hysteresis]) or 'not measured' for r in results])
    return text_table(['', *(s.name for s in states)], rows)


def _listed(items: Sequence[str]) -> str:
    """Return the items, of many the first and the last few."""
    return ' '.join(items if len(items) <= 6 else [*items[:3], '...', *items[-2:]])


def _parameters(results: dict[str, Characterisation], values: Mapping[str, object],
                arm: Arm, index: int, soft: float) -> dict[str, Sequence[float]]:
    """Return what replaces the lists of the description, whole lists as these are."""
    parameters: dict[str, Sequence[float]] = {}
    segments = arm.segments
    for name, laws in (('soft', [s.soft_law for s in segments]),
                       ('stiff', [s.jam.law for s in segments])):
        before = list(laws)
        if name in results:
            laws[index] = results[name].table
        if laws != before:
            parameters |= table_parameters(laws, name)
    if 'soft' in results:
        parameters['bending_stiffnesses'] = _replaced(
            values['arm.bending_stiffnesses'], len(segments), index, soft)
    if 'stiff' in results:
        parameters['stiffness_ratios'] = _replaced(
            values['arm.stiffness_ratios'], len(segments), index,
            results['stiff'].bending_stiffness / soft)
    return parameters


def _replaced(given: object, count: int, index: int, value: float) -> Sequence[float]:
    assert isinstance(given, tuple)
    whole = list(given if len(given) == count else given * count)
    whole[index] = value
    return whole
