# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated steppers move like steppers: finite speed and acceleration, in whole steps."""

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from soft_continuum.hardware.simulated_tendons import SimulatedTendons, TIME_STEP
from support.virtual_clock import ToldClock

TENDONS = ('right_tendon', 'left_tendon')
SPEED, ACCELERATION, STEP = 0.03, 0.3, 5e-6
ROUNDING = 1e-12  # m
BRAKING = SPEED**2 / (2 * ACCELERATION)  # m, from full speed
# The speed may be up to two integration steps off the ideal ramp.
RAMP = 2 * ACCELERATION * TIME_STEP

property_test = settings(deadline=None, derandomize=True, max_examples=40)
pulls = st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
intervals = st.one_of(
    st.sampled_from([0.0, 1e-9, 1e-4, TIME_STEP, 0.02]), st.floats(1e-6, 0.05),
    st.floats(0.05, 5.0))


def rig():
    clock = ToldClock()
    return clock, SimulatedTendons(clock, TENDONS, SPEED, ACCELERATION, STEP)


def after(clock, tendons, seconds):
    clock.now += seconds
    return tendons.read()


def watched(clock, tendons, seconds, interval=TIME_STEP):
    """Readings at regular moments over a time."""
    return [after(clock, tendons, interval) for _ in range(round(seconds / interval))]


def in_steps(pull):
    return pull / STEP


def is_whole(steps):
    return abs(steps - round(steps)) < 1e-6


def distance(before, later):
    return [abs(b - a) for a, b in zip(before.pulls, later.pulls, strict=True)]


def fastest(reading):
    return max(abs(speed) for speed in reading.speeds)


def arrival(readings, side):
    """Index of the first reading from which on a tendon stays where it ends."""
    end = readings[-1].pulls[side]
    return max((i + 1 for i, r in enumerate(readings) if r.pulls[side] != end), default=0)


@pytest.mark.parametrize('command', ['open', 'stop', 'close'])
def test_tendons_start_at_rest_at_zero_pull_and_nothing_but_a_motion_moves_them(command):
    clock, tendons = rig()
    getattr(tendons, command)()
    reading = after(clock, tendons, 100.0)
    assert reading.pulls == (0.0, 0.0) and reading.referenced and not reading.moving
    assert reading.tensions is None  # nothing measures them


@property_test
@given(pulls, st.floats(0.0, 5.0))
def test_tendons_go_to_the_nearest_whole_step_in_whole_steps_without_turning_back_and_rest(
        target, duration):
    clock, tendons = rig()
    tendons.move(target, duration)
    way = [tendons.read(), *watched(clock, tendons, duration + 3.0, 0.01)]
    for side, wanted in enumerate(target):
        steps = [in_steps(reading.pulls[side]) for reading in way]
        assert all(map(is_whole, steps))
        sign = 1.0 if wanted >= 0.0 else -1.0
        assert all(sign * b >= sign * a - 1e-6 for a, b in pairwise(steps))
        assert abs(way[-1].pulls[side] - wanted) <= STEP / 2 + ROUNDING
    assert not way[-1].moving


@pytest.mark.parametrize('target', [(0.03, -0.03), (0.03, 0.01), (-0.002, 0.02), (0.01, 0.0001)])
@pytest.mark.parametrize('duration', [0.0, 0.5, 1.2, 5.0])
def test_tendons_arrive_together_and_when_they_were_told_if_there_is_time(target, duration):
    clock, tendons = rig()
    tendons.move(target, duration)
    way = watched(clock, tendons, duration + 2.0)
    arrivals = [TIME_STEP * arrival(way, side) for side in (0, 1)]
    late = SPEED / ACCELERATION  # s: what braking may add
    if abs(target[1]) > 0.001:  # or half of one of its few steps takes longer
        assert abs(arrivals[0] - arrivals[1]) <= late
    for side, at in enumerate(arrivals if duration > 1.0 else ()):
        early = duration / abs(in_steps(target[side]))  # s: half-way to the last step
        assert duration - early - 0.01 <= at <= duration + late


@pytest.mark.parametrize('share', [0.25, 0.5, 0.75])
def test_a_motion_too_fast_for_the_limits_keeps_the_ratio_of_the_pulls(share):
    clock, tendons = rig()
    tendons.move((0.03, -0.03 * share), 0.0)
    for reading in watched(clock, tendons, 2.0, 0.05):
        right, left = reading.pulls
        assert left == pytest.approx(-share * right, abs=BRAKING)


