# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Prior of the estimated values, and their drift."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from soft_continuum.parameters.parameter import Parameter


@dataclass(frozen=True)
class Prior:
    """
    Standard deviations before any measurement.

    stiffness: of the logarithm of each segment's stiffness over the described one.  ratio: of the
    logarithm of K.  rigid_ratio: the median of K where the description has a rigid jam.  offset:
    m, of each tendon.  payload: kg.  straight: rad, of the bending angle of a stiff segment that
    is assumed straight.  lock_in: rad, of the bending caused by stiffening.
    """

    stiffness: float = 0.25
    ratio: float = 1.0
    rigid_ratio: float = 30.0
    offset: float = 1.5e-3
    payload: float = 0.03
    straight: float = 0.01
    lock_in: float = 0.006


@dataclass(frozen=True)
class Drift:
    """
    Drift of the estimated values with time and motion: random walks.

    stiffness, ratio: standard deviation of the logarithms after a minute.  payload: kg after a
    minute.  offset: m of each tendon after a minute.  held: rad after a minute, of the shape that
    a jam holds.  offset_motion: m of a tendon's offset per 10 mm of motor motion (friction,
    backlash, stretch).  held_motion: rad, of the shape that a jam holds, per 10 mm.  0 disables.
    """

    stiffness: float = 0.03
    ratio: float = 0.1
    payload: float = 2e-3
    offset: float = 1e-3
    held: float = 5e-3
    offset_motion: float = 5e-4
    held_motion: float = 4e-3


@dataclass(frozen=True)
class EstimationSettings:
    """Prior, drift, and whether measurements are used."""

    prior: Prior = field(default_factory=Prior)
    drift: Drift = field(default_factory=Drift)
    enabled: bool = True


DEFAULT_ESTIMATION = EstimationSettings()
_PRIOR = {
    'stiffness': ('standard deviation of ln(bending stiffness of a segment / described one)',
                  0.0, 2.0, ''),
    'ratio': ('standard deviation of ln(K), the stiffness ratio of a stiff segment', 0.0, 3.0,
              ''),
    'rigid_ratio': ('ratio K assumed for a jam described as rigid until it is measured', 2.0,
                    1e4, ''),
    'offset': ('standard deviation of the length of a tendon', 0.0, 0.01, 'm'),
    'payload': ('standard deviation of the payload', 0.0, 10.0, 'kg'),
    'straight': ('standard deviation of the bending angle of a segment that is assumed '
                 'straight', 1e-4, 1.0, 'rad'),
    'lock_in': ('standard deviation of the angle by which stiffening bends a segment',
                1e-4, 0.2, 'rad'),
}
_DRIFT = {
    'stiffness': ('drift per minute, as estimation.prior.stiffness; 0: constant', 1.0, ''),
    'ratio': ('drift per minute, as estimation.prior.ratio; 0: constant', 1.0, ''),
    'payload': ('drift per minute, as estimation.prior.payload; 0: constant', 1.0, 'kg'),
    'offset': ('drift per minute, as estimation.prior.offset; 0: only by motion', 0.01, 'm'),
    'held': ('drift of the angle that a stiff segment holds, per minute', 0.1, 'rad'),
    'offset_motion': ('drift per 10 mm of motor motion, as estimation.prior.offset: friction, '
                      'stretch', 0.01, 'm'),
    'held_motion': ('drift of the angle that a stiff segment holds, per 10 mm of motor motion',
                    0.1, 'rad'),
}
ESTIMATION_PARAMETERS = (
    Parameter('estimation.enabled', True, 'correct the shape with disc_N/measured_pose and '
              'measured tensions, and estimate stiffness, K, tendon offsets and payload'),
    Parameter('estimation.tension_stddev', 0.3, 'standard deviation of small measured '
              'tensions: zero error of the load cell; ignored if the device reports one',
              1e-3, 100.0, unit='N'),
    Parameter('estimation.tension_relative_stddev', 0.1, 'relative standard deviation, added '
              'to tension_stddev: scale error of the load cell, and undescribed friction of the '
              'guides; ignored if the device reports one', 0.0, 1.0),
    *(Parameter(f'estimation.prior.{name}', getattr(Prior(), name), text, low, high, unit=unit)
      for name, (text, low, high, unit) in _PRIOR.items()),
    *(Parameter(f'estimation.drift.{name}', getattr(Drift(), name), text, 0.0, high, unit=unit)
      for name, (text, high, unit) in _DRIFT.items()),
)


def estimation_from_parameters(parameters: Mapping[str, Any]) -> EstimationSettings:
    """Return the settings for parameters ``estimation.*``."""
    def values(kind: type[Prior | Drift], group: str) -> dict[str, float]:
        return {field.name: parameters[f'estimation.{group}.{field.name}']
                for field in fields(kind)}

    return EstimationSettings(Prior(**values(Prior, 'prior')), Drift(**values(Drift, 'drift')),
                              parameters['estimation.enabled'])
