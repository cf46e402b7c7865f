# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Homing: tendons are let out to limit switches, and pulled from there to zero."""

import contextlib

import pytest

from soft_continuum.hardware.grbl.tendons import GrblState
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.parameters.parameter import ParameterError
from support import grbl_rig
from support.driver_waits import at_rest, failed, until
from support.grbl_rig import board, driver, standing

HOMED = (-0.011, -0.009)  # m: switches at -12 and -10 mm of a straight arm, and 1 mm off them
SWITCHES = (-2400.0, -2000.0)  # steps
HOMES = {22: 1, 23: 3, 130: 20000, 131: 20000}


def rig(switches=SWITCHES, settings=HOMES, **changes):
    """A board that is locked until it is homed, and an open driver that knows how to."""
    return grbl_rig.rig(referenced=False, settings=settings, switches=switches,
                        **{'homed_pulls': HOMED, **changes})


def home(tendons):
    tendons.reference()
    until(tendons, lambda: tendons.read().referenced, 'homed')
    return at_rest(tendons)


@pytest.mark.parametrize(('switches', 'settings', 'signs'), [
    (SWITCHES, HOMES, (1.0, 1.0)), ((2400.0, -2000.0), {**HOMES, 23: 2}, (-1.0, 1.0))],
    ids=['motors turn alike', 'one turns the other way'])
def test_homing_ends_at_zero_pull_from_anywhere_and_a_new_process_need_not_home_again(
        switches, settings, signs):
    goal, zero = (0.004, -0.002), (0, 0, 0)
    with rig(switches, settings, signs=signs) as (emulator, tendons):
        assert emulator.firmware.state == 'Alarm'
        assert not tendons.read().referenced
        assert home(tendons).pulls == (0.0, 0.0) and emulator.motors == zero
        tendons.move(goal, 0.3)
        assert at_rest(tendons).pulls == pytest.approx(goal, abs=1e-9)
        tendons.close()
        tendons.open()
        assert tendons.read().referenced and emulator.firmware.received.count('$H') == 1
        assert tendons.read().pulls == pytest.approx(goal, abs=1e-9)
        assert emulator.motors[:2] == (800 * signs[0], -400)
        emulator.reset()
        until(emulator, lambda: not tendons.read().referenced, 'the reset is seen')
        at_rest(tendons)
        assert home(tendons).pulls == (0.0, 0.0) and emulator.motors == zero


def test_nothing_homes_or_moves_by_itself():
    with rig() as (emulator, tendons):
        with pytest.raises(HardwareError, match='call reference'):
            tendons.move((0.001, 0.0), 0.1)
        emulator.clock.sleep(0.3)
        assert emulator.motors == (0, 0, 0)
        assert not any(line in ('$H', '$X') for line in emulator.firmware.received)


def test_it_moves_until_it_rests_at_zero_and_takes_no_other_motion_before():
    with rig() as (emulator, tendons):
        tendons.reference()
        assert tendons.read().moving
        with pytest.raises(HardwareError, match='homing'):
            tendons.move((0.0, 0.0), 1.0)
        with pytest.raises(HardwareError, match='moving'):
            tendons.reference()
        until(emulator, lambda: emulator.moving, 'it moves')
        assert tendons.read().moving
        until(emulator, lambda: tendons.read().referenced, 'homed')
        assert tendons.read().moving or tendons.read().pulls == (0.0, 0.0)
        assert at_rest(tendons).pulls == (0.0, 0.0)


def test_a_stop_while_it_looks_for_the_switches_ends_motion_and_locks_the_board():
    with rig() as (emulator, tendons):
        tendons.reference()
        until(emulator, lambda: emulator.moving, 'it moves')
        begin = emulator.time
        tendons.stop()
        standing(emulator)
        assert emulator.firmware.stood_since - begin < 0.3
        assert 'ALARM:6' in failed(tendons)
        tendons.close()
        tendons.open()
        assert not tendons.read().referenced
        assert home(tendons).pulls == (0.0, 0.0)
        assert emulator.motors == (0, 0, 0)


def test_a_stop_on_the_way_from_the_switches_holds_where_it_is_and_knows_where():
    with rig() as (emulator, tendons):
        tendons.reference()
        until(emulator, lambda: tendons.read().referenced, 'homed')
        until(emulator, lambda: emulator.moving, 'it moves')
        tendons.stop()
        reading = at_rest(tendons)
        assert reading.referenced and max(reading.pulls) < 0.0
        where = standing(emulator)
        assert [round(p * 200e3) for p in reading.pulls] == list(where[:2])


