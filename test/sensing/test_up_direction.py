# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The filter of where up is, against rotations of a disc in space that scipy makes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.sensing.mounted_imus import imus_of
from soft_continuum.sensing.tilt import ImuSample, ImuSettings, SensorError
from soft_continuum.sensing.up_direction import pose_of_up, turned_upright, UpFilter
from support.imus import Errors, GRAVITY
from support.space_views import ARM, VALUES

DEVIATION, STEP, LENGTH = 0.01, 0.02, 0.25
SETTINGS = ImuSettings(GRAVITY, 0.0, deviation=DEVIATION)
STRAIGHT = Rotation.identity()
ERRORS = Errors(offset=DEVIATION * GRAVITY)


def record(rng, base=STRAIGHT, seconds=10.0, errors=ERRORS, duration=1.2):
    """Return samples of an IMU on a disc that goes and rests, and where up is in its frame."""
    times = STEP * np.arange(int(seconds / STEP))
    vectors, now = np.zeros((len(times), 3)), np.zeros(3)
    for begin in np.arange(3.0, seconds - 2.0, 3.0):
        then = rng.uniform(-0.6, 0.6, 3)
        s = np.clip((times - begin) / duration, 0.0, 1.0)[:, None]
        vectors += (then - now) * (10 * s**3 - 15 * s**4 + 6 * s**5)
        now = then
    poses = base * Rotation.from_rotvec(vectors)
    moved = np.gradient(np.gradient(poses.apply([0.0, 0.0, LENGTH]), STEP, axis=0), STEP, axis=0)
    felt = poses.inv().apply(moved + [0.0, 0.0, GRAVITY]) + (
        errors.acceleration * rng.standard_normal(vectors.shape)
        + errors.offset * rng.standard_normal(3))
    bias = errors.bias * rng.standard_normal(3)
    rates = np.zeros_like(vectors)
    rates[1:] = (poses[:-1].inv() * poses[1:]).as_rotvec() / STEP
    rates += bias + errors.rate * rng.standard_normal(vectors.shape)
    samples = [ImuSample(1000.0 + t, tuple(a), w) for t, a, w in zip(times, felt, rates,
                                                                    strict=True)]
    return samples, poses.inv().apply([0.0, 0.0, 1.0]), bias


def test_up_is_within_its_95_percent_ellipse_90_to_99_percent_of_the_time():
    inside, angles = [], []
    for seed in range(12):  # as many devices, every other one on a base that is turned
        base = Rotation.from_euler('xy', [0.7, 2.0]) if seed % 2 else STRAIGHT
        samples, ups, _ = record(np.random.default_rng(seed), base)
        found = UpFilter(SETTINGS)
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
    found = UpFilter(SETTINGS)
    for sample in samples[:140]:  # before it moves
        found.update(sample)
    assert found.bias[:2] == pytest.approx(bias[:2], abs=0.006)
    known, unknown = np.sqrt(np.diag(found.covariance)[[3, 5]])
    assert known < 0.1 * unknown


@pytest.mark.parametrize('scale', [-1.0, 57.3])
def test_a_gyroscope_that_turns_the_other_way_or_in_degrees_is_noticed(scale):
    samples, _, _ = record(np.random.default_rng(3), seconds=20.0, duration=2.5,
                           errors=Errors(1e-4, 1e-5, bias=0.0))
    found = UpFilter(SETTINGS)
    with pytest.raises(SensorError, match='disagree'):
        for sample in samples:
            found.update(ImuSample(sample.time, sample.acceleration, scale * sample.rate))


def test_a_pose_of_up_has_up_where_it_is_and_no_turn_about_it():
    random = np.random.default_rng(4)
    for up, to in (*(random.standard_normal((2, 3)) for _ in range(5)),
                   (np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0]))):
        up, to = up / np.linalg.norm(up), to / np.linalg.norm(to)
        assert Rotation.from_quat(turned_upright(up, to)).apply(up) == pytest.approx(to)
        across = np.eye(3) - np.outer(up, up)
        pose, covariance = pose_of_up(up, 1e-4 * across, to, 1e6)
        assert Rotation.from_quat(pose[3:]).apply(up) == pytest.approx(to)
        assert np.linalg.eigvalsh(covariance[3:, 3:]) == pytest.approx([1e-4, 1e-4, 1e6], rel=1e-3)
        assert covariance[3:, 3:] @ to == pytest.approx(1e6 * to)


def test_an_imu_that_sits_askew_is_right_after_a_tare():
    imus, none = imus_of(ARM, VALUES | SETTINGS_OF_IMUS, 4), np.zeros(3)
    askew = Rotation.from_rotvec([0.1, -0.2, 0.0])

    def felt(turn, start):
        for k in range(60):
            felt = GRAVITY * (turn * askew).inv().apply([0.0, 0.0, 1.0])
            found = imus.measure(2, ImuSample(start + STEP * k, tuple(felt), none), none, none,
                                 start + STEP * k)
        return found

    felt(STRAIGHT, 10.0)
    assert imus.straight(1, 11.2) is None
    imus.mounts[2] = imus.straight(2, 11.2)
    turn = Rotation.from_rotvec([0.3, 0.2, 0.0])
    pose, _ = felt(turn, 30.0)
    seen = Rotation.from_quat(pose[3:]).inv().apply([0.0, 0.0, 1.0])
    assert seen == pytest.approx(turn.inv().apply([0.0, 0.0, 1.0]), abs=2e-3)
    felt(Rotation.from_rotvec([0.6, 0.0, 0.0]), 50.0)
    with pytest.raises(SensorError, match='turned by'):
        imus.straight(2, 51.2)
    with pytest.raises(ParameterError, match='mounting_turns has 2'):
        imus_of(ARM, VALUES | SETTINGS_OF_IMUS | {'imu.mounting_turns': (0.0, 1.0)}, 4)


SETTINGS_OF_IMUS = {
    'imu.mounting_turns': (0.0,), 'imu.acceleration_deviation': 0.05, 'imu.rate_deviation': 0.003,
    'imu.bias_deviation': 0.05, 'imu.motion_acceleration': 1.0, 'imu.deviation': 0.01}
