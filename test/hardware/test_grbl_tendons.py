# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tendons on a GRBL controller go where they are sent, exactly, and stop when told."""

import math
import random
import sys
import threading

import pytest

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.grbl.tendons import GrblTendons
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.parameters.parameter import ParameterError
from support.driver_waits import at_rest, failed, until
from support.grbl_rig import (
    board,
    driver,
    in_motion,
    rig,
    settled,
    SPEED,
    standing,
    STEP,
    steps,
    STEPS_PER_MM,
)

INTERVAL = 0.02  # s between set-points
QUEUE_LIMIT = 0.2  # s of motion in the controller


def follow(tendons, path, duration, watch=lambda: None):
    """Send set-points as the node does."""
    start = tendons.clock()
    ahead = 0.0
    while ahead < duration:
        ahead = min(tendons.clock() - start + INTERVAL, duration)
        tendons.move(path(ahead), INTERVAL)
        tendons.read()
        watch()
        tendons.clock.sleep(INTERVAL)


def test_opening_moves_nothing_and_nothing_moves_before_the_tendons_are_referenced():
    with rig(referenced=False) as (emulator, tendons):
        reading = tendons.read()
        assert not reading.referenced and not reading.moving
        with pytest.raises(HardwareError, match='call reference'):
            tendons.move((0.01, 0.0), 1.0)
        assert emulator.motors == (0, 0, 0)
        assert not any(line.startswith('$J') for line in emulator.firmware.received)


@pytest.mark.parametrize('signs', [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0)])
def test_both_tendons_arrive_exactly_on_the_step_by_motors_that_pull_as_their_signs_say(signs):
    with rig(signs=signs) as (emulator, tendons):
        tendons.move((0.0123, -0.0071), 0.5)
        assert tendons.read().moving
        assert at_rest(tendons).pulls == pytest.approx((0.0123, -0.0071), abs=1e-9)
        assert emulator.motors[:2] == steps((0.0123 * signs[0], -0.0071 * signs[1]))


@pytest.mark.parametrize('seed', range(2))
def test_commanded_reported_and_real_position_agree_after_any_trajectory(seed):
    chance = random.Random(seed)
    with rig() as (emulator, tendons):
        now = (0.0, 0.0)
        for _ in range(4):
            goal = tuple(chance.uniform(-0.01, 0.01) for _ in range(2))
            duration = chance.uniform(0.1, 0.8)
            follow(tendons, lambda t, a=now, b=goal, d=duration: tuple(
                p + (q - p) * t / d for p, q in zip(a, b, strict=True)), duration)
            now = goal
        reading = at_rest(tendons)
        assert emulator.motors[:2] == steps(now) == steps(reading.pulls)


def test_both_tendons_are_always_equally_far_on_their_way_and_none_is_faster_than_its_limit():
    with rig() as (emulator, tendons):
        def watched(goal, duration):
            tendons.move(goal, duration)
            while tendons.read().moving:
                with emulator.lock:
                    yield *emulator.motors[:2], emulator.firmware.time
                emulator.clock.sleep(0.01)

        for x, y, _ in watched((0.01, -0.005), 1.0):
            assert abs(y + x / 2) <= 0.1 * STEPS_PER_MM
        samples = list(watched((-0.01, 0.005), 0.0))
        for (a, _, t), (b, _, u) in zip(samples, samples[10:], strict=False):
            assert abs(b - a) * STEP <= SPEED * (u - t) * 1.001 + 2 * STEP


@pytest.mark.parametrize('braking', [60e3, 200e3])
def test_never_more_than_200_ms_of_motion_wait_in_the_controller(braking):
    with rig(settings={120: braking, 121: braking}) as (emulator, tendons):
        queued = []
        follow(tendons, lambda t: (0.01 * (1 - math.cos(4 * t)), 0.01 * math.sin(4 * t)), 1.5,
               lambda: queued.append(emulator.remaining_time()))
        tendons.move((-0.03, 0.03), 0.1)
        while tendons.read().moving:
            queued.append(emulator.remaining_time())
            emulator.clock.sleep(0.02)
        assert 0.0 < max(queued) <= QUEUE_LIMIT + 1e-9


