# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is known of an arm before it is measured, and by how much that may change."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from soft_continuum.parameters.parameter import Parameter


@dataclass(frozen=True)
class Prior:
    """
    What is known before anything is measured: standard deviations.

    stiffness: of the logarithm of each segment's stiffness over the described one.  ratio: of the
    logarithm of K.  rigid_ratio: the median of K where the description has a rigid jam.  offset:
    m, of each tendon.  payload: kg.  straight: rad, of the bending angle of a stiff segment that
    is taken to be straight.  lock_in: rad by which a segment bends when it is stiffened.
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
    By how much what is estimated may change with time and motion: random walks.

    stiffness, ratio: standard deviation of the logarithms after a minute.  payload: kg after a
    minute.  offset: m of each tendon after a minute.  held: rad after a minute, of the shape that
    a jam holds.  offset_motion: m of a tendon's offset after its motor has moved by 10 mm
    (friction, backlash, stretch).  held_motion: rad, of the shape that a jam holds, the same.  0
    switches one off.
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
    """What is known beforehand, how it may drift, and whether measurements are used at all."""

    prior: Prior = field(default_factory=Prior)
    drift: Drift = field(default_factory=Drift)
    enabled: bool = True


DEFAULT_ESTIMATION = EstimationSettings()
_PRIOR = {
    'stiffness': ('standard deviation of the logarithm of the bending stiffness of a segment over '
                  'the described one', 0.0, 2.0, ''),
    'ratio': ('standard deviation of the logarithm of the ratio K of a stiff segment', 0.0, 3.0,
              ''),
    'rigid_ratio': ('ratio K that a jam described as rigid is taken to have, until measurements '
                    'tell', 2.0, 1e4, ''),
    'offset': ('standard deviation of the length of a tendon', 0.0, 0.01, 'm'),
    'payload': ('standard deviation of the payload', 0.0, 10.0, 'kg'),
    'straight': ('standard deviation of the bending angle of a segment that is taken to be '
                 'straight', 1e-4, 1.0, 'rad'),
    'lock_in': ('standard deviation of the angle by which a segment bends when it is stiffened',
                1e-4, 0.2, 'rad'),
}
_DRIFT = {
    'stiffness': ('what a minute adds to estimation.prior.stiffness; 0: it is constant', 1.0, ''),
    'ratio': ('what a minute adds to estimation.prior.ratio; 0: it is constant', 1.0, ''),
    'payload': ('what a minute adds to estimation.prior.payload; 0: it is constant', 1.0, 'kg'),
    'offset': ('what a minute adds to estimation.prior.offset; 0: only motion does', 0.01, 'm'),
    'held': ('what a minute adds to the deviation of the angle that a stiff segment holds', 0.1,
             'rad'),
    'offset_motion': ('what 10 mm of a motor add to estimation.prior.offset: friction, stretch',
                      0.01, 'm'),
    'held_motion': ('what 10 mm of a motor add to the deviation of the angle that a stiff segment '
                    'holds', 0.1, 'rad'),
}
ESTIMATION_PARAMETERS = (
    Parameter('estimation.enabled', True, 'correct the shape by disc_N/measured_pose and measured '
              'tensions, and learn stiffness, K, tendon offsets and payload from them'),
    Parameter('estimation.tension_stddev', 0.3, 'standard deviation of a measured tension '
              'that is small: the zero of its load cell; not used where the device tells it',
              1e-3, 100.0, unit='N'),
    Parameter('estimation.tension_relative_stddev', 0.1, 'what is added to it, in parts of the '
              'tension: the scale of the load cell, and friction of the guides that is not '
              'described; not used where the device tells it', 0.0, 1.0),
    *(Parameter(f'estimation.prior.{name}', getattr(Prior(), name), text, low, high, unit=unit)
      for name, (text, low, high, unit) in _PRIOR.items()),
    *(Parameter(f'estimation.drift.{name}', getattr(Drift(), name), text, 0.0, high, unit=unit)
      for name, (text, high, unit) in _DRIFT.items()),
)


def estimation_from_parameters(parameters: Mapping[str, Any]) -> EstimationSettings:
    """Return the settings that parameters ``estimation.*`` ask for."""
    def values(kind: type[Prior | Drift], group: str) -> dict[str, float]:
        return {field.name: parameters[f'estimation.{group}.{field.name}']
                for field in fields(kind)}

    return EstimationSettings(Prior(**values(Prior, 'prior')), Drift(**values(Drift, 'drift')),
                              parameters['estimation.enabled'])
