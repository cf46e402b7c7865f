# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What kinematics publishes of its estimate makes the same model in the other nodes."""

from dataclasses import replace
from math import exp, log, pi

import numpy as np
import pytest

from soft_continuum.estimation.estimator import Estimator
from soft_continuum.estimation.measuring import ActuatorState, DiscMeasurement
from soft_continuum.estimation.unknowns import Drift, Prior
from soft_continuum.mechanics.chain import Chain
from soft_continuum.mechanics.laws import Jam, MomentCurvature
from soft_continuum.mechanics.rotations import in_plane
from soft_continuum.ros.description import load_arm
from soft_continuum.ros.estimates import (
    estimate_to_ros,
    model_from_ros,
    parameter_names,
    parameters_to_ros,
)
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import EstimatedParameter, KinematicsState
from support.flat_arm import of_segments
from support.paper_arm import plane_points

ARM, SPATIAL = (replace(load_arm(description_file().with_name(f'{name}.yaml')),
                        bodies_per_segment=3) for name in ('manipulator', 'spatial_jamming'))
VALUES = {'stiffness_factor_1': 0.8, 'stiffness_factor_2': 1.2, 'stiffness_factor_3': 1.5,
          'stiff_ratio_1': 12.0, 'stiff_ratio_2': 20.0, 'stiff_ratio_3': 40.0,
          'offset_right_tendon': 1e-3, 'offset_left_tendon': -6e-3, 'payload': 0.05}


SPATIAL_VALUES = dict(list(VALUES.items())[:6]) | {
    'offset_tendon_1': 1e-3, 'offset_tendon_2': -2e-3, 'offset_tendon_3': 0.0, 'payload': 0.05}


def estimate_of(arm, values, bending=((0.0, 0.0),) * 3):
    """Return an estimate of a bent arm whose parameters have values."""
    found = Estimator(arm, Chain(arm).uniform(np.array(bending)), Prior(), Drift())
    values = list(values.values())
    found.values[found.layout.parameters] = [*np.log(values[:6]), *values[6:]]
    return found


@pytest.fixture
def estimator():
    return estimate_of(ARM, VALUES)


def published(estimator, covariances=None):
    message = KinematicsState()
    covariances = estimator.pose_covariances() if covariances is None else covariances
    estimate_to_ros(estimator, covariances, parameters_to_ros(estimator), message)
    return message


def parameters(values=VALUES):
    return [EstimatedParameter(name=name, value=value, stddev=0.1 * abs(value))
            for name, value in values.items()]


@pytest.mark.parametrize(('arm', 'values'), [(ARM, VALUES), (SPATIAL, SPATIAL_VALUES)],
                         ids=['planar', 'in space'])
def test_an_estimate_is_published_in_units_and_by_name_and_others_make_the_same_model_of_it(
        arm, values):
    message = published(estimate_of(arm, values))
    assert message.source == KinematicsState.ESTIMATED
    assert parameter_names(arm) == tuple(values)
    assert {p.name: p.value for p in message.parameters} == pytest.approx(values)
    stddevs = {p.name: p.stddev for p in message.parameters}
    assert stddevs['stiffness_factor_2'] == pytest.approx(1.2 * Prior().stiffness)
    assert stddevs['stiff_ratio_1'] == pytest.approx(12.0 * Prior().ratio)
    offsets = {name: value for name, value in values.items() if name.startswith('offset')}
    assert [stddevs[name] for name in offsets] == pytest.approx([Prior().offset] * len(offsets))
    assert not any(p.determined for p in message.parameters)
    assert (message.measured.sec, message.measured.nanosec) == (0, 0)
    model = model_from_ros(message.parameters, arm)
    for segment, described, n in zip(model.chain.arm.segments, arm.segments, (1, 2, 3),
                                     strict=True):
        for name in ('stiffness_x', 'stiffness_y'):
            assert getattr(segment, name) == pytest.approx(
                getattr(described, name) * values[f'stiffness_factor_{n}'])
        assert segment.jam.ratio == pytest.approx(values[f'stiff_ratio_{n}'])
    assert model.offsets == pytest.approx(list(offsets.values()))
    assert model.offset_stddevs == pytest.approx([Prior().offset] * len(offsets))
    assert model.chain.arm.payload == pytest.approx(0.05)
    assert all(model.chain.arm.compliance > 0.0)
    assert model_from_ros(message.parameters[1:], arm).chain.arm == arm


def test_parameters_may_come_in_any_order():
    one, other = (model_from_ros(p, ARM) for p in (parameters(), parameters()[::-1]))
    assert one.chain.arm == other.chain.arm
    assert np.array_equal(one.offsets, other.offsets)


def test_only_what_is_not_plausible_has_a_problem(estimator):
    problems = {p.name: p.problem for p in published(estimator).parameters}
    assert [name for name, problem in problems.items() if problem] == ['offset_left_tendon']
    assert '-6.0 mm' in problems['offset_left_tendon']
    estimator.values[estimator.layout.stiffness] = log(0.3), 0.0, log(2.6)
    problems = [p.name for p in published(estimator).parameters if p.problem]
    assert problems == ['stiffness_factor_1', 'stiffness_factor_3', 'offset_left_tendon']


