# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Stiffness of a segment from force-displacement curves (paper, IV-A)."""

import argparse
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

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
from soft_continuum.analysis.results import reserve_outputs, text_table
from soft_continuum.arguments import FOR_ANALYSIS, number_in, Parser
from soft_continuum.cli.common import described_arm, run_verb
from soft_continuum.mechanics.arm import Arm, ArmError, Segment
from soft_continuum.mechanics.stiffness import joint_stiffness
from soft_continuum.parameters.arm import arm_from_parameters, table_parameters
from soft_continuum.parameters.files import write_parameters
from soft_continuum.parameters.parameter import Value

NAME = 'characterize'
COLUMNS = ('force', 'displacement', 'time', 'repetition')
UNITS = ('force', 'displacement', 'time')


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = Parser(NAME, 'Bending stiffness E I of a segment, soft and stiff, from '
                    'force-displacement curves of a testing machine.', *FOR_ANALYSIS)
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
    return run_verb(parser, _run, argv)


def _run(options: argparse.Namespace) -> None:
    if not options.soft and not options.stiff:
        raise MeasurementError('no file given; name the CSV files of the soft segment, or of the '
                               'stiff one after --stiff')
    values, arm = described_arm(options)
    if not 1 <= options.segment <= len(arm.segments):
        raise ArmError(f'there is no segment {options.segment}; --segment is 1 to '
                       f'{len(arm.segments)} for this arm')
    index = options.segment - 1
    segment = arm.segments[index]
    leaf = arm_from_parameters(values | {'arm.bending_stiffnesses': (0.0,)}).segments[index]
    files = {state: paths for state, paths in (('soft', options.soft), ('stiff', options.stiff))
             if paths}
    states = []
    for name, paths in files.items():
        _refuse_twice(paths)
        curves = read_curves(paths, _given(options, 'column'), _given(options, 'unit'))
        states.append(MeasuredState(
            name, curves, characterise(curves, segment.length, options.lever_arm)))
    results = {state.name: state.result for state in states}
    soft = (results['soft'].bending_stiffness if 'soft' in results
            else segment.bending_stiffness)
    if not options.trust_stiffness:
        _question(files, results, leaf.bending_stiffness, soft)
    parameters = _parameters(results, values, arm, index, soft)
    arm_from_parameters(values | parameters)  # what the nodes would refuse is not written
    figure, layer = reserve_outputs(options.output, [f'{NAME}.png', f'{NAME}.yaml'], options.force)

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
        if len(state.curves) == 1:
            print(f'\nOne repetition of the {state.name} segment does not tell how far they '
                  'scatter, so there is no\nconfidence interval: measure three or more.')
    stiffness_figure(figure, states, f'segment {options.segment}')
    write_parameters(layer, parameters, [
        f'Stiffness of segment {options.segment}, by {NAME} from',
        *(f'  {path.name} ({name})' for name, paths in files.items() for path in paths),
        f'with a lever arm of {options.lever_arm:g} m.',
        *(f'E I {name}: {r.bending_stiffness:.4g} N m^2, +- {_cell(r.half_width)} (95 %)'
          for name, r in results.items())])
    print(f'\nFigure: {figure}\nParameters: {layer}')


def _refuse_twice(paths: Sequence[Path]) -> None:
    """Refuse a file that is given twice: it would count as two independent measurements."""
    for i, path in enumerate(paths):
        if path.resolve() in [other.resolve() for other in paths[:i]]:
            raise MeasurementError(f'{path} is given twice; a repetition is a measurement of its '
                                   'own')


def _given(options: argparse.Namespace, what: str) -> dict[str, str]:
    """Return the headers or units that were given, by the names of their columns."""
    return {name: given for name in COLUMNS if (given := getattr(options, f'{name}_{what}', None))}


def _question(files: Mapping[str, Sequence[Path]], results: Mapping[str, Characterisation],
              leaf: float, soft: float) -> None:
    """Raise MeasurementError when a stiffness looks like a wrong unit."""
    for name, paths in files.items():
        doubt = (question_soft(results[name], leaf) if name == 'soft'
                 else question_stiff(results[name], soft))
        if doubt:
            raise MeasurementError(
                f'{", ".join(map(str, paths))}: {doubt}? State the right one with '
                '--force-unit, --displacement-unit or --lever-arm; --trust-stiffness accepts it')


def _table(states: Sequence[MeasuredState], bodies: int, leaf: Segment, segment: Segment) -> str:
    alone = joint_stiffness(leaf.bending_stiffness, segment.length, bodies)

    def column(state: MeasuredState) -> dict[str, str]:
        result = state.result
        line, stiffness = result.regression, result.bending_stiffness
        joint = joint_stiffness(stiffness, segment.length, bodies)
        return {
            'repetitions': str(len(state.curves)),
            'points on the way up': str(sum(len(c.loading[0]) for c in state.curves)),
            'k, N/mm': f'{1e-3 * line.slope:.4g}',
            '  95 % confidence, +- N/mm': _cell(1e-3 * line.half_width),
            '  of each repetition, N/mm': _listed([f'{1e-3 * k:.4g}' for k in line.each]),
            '  R^2': f'{line.determination:.5f}',
            'E I, N m^2 (eq. 8)': f'{stiffness:.4g}',
            '  95 % confidence, +- N m^2': _cell(result.half_width),
            'c_phi = E I / l, N m/rad': f'{stiffness / segment.length:.4g}',
            f'c_phi_i, n = {bodies}, N m/rad (eq. 5)': f'{joint:.4g}',
            '  leaf spring alone, N m/rad': f'{alone:.4g}',
            '  error of the leaf spring alone': f'{100 * (1 - alone / joint):.3g} %',
            'furthest from a line, of largest force':
                _cell(100 * result.linearity_error, ' %'),
            'spread between repetitions, N': _cell(result.spread),
            'settling, last over first force': _cell(100 * result.settling, ' %', '+.2g'),
            'hysteresis, work lost':
                _listed([f'{100 * h:.2g} %' for h in result.hysteresis]) or '-',
        }

    columns = [column(state) for state in states]
    return text_table(['', *(s.name for s in states)],
                      [[label, *(c[label] for c in columns)] for label in columns[0]])


def _cell(value: float, unit: str = '', digits: str = '.2g') -> str:
    return f'{value:{digits}}{unit}' if isfinite(value) else '-'


def _listed(items: Sequence[str]) -> str:
    """Return the items, of many the first and the last few."""
    return ' '.join(items if len(items) <= 6 else [*items[:3], '...', *items[-2:]])


def _parameters(results: Mapping[str, Characterisation], values: Mapping[str, Value],
                arm: Arm, index: int, soft: float) -> dict[str, Value]:
    """Return what replaces the lists of the description, whole lists as these are."""
    parameters: dict[str, Value] = {}
    laws = {'soft': [s.soft_law for s in arm.segments], 'stiff': [s.jam.law for s in arm.segments]}
    for name, result in results.items():
        before = laws[name][index]
        laws[name][index] = result.table
        if before != result.table:
            parameters |= table_parameters(laws[name], name)
        stiffness = result.bending_stiffness
        replaced, value = {'soft': ('arm.bending_stiffnesses', stiffness),
                           'stiff': ('arm.stiffness_ratios', stiffness / soft)}[name]
        given: Any = values[replaced]
        whole = [*given] if len(given) == len(arm.segments) else [*given] * len(arm.segments)
        whole[index] = value
        parameters[replaced] = tuple(whole)
    return parameters
