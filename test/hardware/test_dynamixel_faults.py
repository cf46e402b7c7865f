# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Whatever fails on Dynamixel servos or their bus, no wrong position is believed, and motion ends.

``./run soak --only dynamixel`` does the same fifty times each, with four servos, at other times.
"""

import pytest

from soft_continuum.hardware.dynamixel.tendons import DynamixelTendons
from soft_continuum.hardware.protocols import HardwareError
from support.servo_rig import (
    BEYOND_TURN,
    FAULTS,
    PULSE_PULL,
    rig,
    servos,
    spools,
    trial,
    WITHIN_TURN,
)

RAN_ON = 0.02  # m that a tendon may go on, until watchdog or driver have ended the motion


@pytest.mark.parametrize('fault', FAULTS, ids=lambda fault: fault.name.replace(' ', '_'))
def test_a_fault_is_noticed_and_no_wrong_position_is_believed(fault, tmp_path):
    number = FAULTS.index(fault)
    outcome = trial(tmp_path, fault, number, moving=number % 3 != 0, tendons=2)
    if outcome.noticed:
        assert outcome.ran_on < RAN_ON


@pytest.mark.parametrize(('limits', 'known'), [(WITHIN_TURN, True), (BEYOND_TURN, False)])
def test_after_a_power_cycle_a_position_is_known_if_one_turn_only_can_be(limits, known, tmp_path):
    with rig(tmp_path, limits, tendons=2) as made:
        made.follow((0.012, -0.01), 1.0)
        made.emulator.power_cycle()
        made.wait(1.0)
        made.rest()
        made.reopen()
        reading = made.driver.read()
        assert reading.referenced == known
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


def test_a_second_program_cannot_open_the_port(tmp_path):
    with rig(tmp_path, tendons=2) as made:
        assert 'in use by another program' in refused(made.emulator, tmp_path)
        assert made.check()


def refused(emulator, folder, **changes):
    """Why a driver cannot be opened; nothing moves."""
    driver = DynamixelTendons(emulator.port, 1000000, spools(2, **changes),
                              folder / 'zeros.json', emulator.clock)
    before = emulator.pulls
    with pytest.raises(HardwareError) as error:
        driver.open()
    assert emulator.pulls == before
    return str(error.value)


def test_a_wrong_mode_model_protocol_or_baud_rate_is_named(tmp_path):
    with servos(2) as emulator:
        emulator.servos[1].set_up('Operating Mode', 3)
        assert 'Operating Mode (11) is 3, needed: 5' in refused(emulator, tmp_path)
        emulator.servos[1].values['Baud Rate'] = 1
        emulator.servos[0].values['Baud Rate'] = 1
        assert 'at 57600 baud' in refused(emulator, tmp_path)
        for servo in emulator.servos:
            servo.values.update({'Baud Rate': 3, 'Protocol Type': 1})
        assert 'Protocol 1.0' in refused(emulator, tmp_path)
    with servos(2, 'XL430-W250') as emulator:
        assert 'neither measure nor limit' in refused(emulator, tmp_path)


def test_two_servos_with_one_id_a_missing_one_and_a_wrong_radius_are_named(tmp_path):
    with servos(2) as emulator:
        emulator.collide(1, 0)
        assert 'two servos may have the ID 1' in refused(emulator, tmp_path)
        emulator.repair()
        emulator.servos[1].power_off()
        assert 'servo 2 (second) does not answer' in refused(emulator, tmp_path)
        emulator.servos[1].power_on()
    with pytest.raises(ValueError, match='10 mm are 0.01 m'):
        spools(2, radii=(10.0, 10.0))
