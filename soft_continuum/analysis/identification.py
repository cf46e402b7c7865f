# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Unknowns of an arm from measured points and pulls, by least squares.  Not in the paper.

The pulls are taken as they are, the points as measured with independent errors of one size.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Generic, Protocol

import numpy as np
import scipy

from soft_continuum.analysis.measured_shapes import loaded, MeasuredShape, simulate_steps
from soft_continuum.analysis.path_sensitivity import derivatives_of_points
from soft_continuum.analysis.unknowns import (
    Described,
    IdentificationError,
    Unknown,
    with_values,
)
from soft_continuum.mechanics.arm import Arm, SECOND_ORDER
from soft_continuum.mechanics.chain import Array, Equilibrium
from soft_continuum.mechanics.statics import Statics, StaticsError

DETERMINED = 0.15  # standard deviation over scale, beyond which data do not determine an unknown
BEST_MEASUREMENT = 5e-5  # m: points agree no better than this by merit of the model
MIN_SHARE = 0.3  # of an unknown in what cannot be told, for it to be named


@dataclass(frozen=True, eq=False)
class Identification(Generic[Described]):
    """
    What a fit found.

    values, deviations: (k,) of the unknowns and their standard deviations.  half_widths: (k,) of
    the 95 % confidence intervals.  correlations: (k, k).  noise: standard deviation of one
    coordinate, m, from the residuals.  arm: with the values put in; in space the parameters that
    describe it.
    """

    unknowns: tuple[Unknown[Described], ...]
    values: Array
    deviations: Array
    half_widths: Array
    correlations: Array
    noise: float
    arm: Described


class ShapeFit(Protocol):
    """One measured shape, and what the arm with values for its unknowns makes of it."""

    def residuals(self, values: Array) -> Array:
        """Return predicted less measured coordinates, m; raises StaticsError."""

    def jacobian(self, values: Array, scales: Array) -> Array:
        """Return derivatives of the residuals by values (k,), (coordinates, k)."""


def identify(arm: Arm, unknowns: Sequence[Unknown[Arm]], shapes: Sequence[MeasuredShape]
             ) -> Identification[Arm]:
    """
    Fit the unknowns to the points of the shapes.

    The arm is computed with second-order springs: E I is then that of the segment, not of a
    coarse chain.  Raises IdentificationError when there are fewer measured coordinates than
    unknowns, the model cannot follow the shapes, or the data do not determine every unknown.
    """
    arm = replace(arm, discretisation=SECOND_ORDER)
    if np.isfinite(arm.tendon.axial_stiffness) and (
            arm.tendon.friction or any(u.name == 'friction' for u in unknowns)):
        raise IdentificationError(
            'friction together with tendons that stretch cannot be identified; set '
            'arm.tendon_axial_stiffness or arm.tendon_friction to 0')
    if any(np.isfinite(segment.jam.yield_moment) for segment in arm.segments):
        raise IdentificationError('jams that yield cannot be identified from shapes; set '
                                  'arm.yield_moments to 0 and measure where nothing yields')
    # Shapes with the same payload are of one arm.
    models = {shape.payload: _models(loaded(arm, shape), unknowns) for shape in shapes}
    return fit_shapes(arm, unknowns, [_Fit(models[shape.payload], shape) for shape in shapes],
                      sum(shape.coordinates for shape in shapes))


def fit_shapes(described: Described, unknowns: Sequence[Unknown[Described]],
               fits: Sequence[ShapeFit], coordinates: int) -> Identification[Described]:
    """Fit unknowns to shapes with so many measured coordinates in all; raises as identify."""
    if coordinates <= len(unknowns):
        raise IdentificationError(
            f'{coordinates} measured coordinates are too few for {len(unknowns)} unknowns; '
            'measure more points or shapes, or name fewer unknowns')
    scales = np.array([u.scale for u in unknowns])
    start = np.array([u.start for u in unknowns])

    def residuals(scaled: Array) -> Array:
        try:
            return np.concatenate([fit.residuals(scaled * scales) for fit in fits])
        except StaticsError:
            return np.full(coordinates, np.inf)  # least_squares then tries a shorter step

    def jacobian(scaled: Array) -> Array:
        rows: Array = scales * np.concatenate(
            [fit.jacobian(scaled * scales, scales) for fit in fits])
        return rows

    try:
        for fit in fits:
            fit.residuals(start)
    except StaticsError as error:
        raise IdentificationError(
            f'the arm as described cannot be set as measured: {error}; describe it better with '
            '--params-file, such as by characterize.yaml') from None
    bounds = (np.array([u.low for u in unknowns]) / scales,
              np.array([u.high for u in unknowns]) / scales)
    found = scipy.optimize.least_squares(residuals, start / scales, jac=jacobian, bounds=bounds,
                          xtol=1e-10, ftol=1e-10, gtol=1e-12)
    values = found.x * scales
    return _judged(described, tuple(unknowns), values, found.fun, found.jac, scales)


