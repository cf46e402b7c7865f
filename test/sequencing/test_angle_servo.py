# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A segment follows a moving target, of an arm that is not the model of the servo."""

from dataclasses import replace
from math import degrees, inf, nan, pi, radians, sin, sqrt

import numpy as np
import pytest

from benchmarks.servo_loop import follow, Measuring, StaticPlant, TwinPlant
from soft_continuum.mechanics import Jam, Statics, StaticsError
from soft_continuum.mechanics.arm import mounted
from soft_continuum.mechanics.statics import SLACK_ALLOWANCE
from soft_continuum.parameters.files import load_arm
from soft_continuum.sequencing.bending_map import bending_map, BendingLimits, LINE_STEP
from soft_continuum.sequencing.servo import (
    AngleServo,
    HeldSegmentMovedError,
    ServoSettings,
    TargetError,
)
from soft_continuum.twin.differences import read_differences
from soft_continuum.user_files import description_file

ARM = load_arm(description_file())
TYPICAL = read_differences(description_file().with_name('twin.yaml'), 'typical')
STATICS = Statics(ARM)
SETTINGS = ServoSettings()
STRAIGHT = STATICS.chain.straight()


def new_servo(segment=1, **changes):
    return AngleServo(STATICS, replace(SETTINGS, **changes), STRAIGHT, segment)


def bent(*angles):
    """Return the arm with bending angles in degrees."""
    return STATICS.chain.uniform(np.radians(angles))


def pieces(servo, seconds, target=None, begin=10.0):
    """Return the pieces that are sent in a time in which ``target`` is given all the time."""
    found = []
    for now in np.arange(begin, begin + seconds, SETTINGS.period):
        if target is not None:
            servo.set_angle(target, now)
        piece = servo.advance(now, np.zeros(2))
        if piece is not None:
            found.append(piece)
    return found


def end_angle(servo, piece):
    return servo.map.angle_for_pulls(piece.pulls[-1], 0.1 * np.sign(piece.pulls[-1][0])).real


# The plant is not the model.


def worn_arm(stiffness):
    """Return an arm with other springs, jams that give way, tendons that stretch."""
    return replace(
        ARM.with_tendons(axial_stiffness=5e3, free_length=0.3),
        segments=tuple(replace(s, stiffness_y=stiffness * s.stiffness_y,
                               jam=Jam(ratio=50.0)) for s in ARM.segments))


@pytest.mark.parametrize('stiffness', [0.5, 2.0])
@pytest.mark.parametrize(('delay', 'stamp_error'), [(0.0, 0.0), (0.15, 0.0), (0.15, 0.15)])
def test_it_settles_with_wrong_stiffness_delay_and_friction(stiffness, delay, stamp_error):
    plant = StaticPlant(worn_arm(stiffness), 0, dead_band=1e-4, lag=0.1)
    found = follow(ARM, plant, 0, lambda t: radians(20.0 if t < 5.0 else -20.0), 10.0,
                   Measuring(delay, stamp_error), SETTINGS)
    error = np.degrees(found.error(9.0))
    assert np.abs(error).max() < 1.0
    overshoot = -np.degrees(found.targets - found.angles)[found.times < 5.0].min()
    assert overshoot < 8.0


@pytest.mark.parametrize('gain', [0.5, 1.0, 2.0])
@pytest.mark.parametrize('delay', [0.0, 0.15, 0.4])
def test_it_settles_where_the_arm_turns_half_or_twice_as_far_as_the_model(gain, delay):
    servo = new_servo()
    past, angle, end = [], 0.0, 12.0
    pending = []
    for step in range(round(end / SETTINGS.period)):
        now = step * SETTINGS.period
        servo.set_angle(radians(15.0), now)
        piece = servo.advance(now, np.zeros(2))
        if piece is not None:
            pending = list(zip(now + piece.times, piece.pulls, strict=True))
        sent = next((p for t, p in pending if t >= now + SETTINGS.period - 1e-9),
                    pending[-1][1])
        wanted = gain * servo.map.angle_for_pulls(sent, 0.1).real
        angle += (wanted - angle) * (1.0 - np.exp(-SETTINGS.period / 0.06))
        past.append((now + SETTINGS.period, angle))
        seen = [(t, a) for t, a in past if t <= now + SETTINGS.period - delay + 1e-9]
        if seen:
            time, measured = seen[-1]
            servo.observe(bent(0.0, degrees(measured), 0.0), time, time, now + SETTINGS.period)
    last = np.degrees([a for t, a in past if t > end - 2.0])
    assert np.abs(last - 15.0).max() < 0.5


