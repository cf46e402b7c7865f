# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Whatever fails on a GRBL board or its line, motion ends and no wrong position is believed."""

import random
import threading

import pytest

from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.serial_ports import open_serial
from soft_continuum.sim.emulators.grbl import GrblEmulator
from support.driver_waits import at_rest, failed, until
from support.grbl_rig import board, driver, in_motion, rig, settled, standing, STEP, steps
from support.virtual_clock import LateClock

QUEUE = 0.2 * 0.03 / STEP  # steps that may still be made


def unreferenced(tendons):
    until(tendons, lambda: not tendons.read().referenced, 'the reference is lost')
    with pytest.raises(HardwareError, match='call reference'):
        tendons.move((0.0, 0.0), 1.0)
    return at_rest(tendons)


@pytest.mark.parametrize('moving', [False, True])
@pytest.mark.parametrize(('fault', 'words'), [
    (lambda emulator: emulator.unplug(), 'lost'),
    (lambda emulator: setattr(emulator, 'hang', True), 'has not answered')],
    ids=['cable pulled out', 'firmware hangs'])
def test_a_board_that_is_lost_is_reported_and_goes_on_by_the_queue_at_most(fault, words, moving):
    with rig() as (emulator, tendons):
        if moving:
            in_motion(emulator, tendons)
        with emulator.lock:
            before = emulator.motors
            fault(emulator)
        assert words in failed(tendons)
        after = standing(emulator)
        assert all(abs(b - a) <= QUEUE * moving for a, b in zip(before, after, strict=True))
        emulator.hang = False
        emulator.clock.sleep(0.2)
        assert emulator.motors == after
        failed(tendons)


@pytest.mark.parametrize('reset', [False, True])
def test_a_cable_put_back_moves_nothing_and_the_position_is_known_if_power_was_not_lost(
        tmp_path, reset):
    with rig(link=str(tmp_path / 'port')) as (emulator, tendons):
        in_motion(emulator, tendons)
        emulator.unplug()
        failed(tendons)
        where = standing(emulator)
        if reset:
            emulator.reset()
        emulator.plug()
        emulator.clock.sleep(0.2)
        assert emulator.motors == where
        failed(tendons)
        tendons.close()
        tendons.open()
        reading = tendons.read()
        assert reading.referenced is not reset
        assert reset or steps(reading.pulls) == where[:2]
        emulator.clock.sleep(0.2)
        assert emulator.motors == where


@pytest.mark.parametrize('banner', [True, False])
def test_a_reset_at_the_board_in_motion_loses_the_reference(banner):
    with rig() as (emulator, tendons):
        in_motion(emulator, tendons)
        emulator.reset(banner)
        where = emulator.motors
        unreferenced(tendons)
        after = standing(emulator)
        # A jog that was on its way is still executed, from a position that is wrong.
        assert all(abs(b - a) <= 2 * QUEUE for a, b in zip(where, after, strict=True))
        where = after
        tendons.reference()
        tendons.move((0.001, 0.002), 0.1)
        assert at_rest(tendons).pulls == pytest.approx((0.001, 0.002), abs=1e-9)
        assert emulator.motors[:2] == (where[0] + 200, where[1] + 400)


GREETINGS = {
    'of its own': "Grbl 1.1i MR 2023 ['$' for help]", 'of a laser': 'Ortur Laser Master 2 Ready!',
    'of a fork': 'Grbl-Vigo:1.1f|Build:G-20170131-V3.0-20200720',
    'damaged': "Gr\x02l 1.1h ['$' fo", 'none': None}


@pytest.mark.parametrize('greeting', GREETINGS)
@pytest.mark.parametrize('at', [(0.0, 0.0), (0.004, -0.002)])
def test_a_reset_at_rest_is_known_by_its_effects_whatever_the_board_says(greeting, at):
    with rig() as (emulator, tendons):
        settled(tendons)
        tendons.move(at, 0.2)
        at_rest(tendons)
        emulator.firmware.greeting = GREETINGS[greeting] or ''
        emulator.reset(banner=GREETINGS[greeting] is not None)
        begin, where = emulator.time, emulator.motors
        unreferenced(tendons)
        assert emulator.time - begin < 0.3 and emulator.motors == where


