# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Models against measured shapes: constant curvature, chain, chain under gravity (paper, V, Fig. 5).

Every model gets the pulls of the rig.  Errors are distances between calculation points; the base
disc, which is fixed, is excluded.
"""

import argparse
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from soft_continuum.lab.analysis.measured_shapes import (
    MeasuredShape,
    read_shapes,
    simulate_steps,
    Step,
)
from soft_continuum.lab.analysis.verbs import (
    described_arm,
    finish_panels,
    new_figure,
    new_panels,
    progress,
    reserve_outputs,
    run_verb,
    shapes_parser,
    text_table,
    write_rows,
)
from soft_continuum.mechanics import (
    Arm,
    ArmError,
    constant_curvature,
    SLACK,
    Statics,
    StaticsError,
)
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.directions import hinged
from soft_continuum.parameters.arguments import given_path
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.ros.description import load_description

CONSTANT_CURVATURE = 'constant curvature'
WITHOUT_GRAVITY = 'chain, no gravity'
WITH_GRAVITY = 'chain, gravity'
CORRECTED = 'chain, gravity, corrected'
MODEL_STYLES = {CONSTANT_CURVATURE: ('s', 9.0, ''), WITHOUT_GRAVITY: ('+', 9.0, ''),
                WITH_GRAVITY: ('^', 6.0, '--'), CORRECTED: ('D', 6.0, '')}
"""Marker, its size and the line of each model."""
MAX_PANELS = 4
NAME = 'validate'


@dataclass(frozen=True, eq=False)
class Prediction:
    """
    One shape by one model.

    points: (2 * discs, 3), m.  slack: for each step, whether no tendon was taut at its end.
    jumped: whether the arm snapped to another equilibrium on the way.  needed: for each step,
    tendon and pull (m) that bend the segment to the commanded angle; None if no angle was given,
    no tendon can, or an angle does not determine the bending.
    """

    model: str
    shape: MeasuredShape
    points: Array
    slack: tuple[bool, ...]
    jumped: bool
    needed: tuple[tuple[int, float] | None, ...]

    @property
    def errors(self) -> Array:
        """Distance (m) of the measured points, without those of the base disc."""
        return self.shape.errors(self.points)

    @property
    def relative_errors(self) -> Array:
        """Errors over the distance of the measured point from the base."""
        from_base: Array = self.shape.errors(np.zeros_like(self.points))
        return self.errors / from_base

    @property
    def segments(self) -> list[int]:
        """Segment (0-based) of each error: the one below the disc."""
        return [self.shape.numbers[row] // 2 - 1 for row in self.shape.moving]


def predict(shapes: Sequence[MeasuredShape], arm: Arm, corrected: Arm | None = None
            ) -> tuple[Prediction, ...]:
    """
    Return the results of each model for each shape, shape by shape.

    corrected: the arm with measured stiffness.  Raises StaticsError naming model, shape and step.
    """
    predictions = []
    for shape in progress(shapes, 'shapes'):
        predictions.append(_constant_curvature(shape, arm))
        predictions.append(_chain(WITHOUT_GRAVITY, shape, arm.without_gravity()))
        predictions.append(_chain(WITH_GRAVITY, shape, arm))
        if corrected is not None:
            predictions.append(_chain(CORRECTED, shape, corrected))
    return tuple(predictions)


def _constant_curvature(shape: MeasuredShape, arm: Arm) -> Prediction:
    """Return arcs for the pulls of the tendons; straight if these do not determine them."""
    bending = np.zeros((len(arm.segments), 2))
    aimed, needed = bending.copy(), []
    for step in shape.steps:
        soft = np.array(step.soft(len(arm.segments)))
        bending[soft] = aimed[soft] = 0.0
        with suppress(ArmError):
            bending = constant_curvature.bending(arm, step.pulls, bending, soft.tolist())
        before = constant_curvature.pulls(arm, aimed)
        wanted = _wanted(arm, step)
        aimed[soft] = bending[soft] if wanted is None else wanted[soft]
        pulls = constant_curvature.pulls(arm, aimed)
        most = len(pulls) - 1 - int(np.argmax((pulls - before)[::-1]))
        needed.append(None if wanted is None else (most, float(pulls[most])))
    slack = tuple(set(step.pulls) == {SLACK} for step in shape.steps)
    return Prediction(CONSTANT_CURVATURE, shape, constant_curvature.poses(arm, bending)[0], slack,
                      False, tuple(needed))


def _wanted(arm: Arm, step: Step) -> Array | None:
    """Return the bending (segments, 2), rad, of the commanded angle, if it determines one."""
    if step.segment is None or not np.isfinite(step.angle) or not hinged(arm):
        return None
    wanted = np.zeros((len(arm.segments), 2))
    wanted[step.segment] = step.angle * arm.bending_axes[step.segment]
    return wanted


def _chain(model: str, shape: MeasuredShape, arm: Arm) -> Prediction:
    statics: Statics = Statics(replace(arm, payload=arm.payload + shape.payload))
    try:
        states = simulate_steps(statics, shape.steps, shape.name)
    except StaticsError as error:
        raise StaticsError(f'{model}: {error}', error.state) from None
    return Prediction(
        model, shape, states[-1].poses[:, :3],
        tuple(not np.any(np.nan_to_num(state.tensions) > 0.0) for state in states),
        any(state.jumped for state in states),
        _needed(statics, shape))


def _needed(statics: Statics, shape: MeasuredShape) -> tuple[tuple[int, float] | None, ...]:
    """Return tendon and pull for the angle of each step, if a tendon holds it there."""
    state, needed = statics.chain.straight(), []
    for step in shape.steps:
        wanted = _wanted(statics.chain.arm, step)
        if wanted is None:
            break
        try:
            state = statics.hold(state, wanted, step.soft(len(wanted))).state
        except StaticsError:
            break
        most = int(np.argmax(state.tensions))
        needed.append((most, float(statics.commanded_pulls(state)[most])))
    return (*needed, *[None] * (len(shape.steps) - len(needed)))


def validation_figure(path: str | Path, predictions: Sequence[Prediction]) -> None:
    """Write a panel for each shape from the side, and the error of each model; mm."""
    shapes = list(dict.fromkeys(p.shape for p in predictions))
    columns = min(MAX_PANELS, len(shapes))
    rows = -(-len(shapes) // columns)
    drawn = np.concatenate([*(s.positions for s in shapes), *(p.points for p in predictions)])
    width, _, height = np.ptp(drawn, axis=0)
    tall = min(2.0, max(0.4, height / max(width, 1e-3)))
    width, height = 3.9 * columns, (3.5 * tall + 1.0) * rows
    figure = new_figure(width, height + 3.6)
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=[height, 3.0]).ravel()
    panels = new_panels(rows, columns, width, height, above)[1]
    errors = below.subplots()
    starts = np.cumsum([0, *(len(shape.moving) + 1 for shape in shapes)])
    for axes, shape, start in zip(panels, shapes, starts.tolist(), strict=False):
        axes.plot(*(1e3 * shape.positions[:, ::2].T), 'o-', color='0.0',
                  markersize=4.5, linewidth=0.8, label='measured')
        for prediction in (p for p in predictions if p.shape is shape):
            marker, size, line = MODEL_STYLES[prediction.model]
            style: dict[str, Any] = {'marker': marker, 'markersize': size, 'color': '0.35',
                                     'markerfacecolor': 'none'}
            axes.plot(*(1e3 * prediction.points[:, ::2].T), linestyle=line, linewidth=0.8,
                      label=prediction.model, **style)
            errors.plot(start + np.arange(len(shape.moving)), 1e3 * prediction.errors,
                        linewidth=0.5, **style)
        axes.set_title(shape.name, parse_math=False)
        axes.tick_params(labelbottom=True)
    for axes in panels[len(shapes):]:
        axes.set_visible(False)
    errors.set_xticks(starts[:-1], [f'{s.name}, base' for s in shapes], parse_math=False,
                      rotation=30 if len(shapes) > MAX_PANELS else 0, ha='left')
    errors.set_ylabel('error of each point in mm')
    errors.grid(alpha=0.3)
    finish_panels(path, figure, 2 * columns)


# The verb.


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
