# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Unknowns of an arm from measured points and pulls, by least squares.  Not from the paper.

The pulls are assumed exact, the points to have independent errors of equal size.

Unknowns are parameters of the description, some by a common factor.  Names: stiffness_N, ratio_N,
segment_mass_N, disc_mass_N and offset_N of segment N (1 is the lowest; the disc is the one above
it), angle_N of the tendons that end at disc N; stiffness, mass and offset for all by one factor,
friction, stretch and tilt.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from soft_continuum.lab.analysis.delimited import MeasurementError
from soft_continuum.lab.analysis.measured_shapes import MeasuredShape, read_shapes, simulate_steps
from soft_continuum.lab.analysis.verbs import (
    cell,
    described_arm,
    DPI,
    new_figure,
    progress,
    reserve_outputs,
    run_verb,
    shapes_parser,
    text_table,
)
from soft_continuum.mechanics import SECOND_ORDER, Statics, StaticsError
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.rotations import wrapped
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import write_parameters
from soft_continuum.parameters.parameter import Value

DIFFERENCE = 1e-4  # of the scale of an unknown
SNAP = 1e-3  # m: a point that such a difference moves farther belongs to an arm that snaps
DETERMINED = 0.15  # standard deviation over scale, beyond which data do not determine an unknown
BEST_MEASUREMENT = 5e-5  # m: points agree no better than this by merit of the model
MIN_SHARE = 0.3  # share of an unknown in an undetermined combination, for it to be named
NAME = 'identify'
Values = Mapping[str, Value]
"""The parameters of a description, by name."""
STIFFNESSES = ('arm.bending_stiffnesses', 'arm.lateral_bending_stiffnesses',
               'arm.torsional_stiffnesses')
MASSES = ('arm.segment_masses', 'arm.disc_masses')
START_RATIO = 20.0  # K where the description has rigid segments
START_FRICTION = 0.05
START_MASS = 0.05  # kg, where the description has none


class IdentificationError(MeasurementError):
    """Unknowns cannot be identified from the data; the message says why and what to do."""


@dataclass(frozen=True)
class Unknown:
    """
    One unknown of an arm.

    unit: of its value.  start, low, high: initial value and bounds of a fit.  scale: its full
    range of change.  changes: names of the parameters that it changes.  put: returns a
    description, from spread_out, with a given value.  remedy: what to do when the data do not
    determine it.
    """

    name: str
    unit: str
    start: float
    low: float
    high: float
    scale: float
    changes: tuple[str, ...]
    put: Callable[[Values, float], Values]
    remedy: str


def stiffnesses_of(arm: Arm) -> dict[str, tuple[float, ...]]:
    """Return the stiffnesses of each segment, E I about y first, by parameter, N m^2."""
    found = {STIFFNESSES[0]: tuple(s.stiffness_y for s in arm.segments)}
    if all(len(s.stiffnesses) == 1 for s in arm.segments):  # hinges, which nothing else describes
        return found
    return found | {
        STIFFNESSES[1]: tuple(s.stiffness_x for s in arm.segments),
        STIFFNESSES[2]: tuple(0.0 if s.torsional_stiffness == inf else s.torsional_stiffness
                              for s in arm.segments)}