def test_a_stop_at_any_moment_of_homing_wins():
    for delay in (0.0, 0.02, 0.3, 0.8, 1.25, 1.4, 1.6, 2.0):
        with rig() as (emulator, tendons):
            tendons.reference()
            emulator.clock.sleep(delay)
            with contextlib.suppress(HardwareError):
                tendons.stop()
            where = standing(emulator)
            emulator.clock.sleep(0.5)
            assert emulator.motors == where, f'moved on after a stop at {delay} s'


def test_a_stop_whose_byte_is_lost_is_sent_again():
    with rig() as (emulator, tendons):
        tendons.reference()
        until(emulator, lambda: emulator.moving, 'it moves')
        emulator.hang = True  # what the board does not hear, it does not do
        tendons.stop()
        emulator.clock.sleep(0.1)
        emulator.hang = False
        failed(tendons)
        where = standing(emulator)
        emulator.clock.sleep(0.3)
        assert emulator.motors == where and where[0] < -20


def test_a_stop_that_comes_when_the_switches_are_just_found_pulls_nothing():
    with rig() as (emulator, tendons):
        emulator.late_ok = 1.0
        tendons.reference()
        until(emulator, lambda: emulator.firmware.state == 'Home', 'it homes')
        until(emulator, lambda: emulator.firmware.state == 'Idle', 'it has homed')
        where = emulator.motors
        tendons.stop()
        emulator.clock.sleep(1.5)
        assert emulator.motors == where
        assert not tendons.read().referenced


@pytest.mark.parametrize('state', ['Alarm', 'Idle'])
def test_a_reset_of_the_board_while_it_homes_is_no_zero(state):
    with rig() as (emulator, tendons):
        tendons.reference()
        until(emulator, lambda: emulator.moving, 'it moves')
        with emulator.lock:
            emulator.reset()
            emulator.firmware.state = state  # Idle: a build that is not locked when switched on
        where = standing(emulator)
        at_rest(tendons)
        emulator.clock.sleep(0.3)
        assert emulator.motors == where
        assert not tendons.read().referenced
        emulator.firmware.state = 'Alarm'
        emulator.clock.sleep(0.3)


def test_homing_that_takes_too_long_is_ended(monkeypatch):
    monkeypatch.setattr('soft_continuum.hardware.grbl.tendons.HOMING_TIMEOUT', 0.3)
    with rig() as (emulator, tendons):
        tendons.reference()
        assert 'not ended' in failed(tendons)
        where = standing(emulator)
        emulator.clock.sleep(0.3)
        assert emulator.motors == where and where[0] > -2000


def test_a_status_that_was_on_its_way_does_not_end_homing_before_it_began():
    with rig() as (emulator, tendons):
        home(tendons)
        tendons.reference()
        until(emulator, lambda: tendons._session.state is GrblState.SEEKING, 'it seeks')
        with emulator.lock:
            for _ in range(3):
                emulator.say('<Idle|MPos:0.000,0.000,0.000|FS:0,0>')
        until(emulator, lambda: tendons.read().referenced, 'homed')
        at_rest(tendons)
        assert emulator.firmware.received.count('$H') == 2
        assert emulator.motors == (0, 0, 0)


def test_switches_that_are_not_found_are_an_alarm_and_no_zero():
    with rig(switches=()) as (_, tendons):
        tendons.reference()
        assert 'ALARM:9' in failed(tendons)


@pytest.mark.parametrize(('settings', 'homed', 'words'), [
    ({22: 0}, HOMED, '$22=1'), ({23: 0}, HOMED, '$23=3'), ({25: 500000}, HOMED, '$25=360000'),
    ({130: 40000}, HOMED, '$130=24000'), ({}, (0.0,), '$22=0')])
def test_settings_that_contradict_homing_are_named(settings, homed, words):
    with board(switches=SWITCHES, settings={**HOMES, **settings}) as emulator:
        with pytest.raises(HardwareError) as refused:
            driver(emulator, homed_pulls=homed).open()
        assert words in str(refused.value)


@pytest.mark.parametrize('homed', [(-0.01,), (0.01, -0.01), (-0.1, -0.01), (0.0, 0.0, 0.0)])
def test_pulls_that_homing_cannot_end_at_are_refused(homed):
    with pytest.raises(ParameterError, match=r'grbl\.homed_pulls'):
        driver('/dev/null', homed_pulls=homed)