@pytest.mark.parametrize('segment', [2])  # the worst; ./run bench --only servo has all
def test_it_follows_a_sine_on_the_typical_twin_within_half_a_degree(segment):
    found = follow(ARM, TwinPlant(ARM, TYPICAL, segment), segment,
                   lambda t: radians(15.0) * sin(0.2 * pi * t), 9.0,
                   Measuring(0.1, deviation=radians(0.1)), SETTINGS)
    assert degrees(sqrt(np.mean(found.error(2.0)**2))) < 0.5


def test_at_rest_friction_does_not_make_it_hunt():
    plant = StaticPlant(worn_arm(1.0), 1, dead_band=2e-4, lag=0.1)
    found = follow(ARM, plant, 1, lambda _: radians(10.0), 12.0,
                   Measuring(0.1, deviation=radians(0.02)), SETTINGS)
    last = found.pulls[found.times > 8.0]
    assert np.ptp(last, axis=0).max() < 2e-4
    turns = np.abs(np.diff(np.sign(np.diff(last[:, 0])[np.diff(last[:, 0]) != 0.0]))).sum() / 2
    assert turns <= 2


def test_noise_within_the_friction_band_sends_nothing():
    servo = new_servo(friction_band=2e-4)
    pieces(servo, 4.0, 0.2)
    random = np.random.default_rng(1)
    for now in np.arange(14.0, 20.0, SETTINGS.period):
        servo.set_angle(0.2, now)
        angle = degrees(0.2) + random.normal(0.0, 0.1)
        servo.observe(bent(0.0, angle, 0.0), now - 0.1, now - 0.1, now)
        assert servo.advance(now, np.zeros(2)) is None


# Motion.


def test_nothing_moves_before_a_target():
    assert new_servo().advance(10.0, np.zeros(2)) is None


def test_it_reaches_a_target_within_speed_and_acceleration():
    servo = new_servo()
    found = pieces(servo, 5.0, radians(20.0))
    assert end_angle(servo, found[-1]) == pytest.approx(radians(20.0), abs=radians(0.05))
    for piece in found:
        steps = np.diff(piece.times)
        assert np.all(steps > 0.0)
        speeds = np.abs(np.diff(piece.pulls, axis=0) / steps[:, None])
        assert speeds.max(initial=0.0) <= SETTINGS.speed * 1.001
        changes = np.abs(np.diff(np.diff(piece.pulls, axis=0) / steps[:, None], axis=0))
        assert changes.max(initial=0.0) <= SETTINGS.acceleration * SETTINGS.period * 1.3


def test_every_piece_ends_at_rest_within_the_horizon():
    servo = new_servo()
    random, now = np.random.default_rng(1), 10.0
    for _ in range(100):
        now += SETTINGS.period * random.uniform(0.5, 2.5)  # on a busy machine
        servo.set_angle(radians(30.0 if now < 12.0 else -30.0), now)
        piece = servo.advance(now, np.zeros(2))
        if piece is None:
            continue
        assert piece.times[0] > 0.0
        assert piece.times[-1] <= SETTINGS.horizon


def test_a_piece_continues_the_one_before():
    servo = new_servo()
    found = pieces(servo, 3.0, radians(30.0))
    for before, after in zip(found, found[1:], strict=False):
        first = after.start + after.times[0]
        planned = [np.interp(first, before.start + before.times, p) for p in before.pulls.T]
        assert planned == pytest.approx(after.pulls[0], abs=1e-9)


def test_a_late_process_goes_on_from_where_the_tendons_braked():
    servo = new_servo()
    found = pieces(servo, 0.4, radians(30.0))
    servo.set_angle(radians(30.0), 11.0)
    late = servo.advance(11.0, np.zeros(2))
    assert np.abs(late.pulls[0] - found[-1].pulls[-1]).max() < 1e-4