def spread_out(values: Values) -> Values:
    """Return a description whose lists have one number for every part."""
    arm = arm_from_parameters(values)
    offsets = _numbers(values, 'arm.guide_offsets')
    if len(offsets) == 1:
        offsets *= 2 * len(arm.segments)
    return {
        **values, **stiffnesses_of(arm),
        'arm.stiffness_ratios': tuple(0.0 if s.jam.ratio == inf else s.jam.ratio
                                      for s in arm.segments),
        'arm.segment_masses': tuple(s.mass for s in arm.segments),
        'arm.disc_masses': tuple(d.mass for d in arm.discs),
        'arm.guide_offsets': tuple(offset or arm.segments[i // 2].outer_diameter / 2
                                   for i, offset in enumerate(offsets)),
    }


def find_unknowns(names: Sequence[str], values: Values) -> tuple[Unknown, ...]:
    """
    Return the unknowns of these names.

    values: of the description, from spread_out.  Raises IdentificationError listing the known
    names.
    """
    arm = arm_from_parameters(values)
    allowed = [f'{kind}_{n}' for kind in ('stiffness', 'ratio', 'segment_mass', 'disc_mass',
                                          'offset') for n in range(1, len(arm.segments) + 1)]
    if len(_numbers(values, 'arm.tendon_angles')) == len(arm.tendon_ends):
        allowed += [f'angle_{end}' for end in sorted(set(arm.tendon_ends))]
    allowed += ['stiffness', 'mass', 'offset', 'friction', 'tilt']
    allowed += ['stretch'] if values['arm.tendon_axial_stiffness'] else []
    for k, name in enumerate(names):
        if name not in allowed:
            raise IdentificationError(f'there is no unknown {name!r}; known: {", ".join(allowed)}')
        if name in names[:k]:
            raise IdentificationError(f'{name} is named twice; name every unknown once')
    return tuple(_unknown(name, values, arm) for name in names)


def _unknown(name: str, values: Values, arm: Arm) -> Unknown:
    kind, _, number = name.rpartition('_')
    if not number.isdecimal():
        return _of_all(name, values, arm)
    index = int(number) - 1
    if kind == 'angle':
        which = [i for i, end in enumerate(arm.tendon_ends) if end == index + 1]
        start = _numbers(values, 'arm.tendon_angles')[which[0]]
        return Unknown(name, 'rad', start, start - 1.0, start + 1.0, 0.5, ('arm.tendon_angles',),
                       lambda v, angle: _turned(v, which, angle),
                       f'add shapes that the tendons of disc {number} bend to several sides')
    segment = arm.segments[index]
    if {'stiffness': segment.soft_law, 'ratio': segment.jam.law}.get(kind) is not None:
        raise IdentificationError(
            f'{name} cannot be identified: a measured table of moment over curvature takes its '
            f'place; leave it out, or take the table of segment {number} out of the description')
    count = {2: 'both'}.get(len(arm.tendon_names), 'all')
    names, places, unit, start, least, most, remedy = {
        'stiffness': (tuple(stiffnesses_of(arm)), (index,), 'N m^2', 0.0, 0.05, 20.0,
                      f'add a shape at whose end segment {number} is soft with {count} tendons '
                      'slack, so that its own spring holds the weight'),
        'ratio': (('arm.stiffness_ratios',), (index,), '', START_RATIO, 0.0, 100.0,
                  'a segment that is all but rigid has no ratio; characterise it stiff, or '
                  'add shapes with a payload'),
        'segment_mass': (MASSES[:1], (index,), 'kg', START_MASS, 0.01, 10.0,
                         f'weigh the segment {number}, and leave {name} out'),
        'disc_mass': (MASSES[1:], (index + 1,), 'kg', START_MASS, 0.01, 10.0,
                      f'weigh the disc above segment {number}, and leave {name} out'),
        'offset': (('arm.guide_offsets',), (2 * index, 2 * index + 1), 'm', 0.0, 1 / 3, 3.0,
                   'measure the distance of the guides from the backbone'),
    }[kind]
    value = float(np.mean([_numbers(values, names[0])[place] for place in places])) or start
    return Unknown(name, unit, value, 1.001 if kind == 'ratio' else least * value, most * value,
                   value, MASSES if names[0] in MASSES else names,
                   lambda v, to: with_mean(v, names, places, to), remedy)


def _of_all(name: str, values: Values, arm: Arm) -> Unknown:
    """Return an unknown of the whole arm; factors are relative to the initial description."""
    number: Any = values.get({
        'friction': 'arm.tendon_friction', 'tilt': 'arm.mounting_angle',
        'stretch': 'arm.tendon_axial_stiffness'}.get(name, ''))
    if name == 'friction':
        start = max(number, START_FRICTION)
        return Unknown(name, '', start, 1e-4, max(0.5, 1.5 * start), 0.1, ('arm.tendon_friction',),
                       lambda v, value: {**v, 'arm.tendon_friction': value},
                       'with rigid stiff segments friction changes no shape, only the tension; '
                       'measure it as a ratio of forces along a bent tendon')
    if name == 'tilt':
        return Unknown(name, 'rad', number, number - 0.5, number + 0.5, 0.1,
                       ('arm.mounting_angle',),
                       lambda v, angle: {**v, 'arm.mounting_angle': angle},
                       'level the base, or add shapes to several sides')
    if name == 'stretch':
        start = 1.0 / number
        return Unknown(name, '1/N, 1/E A', start, start / 100.0, start * 100.0, start,
                       ('arm.tendon_axial_stiffness',),
                       lambda v, value: {**v, 'arm.tendon_axial_stiffness': 1.0 / value},
                       'stretch shows where tendons carry much; add shapes that bend far')
    names, what, remedy = {
        'stiffness': (tuple(stiffnesses_of(arm)), 'of E I described',
                      'add shapes that a known payload bends'),
        'mass': (MASSES, 'of the masses described',
                 'weigh segments and discs, and leave mass out'),
        'offset': (('arm.guide_offsets',), 'of the offsets described',
                   'measure the distance of the guides from the backbone'),
    }[name]
    return Unknown(name, what, 1.0, 0.1, 10.0, 1.0, names,
                   lambda v, factor: _scaled(v, names, None, factor), remedy)


def _scaled(values: Values, names: Sequence[str], places: Sequence[int] | None, factor: float
            ) -> Values:
    """Return the description with lists times a factor, entirely or at some indices."""
    return {**values, **{name: tuple(
        factor * number if places is None or i in places else number
        for i, number in enumerate(_numbers(values, name))) for name in names}}


def with_mean(values: Values, names: Sequence[str], places: Sequence[int], to: float) -> Values:
    """Return the description with a mean of the first list at indices, others in proportion."""
    mean = float(np.mean([_numbers(values, names[0])[place] for place in places]))
    if mean:
        return _scaled(values, names, places, to / mean)
    return {**values, names[0]: tuple(to if i in places else number for i, number in enumerate(
        _numbers(values, names[0])))}


def _turned(values: Values, which: Sequence[int], angle: float) -> Values:
    """Return the description with tendons turned together, the first to an angle, rad."""
    angles = list(_numbers(values, 'arm.tendon_angles'))
    more = angle - angles[which[0]]
    for i in which:
        angles[i] = wrapped(angles[i] + more)
    return {**values, 'arm.tendon_angles': tuple(angles)}


def with_values(described: Values, unknowns: Sequence[Unknown], values: Array) -> Values:
    """Return the description with values for its unknowns."""
    for unknown, value in zip(unknowns, values.tolist(), strict=True):
        described = unknown.put(described, value)
    return described


def parameters_of(described: Values, unknowns: Sequence[Unknown]) -> dict[str, Value]:
    """Return the parameters of the description that the unknowns change, and its springs."""
    return {name: described[name] for name in (
        'arm.discretisation', *(name for unknown in unknowns for name in unknown.changes))}


def _numbers(values: Values, name: str) -> tuple[float, ...]:
    found: Any = values[name]
    return tuple(map(float, found))


@dataclass(frozen=True, eq=False)
class Identification:
    """
    The result of a fit.

    values, deviations: (k,) of the unknowns and their standard deviations.  half_widths: (k,) of
    the 95 % confidence intervals.  correlations: (k, k).  noise: standard deviation of one
    coordinate, m, from the residuals.  arm: its description with the values put in.
    """

    unknowns: tuple[Unknown, ...]
    values: Array
    stddevs: Array
    half_widths: Array
    correlations: Array
    noise: float
    arm: Values


def identify(described: Values, unknowns: Sequence[Unknown], shapes: Sequence[MeasuredShape]
             ) -> Identification:
    """
    Fit the unknowns to the points of the shapes.

    described: the parameters of the arm, from spread_out.  The arm is computed with second-order
    springs, so that E I is that of the segment, not of a coarse chain.  Raises IdentificationError
    when there are fewer measured coordinates than unknowns, the model cannot follow the shapes, or
    the data do not determine every unknown.
    """
    described = {**described, 'arm.discretisation': SECOND_ORDER}
    coordinates = sum(shape.coordinates for shape in shapes)
    if coordinates <= len(unknowns):
        raise IdentificationError(
            f'{coordinates} measured coordinates are too few for {len(unknowns)} unknowns; '
            'measure more points or shapes, or name fewer unknowns')
    scales = np.array([u.scale for u in unknowns])
    start = np.array([u.start for u in unknowns])

    @lru_cache(len({shape.payload for shape in shapes}))  # those with the same are of one arm
    def statics_at(payload: float, *values: float) -> Statics:
        return _statics(with_values(described, unknowns, np.array(values)), payload)

    @lru_cache(1)  # derivatives are asked for where it was
    def misses(*values: float) -> list[Array]:
        return [_misses(statics_at(shape.payload, *values), shape) for shape in shapes]

    def tried(scaled: Array) -> list[Array]:
        try:
            return misses(*(scaled * scales).tolist())
        except StaticsError:  # least_squares then tries a shorter step
            return [np.full(shape.coordinates, np.inf) for shape in shapes]

    def jacobian(scaled: Array) -> Array:
        here, columns = tried(scaled), []
        for step in DIFFERENCE * np.eye(len(scaled)):
            changes = [more - now for more, now in zip(tried(scaled + step), here, strict=True)]
            if max(map(_size, changes)) > SNAP:
                changes = [min(more, now - less, key=_size) for more, now, less in zip(
                    changes, here, tried(scaled - step), strict=True)]
            columns.append(np.concatenate(changes) / DIFFERENCE)
        return np.stack(columns, axis=1)

    try:
        misses(*start.tolist())
    except StaticsError as error:
        raise IdentificationError(
            f'the described arm cannot follow the measured pulls: {error}; correct it with '
            '--params-file, such as by characterize.yaml') from None
    bounds = (np.array([u.low for u in unknowns]) / scales,
              np.array([u.high for u in unknowns]) / scales)
    found = scipy.optimize.least_squares(
        lambda scaled: np.concatenate(tried(scaled)), start / scales, jac=jacobian, bounds=bounds,
        xtol=1e-10, ftol=1e-10, gtol=1e-12)
    values = found.x * scales
    return _judged(described, tuple(unknowns), values, found.fun, found.jac, scales)


def _statics(described: Values, payload: float) -> Statics:
    """Return the statics of the described arm with an additional payload (kg)."""
    arm = arm_from_parameters(described)
    return Statics(replace(arm, payload=arm.payload + payload))


def _size(change: Array) -> float:
    return float(np.abs(change).max())


def _misses(statics: Statics, shape: MeasuredShape) -> Array:
    """Return the errors of the measured coordinates of a shape, m."""
    misses = shape.misses(_points(statics, shape))
    return misses[np.isfinite(misses)]


def _points(statics: Statics, shape: MeasuredShape) -> Array:
    return simulate_steps(statics, shape.steps, shape.name)[-1].poses[:, :3]


def _judged(described: Values, unknowns: tuple[Unknown, ...], values: Array,
            residuals: Array, jacobian: Array, scales: Array) -> Identification:
    """Return the fit with uncertainties; raises IdentificationError for undetermined unknowns."""
    spare = residuals.size - values.size
    noise = float(np.sqrt(residuals @ residuals / spare))
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=False)
    spread = max(noise, BEST_MEASUREMENT) / np.maximum(singular, 1e-300)
    if spread[-1] > DETERMINED:
        _refuse(unknowns, directions[-1], float(spread[-1]))
    for unknown, value in zip(unknowns, values, strict=True):
        edge = 1e-3 * unknown.scale
        if not unknown.low + edge < value < unknown.high - edge:
            raise IdentificationError(
                f'{unknown.name} reached the end of its range, {value:.4g} {unknown.unit}; '
                'either the points do not belong to these pulls, or something that is not among '
                f'the unknowns is described wrongly; else {unknown.remedy}')
    inverse = (directions.T / singular) * noise
    stddevs = np.linalg.norm(inverse, axis=1)
    correlations = inverse @ inverse.T / np.outer(stddevs, stddevs)
    return Identification(
        unknowns, values, stddevs * scales,
        scipy.special.stdtrit(spare, 0.975) * stddevs * scales, correlations, noise,
        with_values(described, unknowns, values))


