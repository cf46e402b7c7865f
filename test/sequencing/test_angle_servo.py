# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A segment follows a moving target, of an arm that is not the model of the servo."""

from cmath import exp
from dataclasses import replace
from math import degrees, inf, nan, pi, radians, sin, sqrt

import numpy as np
import pytest

from benchmarks.servo_loop import follow, Measuring, StaticPlant, TwinPlant
from soft_continuum.mechanics import Jam, Statics, StaticsError
from soft_continuum.mechanics.arm import mounted
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.mechanics.statics import SLACK_ALLOWANCE
from soft_continuum.planning.bending_map import (
    bending_map,
    BendingLimits,
    complex_bending,
    LINE_STEP,
)
from soft_continuum.ros.description import load_arm
from soft_continuum.sequencing.servo import (
    AngleServo,
    HeldSegmentMovedError,
    ServoSettings,
    TargetError,
)
from soft_continuum.sim.twin.model_errors import read_model_errors
from soft_continuum.user_files import description_file
from support.spatial_arms import in_space

ARM = load_arm(description_file())
TYPICAL = read_model_errors(description_file().with_name('twin.yaml'), 'typical')
STATICS = Statics(ARM)
SETTINGS = ServoSettings()
STRAIGHT = STATICS.chain.straight()
SPATIAL_ARM = replace(load_arm(description_file().with_name('spatial_jamming.yaml')),
                      bodies_per_segment=4)
SPATIAL = SpaceStatics(SPATIAL_ARM)
SEGMENT = 1  # of those in space, and of those that follow what bends by a rule
SOFT = [False, True, False]
DEGREE = radians(1.0)


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


@pytest.mark.parametrize(('stiffness', 'delay', 'stamp_error'), [
    (0.5, 0.0, 0.0), (0.5, 0.15, 0.15), (2.0, 0.15, 0.0), (2.0, 0.15, 0.15)])
def test_it_settles_with_wrong_stiffness_delay_and_friction(stiffness, delay, stamp_error):
    plant = StaticPlant(worn_arm(stiffness), 0, dead_band=1e-4, lag=0.1)
    found = follow(ARM, plant, 0, lambda t: radians(20.0 if t < 5.0 else -20.0), 10.0,
                   Measuring(delay, stamp_error), SETTINGS)
    error = np.degrees(found.error(9.0))
    assert np.abs(error).max() < 1.0
    overshoot = -np.degrees(found.targets - found.angles)[found.times < 5.0].min()
    assert overshoot < 8.0


def followed(servo, chain, arm, target, end, delay=0.0):
    """Return times, and where an arm goes that bends as ``arm`` says of the pulls it gets."""
    rows, pending, at = [], [], 0j
    for now in np.arange(0.0, end, SETTINGS.period):
        servo.set_angle(target(now), now)
        piece = servo.advance(now, np.zeros(len(chain.arm.tendon_names)))
        if piece is not None:
            pending = list(zip(now + piece.times, piece.pulls, strict=True))
        sent = next((pulls for time, pulls in pending if time >= now + SETTINGS.period - 1e-9),
                    pending[-1][1])
        at += (arm(sent) - at) * (1.0 - np.exp(-SETTINGS.period / 0.06))
        rows.append((now + SETTINGS.period, at))
        seen = [row for row in rows if row[0] <= now + SETTINGS.period - delay + 1e-9]
        if seen:
            time, bending = seen[-1]
            measured = chain.uniform(bending_vectors(
                chain.arm, [0.0, abs(bending), 0.0], [0.0, float(np.angle(bending)), 0.0]))
            servo.observe(measured, time, time, now + SETTINGS.period)
    return np.array([time for time, _ in rows]), np.array([bending for _, bending in rows])


@pytest.mark.parametrize('segment', [2])  # the worst; ./run bench --only servo has all
def test_it_follows_a_sine_on_the_typical_twin_within_half_a_degree(segment):
    found = follow(ARM, TwinPlant(ARM, TYPICAL, segment), segment,
                   lambda t: radians(15.0) * sin(0.2 * pi * t), 9.0,
                   Measuring(0.1, stddev=radians(0.1)), SETTINGS)
    assert degrees(sqrt(np.mean(found.error(2.0)**2))) < 0.5


def test_at_rest_friction_does_not_make_it_hunt():
    plant = StaticPlant(worn_arm(1.0), 1, dead_band=2e-4, lag=0.1)
    found = follow(ARM, plant, 1, lambda _: radians(10.0), 12.0,
                   Measuring(0.1, stddev=radians(0.02)), SETTINGS)
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