@pytest.mark.parametrize('wrong', [
    [], parameters()[:-1], [*parameters(), EstimatedParameter(name='colour')],
    parameters({**VALUES, 'payload': float('nan')}),
    parameters({**VALUES, 'stiff_ratio_2': float('inf')}),
    parameters({name.replace('_3', '_4'): value for name, value in VALUES.items()})],
    ids=['none', 'one missing', 'one more', 'nan', 'inf', 'of another arm'])
def test_what_is_not_of_this_arm_leaves_it_as_described(wrong):
    model = model_from_ros(wrong, ARM)
    assert model.chain.arm == ARM
    assert np.all(model.offsets == 0.0)
    assert np.all(model.offset_stddevs == 0.0)


def test_values_that_no_arm_has_are_limited():
    hostile = {**VALUES, 'stiffness_factor_1': -3.0, 'stiffness_factor_2': 1e30,
               'stiff_ratio_1': 0.0, 'offset_right_tendon': 10.0, 'payload': -1.0}
    arm = model_from_ros(parameters(hostile), ARM)
    factors = [s.stiffness_y / d.stiffness_y
               for s, d in zip(arm.chain.arm.segments, ARM.segments, strict=True)]
    assert factors == pytest.approx([0.2, 5.0, 1.5])
    assert arm.chain.arm.segments[0].jam.ratio == pytest.approx(2.0)
    assert arm.offsets == pytest.approx([0.01, -0.006])
    assert arm.chain.arm.payload == 0.0


def test_a_spring_that_is_stiffer_than_its_jam_was_measured_leaves_the_arm_as_described():
    law = MomentCurvature((0.0, 1.0, 10.0), (0.0, 0.05, 0.3))
    arm = replace(ARM, segments=tuple(
        replace(s, stiffness_y=0.02, jam=Jam(law=law)) for s in ARM.segments))
    names = parameter_names(arm)
    values = {name: 3.0 if name.startswith('stiffness') else 0.0 for name in names}
    assert model_from_ros(parameters(values), arm).chain.arm == arm


def test_names_are_those_of_the_arms_segments_and_tendons():
    two = of_segments(ARM, range(2))
    assert parameter_names(two) == (
        'stiffness_factor_1', 'stiffness_factor_2', 'stiff_ratio_1', 'stiff_ratio_2',
        'offset_right_tendon', 'offset_left_tendon', 'payload')


def test_the_deviation_of_the_tip_counts_the_lever_of_the_last_disc(estimator):
    covariances = np.zeros((4, 6, 6))
    covariances[1:] = np.diag([1e-3, 0.0, 1e-3, 0.0, 0.02, 0.0])**2
    message = published(estimator, covariances)
    height = ARM.discs[-1].height  # upright: it leans sideways, and does not get longer
    assert np.reshape(message.tip_covariance, (6, 6)).diagonal() == pytest.approx(
        np.square([np.hypot(1e-3, 0.02 * height), 0.0, 1e-3, 0.0, 0.02, 0.0]))
    assert len(message.angle_stddevs) == 3


def test_the_lever_of_the_last_disc_counts_where_it_leans_in_space():
    estimator = estimate_of(SPATIAL, SPATIAL_VALUES, ((0.0, 0.0), (0.0, 0.0), (pi / 2, 0.0)))
    message = published(estimator, np.tile(
        np.diag([1e-3, 2e-3, 3e-3, 0.02, 0.03, 0.04])**2, (4, 1, 1)))
    height = SPATIAL.discs[-1].height  # it leans towards -y: a turn about z moves it in x
    assert np.reshape(message.tip_covariance, (6, 6)).diagonal() == pytest.approx(np.square(
        [np.hypot(1e-3, 0.04 * height), 2e-3, np.hypot(3e-3, 0.02 * height), 0.02, 0.03, 0.04]))
    assert message.angle_stddevs == pytest.approx([np.hypot(0.02, 0.03)] * 3)


def test_of_an_arm_without_jamming_no_ratio_is_published():
    estimator = estimate_of(SPATIAL, SPATIAL_VALUES)
    without = parameters_to_ros(estimator, jamming=False)
    assert [p.name for p in without] == [
        name for name in SPATIAL_VALUES if not name.startswith('stiff_ratio')]
    model, loose = (model_from_ros(p, SPATIAL) for p in (published(estimator).parameters, without))
    assert np.array_equal(loose.offsets, model.offsets)
    assert loose.chain.arm.segments[0].stiffness_x == model.chain.arm.segments[0].stiffness_x


def test_when_it_was_measured_is_published(estimator):
    estimator.follow(ActuatorState(1234.5, np.zeros(2), (True,) * 3))
    truth = plane_points(estimator.state)
    estimator.measure(1234.5, [
        DiscMeasurement(n, *in_plane(truth[2 * n], 1e-6 * np.eye(3))) for n in (1, 2, 3)])
    message = published(estimator)
    assert (message.measured.sec, message.measured.nanosec) == (1234, 500_000_000)
    assert exp(estimator.values[estimator.layout.payload]) >= 1.0
