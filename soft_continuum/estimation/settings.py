# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is known of an arm before it is measured, and by how much that may change."""

from dataclasses import dataclass, field


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
