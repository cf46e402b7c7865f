# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a fit finds afterwards and what the estimate learns meanwhile is the same, and is true."""

from dataclasses import replace
from math import atan2, pi

import numpy as np
import pytest

from soft_continuum.estimation.estimator import Estimator
from soft_continuum.estimation.measuring import ActuatorState, DiscMeasurement
from soft_continuum.estimation.unknowns import Drift, Prior
from soft_continuum.lab.analysis.identification import find_unknowns, identify, spread_out
from soft_continuum.lab.analysis.measured_shapes import MeasuredShape, Step
from soft_continuum.mechanics import Statics
from soft_continuum.mechanics.arm import SECOND_ORDER
from soft_continuum.mechanics.rotations import in_plane
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.ros.description import load_description
from soft_continuum.sim.twin.model_errors import read_model_errors
from soft_continuum.sim.twin.plant import Plant, TIME_STEP
from soft_continuum.user_files import description_file

RATIO, FACTORS = 30.0, (1.2, 0.85, 1.15)
NOISE = 3e-4  # m of each coordinate of a point
# Hanging, so that a soft segment without tendons shows its stiffness against the weight.
DESCRIBED = spread_out({
    **load_description(description_file()), 'arm.discretisation': SECOND_ORDER,
    'arm.mounting_angle': pi, 'arm.bodies_per_segment': 4, 'arm.stiffness_ratios': (RATIO,)})
ARM = arm_from_parameters(DESCRIBED)
SLACK = (-0.03, -0.03)
STEPS = (Step(0, (0.010, -0.020)), Step(1, (-0.025, 0.012)), Step(0, SLACK),
         Step(2, (0.012, -0.035)), Step(1, SLACK), Step(2, SLACK))
KNOWN = Prior(ratio=0.1, offset=1e-4, payload=1e-3, straight=1e-3, lock_in=1e-3)
NO_DRIFT = Drift(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def recorded():
    """Return the points (8, 2), m, that are measured on a simulated arm after each step."""
    ideal = read_model_errors(description_file().with_name('twin.yaml'), 'ideal')
    plant = Plant(ARM, replace(ideal, stiffness_factors=FACTORS, stiff_ratio=RATIO))
    rng, pulls, found = np.random.default_rng(0), np.zeros(2), []

    def wait(seconds, vacuum, goal):
        for part in np.linspace(0.0, 1.0, round(seconds / TIME_STEP)):
            plant.step(pulls + part * (goal - pulls), vacuum)

    wait(0.5, np.ones(3), pulls)
    for step in STEPS:
        vacuum, goal = np.arange(3) != step.segment, np.array(step.pulls)
        wait(0.5, vacuum, pulls)
        wait(0.8, vacuum, goal)
        pulls = goal
        wait(2.0, vacuum, pulls)
        points = plant.poses[:, [0, 2]]
        points[2:] += rng.normal(0.0, NOISE, points[2:].shape)
        found.append(points)
    return found


def fitted(recording):
    """Return factors (3,) of the stiffness and their standard deviations, by the fit."""
    shapes = [MeasuredShape(f'{k}', STEPS[:k + 1], tuple(range(len(points))),
                            np.insert(points, 1, np.nan, axis=1))
              for k, points in enumerate(recording)]
    found = identify(
        DESCRIBED, find_unknowns([f'stiffness_{n}' for n in (1, 2, 3)], DESCRIBED), shapes)
    described = np.array([s.stiffness_y for s in ARM.segments])
    return found.values / described, found.stddevs / described


def learned(recording):
    """Return the same by the estimate, which sees the points as poses of the discs."""
    estimator, pulls, time = Estimator(
        ARM, Statics(ARM).chain.straight(), KNOWN, NO_DRIFT), np.zeros(2), 100.0
    for step, points in zip(STEPS, recording, strict=True):
        stiff, goal = tuple(s != step.segment for s in range(3)), np.array(step.pulls)
        for part in np.linspace(0.0, 1.0, 11):
            time += 1.0
            estimator.follow(ActuatorState(time, pulls + part * (goal - pulls), stiff))
        pulls, discs = goal, []
        for n in (1, 2, 3):
            (x, z), (top_x, top_z) = points[2 * n:2 * n + 2]
            stddevs = NOISE * np.array([1.0, 1.0, 2.0**0.5 / ARM.discs[n].height])
            discs.append(DiscMeasurement(n, *in_plane(
                np.array([x, z, atan2(top_x - x, top_z - z)]), np.diag(stddevs**2))))
        time += 1.0
        estimator.follow(ActuatorState(time, pulls, stiff))
        estimator.measure(time, discs)
    where = estimator.layout.stiffness
    factors = np.exp(estimator.values[where])
    return factors, factors * estimator.stddevs()[where]


def test_the_fit_and_the_estimate_find_the_same_stiffness_in_the_same_recording():
    recording = recorded()
    (fit, fit_deviation), (estimate, stddev) = fitted(recording), learned(recording)
    assert np.all(np.abs(fit - estimate) < 2.5 * np.hypot(fit_deviation, stddev))
    assert fit == pytest.approx(FACTORS, abs=0.05)
    assert np.all(np.abs(estimate - FACTORS) < 2.5 * stddev)
    assert np.all(stddev[:2] < 0.1 * estimate[:2])  # it has learned them: 25 % at first
