# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Prior of the estimated values, and their drift."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from soft_continuum.parameters.parameter import (
    Parameter,
    setting,
    setting_parameters,
    settings_from,
)


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
