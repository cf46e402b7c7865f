# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The shape of the arm: exactly the statics without measurements, and found by them when lost."""

from dataclasses import replace

import numpy as np
import pytest

from soft_continuum.estimation.estimator import PERSISTENT
from soft_continuum.estimation.measuring import DiscMeasurement
from soft_continuum.estimation.shape import (
    ActuatorState,
    ArmShape,
    EstimationSettings,
    MAX_FAR_OFF,
    ShapeError,
    UnknownShapeError,
)
from soft_continuum.mechanics import Statics
from soft_continuum.mechanics.laws import Jam
from soft_continuum.mechanics.rotations import in_plane
from soft_continuum.mechanics.statics import StaticsError
from support.flat_arm import made_of
from support.paper_arm import plane_points
from support.spatial_arms import in_space
from support.true_arm import ARM, COVARIANCE, only, STIFF, TrueArm

TOLERANCE = 1e-3  # m
ELASTIC = replace(ARM, segments=tuple(replace(s, jam=Jam(15.0)) for s in ARM.segments))
BENT = (0.4, -0.3, 0.5)
DEFAULT = EstimationSettings()


def commands(time, pulls, soft, vacuum=None):
    return ActuatorState(
        time, np.array(pulls, dtype=float), tuple(not s for s in soft), vacuum, (0, 0))


def discs(points, which=(1, 2, 3), covariance=COVARIANCE):
    return [DiscMeasurement(n, *in_plane(points[2 * n], covariance)) for n in which]


def bent_points(angles=BENT):
    return plane_points(Statics(ARM).chain.uniform(angles))


def lost(settings=DEFAULT):
    """Return the shape of an arm that nobody saw being bent: all stiff, with pulled tendons."""
    shape = ArmShape(ARM, TOLERANCE, settings)
    with pytest.raises(UnknownShapeError):
        shape.follow(commands(100.0, (-0.03, -0.03), STIFF))
    return shape


# Without measurements.


@pytest.mark.parametrize('spatial', [False, True])
def test_a_stiff_arm_whose_tendons_stretch_keeps_its_shape_while_they_are_pulled_as_they_were(
        spatial):
    flat = ARM.with_tendons(**made_of(1e3))
    shape = ArmShape(in_space(flat) if spatial else flat, TOLERANCE)
    shape.follow(commands(0.0, (0.0, 0.0), STIFF))
    pulls = np.array([0.02, -0.03])
    shape.follow(commands(1.0, pulls, only(0)))
    bent = shape.state
    assert bent.tensions[0] / 1e3 * ARM.length > 1.1 * TOLERANCE  # by so much it is stretched
    for time, change in enumerate((0.0, -0.01, 0.0), start=2):
        shape.follow(commands(time, pulls + change, STIFF))
        assert np.array_equal(shape.state.points, bent.points)
    assert shape.state.tensions == pytest.approx(bent.tensions, abs=1e-6)
    with pytest.raises(ShapeError, match='do not fit the stiff arm'):
        shape.follow(commands(6.0, pulls + 2.0 * TOLERANCE, STIFF))


@pytest.mark.parametrize('arm', [ARM, ELASTIC], ids=['rigid jams', 'jams that give'])
def test_without_measurements_it_is_the_path_of_the_statics_bit_for_bit(arm):
    rng, shape, statics = np.random.default_rng(1), ArmShape(arm, TOLERANCE), Statics(arm)
    state, pulls, soft, compared = statics.chain.straight(), np.zeros(2), STIFF, 0
    before = None
    shape.follow(commands(0.0, pulls, soft))
    for step in range(80):
        if rng.random() < 0.3:
            soft = [STIFF, *map(only, range(3))][rng.integers(4)]
        if any(soft):
            # One tendon is pulled in and the other paid out more, as plans have it.
            turn = rng.uniform(-0.002, 0.002)
            pulls = np.clip(pulls + np.array([turn, -turn]) - 2e-4, -0.03, 0.01)
        command = commands(0.05 * step, pulls, soft)
        # A locked arm does not yield to the last step of a stepper.
        asked = pulls if any(soft) else np.minimum(pulls, state.pulls)
        if (command.pulls.tolist(), command.stiff) == before:
            continue  # nothing is solved again
        before = (command.pulls.tolist(), command.stiff)
        try:
            expected = statics.solve(state, asked, soft)
        except StaticsError:
            with pytest.raises(StaticsError):
                shape.follow(command)
            continue
        shape.follow(command)
        if all(expected.taut):  # what it eases is claimed elsewhere
            state = shape.state
            continue
        compared += 1
        state = expected
        assert np.array_equal(shape.state.joint_angles, expected.joint_angles)
        assert np.array_equal(shape.state.tensions, expected.tensions, equal_nan=True)
        assert np.array_equal(shape.state.held, expected.held)
        assert shape.state is shape.predicted
    assert shape.estimator is None
    assert compared > 40