@pytest.mark.filterwarnings('ignore::pytest.PytestUnhandledThreadExceptionWarning')
def test_a_driver_that_dies_leaves_at_most_the_queue_to_run(monkeypatch):
    with rig() as (emulator, tendons):
        in_motion(emulator, tendons)
        with tendons._session._lock:  # as if the process had ended here
            before, ended = emulator.motors, tendons._thread
            monkeypatch.setattr(tendons._session, 'act', lambda now: sys.exit())
        after = standing(emulator)
        assert not ended.is_alive()
        largest = SPEED * QUEUE_LIMIT / STEP
        assert all(abs(b - a) <= largest for a, b in zip(before, after, strict=True))


@pytest.mark.parametrize(('pulls', 'duration', 'words'), [
    ((math.nan, 0.0), 1.0, 'pulls'), ((0.0, math.inf), 1.0, 'pulls'),
    ((0.0, 0.0), math.nan, 'pulls'), ((0.0, 0.0), -1.0, 'pulls'), ((0.0601, 0.0), 1.0, 'pulls'),
    ((0.0, -0.0601), 1.0, 'pulls'), ((0.001,), 0.1, 'right_tendon, left_tendon')])
def test_what_is_no_motion_or_beyond_the_travel_is_refused(pulls, duration, words):
    with rig() as (emulator, tendons):
        with pytest.raises(HardwareError, match=words):
            tendons.move(pulls, duration)
        assert not tendons.read().moving
        assert emulator.motors == (0, 0, 0)


@pytest.mark.parametrize('moment', [0.0, 0.21, 0.47, 0.8])
def test_a_stop_at_any_moment_takes_less_than_300_ms_and_holds_until_there_is_a_new_goal(moment):
    with rig() as (emulator, tendons):
        end = emulator.clock() + moment
        in_motion(emulator, tendons)
        until(emulator, lambda: emulator.clock() > end)
        asked = emulator.time
        tendons.stop()
        reading = at_rest(tendons)
        assert steps(reading.pulls) == emulator.motors[:2]
        assert reading.referenced and emulator.energised
        assert emulator.firmware.stood_since - asked < 0.3
        emulator.clock.sleep(0.3)
        assert emulator.motors[:2] == steps(reading.pulls)
        tendons.move((0.001, 0.0), 0.5)
        at_rest(tendons)
        assert emulator.motors[:2] == steps((0.001, 0.0))


@pytest.mark.parametrize('moving', [True, False])
def test_a_motion_that_is_wanted_during_a_stop_begins_after_it(moving):
    with rig() as (emulator, tendons):
        if moving:
            in_motion(emulator, tendons)
        tendons.stop()
        tendons.move((-0.002, 0.003), 0.5)
        at_rest(tendons)
        assert emulator.motors[:2] == steps((-0.002, 0.003))
        assert emulator.firmware.state == 'Idle'


def test_the_present_position_becomes_zero_by_reference_but_not_in_motion():
    with rig() as (emulator, tendons):
        tendons.move((0.004, -0.002), 0.3)
        with pytest.raises(HardwareError, match='moving'):
            tendons.reference()
        at_rest(tendons)
        tendons.reference()
        assert tendons.read().pulls == (0.0, 0.0)
        tendons.move((0.001, 0.0), 0.1)
        at_rest(tendons)
        assert emulator.motors[:2] == steps((0.005, -0.002))


def test_closing_in_motion_stops_and_holds():
    with rig() as (emulator, tendons):
        in_motion(emulator, tendons)
        tendons.close()
        where = standing(emulator)
        assert abs(where[0]) < steps((0.04, 0.0))[0]
        assert emulator.energised
        assert 'configure' in failed(tendons)


def test_two_threads_that_close_it_close_its_descriptors_once(monkeypatch):
    with rig() as (emulator, tendons):
        link, thread = tendons._session.link, tendons._thread
        close, is_alive = link.close, thread.is_alive
        closed, closing, both = [], set(), threading.Event()

        def waits_for_both():
            closing.add(threading.get_ident())
            if len(closing) == 2:
                both.set()
            assert both.wait(20.0)
            return is_alive()

        monkeypatch.setattr(link, 'close', lambda: closed.append(0) or close())
        monkeypatch.setattr(thread, 'is_alive', waits_for_both)
        closers = [threading.Thread(target=tendons.close) for _ in range(2)]
        for one in closers:
            one.start()
        until(emulator, lambda: not any(one.is_alive() for one in closers), 'both are done')
        assert len(closed) == 1


