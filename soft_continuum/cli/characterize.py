# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Stiffness of a segment from force-displacement curves (paper, IV-A).

A segment of a spatial arm may differ in stiffness about x and y.  Pushing it along x bends it
about y, pushing it along y bends it about x.
"""

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
from soft_continuum.arguments import FOR_ANALYSIS, given_path, number_in, Parser
from soft_continuum.cli.common import described_arm, run_verb
from soft_continuum.mechanics.arm import Arm, ArmError
from soft_continuum.mechanics.stiffness import joint_stiffness
from soft_continuum.parameters.arm import arm_from_parameters, table_parameters
from soft_continuum.parameters.files import write_parameters
from soft_continuum.parameters.parameter import Value

NAME = 'characterize'
COLUMNS = ('force', 'displacement', 'time', 'repetition')
UNITS = ('force', 'displacement')
SOFT, LATERAL, STIFF = 'soft', 'lateral', 'stiff'
REPLACED = {SOFT: 'arm.bending_stiffnesses', LATERAL: 'arm.lateral_bending_stiffnesses',
            STIFF: 'arm.stiffness_ratios'}


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
        raise ArmError('--lateral is for spatial arms; a planar arm does not bend to the side')
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
        if not isfinite(state.result.linearity_error):
            print(f'\nE I of the {state.name} segment is a mean only: its curves are no line '
                  f'(R^2 = {state.result.regression.determination:.3f}), and no law that rises '
                  'fits them. Look at the figure; leave out where it slips.')
        if len(state.curves) == 1:
            print(f'\nThe {state.name} segment has a single repetition, so there is '
                  'no\nconfidence interval: measure three or more.')
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
    return dict(zip((SOFT, LATERAL), arm.segments[index].stiffnesses, strict=False))


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
            '  95 % confidence, +- N/mm': _cell(1e-3 * line.half_width),
            '  of each repetition, N/mm': _listed([f'{1e-3 * k:.4g}' for k in line.each]),
            '  R^2': f'{line.determination:.5f}',
            'E I, N m^2 (eq. 8)': f'{stiffness:.4g}',
            '  95 % confidence, +- N m^2': _cell(result.half_width),
            'c_phi = E I / l, N m/rad': f'{stiffness / length:.4g}',
            f'c_phi_i, n = {bodies}, N m/rad (eq. 5)': f'{joint:.4g}',
            **beside,
            'deviation from line, of largest force':
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