def _refuse(unknowns: tuple[Unknown, ...], direction: Array, spread: float) -> None:
    involved = [u for u, share in zip(unknowns, direction, strict=True) if abs(share) > MIN_SHARE]
    names = ', '.join(u.name for u in involved)
    remedies = '; or '.join(dict.fromkeys(u.remedy for u in involved))
    if len(involved) == 1:
        only = involved[0]
        what = ('no measured point moves with it' if spread > 1e3 else 'its standard deviation '
                f'would be {spread * only.scale:.2g} {only.unit}'.rstrip())
        raise IdentificationError(
            f'these shapes do not determine {names}: {what}. Remedy: {remedies}')
    raise IdentificationError(
        f'these shapes do not determine {names}, only a combination of them: other values that '
        f'change together would give the same points. Remedy: {remedies}')


def shape_error(described: Values, shape: MeasuredShape) -> Array:
    """Return the distances (m) of the moving points of a shape from the model."""
    statics = _statics({**described, 'arm.discretisation': SECOND_ORDER}, shape.payload)
    return shape.errors(_points(statics, shape))


def without(shapes: Sequence[MeasuredShape], names: Sequence[str]) -> list[MeasuredShape]:
    """Return the shapes except those named; raises IdentificationError if none remain."""
    known = [shape.name for shape in shapes]
    for name in names:
        if name not in known:
            raise IdentificationError(f'there is no shape {name!r} to hold out; the shapes are '
                                      f'{", ".join(known)}')
    kept = [shape for shape in shapes if shape.name not in names]
    if not kept:
        raise IdentificationError('every shape is held out; leave at least one to fit')
    return kept