def test_without_targets_it_brakes_and_holds():
    servo = new_servo()
    pieces(servo, 0.5, radians(30.0))
    rest = pieces(servo, 3.0, begin=10.5)
    ends = {tuple(piece.pulls[-1]) for piece in rest[-1:]}
    assert len(rest) * SETTINGS.period < SETTINGS.target_timeout + SETTINGS.horizon + 0.1
    assert not servo.has_target(13.5)
    again = pieces(servo, 2.0, radians(30.0), begin=14.0)
    assert tuple(again[0].pulls[0]) == pytest.approx(ends.pop(), abs=1e-4)
    assert end_angle(servo, again[-1]) == pytest.approx(radians(30.0), abs=radians(0.05))


def test_it_begins_where_the_tendons_are():
    servo = new_servo()
    servo.set_angle(0.0, 10.0)
    pulls = np.array([-0.002, -0.003])
    piece = servo.advance(10.0, pulls)
    assert np.abs(piece.pulls[0] - pulls).max() < 1e-4
    last = piece
    for now in np.arange(10.04, 14.0, SETTINGS.period):  # the target is lost meanwhile
        piece = servo.advance(now, pulls)
        if piece is None:
            break
        last = piece
    assert now < 10.0 + SETTINGS.target_timeout + SETTINGS.horizon
    servo.set_angle(0.0, 20.0)
    assert np.abs(servo.advance(20.0, pulls).pulls[0] - last.pulls[-1]).max() < 1e-4


# Measurements.


def test_a_lost_sensor_leaves_the_correction_as_it_is():
    servo = new_servo()
    pieces(servo, 2.0, 0.1)
    for now in np.arange(12.0, 15.0, SETTINGS.period):
        servo.set_angle(0.1, now)
        servo.observe(bent(0.0, degrees(0.07), 0.0), now - 0.1, now - 0.1, now)
        servo.advance(now, np.zeros(2))
    correction = servo.correction
    assert correction.real > 0.02
    for now in np.arange(15.0, 18.0, SETTINGS.period):
        servo.set_angle(0.1, now)
        servo.observe(bent(0.0, degrees(0.05), 0.0), now, None, now)
        servo.advance(now, np.zeros(2))
    assert servo.correction == pytest.approx(correction, abs=2e-3)
    assert not servo.is_measured(18.0)


def test_what_is_only_predicted_corrects_nothing():
    servo = new_servo()
    for now in np.arange(10.0, 13.0, SETTINGS.period):
        servo.set_angle(0.1, now)
        servo.observe(bent(0.0, 0.0, 0.0), now, None, now)
        servo.advance(now, np.zeros(2))
    assert servo.correction == 0.0


def test_a_measurement_counts_once_and_an_old_one_not_at_all():
    servo = new_servo()
    pieces(servo, 2.0, 0.1)
    for _ in range(100):
        servo.observe(bent(0.0, 0.0, 0.0), 11.9, 11.9, 12.0)
    servo.set_angle(0.1, 12.0)
    servo.advance(12.0, np.zeros(2))
    once = servo.correction
    assert 0.0 < once.real < 0.04
    servo.observe(bent(0.0, 0.0, 0.0), 12.0, 11.95, 14.0)
    servo.advance(12.04, np.zeros(2))
    assert servo.correction == once


def test_limits_do_not_wind_it_up():
    servo, piece = new_servo(), None
    for now in np.arange(10.0, 20.0, SETTINGS.period):  # held by an obstacle at 30 degrees
        servo.set_angle(radians(59.0), now)
        servo.observe(bent(0.0, 30.0, 0.0), now - 0.1, now - 0.1, now)
        piece = servo.advance(now, np.zeros(2)) or piece
    assert 'bending angle limit' in servo.limited
    assert abs(servo.correction) < radians(31.0)
    assert end_angle(servo, piece) <= radians(60.1)


def test_a_stiff_segment_that_moves_ends_it():
    with pytest.raises(HeldSegmentMovedError, match='segment 3 is stiff, but turned by 12'):
        new_servo().observe(bent(0.0, 0.0, 12.0), 10.0, None, 10.0)


# Targets.