def test_a_stiff_segment_that_moves_ends_it(servo):
    with pytest.raises(HeldSegmentMovedError, match='segment 3 is stiff, but turned by 12'):
        new_servo().observe(bent(0.0, 0.0, 12.0), 10.0, None, 10.0)
    with pytest.raises(HeldSegmentMovedError, match='segment 3 is'):
        servo.observe(SPATIAL.chain.uniform([[0.0, 0.0], [0.0, 0.0], [0.2, 0.0]]), 10.0, None,
                      10.0)


# Targets.


@pytest.mark.parametrize('angle', [nan, inf, 1.2, -1.2])
def test_a_bad_angle_is_refused_and_changes_nothing(angle):
    servo = new_servo()
    servo.set_angle(0.1, 10.0)
    with pytest.raises(TargetError, match='needed: a finite|allowed by bending_angle_limits'):
        servo.set_angle(angle, 10.01)
    found = pieces(servo, 0.4)
    assert end_angle(servo, found[-1]) == pytest.approx(0.1, abs=0.01)


def test_a_target_that_is_not_finite_is_refused(servo):
    for one, target in ((new_servo(), (nan, 0.3, 10.0)), (servo, (0.1, 0.2, 10.0, nan))):
        with pytest.raises(TargetError, match='finite'):
            one.set_tip(*target)
    for bad in (complex(nan, 0.0), complex(0.0, inf)):
        with pytest.raises(TargetError, match='finite'):
            servo.set_angle(bad, 10.0)


