# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Measured shapes of the simulated specimen, without a detour over files."""

import generate as specimen
import numpy as np

from soft_continuum.lab.analysis.measured_shapes import MeasuredShape
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.ros.description import load_description

TRUE = specimen.specimen()
DESCRIPTION = load_description() | specimen.weighed()
DESCRIBED = arm_from_parameters(DESCRIPTION)


def measure(arm, shape, noise=0.0, seed=0):
    """Return a shape as it is measured on an arm; noise in m."""
    steps, positions = specimen.set_on(arm, shape)
    errors = np.random.default_rng(seed).normal(0.0, noise, positions.shape)
    errors[:2] = 0.0
    return MeasuredShape(shape.name, tuple(steps), tuple(range(len(positions))),
                         np.insert(positions + errors, 1, np.nan, axis=1), shape.payload)


PAPER_SHAPES = tuple(measure(TRUE, shape) for shape in specimen.paper_shapes())
SHAPES = tuple(measure(TRUE, shape, 0.3e-3, seed) for seed, shape in enumerate(
    specimen.identification_shapes()))
