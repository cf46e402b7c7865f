# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Unknowns of an arm in space from measured points and pulls: as in the plane, by differences."""

from collections.abc import Sequence

import numpy as np

from soft_continuum.analysis.identification import fit_shapes, Identification
from soft_continuum.analysis.measured_shapes import loaded, MeasuredShape, simulate_steps
from soft_continuum.analysis.unknowns import Unknown, with_values
from soft_continuum.analysis.unknowns_in_space import arm_of, Values
from soft_continuum.mechanics.arm import SECOND_ORDER
from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.spatial import SpatialStatics

DIFFERENCE = 1e-4  # of the scale of an unknown


def identify_in_space(values: Values, unknowns: Sequence[Unknown[Values]],
                      shapes: Sequence[MeasuredShape]) -> Identification[Values]:
    """
    Fit the unknowns to the points of the shapes; raises IdentificationError as identify.

    values: of the description, as spread_out returns them.
    """
    values = {**values, 'arm.discretisation': SECOND_ORDER}
    return fit_shapes(values, unknowns, [_Fit(values, unknowns, shape) for shape in shapes],
                      sum(shape.coordinates for shape in shapes))


def shape_error_in_space(values: Values, shape: MeasuredShape) -> Array:
    """Return the distances (m) of the moving points of a shape from where the model has them."""
    distances: Array = np.linalg.norm(
        _misses({**values, 'arm.discretisation': SECOND_ORDER}, shape), axis=1)
    return distances


def _misses(values: Values, shape: MeasuredShape) -> Array:
    statics = SpatialStatics(loaded(arm_of(values), shape))
    return shape.misses(simulate_steps(statics, shape.steps, shape.name)[-1])


class _Fit:
    """Residuals of one shape and their derivatives."""

    def __init__(self, values: Values, unknowns: Sequence[Unknown[Values]], shape: MeasuredShape
                 ) -> None:
        self._values, self._unknowns, self._shape = values, unknowns, shape

    def residuals(self, values: Array) -> Array:
        """Return predicted less measured coordinates, m."""
        return _misses(with_values(self._values, self._unknowns, values), self._shape).ravel()

    def jacobian(self, values: Array, scales: Array) -> Array:
        """Return derivatives of the residuals, (coordinates, k)."""
        here = self.residuals(values)
        return np.stack([(self.residuals(values + step) - here) / step.max()
                         for step in np.diag(DIFFERENCE * scales)], axis=1)
