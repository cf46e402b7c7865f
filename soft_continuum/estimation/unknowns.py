# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The unknowns of an arm as one vector, and the arm with their values.

Not from the paper, which assumes known stiffness and finds shape errors of 22 % otherwise.
"""

from dataclasses import dataclass, replace
from math import exp, log
from typing import Any

import numpy as np

from soft_continuum.estimation.settings import Prior
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.mechanics.laws import Jam, LawError
from soft_continuum.mechanics.statics import Statics

MIN_RATIO = 2.0  # K of a stiff segment that is estimated
MAX_RATIO = 1e4
MAX_FACTOR = 5.0  # of a stiffness
MAX_OFFSET = 0.01  # m of a tendon
STRETCH = 3e-5
"""m/N of tendons that are described as inextensible: half a metre of the paper's steel rope, of
0.75 mm.  Without it, two tendons that are 0.01 mm too short would crush the arm."""


@dataclass(frozen=True)
class UnknownIndices:
    """
    Positions of the unknowns in the vector, in their order.

    held: error of the held shape, rad about x and y of each segment.  stiffness, ratio: logarithms
    of stiffness factors and of K, per segment.  offset: of each tendon, m pulled in beyond the
    motor position.  payload: kg.  biases: of all poses of each disc, from the base, and then of
    all measured tensions of each tendon, N.
    """

    segments: int
    tendons: int
    held: slice
    stiffness: slice
    ratio: slice
    offset: slice
    payload: int
    biases: slice

    @property
    def model(self) -> int:
        """Number of unknowns of the model; biases of measurements follow."""
        return self.payload + 1

    @property
    def size(self) -> int:
        """Number of all unknowns."""
        return int(self.biases.stop)

    @property
    def parameters(self) -> slice:
        """Parameters estimated in addition to the shape."""
        return slice(self.held.stop, self.model)

    def held_by(self, segment: int) -> slice:
        """Shape held by one segment."""
        return slice(2 * segment, 2 * (segment + 1))

    def bias(self, disc: int) -> slice:
        """Bias of all measurements of a disc."""
        return slice(self.model + 6 * disc, self.model + 6 * (disc + 1))

    def tension_bias(self, tendon: int) -> int:
        """Bias of all measured tensions of a tendon."""
        return self.size - self.tendons + tendon

    @property
    def observable_from_tension(self) -> list[int]:
        """Unknowns corrected by tensions: all others would absorb unmodelled friction."""
        return [*range(self.stiffness.start, self.stiffness.stop),
                *range(self.tension_bias(0), self.size)]


def indices_of(arm: Arm) -> UnknownIndices:
    """Return the positions of the unknowns of an arm."""
    segments, tendons = len(arm.segments), len(arm.tendon_names)
    ends = np.cumsum([2 * segments, segments, segments, tendons, 1,
                      6 * (segments + 1) + tendons]).tolist()
    held, stiffness, ratio, offset, payload, biases = map(slice, [0, *ends[:-1]], ends)
    return UnknownIndices(segments, tendons, held, stiffness, ratio, offset, payload.start, biases)


def first_values(arm: Arm, layout: UnknownIndices, prior: Prior) -> Array:
    """Return the vector (size,) of the described arm."""
    values = np.zeros(layout.size)
    values[layout.ratio] = [log(prior.rigid_ratio if s.jam.rigid else
                                min(s.jam.ratio, MAX_RATIO)) for s in arm.segments]
    values[layout.payload] = arm.payload
    return values


def first_covariance(arm: Arm, layout: UnknownIndices, prior: Prior) -> Array:
    """Return the covariance (size, size) before any measurement; biases are added later."""
    variances = np.zeros(layout.size)
    variances[layout.held] = arm.bending_axes.ravel() * prior.straight**2
    variances[layout.stiffness] = [
        0.0 if s.soft_law is not None else prior.stiffness**2 for s in arm.segments]
    variances[layout.ratio] = [
        0.0 if s.jam.law is not None else prior.ratio**2 for s in arm.segments]
    variances[layout.offset] = prior.offset**2
    variances[layout.payload] = prior.payload**2
    return np.diag(variances)


def limited(values: Array, layout: UnknownIndices) -> Array:
    """Return a vector clipped to values that a model accepts."""
    after = values.copy()
    after[layout.stiffness] = np.clip(after[layout.stiffness], -log(MAX_FACTOR), log(MAX_FACTOR))
    after[layout.ratio] = np.clip(after[layout.ratio], log(MIN_RATIO), log(MAX_RATIO))
    after[layout.offset] = np.clip(after[layout.offset], -MAX_OFFSET, MAX_OFFSET)
    after[layout.payload] = max(0.0, after[layout.payload])
    return after


def arm_with(arm: Arm, layout: UnknownIndices, values: Array) -> Any:
    """
    Return a described arm with estimated stiffness, K and payload, and elastic jams and tendons.

    A jam with a measured law keeps it.
    """
    compliant: Any = arm.with_compliant_tendons(STRETCH)
    segments = tuple(
        replace(s.with_stiffness_factor(exp(factor)),
                jam=s.jam if s.jam.law is not None else
                Jam(ratio=exp(ratio), yield_moment=s.jam.yield_moment,
                    stiffness_exponent=s.jam.stiffness_exponent))
        for s, factor, ratio in zip(compliant.segments, values[layout.stiffness],
                                    values[layout.ratio], strict=True))
    return replace(compliant, segments=segments, payload=float(values[layout.payload]))


def statics_with(arm: Arm, layout: UnknownIndices, values: Array, state: Any) -> Any:
    """
    Return the statics of arm_with.

    Raises StaticsError, with ``state``, where a soft segment would be stiffer than the measured
    law of its stiff state.
    """
    try:
        return Statics(arm_with(arm, layout, values))
    except LawError as error:
        raise StaticsError(str(error), state) from None
