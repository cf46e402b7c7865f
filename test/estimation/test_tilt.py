# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The filter of a disc that turns about a hinge, against an IMU that shares no formula with it."""

from dataclasses import replace
from math import degrees, pi, radians

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.estimation.sensing.imus import imu_rotations, ImuSample, ImuSettings, UpFilter
from soft_continuum.estimation.sensing.tare import SensorError
from soft_continuum.mechanics.arm import PLANAR_AXES, SPATIAL_AXES
from support import imus

DEVIATION = 0.01  # rad, of what is off all the time
OFFSET = DEVIATION * imus.GRAVITY  # m/s^2
QUIET = imus.Errors(acceleration=1e-4, rate=1e-5, bias=0.0, walk=0.0)
REST = np.zeros(500)


def hinge(axes=PLANAR_AXES):
    return UpFilter(ImuSettings(imus.GRAVITY, stddev=DEVIATION), axes[3:])


def samples(record, start=1000.0):
    return [ImuSample(start + t, tuple(a), w) for t, a, w in zip(
        record.times.tolist(), record.accelerations.tolist(), record.rates, strict=True)]


def tilt(found, mounting=0.0):
    """Return the angle about y, and its variance."""
    x, y, z = found.up
    along = np.array([-z, 0.0, x])  # as up goes with the angle
    assert y == 0.0
    angle = (np.arctan2(-x, z) - mounting + pi) % (2.0 * pi) - pi
    return angle, along @ found.up_covariance @ along


def fed(found, record, mounting=0.0):
    """Return angle and variance after each sample; nan where it was not used."""
    return np.array([tilt(found, mounting) if found.update(sample) else (np.nan, np.nan)
                     for sample in samples(record)]).T


def test_the_angle_is_within_its_95_percent_interval_90_to_99_percent_of_the_time():
    ways = [(0.0, 50.0, 0.0), (pi, 50.0, 0.0), (-pi / 2, 100.0, 0.0), (0.4, 25.0, 0.5)]
    inside, errors = [[] for _ in ways], []
    for seed in range(60):  # as many devices
        way = seed % len(ways)
        mounting, rate, lean = ways[way]
        rng = np.random.default_rng(seed)
        times = np.arange(int(8.0 * rate)) / rate
        record = imus.record(rng, imus.steps(times, rng), rate, mounting, lean=lean,
                             errors=imus.Errors(offset=OFFSET * np.cos(lean)))
        angle, variance = fed(hinge(), record, mounting)
        error = (angle - record.angles)[times > 1.0]
        inside[way].append(np.mean(error**2 < 1.96**2 * variance[times > 1.0]))
        errors.append(np.nanmean(np.square(error)))
    assert 0.90 <= np.mean(inside) <= 0.99
    assert np.mean(inside, axis=1).min() > 0.83  # 15 devices of each way
    assert degrees(np.sqrt(np.mean(errors))) < 0.7


def test_the_bias_of_the_gyroscope_is_found_at_rest():
    misses = []
    for seed in range(12):
        record = imus.record(np.random.default_rng(seed), REST, rate=50.0)
        found = hinge()
        fed(found, record)
        away = found.bias - [0.0, record.biases[-1], 0.0]
        misses.append(away[1] / np.sqrt(found.covariance[4, 4]))
        assert np.abs(away).max() < 0.002
    assert np.abs(misses).max() < 3.0


def test_a_short_push_does_not_turn_the_angle():
    record = imus.record(np.random.default_rng(1), REST, errors=QUIET)
    for push in (3.0, 30.0, 9000.0):
        record.accelerations[300:303, 0] += push
        angle, _ = fed(hinge(), record)
        assert np.nanmax(np.abs(angle[100:])) < radians(0.5)


@pytest.mark.parametrize(('spoil', 'named'), [
    (lambda r: replace(r, accelerations=r.accelerations / imus.GRAVITY), 'is it in m/s'),
    (lambda r: replace(r, accelerations=r.accelerations * 0.0), 'gravity included'),
    (lambda r: replace(r, accelerations=r.accelerations[:, [0, 2, 1]]), 'along y of the disc')])
def test_an_acceleration_that_is_no_gravity_in_the_plane_is_refused(spoil, named):
    record = spoil(imus.record(np.random.default_rng(1), REST, errors=QUIET))
    found = hinge()
    for sample in samples(record)[:10]:
        with pytest.raises(SensorError, match=named):
            found.update(sample)
    for sample in samples(imus.record(np.random.default_rng(1), REST, errors=QUIET), 2000.0):
        assert found.update(sample)  # it works once that is mended
    assert tilt(found)[0] == pytest.approx(0.0, abs=1e-3)


def test_without_gravity_there_is_no_tilt():
    with pytest.raises(SensorError, match='use a camera or a tracker'):
        UpFilter(ImuSettings(0.0), PLANAR_AXES[3:])


@pytest.mark.parametrize(('axes', 'about'), [(PLANAR_AXES, 0.0), (SPATIAL_AXES, 0.7)],
                         ids=['in the plane', 'in space'])  # whose motion is of x and y
@pytest.mark.parametrize('scale', [-1.0, 57.3])
def test_a_gyroscope_that_turns_the_other_way_or_in_degrees_is_noticed(scale, axes, about):
    rng = np.random.default_rng(3)
    times = np.arange(3000) / 100.0
    record = imus.record(rng, imus.steps(times, rng, duration=2.5), errors=QUIET)
    turn = Rotation.from_euler('z', about)
    record = replace(record, accelerations=turn.apply(record.accelerations),
                     rates=scale * turn.apply(record.rates))
    found = hinge(axes)
    with pytest.raises(SensorError, match='disagree'):
        for sample in samples(record):
            found.update(sample)


def test_after_a_gap_the_angle_starts_anew_and_the_bias_is_kept():
    record = imus.record(np.random.default_rng(5), REST)
    found = hinge()
    fed(found, record)
    bias, (_, variance) = found.bias.copy(), tilt(found)
    later = imus.record(np.random.default_rng(6), REST + 0.5, errors=QUIET)
    assert found.update(samples(later, 1060.0)[0])
    assert tilt(found)[0] == pytest.approx(0.5, abs=1e-3)
    assert np.array_equal(found.bias, bias)
    assert tilt(found)[1] > 2.0 * variance


def test_samples_that_come_twice_late_or_too_fast_are_left_out():
    first, second, *_ = samples(imus.record(np.random.default_rng(5), REST))
    found = hinge()
    assert found.update(second)
    for other in (first, second, replace(second, time=second.time + 1e-4)):
        assert not found.update(replace(other, acceleration=(9.0, 0.0, 0.0)))
    assert found.update(replace(first, time=first.time - 3600.0))  # a clock that was set


@pytest.mark.parametrize('axes', [('+x', '+y', '+z'), ('-x', '-y', '+z'), ('+x', '-z', '+y')])
def test_an_imu_that_is_mounted_another_way_measures_the_same(axes):
    """Its axes are what points along those of the disc: first x, then y, then z."""
    record = imus.record(np.random.default_rng(5), np.linspace(0.0, 0.5, 200), errors=QUIET)
    rotation, *_ = imu_rotations(axes, 4)
    columns, signs = ['xyz'.index(a[-1]) for a in axes], [-1.0 if '-' in a else 1.0 for a in axes]
    own = np.empty_like(record.accelerations)
    own[:, columns] = record.accelerations * signs  # what that IMU would send
    assert own @ rotation.T == pytest.approx(record.accelerations)