@pytest.mark.parametrize('segment', [0, 1, 2])
def test_a_tip_is_approached_as_near_as_the_segment_can(segment):
    servo = new_servo(segment)
    for angle in (-0.7, -0.01, 0.3, 0.9):
        tip = STATICS.bend(STRAIGHT, segment, angle).tip
        assert servo.map.angle_for_tip(tip[0], tip[2]) == pytest.approx(angle, abs=2e-3)
    x, z = 0.05, 0.4
    nearest = servo.map.angle_for_tip(x, z).real
    tips = np.array([STATICS.bend(STRAIGHT, segment, a).tip[::2]
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


# In space.


def towards(angle, direction):
    """Return a bending of the segment, of degrees."""
    return radians(angle) * exp(1j * radians(direction))


@pytest.fixture(scope='module')
def disc():
    return bending_map(SPATIAL, SPATIAL.chain.straight(), SEGMENT, BendingLimits())


@pytest.fixture
def servo(disc, monkeypatch):
    monkeypatch.setattr('soft_continuum.sequencing.servo.bending_map', lambda *_: disc)
    return AngleServo(SPATIAL, SETTINGS, SPATIAL.chain.straight(), SEGMENT)


@pytest.mark.parametrize(('statics', 'gain', 'askew', 'delay'), [
    (STATICS, 0.5, 0.0, 0.4), (STATICS, 1.0, 0.0, 0.15), (STATICS, 2.0, 0.0, 0.0),
    (STATICS, 2.0, 0.0, 0.4), (SPATIAL, 0.5, 35.0, 0.3), (SPATIAL, 1.5, -35.0, 0.0),
    (SPATIAL, 1.5, 35.0, 0.3)])
def test_it_settles_where_the_arm_turns_too_far_or_in_another_direction(
        statics, gain, askew, delay, request):
    """The proof asks for gain < 2 cos(askew)."""
    planar = statics is STATICS
    servo = new_servo(SEGMENT) if planar else request.getfixturevalue('servo')
    goal, near = towards(15.0, 0.0 if planar else 120.0), 0.1 if planar else 0.1j

    def arm(pulls):
        return gain * exp(1j * radians(askew)) * servo.map.angle_for_pulls(pulls, near)
    times, found = followed(servo, statics.chain, arm, lambda _: goal, 12.0, delay)
    assert np.abs(found[times > (10.0 if planar else 7.5)] - goal).max() < 0.5 * DEGREE


def worn_spatial_arm():
    """Return an arm with other springs, guides that are off, and tendons at wrong angles."""
    springs = tuple(replace(s, stiffness_x=0.7 * s.stiffness_x, stiffness_y=0.6 * s.stiffness_y)
                    for s in SPATIAL_ARM.segments)
    tendons = tuple(
        replace(t, angle=t.angle + askew, offset=tuple(0.94 * offset for offset in t.offset))
        for t, askew in zip(SPATIAL_ARM.tendons, (0.1, -0.1, 0.15), strict=True))
    return replace(SPATIAL_ARM, segments=springs, tendons=tendons)


def test_an_arm_that_is_not_its_model_goes_where_it_is_to_go(servo):
    plant = SpaceStatics(worn_spatial_arm())
    state = [plant.chain.straight()]

    def arm(pulls):
        state[0] = plant.solve(state[0], pulls, SOFT)
        return complex_bending(state[0].bending, SEGMENT)
    goals = [towards(25.0, 40.0), towards(25.0, -140.0)]
    times, found = followed(servo, SPATIAL.chain, arm, lambda t: goals[int(t >= 4.0)], 8.0, 0.1)
    for goal, since in zip(goals, (3.0, 7.0), strict=True):
        then = (times > since) & (times < since + 0.9)
        assert np.abs(found[then] - goal).max() < 1.0 * DEGREE
    open_loop = arm(servo.map.pulls_at(goals[1]))
    assert abs(open_loop - goals[1]) > 2.0 * DEGREE  # else it would not have been corrected


def test_what_is_interpolated_is_where_the_statics_have_the_arm(disc):
    random = np.random.default_rng(1)
    for _ in range(10):
        wanted = random.uniform(0.2, 0.95) * exp(2j * pi * random.uniform())
        state = SPATIAL.chain.straight()
        for part in (0.5, 1.0):
            state = SPATIAL.solve(state, disc.pulls_at(part * wanted), SOFT)
        assert abs(complex_bending(state.bending, SEGMENT) - wanted) < 1.0 * DEGREE
        x, y, z = state.tip
        assert abs(disc.angle_for_tip(x, z, y) - wanted) < 1.5 * DEGREE


def test_beyond_the_edge_it_stays_on_it_and_says_why(servo):
    with pytest.raises(TargetError, match='allowed by bending_angle_limits'):
        servo.set_angle(towards(70.0, 33.0), 10.0)
    strong = bending_map(SPATIAL, SPATIAL.chain.straight(), SEGMENT,
                         BendingLimits(pull_limits=(-0.1, 0.008)))
    assert 'pull_limits' in strong.end(towards(59.0, 33.0))
    edge = strong.clipped(towards(59.0, 33.0))
    assert np.angle(edge) == pytest.approx(radians(33.0))
    assert np.isfinite(strong.pulls_at(edge)).all()
    assert strong.pulls_at(edge).max() <= 0.008


def test_it_is_no_faster_than_the_tendons_may_be(servo):
    pulls = []
    for now in np.arange(10.0, 14.0, SETTINGS.period):
        servo.set_angle(towards(40.0, 70.0 if now < 12.0 else 200.0), now)
        piece = servo.advance(now, np.zeros(3))
        if piece is not None:
            speeds = np.diff(piece.pulls, axis=0) / np.diff(piece.times)[:, None]
            pulls.append(np.abs(speeds).max(initial=0.0))
            assert piece.times[-1] <= SETTINGS.horizon
    assert 0.5 * SETTINGS.speed < max(pulls) <= 1.001 * SETTINGS.speed


def test_without_jamming_tendons_hold_the_other_segments():
    arm = load_arm(description_file().with_name('tendon_arm.yaml'))
    arm = replace(arm, spacers=1, bodies_per_segment=2, segments=tuple(
        replace(segment, bending_angle_limit=0.65) for segment in arm.segments))
    statics = SpaceStatics(arm)
    limits = BendingLimits(tension_limit=10.0)
    start = statics.chain.straight()
    disc = bending_map(statics, start, 0, limits, jamming=False)
    state = start
    for part in (0.5, 1.0):
        state = statics.solve(state, disc.pulls_at(part * 0.6j), [True] * 3)
    assert abs(complex_bending(state.bending, 0) - 0.6j) < 1.0 * DEGREE
    assert np.abs(state.bending[1:]).max() < 2.0 * DEGREE


def test_a_hinge_bends_as_in_the_plane_and_to_no_other_side():
    statics = SpaceStatics(in_space(ARM))
    limits = BendingLimits(tension_limit=20.0)
    found, wanted = (bending_map(each, each.chain.straight(), 0, limits)
                     for each in (statics, STATICS))
    for bending in np.linspace(wanted.clipped(-9.0).real, wanted.clipped(9.0).real, 15):
        assert found.pulls_at(bending) == pytest.approx(wanted.pulls_at(bending), abs=1e-6)
    assert found.end(1.0) == wanted.end(1.0)
    servo = AngleServo(statics, ServoSettings(limits), statics.chain.straight(), 0)
    with pytest.raises(TargetError, match='of 0.2 rad towards y; allowed: 0, since this arm'):
        servo.set_angle(0.1 + 0.2j, 10.0)
