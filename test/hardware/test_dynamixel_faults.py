# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Whatever fails on Dynamixel servos or their bus, no wrong position is believed, and motion ends.

``./run soak --only dynamixel`` does the same fifty times each, with four servos, at other times,
and stops them a thousand times.
"""

from random import Random
from statistics import median

import pytest

from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.sim.emulators import dynamixel_servo
from soft_continuum.sim.emulators.dynamixel import tension_limit
from support import servo_rig
from support.servo_rig import (
    BEYOND_TURN,
    driver_of,
    FAULTS,
    PULSE_PULL,
    refusal,
    rig,
    servos,
    somewhere,
    trial,
    WITHIN_TURN,
)
from support.servo_stops import MAX_STOP_TIME, MEDIAN_STOP_TIME, REST_DISTANCE, stop_in_motion
from support.virtual_clock import LateClock

RAN_ON = 0.02  # m that a tendon may go on, until watchdog or driver have ended the motion
GOES_ON = 0.0012
"""m that the other tendon may go on at 28 mm/s; docs/how_to/use_dynamixel_servos.md: 1.15 mm."""


@pytest.mark.parametrize('fault', FAULTS, ids=lambda fault: fault.name.replace(' ', '_'))
def test_a_fault_is_noticed_and_no_wrong_position_is_believed(fault, tmp_path):
    number = FAULTS.index(fault)
    outcome = trial(tmp_path, fault, number, moving=number % 3 != 0, tendons=2)
    if outcome.noticed:
        assert outcome.ran_on < RAN_ON


@pytest.mark.parametrize(('limits', 'offset', 'known'), [
    (WITHIN_TURN, 0, True), (WITHIN_TURN, 1500, True), (BEYOND_TURN, 0, False)])
def test_after_a_power_cycle_a_position_is_known_if_one_turn_only_can_be(
        limits, offset, known, tmp_path):
    with rig(tmp_path, limits, tendons=2) as made:
        made.driver.close()
        for servo in made.emulator.servos:
            servo.set_up('Homing Offset', offset)
        made.emulator.power_cycle()
        made.wait(0.5)
        made.driver.open()
        made.driver.reference()
        made.wait(0.5)
        made.zero = made.emulator.pulls
        made.follow((0.012, -0.01), 1.0)
        made.emulator.power_cycle()
        made.wait(1.0)
        made.rest()
        made.reopen()
        assert made.driver.read().referenced == known
        made.seen.clear()
        assert made.check() == known


@pytest.mark.parametrize('model', ['XL330-M288', 'XM430-W350'])
def test_connecting_to_loaded_servos_that_their_watchdogs_stopped_pays_nothing_out(
        model, tmp_path):
    with rig(tmp_path, tendons=2, model=model) as made:
        for servo in made.emulator.servos:
            servo.motor.tendon.weight = 10.0
        made.follow((0.005, -0.005), 0.6)
        made.driver.close()
        for servo in made.emulator.servos:
            made.emulator.read(servo.expire)
        made.wait(0.3)
        made.rest()
        before = made.pulls
        made.driver.open()
        made.wait(0.3)
        assert made.pulls == pytest.approx(before, abs=1.1 * PULSE_PULL)


HOLD_UPS = {
    'caught': lambda servo: setattr(servo.motor, 'caught', True),
    'limp': lambda servo: servo.write(64, b'\0')}


@pytest.mark.parametrize('how', HOLD_UPS)
@pytest.mark.parametrize('seed', range(3))
def test_a_servo_that_is_caught_or_limp_soon_stops_the_other(how, seed, tmp_path):
    random = Random(seed)
    speed, held, way = random.uniform(0.005, 0.028), seed % 2, random.choice([0.018, -0.018])
    with rig(tmp_path, tendons=2) as made:
        emulator, clock = made.emulator, made.emulator.clock
        at = clock() + random.uniform(0.15, 0.8) * 0.018 / speed
        before = []

        def hold_up():
            if clock() >= at and not before:
                before.append(made.pulls)
                emulator.read(lambda: HOLD_UPS[how](emulator.servos[held]))
        with pytest.raises(HardwareError, match=f'servo {held + 1}'):
            made.follow((way, -way), 0.018 / speed, hold_up)
        went = 0.0
        while emulator.moving and emulator.servos[1 - held].motor.speed:
            went = max(went, abs(made.pulls[1 - held] - before[0][1 - held]))
            clock.sleep(0.002)
        assert went < GOES_ON


@pytest.mark.parametrize('seed', range(4))
def test_load_friction_inertia_and_a_late_computer_do_not_look_like_a_servo_that_is_caught(
        seed, tmp_path, monkeypatch):
    random = Random(seed)
    model = ('XM430-W350', 'XL330-M288')[seed % 2]
    monkeypatch.setattr(dynamixel_servo, 'TIME_CONSTANT', random.choice([0.005, 0.02]))
    monkeypatch.setattr(dynamixel_servo, 'LOAD_FRICTION', random.choice([0.05, 0.3]))
    monkeypatch.setattr(servo_rig, 'VirtualClock', lambda: LateClock(
        'DynamixelTendons', lambda _: random.choice([0.002, 0.01, 0.04])
        if random.random() < 0.2 else 0.0))
    with rig(tmp_path, tendons=2, model=model) as made:
        for servo in made.emulator.servos:
            servo.motor.tendon.stiffness = random.uniform(0.0, 500.0) * tension_limit(model) / 60.0
            servo.motor.tendon.weight = random.uniform(0.0, 0.5) * tension_limit(model)
        made.wait(0.3)
        for _ in range(2):
            goal, now = somewhere(random, 2), made.driver.read().pulls
            way = max(abs(a - b) for a, b in zip(goal, now, strict=True))
            made.follow(goal, max(0.3, way / random.uniform(0.005, 0.029)))
        assert made.emulator.clock.late > 0.0


def refused(emulator, folder):
    """Why a driver cannot be opened; nothing moves."""
    before, why = emulator.pulls, refusal(driver_of(emulator, folder))
    assert emulator.pulls == before
    return why


def test_two_servos_with_one_id_are_named_even_if_they_answer_at_the_same_time(tmp_path):
    with servos(2) as emulator:
        emulator.collide(1, 0)
        assert 'two servos may have the ID 1' in refused(emulator, tmp_path)
        with emulator.lock:  # they answer a ping alike, at the same time
            emulator.random.randint = lambda low, high: low
        assert 'two servos may have the ID 1' in refused(emulator, tmp_path)


def test_stopped_servos_rest_within_150_ms_and_stay_there(tmp_path):
    random, stops = Random(2), []
    with rig(tmp_path, BEYOND_TURN) as made:
        while len(stops) < 6:
            if (stop := stop_in_motion(made, random)) is not None:
                stops.append(stop)
    times = [stop.slow for stop in stops]
    assert median(times) < MEDIAN_STOP_TIME
    assert max(times) < MAX_STOP_TIME
    assert max(stop.moved for stop in stops) < REST_DISTANCE