@pytest.mark.parametrize('angle', [nan, inf, 1.2, -1.2])
def test_a_bad_angle_is_refused_and_changes_nothing(angle):
    servo = new_servo()
    servo.set_angle(0.1, 10.0)
    with pytest.raises(TargetError, match='needed: a finite|allowed by bending_angle_limits'):
        servo.set_angle(angle, 10.01)
    found = pieces(servo, 0.4)
    assert end_angle(servo, found[-1]) == pytest.approx(0.1, abs=0.01)


def test_a_bad_tip_is_refused():
    with pytest.raises(TargetError, match='finite'):
        new_servo().set_tip(nan, 0.3, 10.0)


@pytest.mark.parametrize('segment', [0, 1, 2])
def test_a_tip_is_approached_as_near_as_the_segment_can(segment):
    servo = new_servo(segment)
    for angle in (-0.7, -0.01, 0.3, 0.9):
        tip = STATICS.bend(STRAIGHT, segment, angle).tip
        assert servo.map.angle_for_tip(tip[0], tip[1]) == pytest.approx(angle, abs=2e-3)
    x, z = 0.05, 0.4
    nearest = servo.map.angle_for_tip(x, z).real
    tips = np.array([STATICS.bend(STRAIGHT, segment, a).tip[:2]
                     for a in np.linspace(nearest - 0.05, nearest + 0.05, 11)])
    assert np.hypot(*(tips - [x, z]).T).argmin() in (4, 5, 6)


def test_a_target_that_jumps_is_not_extrapolated():
    servo = new_servo()
    servo.set_angle(0.0, 10.0)
    servo.set_angle(0.5, 10.05)
    assert servo._target.speed == 0.0
    servo.set_angle(0.51, 10.1)
    assert servo._target.speed == pytest.approx(0.1)


# The map.


def bendings_and_pulls(found):
    """Return bendings from one end to the other, and the pulls there."""
    bendings = np.linspace(found.clipped(-9.0).real, found.clipped(9.0).real, 101)
    return bendings, np.array([found.pulls_at(bending) for bending in bendings])


def test_the_map_ends_at_a_limit_and_says_which():
    for limits, why in ((BendingLimits(tension_limit=1.0), 'tension_limit of 1 N'),
                        (BendingLimits(pull_limits=(-0.01, 0.01)), 'pull_limits'),
                        (BendingLimits(), 'bending angle limit of 60.0 degrees')):
        found = bending_map(STATICS, STRAIGHT, 0, limits)
        assert all(why in found.end(side) for side in (-1.0, 1.0))
        pulls = bendings_and_pulls(found)[1]
        assert pulls.max() <= limits.pull_limits[1]
        assert pulls.min() >= limits.pull_limits[0]


def test_what_cannot_be_straight_is_bent_from_where_it_is_straightest():
    statics, sags = Statics(replace(ARM, gravity=mounted(pi / 2))), bent(0.0, 0.0, 20.0)
    found = bending_map(statics, sags, 2, BendingLimits(tension_limit=0.5))
    assert 0.0 < found.clipped(-1.0).real <= found.middle.real < radians(20.0)
    assert radians(25.0) < found.clipped(1.0).real < radians(40.0)
    assert {found.end(side) for side in (-1.0, 1.0)} == {'the tension_limit of 0.5 N'}


def test_a_segment_that_cannot_be_bent_is_refused():
    with pytest.raises(StaticsError, match='segment 1 cannot be bent from here'):
        bending_map(STATICS, STRAIGHT, 0, BendingLimits(tension_limit=1e-4))


def test_the_map_always_leaves_the_slack_between_both_tendons():
    """All of it where one carries; where none does, what rope absorbs in each."""
    bendings, tight = bendings_and_pulls(
        bending_map(STATICS, STRAIGHT, 1, BendingLimits(antagonist_slack=0.0)))
    loose = bendings_and_pulls(
        bending_map(STATICS, STRAIGHT, 1, BendingLimits(antagonist_slack=0.0005)))[1]
    left = (tight - loose).sum(axis=1)
    assert left[np.abs(bendings) > LINE_STEP] == pytest.approx(0.0005)
    assert left.min() == pytest.approx(2.0 * SLACK_ALLOWANCE)
    assert (tight - loose).min() >= -1e-12


def test_a_horizon_too_short_to_brake_is_refused():
    with pytest.raises(ValueError, match='too short for a period'):
        ServoSettings(period=0.05, horizon=0.1)