@property_test
@given(pulls, st.floats(0.0, 2.0), st.floats(0.0, 1.5))
def test_a_stop_ends_within_the_braking_distance_without_turning_back(target, duration, moment):
    clock, tendons = rig()
    tendons.move(target, duration)
    moving = after(clock, tendons, moment)
    tendons.stop()
    for later in watched(clock, tendons, SPEED / ACCELERATION + 0.1, 0.005):
        assert all(a * b >= 0.0 for a, b in zip(moving.speeds, later.speeds, strict=True))
        for way, speed in zip(distance(moving, later), moving.speeds, strict=True):
            overrun = abs(speed) * TIME_STEP  # one integration step
            assert way <= speed**2 / (2 * ACCELERATION) + overrun + STEP + ROUNDING
    assert not later.moving
    assert tendons.read().pulls == after(clock, tendons, 100.0).pulls
    tendons.move((0.01, -0.01), 1.0)  # and it may move again
    assert after(clock, tendons, 5.0).pulls == pytest.approx((0.01, -0.01), abs=ROUNDING)


def test_closing_stops_and_holds():
    clock, tendons = rig()
    tendons.move((0.05, -0.05), 2.0)
    moving = after(clock, tendons, 0.5)
    tendons.close()
    rest = after(clock, tendons, 10.0)
    assert not rest.moving
    assert max(distance(moving, rest)) <= BRAKING + STEP


def test_referencing_takes_the_present_position_as_zero_and_moves_nothing():
    clock, tendons = rig()
    tendons.move((0.01, -0.02), 1.0)
    after(clock, tendons, 3.0)
    tendons.reference()
    for waiting in (0.0, 10.0):
        reading = after(clock, tendons, waiting)
        assert reading.pulls == (0.0, 0.0) and reading.referenced and not reading.moving
    tendons.move((0.005, 0.001), 1.0)
    assert after(clock, tendons, 3.0).pulls == pytest.approx((0.005, 0.001), abs=ROUNDING)


def test_a_reference_on_the_way_counts_from_there():
    clock, tendons = rig()
    tendons.move((0.02, -0.02), 2.0)
    after(clock, tendons, 1.0)
    tendons.reference()
    assert tendons.read().pulls == (0.0, 0.0)


def test_a_target_beyond_one_motor_step_is_not_lost_to_rounding():
    clock, tendons = rig()
    for number in range(1, 21):
        tendons.move((number * STEP, 0.0), 0.01)
        after(clock, tendons, 1.0)
    assert tendons.read().pulls[0] == pytest.approx(20 * STEP, abs=ROUNDING)


@pytest.mark.timeout(60)
@pytest.mark.parametrize('target', [(0.0, 0.0), (0.03, -0.01)])
def test_a_clock_that_was_set_by_years_does_not_block_the_driver(target):
    clock, tendons = rig()
    tendons.move(target, 1.0)
    reading = after(clock, tendons, 1e9)
    assert reading.pulls == pytest.approx(target, abs=ROUNDING)


moves = st.tuples(st.just('move'), pulls, st.floats(0.0, 3.0))
commands = st.one_of(moves, moves, st.tuples(st.just('stop')), st.tuples(st.just('wait')))


@settings(deadline=None, derandomize=True, max_examples=80)
@given(st.lists(st.tuples(commands, intervals), max_size=12))
def test_limits_hold_and_positions_are_continuous_whatever_is_commanded_and_when(script):
    clock, tendons = rig()
    before = tendons.read()
    for (name, *arguments), interval in script:
        if name != 'wait':
            getattr(tendons, name)(*arguments)
        assert tendons.read() == before  # a command takes effect in time, not at once
        reading = after(clock, tendons, interval)
        assert fastest(reading) <= SPEED * (1 + 1e-9)
        assert max(distance(before, reading)) <= SPEED * interval + STEP + ROUNDING
        for old, new in zip(before.speeds, reading.speeds, strict=True):
            assert abs(new - old) <= ACCELERATION * interval * (1 + 1e-9) + RAMP
        before = reading


@property_test
@given(pulls, st.floats(0.0, 2.0), st.lists(st.floats(1e-5, 0.2), min_size=1, max_size=30))
def test_how_often_the_driver_is_read_hardly_changes_the_motion(target, duration, ticks):
    way = []
    for pattern in (ticks, [sum(ticks)]):
        clock, tendons = rig()
        tendons.move(target, duration)
        for interval in pattern:
            reading = after(clock, tendons, interval)
        way.append(reading)
    assert max(distance(*way)) <= SPEED * TIME_STEP * 5 + STEP
