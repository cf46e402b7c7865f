# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What the statics do not know of an arm, as one vector, and the arm that has it.

Not from the paper, which takes the stiffness as known and finds shapes 22 % off when it is not.
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
0.75 mm.  Without any, two that are a hundredth of a millimetre too short would crush the arm."""


@dataclass(frozen=True)
class Layout:
    """
    Where each unknown is in the vector.

    In turn: by how much the shape that a stiff segment holds is off (rad about x and y), the
    logarithms of stiffness factors and of K, of each segment; the offset
    of each tendon (m pulled in beyond what its motor says); the payload (kg); what is wrong alike
    in all measurements of a disc (as poses differ), discs from the base; what is wrong alike in
    all measured tensions of each tendon (N).
    """

    segments: int
    tendons: int

    @property
    def held(self) -> slice:
        """Shapes that stiff segments hold."""
        return slice(0, 2 * self.segments)

    def held_by(self, segment: int) -> slice:
        """Shape that one segment holds."""
        return slice(2 * segment, 2 * (segment + 1))

    @property
    def stiffness(self) -> slice:
        """Logarithms of stiffness factors."""
        return slice(self.held.stop, self.held.stop + self.segments)

    @property
    def ratio(self) -> slice:
        """Logarithms of K."""
        return slice(self.stiffness.stop, self.stiffness.stop + self.segments)

    @property
    def offset(self) -> slice:
        """Offsets of the tendons."""
        return slice(self.ratio.stop, self.ratio.stop + self.tendons)

    @property
    def payload(self) -> int:
        """The payload."""
        return 4 * self.segments + self.tendons

    @property
    def model(self) -> int:
        """Number of unknowns of the model; what is wrong with the measurements follows."""
        return self.payload + 1

    @property
    def parameters(self) -> slice:
        """What is estimated beside the shape."""
        return slice(self.held.stop, self.model)

    def bias(self, disc: int) -> slice:
        """What is wrong in all measurements of a disc."""
        return slice(self.model + 6 * disc, self.model + 6 * (disc + 1))

    def tension_bias(self, tendon: int) -> int:
        """What is wrong in all measured tensions of a tendon."""
        return self.model + 6 * (self.segments + 1) + tendon

    @property
    def biases(self) -> slice:
        """What is wrong in all measurements, of discs and of tensions."""
        return slice(self.model, self.size)

    @property
    def observable_from_tension(self) -> list[int]:
        """What tensions correct: all else would be bent to what the statics lack of friction."""
        return [*range(self.stiffness.start, self.stiffness.stop),
                *range(self.tension_bias(0), self.size)]

    @property
    def size(self) -> int:
        """Number of all of them."""
        return self.tension_bias(self.tendons)


def layout_of(arm: Arm) -> Layout:
    """Return where each unknown of an arm is."""
    return Layout(len(arm.segments), len(arm.tendon_names))


def first_values(arm: Arm, layout: Layout, prior: Prior) -> Array:
    """Return the vector (size,) of the described arm."""
    values = np.zeros(layout.size)
    values[layout.ratio] = [log(prior.rigid_ratio if s.jam.rigid else
                                min(s.jam.ratio, MAX_RATIO)) for s in arm.segments]
    values[layout.payload] = arm.payload
    return values


def first_covariance(arm: Arm, layout: Layout, prior: Prior) -> Array:
    """Return the covariance (size, size) before anything was measured; biases are added later."""
    variances = np.zeros(layout.size)
    variances[layout.held] = arm.bending_axes.ravel() * prior.straight**2
    variances[layout.stiffness] = [
        0.0 if s.soft_law is not None else prior.stiffness**2 for s in arm.segments]
    variances[layout.ratio] = [
        0.0 if s.jam.law is not None else prior.ratio**2 for s in arm.segments]
    variances[layout.offset] = prior.offset**2
    variances[layout.payload] = prior.payload**2
    return np.diag(variances)


def limited(values: Array, layout: Layout) -> Array:
    """Return a vector within what a model can be made of."""
    after = values.copy()
    after[layout.stiffness] = np.clip(after[layout.stiffness], -log(MAX_FACTOR), log(MAX_FACTOR))
    after[layout.ratio] = np.clip(after[layout.ratio], log(MIN_RATIO), log(MAX_RATIO))
    after[layout.offset] = np.clip(after[layout.offset], -MAX_OFFSET, MAX_OFFSET)
    after[layout.payload] = max(0.0, after[layout.payload])
    return after


def arm_with(arm: Arm, layout: Layout, values: Array) -> Any:
    """
    Return a described arm with the estimated stiffness, K and payload; its jams and tendons give.

    A jam that is described by a measured law keeps it.
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


def statics_with(arm: Arm, layout: Layout, values: Array, state: Any) -> Any:
    """
    Return the statics of arm_with.

    Raises StaticsError, with ``state``, where a soft segment would be stiffer than its measured
    law says of it when it is stiff: there is no such arm.
    """
    try:
        return Statics(arm_with(arm, layout, values))
    except LawError as error:
        raise StaticsError(str(error), state) from None