@pytest.mark.parametrize('greeting', GREETINGS)
def test_a_board_that_is_accepted_with_its_greeting_is_known_by_it_while_it_is_asked(greeting):
    with rig() as (emulator, tendons):
        settled(tendons)
        tendons.close()
        take = emulator.firmware.take

        def reset_when_asked(data):
            take(data)
            if data == b'$$\n' and emulator.firmware.received.count('$$') == 2:
                emulator.firmware.greeting = GREETINGS[greeting] or ''
                emulator.reset(banner=GREETINGS[greeting] is not None)
        emulator.firmware.take = reset_when_asked
        tendons.open()
        assert not tendons.read().referenced


def test_a_work_offset_that_was_damaged_on_the_way_stops_nothing_for_good():
    with rig() as (emulator, tendons):
        in_motion(emulator, tendons)
        report = emulator.firmware._report
        damaged = []

        def damage():
            line = report()
            if 'WCO' in line and not damaged:
                damaged.append(line)
                return line.replace('WCO:0', 'WCO:7')
            return line
        emulator.firmware._report = damage
        at_rest(tendons)
        assert damaged and '$#' in emulator.firmware.received[-100:]
        assert tendons.read().referenced and emulator.motors[:2] == steps((0.04, -0.04))


def test_a_work_offset_that_another_program_sets_is_set_right_again():
    with rig() as (emulator, tendons):
        settled(tendons)
        with emulator.lock:
            assert emulator.firmware._do('G92X5') == 0
        emulator.clock.sleep(0.5)
        tendons.move((0.001, 0.002), 0.1)
        assert at_rest(tendons).referenced and emulator.motors[:2] == (200, 400)
        assert emulator.firmware._work_offset[0] == 0.0


def test_a_board_that_reports_no_work_offset_is_refused():
    with board() as emulator:
        report = emulator.firmware._report
        emulator.firmware._report = lambda: report().split('|WCO')[0].rstrip('>') + '>'
        with pytest.raises(HardwareError, match='WCO.*reset of the board goes undetected'):
            driver(emulator).open()


@pytest.mark.parametrize(('fault', 'value'), [('drop_ok', 1), ('late_ok', 3.0)])
def test_an_acknowledgement_that_is_lost_or_too_late_ends_the_motion(fault, value):
    with rig() as (emulator, tendons):
        in_motion(emulator, tendons)
        setattr(emulator, fault, value)
        assert 'did not acknowledge' in failed(tendons)
        emulator.late_ok = 0.0
        after = standing(emulator)
        emulator.clock.sleep(0.1)
        assert emulator.motors == after
        tendons.close()
        tendons.open()
        reading = tendons.read()
        assert reading.referenced and steps(reading.pulls) == after[:2]


NO_FAULTS = {
    'acknowledgements a little late': lambda emulator: setattr(emulator, 'late_ok', 0.1),
    'acknowledgements that nothing waits for': lambda emulator: (
        emulator.say('ok'), emulator.say('error:9')),
    'a jog that runs as a program': lambda emulator: setattr(emulator.firmware, 'race', True)}


@pytest.mark.parametrize('what', NO_FAULTS)
def test_what_is_no_fault_changes_no_motion(what):
    with rig() as (emulator, tendons):
        settled(tendons)
        with emulator.lock:
            NO_FAULTS[what](emulator)
        emulator.clock.sleep(0.2)  # until what was said has arrived
        tendons.move((0.006, -0.003), 0.3)
        reading = at_rest(tendons)
        assert emulator.motors[:2] == steps((0.006, -0.003)) == steps(reading.pulls)
        assert emulator.energised and reading.referenced


@pytest.mark.parametrize('seed', range(2))
def test_a_noisy_line_may_end_a_motion_but_no_position_is_wrong(seed):
    with rig() as (emulator, tendons):
        settled(tendons)
        emulator.random = random.Random(seed)
        emulator.garble = 0.1
        try:
            tendons.move((0.01, -0.01), 0.5)
            reading = at_rest(tendons)
        except HardwareError:
            standing(emulator)
        else:
            if reading.referenced:
                until(emulator, lambda: steps(tendons.read().pulls) == emulator.motors[:2])
        emulator.garble = 0.0


