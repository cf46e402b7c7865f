# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The unknowns of an arm as one vector, their prior and drift, and the arm with their values.

Not from the paper, which assumes known stiffness and finds shape errors of 22 % otherwise.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import exp, log
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.laws import Jam
from soft_continuum.parameters.parameter import (
    Parameter,
    setting,
    setting_parameters,
    settings_from,
)

MIN_RATIO = 2.0  # K of a stiff segment that is estimated
MAX_RATIO = 1e4
MAX_FACTOR = 5.0  # of a stiffness
MAX_OFFSET = 0.01  # m of a tendon
STRETCH = 3e-5
"""m/N of tendons that are described as inextensible: half a metre of the paper's steel rope, of
0.75 mm.  Without it, two tendons that are 0.01 mm too short would crush the arm."""


@dataclass(frozen=True)
class Prior:
    """Standard deviations before any measurement, by parameters ``estimation.prior.*``."""

    stiffness: float = setting(
        0.25, 'standard deviation of ln(bending stiffness of a segment / described one)', 0.0, 2.0)
    ratio: float = setting(
        1.0, 'standard deviation of ln(K), the stiffness ratio of a stiff segment', 0.0, 3.0)
    rigid_ratio: float = setting(
        30.0, 'ratio K assumed for a jam described as rigid once discs are measured', 2.0, 1e4)
    offset: float = setting(
        1.5e-3, 'standard deviation of the length of a tendon', 0.0, 0.01, unit='m')
    payload: float = setting(0.03, 'standard deviation of the payload', 0.0, 10.0, unit='kg')
    straight: float = setting(
        0.01, 'standard deviation of the bending angle of a segment that is assumed straight',
        1e-4, 1.0, unit='rad')
    lock_in: float = setting(
        0.006, 'standard deviation of the angle by which stiffening bends a segment', 1e-4, 0.2,
        unit='rad')


@dataclass(frozen=True)
class Drift:
    """
    Drift of the estimated values with time and motion, by parameters ``estimation.drift.*``.

    Random walks; their standard deviations as of Prior.
    """

    stiffness: float = setting(
        0.03, 'drift per minute, as estimation.prior.stiffness; 0: constant', 0.0, 1.0)
    ratio: float = setting(
        0.1, 'drift per minute, as estimation.prior.ratio; 0: constant', 0.0, 1.0)
    payload: float = setting(
        2e-3, 'drift per minute, as estimation.prior.payload; 0: constant', 0.0, 1.0, unit='kg')
    offset: float = setting(
        1e-3, 'drift per minute, as estimation.prior.offset; 0: only by motion', 0.0, 0.01,
        unit='m')
    held: float = setting(
        5e-3, 'drift of the angle that a stiff segment holds, per minute', 0.0, 0.1, unit='rad')
    offset_motion: float = setting(
        5e-4, 'drift per 10 mm of motor motion, as estimation.prior.offset: friction, stretch',
        0.0, 0.01, unit='m')
    held_motion: float = setting(
        4e-3, 'drift of the angle that a stiff segment holds, per 10 mm of motor motion', 0.0, 0.1,
        unit='rad')


@dataclass(frozen=True)
class EstimationSettings:
    """Prior, drift, and whether measurements are used."""

    prior: Prior = field(default_factory=Prior)
    drift: Drift = field(default_factory=Drift)
    enabled: bool = True


DEFAULT_ESTIMATION = EstimationSettings()
ESTIMATION_PARAMETERS = (
    Parameter('estimation.enabled', True, 'correct the shape with disc_N/measured_pose and '
              'measured tensions, and estimate stiffness, K, tendon offsets and payload'),
    Parameter('estimation.tension_stddev', 0.3, 'standard deviation of small measured '
              'tensions: zero error of the load cell; ignored if the device reports one',
              1e-3, 100.0, unit='N'),
    Parameter('estimation.tension_relative_stddev', 0.1, 'relative standard deviation, added '
              'to tension_stddev: scale error of the load cell, and undescribed friction of the '
              'guides; ignored if the device reports one', 0.0, 1.0),
    *setting_parameters(Prior, 'estimation.prior'), *setting_parameters(Drift, 'estimation.drift'),
)


def estimation_from_parameters(parameters: Mapping[str, Any]) -> EstimationSettings:
    """Return the settings for parameters ``estimation.*``."""
    return EstimationSettings(settings_from(Prior, 'estimation.prior', parameters),
                              settings_from(Drift, 'estimation.drift', parameters),
                              parameters['estimation.enabled'])


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