def test_measurements_that_are_not_to_be_used_change_nothing():
    shape = ArmShape(ARM, TOLERANCE, EstimationSettings(enabled=False))
    shape.follow(commands(100.0, (0.0, 0.0), STIFF))
    before = shape.state
    for _ in range(30):
        assert shape.measure(100.0, discs(bent_points())) is None
    assert shape.state is before
    assert shape.estimator is None
    assert lost(EstimationSettings(enabled=False)).measure(100.0, discs(bent_points())) is None


def test_nothing_is_measured_before_tendons_and_valves_are_known():
    shape = ArmShape(ARM, TOLERANCE)
    assert shape.measure(100.0, discs(bent_points())) is None
    assert shape.state is None
    assert 'tendons' in shape.refusal(100.0)


# Found by measurements.


@pytest.mark.parametrize('turned', [1.0, -1.0])
def test_a_bent_arm_is_found_by_its_discs(turned):
    shape = lost()
    points = bent_points(turned * np.array(BENT))
    assert shape.measure(100.0, discs(points)) is not None
    for _ in range(10):
        shape.measure(100.0, discs(points))
    assert shape.state.bending_angles == pytest.approx(turned * np.array(BENT), abs=0.02)
    assert np.abs(shape.state.points[:, ::2] - points[:, :2]).max() < 1e-3
    shape.follow(commands(100.1, (-0.03, -0.03), STIFF))  # and is followed from now on
    assert shape.state.bending_angles == pytest.approx(turned * np.array(BENT), abs=0.02)


@pytest.mark.parametrize('missing', [1, 2, 3])
def test_a_bent_arm_is_not_found_while_one_disc_is_missing(missing):
    shape = lost()
    points = bent_points()
    rest = [n for n in (1, 2, 3) if n != missing]
    for _ in range(10):
        assert shape.measure(100.0, discs(points, rest)) is None
    assert shape.state is None
    assert 'every disc' in shape.refusal(100.0)
    # Nor while one shows its place but not its angle.
    blind = np.diag([1e-6, 1e-6, 1e6])
    assert shape.measure(100.0, discs(points, rest) + discs(points, [missing], blind)) is None
    assert shape.measure(100.0, discs(points)) is not None


def test_a_bent_arm_that_was_found_is_set_on_from_there():
    truth = TrueArm(ratio=1e4)
    truth.follow((0.008, -0.02), only(1))
    truth.follow((0.008, -0.02), STIFF)
    shape = ArmShape(ARM, TOLERANCE)
    with pytest.raises(UnknownShapeError):
        shape.follow(commands(100.0, (0.008, -0.02), STIFF))
    for n in range(10):
        shape.measure(100.0, discs(plane_points(truth.state)))
        shape.follow(commands(100.0 + 0.1 * n, (0.008, -0.02), STIFF))
    time = 110.0
    for pulls in ((0.014, -0.03), (0.016, -0.03), (0.018, -0.03)):
        truth.follow(pulls, only(2))
        for _ in range(15):
            time += 0.2
            shape.follow(commands(time, pulls, only(2)))
            shape.measure(time, discs(plane_points(truth.state)))
    assert shape.state.bending_angles == pytest.approx(truth.state.bending_angles, abs=0.02)
    assert shape.state.tip == pytest.approx(truth.state.tip, abs=1e-3)


def test_an_arm_of_another_shape_than_thought_is_found_anew():
    shape = ArmShape(ARM, TOLERANCE)
    shape.follow(commands(100.0, (0.0, 0.0), STIFF))
    angles = np.array(BENT) / 2.0
    points = bent_points(angles)
    for n in range(1, MAX_FAR_OFF + 30):
        shape.follow(commands(100.0 + 0.1 * n, (0.0, 0.0), STIFF))
        shape.measure(100.0 + 0.1 * n, discs(points))
    assert shape.state.bending_angles == pytest.approx(angles, abs=0.02)
    assert np.abs(shape.state.points[:, ::2] - points[:, :2]).max() < 1e-3


def test_one_glimpse_of_another_shape_is_not_believed():
    shape = ArmShape(ARM, TOLERANCE)
    straight = plane_points(ArmShape(ARM, TOLERANCE).statics.chain.straight())
    for n in range(3 * MAX_FAR_OFF):
        time = 100.0 + 0.1 * n
        shape.follow(commands(time, (0.0, 0.0), STIFF))
        shape.measure(time, discs(bent_points() if n % 3 == 0 else straight))
        assert np.abs(shape.state.bending_angles).max() < 0.02


def test_the_prediction_goes_on_beside_the_estimate():
    truth, shape = TrueArm(offsets=(5e-4, -5e-4)), ArmShape(ARM, TOLERANCE)
    alone = ArmShape(ARM, TOLERANCE)
    time = 100.0
    for pulls, soft in (((0.0, 0.0), STIFF), ((0.0, 0.0), only(2)), ((0.003, -0.006), only(2)),
                        ((0.006, -0.010), only(2)), ((0.006, -0.010), STIFF)):
        truth.follow(pulls, soft)
        for _ in range(4):
            time += 0.5
            for one in (shape, alone):
                one.follow(commands(time, pulls, soft))
            shape.measure(time, discs(plane_points(truth.state)))
    assert np.array_equal(shape.predicted.joint_angles, alone.state.joint_angles)
    off = [np.abs(one.bending_angles - truth.state.bending_angles).max()
           for one in (shape.state, shape.predicted)]
    assert off[0] < 0.2 * off[1]