@pytest.mark.parametrize('number', [1, 2, 3])
@pytest.mark.parametrize('moving', [False, True])
def test_an_alarm_is_reported_with_its_meaning_and_never_unlocked(number, moving, monkeypatch):
    monkeypatch.setattr('soft_continuum.hardware.grbl.setup.FIND_TIMEOUT', 1.0)
    with rig() as (emulator, tendons):
        if moving:
            in_motion(emulator, tendons)
        emulator.alarm(number)
        where = emulator.motors
        assert f'ALARM:{number}' in failed(tendons)
        tendons.close()
        with pytest.raises(HardwareError, match='X in a terminal'):
            tendons.open()
        assert emulator.firmware.state == 'Alarm' and emulator.motors == where
        assert '$X' not in emulator.firmware.received and '$H' not in emulator.firmware.received


@pytest.mark.parametrize('press', ['hold', 'door'])
@pytest.mark.parametrize('moving', [False, True])
def test_a_button_at_the_board_ends_the_motion_for_good(press, moving):
    with rig() as (emulator, tendons):
        if moving:
            in_motion(emulator, tendons)
        getattr(emulator, press)()
        failed(tendons)
        where = standing(emulator)
        emulator.clock.sleep(0.2)
        assert emulator.motors == where


@pytest.mark.parametrize('delay', [0.0, 0.05, 0.1])
def test_a_jog_that_runs_as_a_program_can_be_stopped(delay):
    with rig() as (emulator, tendons):
        emulator.firmware.race = True
        tendons.move((0.03, -0.03), 0.5)
        until(emulator, lambda: not emulator.firmware.race, 'a jog runs as a program')
        emulator.clock.sleep(delay)
        asked = emulator.time
        tendons.stop()
        reading = at_rest(tendons)
        assert steps(reading.pulls) == emulator.motors[:2]
        assert emulator.firmware.stood_since - asked < 0.3
        assert emulator.energised and reading.referenced and emulator.firmware.state == 'Idle'


def test_a_stop_that_was_left_half_done_is_finished_and_not_resumed():
    with rig() as (emulator, tendons):
        in_motion(emulator, tendons)
        tendons.close()
        where = emulator.motors
        emulator.hold()
        tendons.open()
        assert emulator.firmware.state == 'Idle'
        emulator.clock.sleep(0.1)
        assert emulator.motors == where
        assert not tendons.read().referenced  # a soft reset forgets what would prove it


def test_a_position_moved_by_somebody_else_is_not_believed():
    with rig() as (emulator, tendons):
        settled(tendons)
        with emulator.lock:
            assert emulator.firmware._do('$J=G21G91X1F600') == 0
        unreferenced(tendons)


def test_a_refused_line_is_reported_with_its_meaning():
    with rig(settings={130: 1, 131: 1}) as (emulator, tendons):
        emulator.firmware.settings[20] = 1
        tendons.move((0.01, 0.0), 0.1)
        assert 'error:15 (beyond its travel' in failed(tendons)


@pytest.mark.parametrize(('port', 'words'), [
    ('nowhere', 'nowhere: does not exist; .*port'), ('file', 'cannot be opened'),
    ('', 'no serial port is configured')])
def test_a_port_that_is_none_is_refused_with_words(tmp_path, port, words):
    (tmp_path / 'file').touch()
    with pytest.raises(HardwareError, match=words):
        driver(port and tmp_path / port).open()


def test_a_port_that_does_not_answer_is_reported_and_free_again(monkeypatch):
    monkeypatch.setattr('soft_continuum.hardware.grbl.setup.FIND_TIMEOUT', 0.5)
    with board() as emulator:
        emulator.hang = True
        with pytest.raises(HardwareError, match='no GRBL controller answered'):
            driver(emulator).open()
        open_serial(emulator.port, 115200).close()


def test_a_board_that_is_reset_by_opening_its_port_is_waited_for():
    with board() as emulator:
        emulator.hang = True
        tendons = driver(emulator)

        def boot():
            emulator.clock.sleep(1.0)
            emulator.hang = False
            emulator.reset()
        booting = threading.Thread(target=boot)
        booting.start()
        tendons.open()
        assert not tendons.read().referenced
        tendons.close()
        booting.join()