@pytest.mark.parametrize('reset', [False, True])
def test_a_restarted_driver_knows_the_position_if_the_board_was_not_reset(reset):
    with rig() as (emulator, tendons):
        tendons.move((0.003, -0.001), 0.2)
        at_rest(tendons)
        tendons.close()
        if reset:
            emulator.reset()
        begin = emulator.clock()
        tendons.open()
        reading = tendons.read()
        assert reading.referenced is not reset
        if not reset:
            assert emulator.clock() - begin < 0.4
            assert reading.pulls == pytest.approx((0.003, -0.001), abs=1e-9)


def test_a_restarted_driver_knows_the_position_after_a_stop():
    with rig() as (emulator, tendons):
        emulator.firmware.race = True  # its stop needs a soft reset, which forgets offsets
        in_motion(emulator, tendons)
        tendons.stop()
        at_rest(tendons)
        tendons.move((0.002, 0.002), 0.1)
        at_rest(tendons)
        tendons.close()
        tendons.open()
        assert tendons.read().pulls == pytest.approx((0.002, 0.002), abs=1e-9)


def test_a_program_that_died_in_the_middle_of_a_line_leaves_no_motion_behind():
    with board() as emulator:
        first = driver(emulator)
        first.open()
        first.reference()
        settled(first)
        first._session.link.write(b'$J=X+90Y-90F360')
        emulator.clock.sleep(0.1)
        first.close()
        first.open()
        emulator.clock.sleep(0.2)
        assert emulator.motors == (0, 0, 0)
        first.close()


@pytest.mark.parametrize(('setting', 'value'), [
    (1, 25), (10, 0), (11, 0.01), (13, 1), (22, 1), (100, 200), (101, 1.1), (110, 359000),
    (111, 541000), (120, 59000), (121, 300)])
def test_settings_that_contradict_the_configuration_are_named(setting, value):
    settings = {setting: value}
    with board(settings=settings) as emulator:
        if setting == 22:
            emulator.firmware.state = 'Idle'  # unlocked by hand
        with pytest.raises(HardwareError, match='contradict') as error:
            driver(emulator).open()
        assert str(error.value).count('needed: ') == 1
        assert f'needed: ${setting}=' in str(error.value)


def test_a_setting_that_was_refused_fits_after_the_command_that_the_error_names():
    with board(settings={100: 200, 110: 1e6, 120: 50}) as emulator:
        with pytest.raises(HardwareError) as error:
            driver(emulator).open()
        for part in str(error.value).split('needed: ')[1:]:
            assert emulator.firmware._do(part.split(' ')[0]) == 0
        tendons = driver(emulator)
        tendons.open()
        tendons.close()


PARAMETERS = {p.name: p.default for p in GrblTendons.PARAMETERS} | {
    'speed_limit': SPEED, 'acceleration_limit': 0.3, 'pull_limits': (-0.06, 0.06)}


@pytest.mark.parametrize(('name', 'value'), [
    ('signs', (1.0, 0.5)), ('signs', (1.0,)), ('steps_per_mm', (200.0,)),
    ('steps_per_mm', (200.0, 200.0, 200.0))])
def test_motors_that_are_not_one_per_tendon_are_refused_with_the_names_of_the_tendons(name, value):
    with pytest.raises(ParameterError, match=f'grbl.{name}') as refused:
        GrblTendons.from_parameters({**PARAMETERS, f'grbl.{name}': value}, STEADY)
    assert len(value) == 2 or 'right_tendon, left_tendon' in str(refused.value)


def test_three_tendons_are_three_axes():
    with rig(tendons=('a', 'b', 'c')) as (emulator, tendons):
        tendons.move((0.002, -0.001, 0.003), 0.2)
        assert at_rest(tendons).pulls == pytest.approx((0.002, -0.001, 0.003), abs=1e-9)
        assert emulator.motors == (400, -200, 600)
        tendons.close()
        tendons.open()
        reading = tendons.read()
        assert reading.referenced
        assert reading.pulls == pytest.approx((0.002, -0.001, 0.003), abs=1e-9)