@dataclass(frozen=True)
class ShapeResult:
    """
    Largest errors of one shape, m.

    described: of the described arm.  identified: of the fit, which includes the shape unless it
    was held out.  held_out: of a fit without the shape; nan without one.
    """

    name: str
    described: float
    identified: float
    held_out: float


def identification_figure(path: str | Path, found: Identification,
                          shapes: Sequence[ShapeResult]) -> None:
    """Write errors by shape (mm, logarithmic), and values against those described with 95 %."""
    figure = new_figure(5.0 + 0.6 * len(shapes) + 0.5 * len(found.unknowns), 4.2)
    left, right = figure.subplots(1, 2, width_ratios=[2 + len(shapes), 2 + len(found.unknowns)])
    at = np.arange(len(shapes))
    for offset, label, color, hatch, values in (
            (-0.27, 'as described', '0.8', '', [s.described for s in shapes]),
            (0.0, 'identified', '0.3', '', [s.identified for s in shapes]),
            (0.27, 'without this shape', '1.0', '////', [s.held_out for s in shapes])):
        left.bar(at + offset, 1e3 * np.array(values), width=0.25, label=label, color=color,
                 edgecolor='0.0', hatch=hatch, linewidth=0.7)
    left.set(yscale='log', ylabel='largest position error in mm')
    left.set_xticks(at, [s.name for s in shapes], rotation=40, ha='right', parse_math=False)
    left.legend(frameon=False, fontsize='small', loc='upper center',
                bbox_to_anchor=(0.5, 1.14), ncols=3)
    left.grid(axis='y', alpha=0.3)
    start = np.array([u.start for u in found.unknowns])
    percent = 100.0 / np.array([u.scale for u in found.unknowns])
    right.errorbar(np.arange(len(start)), percent * (found.values - start),
                   yerr=percent * found.half_widths, fmt='o', color='0.0', capsize=5,
                   markersize=4)
    right.axhline(0.0, color='0.0', linestyle='--', linewidth=0.8)
    right.set(xlim=(-0.6, len(start) - 0.4),
              ylabel='change from described in %\n(friction, tilt: of 0.1)')
    right.set_xticks(np.arange(len(start)), [u.name for u in found.unknowns], rotation=40,
                     ha='right')
    right.grid(axis='y', alpha=0.3)
    figure.savefig(path, dpi=DPI)


# The verb.


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
        [r.name, *(cell(1e3 * error, digits='.2f') for error in (
            r.described, r.identified, r.held_out))] for r in results]))
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
