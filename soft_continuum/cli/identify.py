# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Stiffness, masses and other unknowns of the arm from measured points and pulls."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from math import nan

import numpy as np

from soft_continuum.analysis.identification import (
    Identification,
    identify,
    shape_error,
    without,
)
from soft_continuum.analysis.measured_shapes import MeasuredShape, read_shapes
from soft_continuum.analysis.result_figures import identification_figure, ShapeResult
from soft_continuum.analysis.results import progress, reserve_outputs, text_table
from soft_continuum.analysis.unknowns import (
    find_unknowns,
    IdentificationError,
    parameters_of,
    spread_out,
    Values,
)
from soft_continuum.cli.common import described_arm, run_verb, shapes_parser
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.parameters.files import write_parameters

NAME = 'identify'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = shapes_parser(NAME, 'Fit unknown parameters of the arm to measured points. Reports '
                           'errors on shapes left out of the fit.', 'payload')
    parser.add_argument('--fit', nargs='+', metavar='UNKNOWN',
                        help='stiffness_N, ratio_N, segment_mass_N, disc_mass_N, offset_N of '
                             'segment N; stiffness, mass, offset (one factor for all), friction, '
                             'stretch, tilt; for spatial arms also angle_N of the tendons that '
                             'end at disc N (default: stiffness of every segment)')
    parser.add_argument('--hold-out', nargs='+', default=[], metavar='SHAPE',
                        help='shapes to leave out of the fit (default: fit all, then leave out '
                             'each in turn)')
    return run_verb(parser, _run, argv, 'matplotlib')


def _run(options: argparse.Namespace) -> None:
    values, arm = described_arm(options)
    names = options.fit or [f'stiffness_{n + 1}' for n in range(len(arm.segments))]
    begun = spread_out(values)
    unknowns = find_unknowns(names, begun)
    shapes = read_shapes(options.points, options.pulls, arm, bool(values['arm.jamming']),
                         options.decimal)
    kept = without(shapes, options.hold_out)
    figure, layer = reserve_outputs(options.output, [f'{NAME}.png', f'{NAME}.yaml'], options.force)
    found = identify(begun, unknowns, kept)
    print(f'{len(kept)} shapes, {sum(s.coordinates for s in kept)} measured coordinates; '
          f'noise of a coordinate, from the residuals: {1e3 * found.noise:.3g} mm\n')
    print(_values(found))
    if len(unknowns) > 1:
        print('\nCorrelations\n')
        print(_correlations(found))
    write_parameters(layer, parameters_of(found.arm, unknowns), [
        f'Identified by {NAME} from',
        f'  {options.points.name}',
        f'  {options.pulls.name}',
        *(f'{u.name}: {v:.5g} +- {h:.2g} {u.unit} (95 %)'.replace('  ', ' ') for u, v, h in zip(
            unknowns, found.values, found.half_widths, strict=True)),
        'These values belong to the second-order chain.'])
    print(f'\nParameters: {layer}', flush=True)
    results = [_held_out(begun, found, shape, kept, options.hold_out)
               for shape in progress(shapes, 'without each shape')]
    print('\nLargest position error of each shape in mm; without it: of a fit that leaves it '
          'out.\n')
    print(text_table(['shape', 'as described', 'identified', 'without it'], [
        [r.name, _mm(r.described), _mm(r.identified), _mm(r.held_out)] for r in results]))
    if not all(np.isfinite(r.held_out) for r in results if not options.hold_out):
        print('\n"-": without this shape the others do not determine every unknown.')
    identification_figure(figure, found, results)
    print(f'\nFigure: {figure}')


def _held_out(begun: Values, found: Identification, shape: MeasuredShape,
              kept: Sequence[MeasuredShape], named: Sequence[str]) -> ShapeResult:
    """Return the errors of one shape, from a fit without it unless shapes were named."""
    described, identified = (_largest(one, shape) for one in (begun, found.arm))
    held_out = nan
    if shape.name in named:
        held_out = identified
    elif not named and len(kept) > 1:
        begin = [replace(u, start=float(v))
                 for u, v in zip(found.unknowns, found.values, strict=True)]
        try:
            rest = identify(begun, begin, without(kept, [shape.name]))
            held_out = _largest(rest.arm, shape)
        except IdentificationError:
            pass
    return ShapeResult(shape.name, described, identified, held_out)


def _largest(described: Values, shape: MeasuredShape) -> float:
    try:
        return float(shape_error(described, shape).max())
    except StaticsError:
        return nan


def _mm(value: float) -> str:
    return f'{1e3 * value:.2f}' if np.isfinite(value) else '-'


def _values(found: Identification) -> str:
    rows = [[u.name, f'{u.start:.5g}', f'{v:.5g}', f'{h:.2g}',
             f'{100 * h / abs(v):.2g} %' if abs(v) > h else '-', u.unit]
            for u, v, h in zip(found.unknowns, found.values, found.half_widths, strict=True)]
    return text_table(['unknown', 'described', 'identified', '95 %, +-', 'of value', 'unit'], rows)


def _correlations(found: Identification) -> str:
    names = [u.name for u in found.unknowns]
    return text_table(['', *names], [
        [name, *(f'{c:+.2f}' for c in row)]
        for name, row in zip(names, found.correlations, strict=True)])
