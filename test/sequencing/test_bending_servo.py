# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A segment of a spatial arm follows a moving target, of an arm that is not the servo's model."""

from cmath import exp
from dataclasses import replace
from math import inf, nan, pi, radians

import numpy as np
import pytest

from soft_continuum.mechanics import Statics
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.parameters.files import load_arm
from soft_continuum.sequencing.bending_map import bending_map, bending_of, BendingLimits
from soft_continuum.sequencing.servo import (
    AngleServo,
    HeldSegmentMovedError,
    ServoSettings,
    TargetError,
)
from soft_continuum.user_files import description_file
from support.spatial_arms import in_space

ARM = replace(load_arm(description_file().with_name('spatial_jamming.yaml')),
              bodies_per_segment=4)
STATICS = SpaceStatics(ARM)
STRAIGHT = STATICS.chain.straight()
SEGMENT = 1
SOFT = [False, True, False]
LIMITS = BendingLimits()
SETTINGS = ServoSettings(LIMITS)
DEGREE = radians(1.0)


def towards(angle, direction):
    """Return a bending of the segment, of degrees."""
    return radians(angle) * exp(1j * radians(direction))


def bent(bending):
    """Return the arm with its segment bent, as what is measured of it says."""
    wanted = np.zeros((3, 2))
    wanted[SEGMENT] = bending_vectors(
        ARM, [0.0, abs(bending), 0.0], [0.0, float(np.angle(bending)), 0.0])[SEGMENT]
    return STATICS.chain.uniform(wanted)


@pytest.fixture(scope='module')
def disc():
    return bending_map(STATICS, STRAIGHT, SEGMENT, LIMITS)


@pytest.fixture
def servo(disc, monkeypatch):
    monkeypatch.setattr('soft_continuum.sequencing.servo.bending_map', lambda *_: disc)
    return AngleServo(STATICS, SETTINGS, STRAIGHT, SEGMENT)


def followed(servo, arm, target, end, delay=0.0):
    """Return times, and where an arm goes that bends as ``arm`` says of the pulls it gets."""
    rows, pending, at = [], [], 0j
    for now in np.arange(0.0, end, SETTINGS.period):
        servo.set_angle(target(now), now)
        if (piece := servo.advance(now, np.zeros(3))) is not None:
            pending = list(zip(now + piece.times, piece.pulls, strict=True))
        sent = next((pulls for time, pulls in pending if time >= now + SETTINGS.period - 1e-9),
                    pending[-1][1])
        at += (arm(sent) - at) * (1.0 - np.exp(-SETTINGS.period / 0.06))
        rows.append((now + SETTINGS.period, at))
        seen = [row for row in rows if row[0] <= now + SETTINGS.period - delay + 1e-9]
        if seen:
            time, measured = seen[-1]
            servo.observe(bent(measured), time, time, now + SETTINGS.period)
    return np.array([time for time, _ in rows]), np.array([bending for _, bending in rows])


@pytest.mark.parametrize(('gain', 'askew', 'delay'), [
    (0.5, 35.0, 0.3), (1.5, -35.0, 0.0), (1.5, 35.0, 0.3)])
def test_it_settles_where_the_arm_turns_too_far_or_in_another_direction(
        servo, disc, gain, askew, delay):
    """The proof asks for gain < 2 cos(askew)."""
    def arm(pulls):
        return gain * exp(1j * radians(askew)) * disc.angle_for_pulls(pulls, 0.1j)
    times, found = followed(servo, arm, lambda _: towards(15.0, 120.0), 9.0, delay)
    assert np.abs(found[times > 7.5] - towards(15.0, 120.0)).max() < 0.5 * DEGREE


def worn_arm():
    """Return an arm with other springs, guides that are off, and tendons at wrong angles."""
    springs = tuple(replace(s, stiffness_x=0.7 * s.stiffness_x, stiffness_y=0.6 * s.stiffness_y)
                    for s in ARM.segments)
    tendons = tuple(
        replace(t, angle=t.angle + askew, offset=tuple(0.94 * offset for offset in t.offset))
        for t, askew in zip(ARM.tendons, (0.1, -0.1, 0.15), strict=True))
    return replace(ARM, segments=springs, tendons=tendons)