def test_while_the_model_finds_no_shape_there_is_no_prediction_beside_the_estimate():
    truth, shape = TrueArm(), ArmShape(ARM, TOLERANCE)
    pulls, soft, time = (0.003, -0.006), only(2), 100.0

    def go(pulls, soft):
        nonlocal time
        for _ in range(4):
            time += 0.5
            shape.follow(commands(time, pulls, soft))
            shape.measure(time, discs(plane_points(truth.state)))

    go((0.0, 0.0), STIFF)
    go((0.0, 0.0), soft)
    truth.follow(pulls, soft)
    go(pulls, soft)
    go(pulls, STIFF)
    before = shape.predicted
    go((0.005, -0.006), STIFF)  # what is held leaves the right tendon no room
    assert shape.predicted is None
    assert 'do not fit' in str(shape.unpredicted)
    assert shape.state is shape.estimate.state
    assert shape.state.bending_angles == pytest.approx(truth.state.bending_angles, abs=0.01)
    go(pulls, STIFF)
    assert shape.unpredicted is None
    assert np.array_equal(shape.predicted.joint_angles, before.joint_angles)


def test_what_is_stiffened_where_the_model_found_no_shape_is_not_known():
    shape = ArmShape(ARM, TOLERANCE)
    shape.follow(commands(100.0, (0.0, 0.0), only(2)))
    for _ in range(2):  # each tendon is shorter than the discs it runs along
        with pytest.raises(StaticsError):
            shape.follow(commands(101.0, (0.5, 0.5), only(2)))
    with pytest.raises(UnknownShapeError):
        shape.follow(commands(102.0, (0.5, 0.5), STIFF))
    with pytest.raises(UnknownShapeError):
        shape.follow(commands(103.0, (0.003, -0.006), only(1)))
    assert shape.state is None
    assert shape.refusal(103.0)
    shape.set_straight()
    shape.follow(commands(104.0, (0.003, -0.006), only(1)))
    assert shape.state.bending_angles[1] > 0.1


def test_taken_to_be_straight_or_soft_it_forgets_the_estimate():
    shape = lost()
    shape.measure(100.0, discs(bent_points()))
    shape.set_straight()
    assert shape.estimator is None
    assert np.all(shape.state.joint_angles == 0.0)
    shape = lost()
    shape.measure(100.0, discs(bent_points()))
    shape.set_soft(np.array([0.002, -0.01]))
    assert shape.estimator is None
    statics = Statics(ARM)
    expected = statics.solve(statics.chain.straight(), (0.002, -0.01), (True,) * 3)
    assert np.array_equal(shape.state.joint_angles, expected.joint_angles)


# A camera that was bumped.


@pytest.mark.parametrize('shift', [(0.01, -0.006, 0.035), (0.0, 0.004, 0.0), (0.03, -0.02, 0.2)])
def test_what_a_camera_sees_that_was_bumped_is_not_used_until_it_is_back(shift):
    truth, shape, rng = TrueArm(), ArmShape(ARM, TOLERANCE), np.random.default_rng(0)
    bumped, time = np.tile(shift, (4, 1)), 100.0

    def look(bias=None):
        nonlocal time
        time += 0.1
        shape.follow(commands(time, (0.0, 0.0), STIFF))
        return shape.measure(time, truth.seen(rng, bias, discs=(0, 1, 2, 3)))

    for _ in range(5):
        look()
    before, last = shape.state, time
    for _ in range(5 * MAX_FAR_OFF):
        assert not look(bumped).used
    assert shape.anomalies  # from when on the estimate is the one of before
    assert shape.estimate.measured == last
    assert shape.state.points == pytest.approx(before.points, abs=3e-4)
    assert look().used
    assert shape.estimate.measured == time


def test_a_lost_shape_is_not_found_by_a_camera_that_was_bumped_but_where_the_arm_is_said_to_be():
    shape = lost()
    straight = plane_points(shape.statics.chain.straight())
    assert shape.measure(100.0, discs(straight, (0, 1, 2, 3))) is not None
    shape.lose('segment 1 by 3 degrees')
    with pytest.raises(UnknownShapeError):
        shape.follow(commands(101.0, (-0.03, -0.03), STIFF))
    moved = straight + np.array([0.01, 0.0, 0.0])
    assert shape.measure(101.0, discs(moved, (0, 1, 2, 3))) is None
    assert shape.state is None
    shape.set_straight()
    shape.follow(commands(102.0, (0.0, 0.0), STIFF))
    found = [shape.measure(102.0, discs(moved, (0, 1, 2, 3))) for _ in range(PERSISTENT)]
    assert found[-1].used
