# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The filter of where up is, against rotations of a disc in space that scipy makes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.estimation.sensing.imus import (
    ImuSample,
    ImuSettings,
    MountedImus,
    pose_of_up,
    UpFilter,
)
from soft_continuum.estimation.sensing.tare import SensorError
from soft_continuum.mechanics.arm import SPATIAL_AXES
from soft_continuum.mechanics.rotations import rotation, turn_between
from soft_continuum.parameters.parameter import ParameterError
from support.imus import Errors, GRAVITY
from support.views import space_views, views

DEVIATION, STEP, LENGTH = 0.01, 0.02, 0.25
SETTINGS, ALL = ImuSettings(GRAVITY, stddev=DEVIATION), SPATIAL_AXES[3:]
STRAIGHT = Rotation.identity()
ERRORS = Errors(offset=DEVIATION * GRAVITY)


def record(rng, base=STRAIGHT, seconds=10.0):
    """Return samples of an IMU on a disc that goes and rests, and where up is in its frame."""
    times = STEP * np.arange(int(seconds / STEP))
    vectors, now = np.zeros((len(times), 3)), np.zeros(3)
    for begin in np.arange(3.0, seconds - 2.0, 3.0):
        then = rng.uniform(-0.6, 0.6, 3)
        s = np.clip((times - begin) / 1.2, 0.0, 1.0)[:, None]
        vectors += (then - now) * (10 * s**3 - 15 * s**4 + 6 * s**5)
        now = then
    poses = base * Rotation.from_rotvec(vectors)
    moved = np.gradient(np.gradient(poses.apply([0.0, 0.0, LENGTH]), STEP, axis=0), STEP, axis=0)
    felt = poses.inv().apply(moved + [0.0, 0.0, GRAVITY]) + (
        ERRORS.acceleration * rng.standard_normal(vectors.shape)
        + ERRORS.offset * rng.standard_normal(3))
    bias = ERRORS.bias * rng.standard_normal(3)
    rates = np.zeros_like(vectors)
    rates[1:] = (poses[:-1].inv() * poses[1:]).as_rotvec() / STEP
    rates += bias + ERRORS.rate * rng.standard_normal(vectors.shape)
    samples = [ImuSample(1000.0 + t, tuple(a), w) for t, a, w in zip(times, felt, rates,
                                                                    strict=True)]
    return samples, poses.inv().apply([0.0, 0.0, 1.0]), bias


def test_up_is_within_its_95_percent_ellipse_90_to_99_percent_of_the_time():
    inside, angles = [], []
    for seed in range(12):  # as many devices, every other one on a base that is turned
        base = Rotation.from_euler('xy', [0.7, 2.0]) if seed % 2 else STRAIGHT
        samples, ups, _ = record(np.random.default_rng(seed), base)
        found = UpFilter(SETTINGS, ALL)
        for number, (sample, up) in enumerate(zip(samples, ups, strict=True)):
            used = found.update(sample)
            # Samples soon after each other are off alike: every fifth tells as much as all.
            if used and sample.time > 1001.0 and number % 5 == 0:
                away = found.up - up
                squares = away @ np.linalg.pinv(found.up_covariance, rcond=1e-6) @ away
                inside.append(squares < 5.991)  # chi squared of two that 95 % are below
                angles.append(np.linalg.norm(away))
    assert 0.90 <= np.mean(inside) <= 0.99
    assert np.sqrt(np.mean(np.square(angles))) < 0.025


def test_biases_across_the_vertical_are_found_at_rest_and_that_about_it_is_not():
    samples, _, bias = record(np.random.default_rng(2), seconds=6.0)
    found = UpFilter(SETTINGS, ALL)
    for sample in samples[:140]:  # before it moves
        found.update(sample)
    assert found.bias[:2] == pytest.approx(bias[:2], abs=0.006)
    known, unknown = np.sqrt(np.diag(found.covariance)[[3, 5]])
    assert known < 0.1 * unknown


def test_a_pose_of_up_has_up_where_it_is_and_no_turn_about_it():
    random = np.random.default_rng(4)
    for up, to in (*(random.standard_normal((2, 3)) for _ in range(5)),
                   (np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])),
                   (np.array([0.6, 0.0, 0.8]), np.array([0.6, 0.0, 0.8]))):
        up, to = up / np.linalg.norm(up), to / np.linalg.norm(to)
        assert Rotation.from_rotvec(turn_between(up, to)).apply(up) == pytest.approx(to)
        across = np.eye(3) - np.outer(up, up)
        pose, covariance = pose_of_up(up, 1e-4 * across, to, 1e6)
        assert Rotation.from_quat(pose[3:]).apply(up) == pytest.approx(to)
        assert np.linalg.eigvalsh(covariance[3:, 3:]) == pytest.approx([1e-4, 1e-4, 1e6], rel=1e-3)
        assert covariance[3:, 3:] @ to == pytest.approx(1e6 * to)


def test_half_a_turn_in_the_plane_of_an_arm_stays_in_it():
    up = np.array([0.6, 0.0, 0.8])
    assert np.abs(turn_between(up, -up)) == pytest.approx([0.0, np.pi, 0.0])
    vector = np.random.default_rng(5).standard_normal(3)
    assert rotation(vector) == pytest.approx(Rotation.from_rotvec(vector).as_matrix())


@pytest.mark.parametrize(('views', 'free', 'wrong'), [
    (views, [0.0, 1.0, 0.0], {'imu.mounting_angles': (0.0, 1.0)}),
    (space_views, [0.5, 1.0, 0.0], {'imu.mounting_turns': (0.0, 1.0)})],
    ids=['in the plane', 'in space'])
def test_an_imu_that_sits_askew_is_right_after_a_tare(views, free, wrong):
    values = views.VALUES | SETTINGS_OF_IMUS
    imus, none, free = MountedImus.of(values, views.ARM), np.zeros(3), np.array(free)
    askew = Rotation.from_rotvec(-0.2 * free)

    def felt(turn, start):
        for k in range(60):
            felt = GRAVITY * (turn * askew).inv().apply([0.0, 0.0, 1.0])
            found = imus.measure(2, ImuSample(start + STEP * k, tuple(felt), none), none, none,
                                 start + STEP * k)
        return found

    felt(STRAIGHT, 10.0)
    assert imus.straight(1, 11.2) is None
    imus.mounts[2] = imus.straight(2, 11.2)
    turn = Rotation.from_rotvec(0.3 * free)
    pose, _ = felt(turn, 30.0)
    seen = Rotation.from_quat(pose[3:]).inv().apply([0.0, 0.0, 1.0])
    assert seen == pytest.approx(turn.inv().apply([0.0, 0.0, 1.0]), abs=2e-3)
    name, kept = imus.kept()
    again = MountedImus.of(values | {f'imu.{name}': kept}, views.ARM)
    assert np.array_equal(again.mounts, imus.mounts)
    assert imus.mounts[2] == pytest.approx(askew.as_rotvec(), abs=0.01)
    felt(Rotation.from_rotvec(0.8 * free), 50.0)
    with pytest.raises(SensorError, match='turned by'):
        imus.straight(2, 51.2)
    with pytest.raises(ParameterError, match=f'{next(iter(wrong))} has 2'):
        MountedImus.of(values | wrong, views.ARM)


SETTINGS_OF_IMUS = {
    'imu.mounting_turns': (0.0,), 'imu.mounting_angles': (0.0,),
    'imu.acceleration_stddev': 0.05, 'imu.rate_stddev': 0.003,
    'imu.bias_stddev': 0.05, 'imu.motion_acceleration': 1.0, 'imu.stddev': 0.01}