def test_an_arm_that_is_not_its_model_goes_where_it_is_to_go(servo):
    plant = SpaceStatics(worn_arm())
    state = [plant.chain.straight()]

    def arm(pulls):
        state[0] = plant.solve(state[0], pulls, SOFT)
        return bending_of(state[0].bending, SEGMENT)
    goals = [towards(25.0, 40.0), towards(25.0, -140.0)]
    times, found = followed(servo, arm, lambda t: goals[int(t >= 4.0)], 8.0, 0.1)
    for goal, since in zip(goals, (3.0, 7.0), strict=True):
        then = (times > since) & (times < since + 0.9)
        assert np.abs(found[then] - goal).max() < 1.0 * DEGREE
    open_loop = arm(servo.map.pulls_at(goals[1]))
    assert abs(open_loop - goals[1]) > 2.0 * DEGREE  # else it would not have been corrected


def test_what_is_interpolated_is_where_the_statics_have_the_arm(disc):
    random = np.random.default_rng(1)
    for _ in range(10):
        wanted = random.uniform(0.2, 0.95) * exp(2j * pi * random.uniform())
        state = STRAIGHT
        for part in (0.5, 1.0):
            state = STATICS.solve(state, disc.pulls_at(part * wanted), SOFT)
        assert abs(bending_of(state.bending, SEGMENT) - wanted) < 1.0 * DEGREE
        x, y, z = state.tip
        assert abs(disc.angle_for_tip(x, z, y) - wanted) < 1.5 * DEGREE


def test_beyond_the_edge_it_stays_on_it_and_says_why(servo):
    with pytest.raises(TargetError, match='allowed by bending_angle_limits'):
        servo.set_angle(towards(70.0, 33.0), 10.0)
    strong = bending_map(STATICS, STRAIGHT, SEGMENT, replace(LIMITS, pull_limits=(-0.1, 0.008)))
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


@pytest.mark.parametrize('bad', [complex(nan, 0.0), complex(0.0, inf)])
def test_a_bad_target_is_refused(servo, bad):
    with pytest.raises(TargetError, match='finite'):
        servo.set_angle(bad, 10.0)
    with pytest.raises(TargetError, match='finite'):
        servo.set_tip(0.1, 0.2, 10.0, nan)


def test_another_segment_that_moves_ends_it(servo):
    moved = STATICS.chain.uniform([[0.0, 0.0], [0.0, 0.0], [0.2, 0.0]])
    with pytest.raises(HeldSegmentMovedError, match='segment 3 is'):
        servo.observe(moved, 10.0, None, 10.0)


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
    assert abs(bending_of(state.bending, 0) - 0.6j) < 1.0 * DEGREE
    assert np.abs(state.bending[1:]).max() < 2.0 * DEGREE


def test_a_hinge_bends_as_in_the_plane_and_to_no_other_side():
    plane = load_arm(description_file())
    arm = in_space(plane)
    statics, planar = SpaceStatics(arm), Statics(plane)
    limits = BendingLimits(tension_limit=20.0)
    found, wanted = (bending_map(each, each.chain.straight(), 0, limits)
                     for each in (statics, planar))
    for bending in np.linspace(wanted.clipped(-9.0).real, wanted.clipped(9.0).real, 15):
        assert found.pulls_at(bending) == pytest.approx(wanted.pulls_at(bending), abs=1e-6)
    assert found.end(1.0) == wanted.end(1.0)
    servo = AngleServo(statics, ServoSettings(limits), statics.chain.straight(), 0)
    with pytest.raises(TargetError, match='of 0.2 rad towards y; allowed: 0, since this arm'):
        servo.set_angle(0.1 + 0.2j, 10.0)