@pytest.mark.parametrize(('stop', 'words', 'least', 'most'), [
    (False, 'no step for 0.5 s at right_tendon', 0.4, 1.0),
    (True, 'not confirmed a stop within 1 s', 0.9, 1.3)])
def test_a_board_that_reports_motion_but_makes_no_step_is_an_error(stop, words, least, most):
    with rig() as (emulator, tendons):
        in_motion(emulator, tendons)
        emulator.firmware.stalled = True
        if stop:
            tendons.stop()
        begin = emulator.time
        assert words in failed(tendons)
        assert least < emulator.time - begin < most


def test_a_motion_that_ends_short_is_reported_with_both_positions_and_the_state():
    with rig() as (emulator, tendons):
        tendons.move((0.004, -0.002), 0.2)
        jogs = tendons._session._jogs
        until(emulator, lambda: jogs.end == jogs.target, 'all jogs are sent')
        emulator.firmware._realtime(0x85)  # another program cancels the last jog
        error = failed(tendons)
        assert error.count('right_tendon') == error.count('left_tendon') == 2
        assert 'short of' in error and 'in the state Idle' in error


# Whatever the board does, its caller goes on.


@pytest.mark.parametrize('call', ['read', 'stop', 'reference'])
def test_a_driver_that_is_being_opened_answers_at_once_and_can_be_closed(call):
    with board() as emulator:
        emulator.hang = True
        tendons = driver(emulator)
        errors = []

        def connect():
            with pytest.raises(HardwareError) as error:
                tendons.open()
            errors.append(str(error.value))
        opening = threading.Thread(target=connect)
        opening.start()
        until(emulator, lambda: tendons._link is not None)
        begin = emulator.time
        with pytest.raises(HardwareError, match='is being connected'):
            getattr(tendons, call)()
        tendons.close()
        until(emulator, lambda: not opening.is_alive())
        assert emulator.time - begin < 0.1
        assert 'closed while' in errors[0]
        open_serial(emulator.port, 115200).close()


@pytest.mark.parametrize('fault', ['hang', 'late_ok'])
def test_no_call_waits_for_a_board_that_does_not_answer(fault):
    with rig() as (emulator, tendons):
        in_motion(emulator, tendons)
        setattr(emulator, fault, 100.0)
        before = emulator.clock()
        for _ in range(100):
            tendons.move((0.01, 0.01), 0.02)
            tendons.read()
        tendons.stop()
        assert emulator.clock() == before  # time passes only when somebody waits


def test_an_opening_that_is_reset_again_and_again_ends():
    with board() as emulator:
        take = emulator.firmware.take

        def reset_instead(data):
            if b'$' in data:
                emulator.reset()
            take(data)
        emulator.firmware.take = reset_instead
        begin = emulator.time
        with pytest.raises(HardwareError):
            driver(emulator).open()
        assert emulator.time - begin < 6.1


@pytest.mark.parametrize('seed', range(2))
def test_a_driver_that_goes_on_late_reads_what_waits_before_it_calls_a_board_silent(seed):
    busy = random.Random(seed)
    clock = LateClock('GrblTendons', lambda timeout: busy.choice([0.3, 1.0, 2.5])
                      if timeout > 0.0 and busy.random() < 0.03 else 0.0)
    with GrblEmulator(clock=clock) as emulator:
        tendons = driver(emulator)
        tendons.open()
        tendons.reference()
        for goal in (0.01, -0.01), (0.0, 0.005):
            tendons.move(goal, 0.6)
            until(emulator, lambda: not tendons.read().moving)
            assert emulator.motors[:2] == steps(goal) and tendons.read().referenced
        tendons.close()
        assert clock.late > 0.0


def test_a_computer_that_is_late_is_not_taken_for_a_board_that_does_not_answer():
    clock = LateClock(threading.current_thread().name, lambda _: 3.0)
    with GrblEmulator(clock=clock) as emulator:
        tendons = driver(emulator)
        tendons.open()
        tendons.close()
