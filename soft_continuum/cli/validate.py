# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Position error of the models against measured shapes (paper, V)."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from soft_continuum.analysis.measured_shapes import read_shapes
from soft_continuum.analysis.result_figures import validation_figure
from soft_continuum.analysis.results import reserve_outputs, text_table, write_rows
from soft_continuum.analysis.validation import predict, Prediction
from soft_continuum.arguments import given_path
from soft_continuum.cli.common import described_arm, run_verb, shapes_parser
from soft_continuum.mechanics.arm import Arm, ArmError
from soft_continuum.mechanics.directions import hinged
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import load_description

NAME = 'validate'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = shapes_parser(NAME, 'Compute the position error of constant curvature and of the '
                           'chain model, without and with gravity, against measured points.',
                           'angle, payload')
    parser.add_argument('--corrected', type=given_path, action='append', default=[],
                        metavar='FILE',
                        help='parameters that correct the arm, such as characterize.yaml: adds a '
                             'series; may be repeated')
    return run_verb(parser, _run, argv, 'matplotlib')


def _run(options: argparse.Namespace) -> None:
    values, arm = described_arm(options)
    corrected = None
    if options.corrected:
        corrected = arm_from_parameters(
            load_description(*options.params_file, *options.corrected,
                             namespace=options.namespace))
        sizes = [([s.length for s in a.segments], [d.height for d in a.discs])
                 for a in (arm, corrected)]
        if sizes[0] != sizes[1]:
            raise ArmError(f'--corrected has an arm with segments of {sizes[1][0]} m and discs of '
                           f'{sizes[1][1]} m, --params-file one with {sizes[0][0]} and '
                           f'{sizes[0][1]}; they must be the same arm')
    shapes = read_shapes(options.points, options.pulls, arm, bool(values['arm.jamming']),
                         options.decimal)
    figure, listing = reserve_outputs(
        options.output, [f'{NAME}.png', f'{NAME}.csv'], options.force)
    predictions = predict(shapes, arm, corrected)
    print('Position errors at the calculation points, without the two of the base disc. Percent: '
          'the largest\nerror, relative to the distance of its point from the base and to the '
          f'length of the arm ({1e3 * arm.length:g} mm).\n')
    print(_summary(predictions, arm))
    for prediction in predictions:
        if prediction.jumped:
            print(f'{prediction.shape.name}, {prediction.model}: the arm snaps to another '
                  'equilibrium during the motion')
    if hinged(arm):
        print('\nPulls of the loaded tendon at the end of each step in mm: measured, and needed '
              'for the angle\nthat was set. "-": no angle was given, or no tendon holds it.\n')
        print(_pulls(predictions, arm.tendon_labels))
    validation_figure(figure, predictions)
    _write_errors(listing, predictions, arm)
    print(f'\nFigure: {figure}\nError of each point: {listing}')


def _summary(predictions: Sequence[Prediction], arm: Arm) -> str:
    segments = range(len(arm.segments))
    head = ['shape', 'model', 'mean mm', 'max mm', '% of distance', '% of length',
            *(f'segment {s + 1} mm' for s in segments), 'no tendon taut']
    rows, last = [], ''
    for p in predictions:
        errors = 1e3 * p.errors
        each = [[e for e, of in zip(errors, p.segments, strict=True) if of == s] for s in segments]
        rows.append([
            p.shape.name if p.shape.name != last else '', p.model, f'{errors.mean():.2f}',
            f'{errors.max():.2f}', f'{100 * p.relative_errors.max():.2f}',
            f'{0.1 * errors.max() / arm.length:.2f}',
            *(f'{max(e):.2f}' if e else '-' for e in each),
            ', '.join(f'step {k}' for k, slack in enumerate(p.slack, start=1) if slack) or '-'])
        last = p.shape.name
    return text_table(head, rows, left=2)


def _pulls(predictions: Sequence[Prediction], tendons: Sequence[str]) -> str:
    def pull(tendon: int, by: float) -> str:
        return f'{tendons[tendon]} {1e3 * by:.2f}'

    models = list(dict.fromkeys(p.model for p in predictions))
    rows = []
    for shape in dict.fromkeys(p.shape for p in predictions):
        needed = {p.model: p.needed for p in predictions if p.shape is shape}
        for k, step in enumerate(shape.steps):
            actual = ', '.join(pull(t, p) for t, p in enumerate(step.pulls) if np.isfinite(p))
            cells = []
            for model in models:
                found = needed[model][k]
                cells.append('-' if found is None else pull(*found))
            segment = '' if step.segment is None else str(step.segment + 1)
            rows.append([shape.name if k == 0 else '', segment, actual or 'slack',
                         *cells])
    return text_table(['shape', 'segment', 'measured', *models], rows)


def _write_errors(path: Path, predictions: Sequence[Prediction], arm: Arm) -> None:
    rows: list[Sequence[object]] = [[
        'shape', 'model', 'segment', 'point', *(f'{x} [mm]' for x in arm.axes), 'error [mm]',
        'error over distance from base [%]', 'error over arm length [%]']]
    for p in predictions:
        for row, segment, error, relative in zip(
                p.shape.moving, p.segments, p.errors, p.relative_errors, strict=True):
            number = p.shape.numbers[row]
            rows.append([
                p.shape.name, p.model, segment + 1, number + 1,
                *(f'{1e3 * value:.3f}' for value in p.points[number, arm.pose_axes[:3]]),
                f'{1e3 * error:.3f}', f'{100 * relative:.3f}', f'{100 * error / arm.length:.3f}'])
    write_rows(path, rows)