def _models(arm: Arm, unknowns: Sequence[Unknown[Arm]]) -> Callable[[Array], Statics]:
    """Return the statics of the arm by values (k,) of its unknowns; each is made once."""
    @lru_cache(1 + 2 * len(unknowns))  # that many make the derivatives at one place
    def made(*values: float) -> Statics:
        return Statics(with_values(arm, unknowns, np.array(values)))

    return lambda values: made(*values.tolist())


class _Fit:
    """Residuals of one shape and their derivatives."""

    def __init__(self, statics_at: Callable[[Array], Statics], shape: MeasuredShape) -> None:
        self._statics_at, self._shape = statics_at, shape
        self._rows = [shape.numbers[row] for row in shape.moving]
        self._at: Array | None = None

    def residuals(self, values: Array) -> Array:
        """Return predicted less measured coordinates, m."""
        return self._shape.misses(self._states(values)[-1]).ravel()

    def jacobian(self, values: Array, scales: Array) -> Array:
        """Return derivatives of the residuals, (coordinates, k)."""
        derivatives = derivatives_of_points(
            self._statics_at, values, scales, self._shape.steps, self._states(values))
        return derivatives[self._rows].reshape(-1, len(values))

    def _states(self, values: Array) -> list[Equilibrium]:
        """Return the equilibrium after each step; derivatives are asked for where it was."""
        if self._at is None or not np.array_equal(self._at, values):
            self._found = simulate_steps(
                self._statics_at(values), self._shape.steps, self._shape.name)
            self._at = values.copy()
        return self._found


def _judged(described: Described, unknowns: tuple[Unknown[Described], ...], values: Array,
            residuals: Array, jacobian: Array, scales: Array) -> Identification[Described]:
    """Return the fit with its uncertainties; raises IdentificationError for what is not known."""
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
                f'{unknown.name} went to the end of what is allowed, {value:.4g} {unknown.unit}; '
                'either the points do not belong to these pulls, or something that is not among '
                f'the unknowns is described wrongly; else {unknown.remedy}')
    inverse = (directions.T / singular) * noise
    deviations = np.linalg.norm(inverse, axis=1)
    correlations = inverse @ inverse.T / np.outer(deviations, deviations)
    return Identification(
        unknowns, values, deviations * scales,
        scipy.special.stdtrit(spare, 0.975) * deviations * scales, correlations, noise,
        with_values(described, unknowns, values))


def _refuse(unknowns: tuple[Unknown[Described], ...], direction: Array, spread: float) -> None:
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


def shape_error(arm: Arm, shape: MeasuredShape) -> Array:
    """Return the distances (m) of the moving points of a shape from where the model has them."""
    statics = Statics(replace(loaded(arm, shape), discretisation=SECOND_ORDER))
    state = simulate_steps(statics, shape.steps, shape.name)[-1]
    distances: Array = np.linalg.norm(shape.misses(state), axis=1)
    return distances


def without(shapes: Sequence[MeasuredShape], names: Sequence[str]) -> list[MeasuredShape]:
    """Return the shapes without those of these names; raises IdentificationError if none stay."""
    known = [shape.name for shape in shapes]
    for name in names:
        if name not in known:
            raise IdentificationError(f'there is no shape {name!r} to hold out; the shapes are '
                                      f'{", ".join(known)}')
    kept = [shape for shape in shapes if shape.name not in names]
    if not kept:
        raise IdentificationError('every shape is held out; leave at least one to fit')
    return kept
