# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Unknowns of an arm from measured points and pulls, by least squares.  Not from the paper.

The pulls are assumed exact, the points to have independent errors of equal size.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy

from soft_continuum.analysis.measured_shapes import MeasuredShape, simulate_steps
from soft_continuum.analysis.unknowns import (
    IdentificationError,
    Unknown,
    Values,
    with_values,
)
from soft_continuum.mechanics import SECOND_ORDER, Statics, StaticsError
from soft_continuum.mechanics.arm import Array
from soft_continuum.parameters.arm import arm_from_parameters

DIFFERENCE = 1e-4  # of the scale of an unknown
SNAP = 1e-3  # m: a point that such a difference moves farther belongs to an arm that snaps
DETERMINED = 0.15  # standard deviation over scale, beyond which data do not determine an unknown
BEST_MEASUREMENT = 5e-5  # m: points agree no better than this by merit of the model
MIN_SHARE = 0.3  # share of an unknown in an undetermined combination, for it to be named


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
