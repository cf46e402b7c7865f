# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tendons on Dynamixel servos go where they are sent, stop, hold, and know where they are."""

from contextlib import contextmanager
import re

import pytest

from soft_continuum.hardware.dynamixel.motion import Track
from soft_continuum.hardware.dynamixel.reference import ZeroFile
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.sim.emulators import dynamixel_servo
from soft_continuum.sim.emulators.dynamixel import SPOOL_RADIUS
from soft_continuum.sim.emulators.dynamixel_packets import Error, Instruction
from support.driver_waits import at_rest, failed
from support.servo_rig import (
    BEYOND_TURN,
    driver_of,
    in_motion,
    PULSE_PULL,
    refusal,
    rig,
    servos,
    WITHIN_TURN,
)

CLOSE = 1e-4  # m


@pytest.fixture(autouse=True)
def _smooth(monkeypatch):
    """Gears that do not rub, and currents without noise: test_dynamixel_faults has both."""
    monkeypatch.setattr(dynamixel_servo, 'LOAD_FRICTION', 0.0)
    monkeypatch.setattr(dynamixel_servo, 'OWN_FRICTION', 0.0)
    monkeypatch.setattr(dynamixel_servo, 'CURRENT_NOISE', 0.0)


def two(folder, limits=BEYOND_TURN, **changes):
    """Two servos, and their driver at zero pull."""
    return rig(folder, limits, 2, **changes)


def hang_weight(made, newton=9.6):
    """Hang a weight on every tendon, and let it sink into its place."""
    for servo in made.emulator.servos:
        servo.motor.tendon.weight, servo.motor.tendon.stiffness = newton, 0.0
    made.wait(0.5)


def values(emulator, name):
    return [servo.values[name] for servo in emulator.servos]


def writes(emulator):
    """Address and data of everything that was written to one servo or to many."""
    for packet in emulator.packets:
        if packet.instruction in (Instruction.WRITE, Instruction.SYNC_WRITE):
            skip = 2 if packet.instruction == Instruction.WRITE else 5
            yield int.from_bytes(packet.parameters[:2], 'little'), packet.parameters[skip:]


def test_opening_moves_nothing_and_lets_the_servos_hold(tmp_path):
    with servos(2) as emulator:
        tendons = driver_of(emulator, tmp_path, tension_limits=(20.0, 20.0))
        before = emulator.pulls
        tendons.open()
        assert not tendons.read().referenced
        emulator.clock.sleep(0.5)
        assert emulator.pulls == pytest.approx(before, abs=CLOSE)
        assert values(emulator, 'Torque Enable') == [1, 1]
        # 20 N on 10 mm are 0.2 N m, 112 mA of an XM430-W350 (4.1 N m at 2.3 A), 41.7 x 2.69 mA
        assert values(emulator, 'Goal Current') == [42, 42]
        assert all(0 < watchdog <= 10 for watchdog in values(emulator, 'Bus Watchdog'))  # 0.2 s
        with pytest.raises(HardwareError, match='the position is unknown.*no zero of it'):
            tendons.move((0.0, 0.0), 0.1)
        tendons.close()


def test_tendons_arrive_together_by_spools_of_their_radii_and_signs_under_load(tmp_path):
    with servos(2) as emulator:
        for servo, radius in zip(emulator.servos, (0.01, 0.02), strict=True):
            servo.motor.tendon.radius, servo.motor.tendon.stiffness = radius, 0.0
            servo.motor.tendon.weight = 9.6
        tendons = driver_of(emulator, tmp_path, radii=(0.01, 0.02))
        tendons.open()
        emulator.clock.sleep(1.0)
        tendons.reference()
        emulator.clock.sleep(0.2)
        start = emulator.pulls
        tendons.move((0.012, -0.006), 0.6)
        emulator.clock.sleep(0.3)
        first, second = tendons.read().pulls
        assert 0.003 < first < 0.009
        assert second == pytest.approx(-first / 2, abs=5e-4)
        reading = at_rest(tendons)
        assert reading.pulls == pytest.approx((0.012, -0.006), abs=CLOSE)
        moved = [b - a for a, b in zip(start, emulator.pulls, strict=True)]
        assert moved == pytest.approx((0.012, -0.006), abs=CLOSE)
        emulator.clock.sleep(0.5)
        assert tendons.read().tensions == pytest.approx((9.6, 9.6), abs=0.5)
        tendons.close()


def test_a_speed_that_cannot_be_makes_no_stop_longer(monkeypatch, tmp_path):
    seen = Track.velocities
    with two(tmp_path) as made:
        in_motion(made)  # the reply before last was dated late
        monkeypatch.setattr(Track, 'velocities', lambda track: [10.0 * v for v in seen(track)])
        at = made.driver.read().pulls[0]
        made.driver.stop()
        assert at_rest(made.driver).pulls[0] == pytest.approx(at, abs=2.5e-3)


def test_stops_in_motion_and_at_rest_do_not_let_a_loaded_tendon_go(tmp_path):
    with two(tmp_path) as made:
        hang_weight(made)
        in_motion(made)
        asked = made.pulls
        made.driver.stop()
        made.emulator.clock.sleep(0.15)
        assert all(abs(servo.motor.speed) * SPOOL_RADIUS < 5e-4  # m/s
                   for servo in made.emulator.servos)
        rest, at = at_rest(made.driver).pulls, made.pulls
        assert rest == pytest.approx(asked, abs=1.5e-3)
        assert rest == pytest.approx(at, abs=CLOSE)
        made.wait(1.0)
        assert made.driver.read().tensions == pytest.approx((9.6, 9.6), abs=0.5)
        for _ in range(20):
            made.driver.stop()
            made.wait(0.06)
        assert made.pulls == pytest.approx(at, abs=2 * PULSE_PULL)


def test_a_motion_goes_on_where_the_last_one_was_stopped(tmp_path):
    with two(tmp_path) as made:
        in_motion(made)
        made.driver.stop()
        made.driver.move((0.001, -0.001), 1.0)  # asked for during the stop
        assert at_rest(made.driver).pulls == pytest.approx((0.001, -0.001), abs=CLOSE)


def test_no_calls_no_motion(tmp_path):
    with two(tmp_path) as made:
        made.driver.move((0.0006, 0.0), 0.02)  # as a control loop does, which then hangs
        made.wait(1.0)
        assert made.driver.read().pulls[0] == pytest.approx(0.0006, abs=CLOSE)
        made.rest()


def test_the_requests_of_the_control_loop_never_wait(tmp_path):
    with two(tmp_path) as made:
        for servo in made.emulator.servos:
            servo.hang = True
        clock = made.emulator.clock
        begin = clock()
        made.driver.move((0.001, 0.0), 0.1)
        made.driver.read()
        made.driver.stop()
        assert clock() == begin
        assert 'stopped replying' in failed(made.driver)


# What is known of the position


@pytest.mark.parametrize('killed', [False, True])
def test_servos_without_their_driver_hold_and_a_new_one_knows_the_position(tmp_path, killed):
    limits = {'pull_limits': (-0.2, 0.2)}
    with two(tmp_path, **limits) as made:
        emulator, tendons = made.emulator, made.driver
        hang_weight(made)
        if killed:
            in_motion(made)
            tendons._session.fail('as if the process had been killed')
            tendons._session.link.abort()
            made.wait(0.5)
            assert values(emulator, 'Bus Watchdog') == [255, 255]
        else:
            tendons.move((0.07, -0.02), 1.0)  # more than a turn
            assert at_rest(tendons).pulls == pytest.approx((0.07, -0.02), abs=CLOSE)
            made.wait(1.0)
            tendons.close()
            (tmp_path / 'zeros.json').unlink()  # it may be another computer
            made.wait(2.0)
            assert values(emulator, 'Bus Watchdog') == [0, 0]
        made.rest()
        at = made.pulls
        assert values(emulator, 'Torque Enable') == [1, 1]
        tendons.close()
        again = driver_of(emulator, tmp_path, **limits)
        again.open()
        assert again.read().referenced
        assert again.read().pulls == pytest.approx(at, abs=CLOSE)
        made.wait(0.5)
        assert made.pulls == pytest.approx(at, abs=2 * PULSE_PULL)
        again.close()


def test_after_a_power_cycle_a_turn_that_cannot_be_told_is_not_guessed(tmp_path):
    with two(tmp_path) as made:  # 120 mm within pull_limits, two turns
        hang_weight(made, 0.0)
        made.driver.move((0.03, 0.0), 1.0)
        at = at_rest(made.driver).pulls[0]
        made.driver.close()
        made.emulator.power_cycle(0)  # only one of them
        made.wait(0.5)
        made.driver.open()
        why = made.driver.read().unreferenced
        assert not made.driver.read().referenced
        assert 'servo 1 (first) lost power' in why
        may_be = [1e-3 * float(found) for found in re.findall(r'(-?[0-9.]+) mm', why)]
        assert may_be == pytest.approx([at, at - 4096 * PULSE_PULL], abs=2e-4)
        assert 'servo 2' not in why
        made.driver.reference()
        made.wait(0.2)
        assert made.driver.read().referenced


@pytest.mark.parametrize('lost', ['zero', 'mode'])
def test_without_a_kept_zero_or_its_mode_a_servo_does_not_know_its_position(tmp_path, lost):
    with two(tmp_path, (-0.02, 0.02)) as made:
        made.driver.close()
        if lost == 'zero':
            (tmp_path / 'zeros.json').write_text('{"no": 1, "json')
            made.emulator.power_cycle()
        else:
            for mode in (4, 5):
                made.emulator.servos[0].set_up('Operating Mode', mode)
            (tmp_path / 'zeros.json').unlink()
        made.wait(0.5)
        made.driver.open()
        assert 'no zero of it is stored' in made.driver.read().unreferenced


def test_a_zero_that_cannot_be_kept_is_an_error(tmp_path):
    with servos(2) as emulator:
        (tmp_path / 'file').write_text('a file where the folder should be')
        tendons = driver_of(emulator, tmp_path / 'file')
        tendons.open()
        tendons.reference()
        assert 'the zero cannot be saved' in failed(tendons)
        tendons.close()


@contextmanager
def slow_disk(monkeypatch, tmp_path):
    """Yield a driver whose file of zeros takes a second to write, referenced and moved since."""
    with servos(2) as emulator:
        tendons = driver_of(emulator, tmp_path, pull_limits=WITHIN_TURN)
        write = ZeroFile.write

        def slow(*arguments):
            emulator.clock.sleep(1.0)
            write(*arguments)

        tendons.open()
        tendons.reference()
        emulator.clock.sleep(0.2)
        tendons.move((0.005, -0.005), 0.3)
        at_rest(tendons)
        monkeypatch.setattr(ZeroFile, 'write', slow)
        yield emulator, tendons
        tendons.close()


def test_a_busy_disk_keeps_no_watchdog_waiting(monkeypatch, tmp_path):
    with slow_disk(monkeypatch, tmp_path) as (emulator, tendons):
        before = (tmp_path / 'zeros.json').read_text()
        tendons.reference()
        emulator.clock.sleep(0.9)
        assert (tmp_path / 'zeros.json').read_text() == before
        tendons.move((0.005, -0.005), 0.3)
        assert at_rest(tendons).pulls == pytest.approx((0.005, -0.005), abs=CLOSE)
        assert (tmp_path / 'zeros.json').read_text() != before


@pytest.mark.parametrize('end', ['close', 'cable'])
def test_a_session_that_ends_while_its_zero_is_written_leaves_the_new_zero(
        monkeypatch, tmp_path, end):
    with slow_disk(monkeypatch, tmp_path) as (emulator, tendons):
        tendons.reference()
        emulator.clock.sleep(0.1)
        if end == 'cable':
            emulator.drop = 60
            assert 'stopped replying' in failed(tendons)
        tendons.close()
        emulator.repair()
        monkeypatch.undo()
        for power in ('stays', 'is lost'):
            tendons.open()
            assert tendons.read().pulls == pytest.approx((0.0, 0.0), abs=CLOSE)
            assert tendons.read().referenced
            tendons.close()
            if power == 'stays':
                emulator.power_cycle()
                emulator.clock.sleep(1.0)


def test_a_zero_that_cannot_be_kept_after_the_last_cycle_is_logged(monkeypatch, tmp_path, caplog):
    with slow_disk(monkeypatch, tmp_path) as (emulator, tendons):
        (tmp_path / 'zeros.json').unlink()
        (tmp_path / 'zeros.json').mkdir()
        tendons.reference()
        emulator.clock.sleep(0.1)
        tendons.close()
        assert 'the zero cannot be saved' in caplog.text
        caplog.clear()
        tendons.close()
        assert not caplog.text


# Slack


@pytest.mark.parametrize('case', ['slack', 'not hooked in', 'stopped'])
def test_reference_takes_up_the_slack_of_every_tendon_that_has_an_end(tmp_path, case):
    with servos(2) as emulator:
        for servo, slack in zip(emulator.servos, (0.0046, 0.0012), strict=True):
            servo.motor.tendon.weight, servo.motor.tendon.stiffness = 0.0, 16e3
            servo.motor.tendon.slack = slack if case == 'slack' else 1.0
        tendons = driver_of(emulator, tmp_path, take_up_tension=5.0)
        tendons.open()
        assert tendons.reference_moves
        tendons.reference()
        assert tendons.read().moving
        if case == 'stopped':
            emulator.clock.sleep(1.0)
            tendons.stop()
        reading = at_rest(tendons)
        assert reading.referenced == (case == 'slack')
        if case == 'slack':
            assert reading.pulls == pytest.approx((0.0, 0.0), abs=CLOSE)
            # 5 N are 0.3 mm beyond the end of the slack
            assert emulator.pulls == pytest.approx((0.0049, 0.0015), abs=2e-4)
            emulator.clock.sleep(0.5)
            assert values(emulator, 'Goal Current') == [125, 125]  # that of 60 N again
            assert tendons.read().tensions == pytest.approx((5.0, 5.0), abs=1.5)
        elif case == 'stopped':
            assert 'the slack was not taken up' in reading.unreferenced
            assert 7e-4 < emulator.pulls[0] < 3e-3
        else:
            assert 'servo 1 (first) pulled its tendon in by 20' in reading.unreferenced
            assert 'dynamixel.take_up_tension' in reading.unreferenced
            assert emulator.pulls[1] == pytest.approx(0.0, abs=2 * PULSE_PULL)
        tendons.close()


# Faults


@pytest.mark.parametrize('fault', ['deaf', 'drop', 'garble', 'garble_in'])
def test_what_is_lost_or_damaged_now_and_then_is_repeated_and_the_motion_goes_on(tmp_path, fault):
    with two(tmp_path) as made:
        made.driver.move((0.01, -0.01), 0.5)
        for _ in range(8):
            made.wait(0.05)
            setattr(made.emulator, fault, 1)
            made.wait(0.004)
            setattr(made.emulator, fault, 0)
        assert at_rest(made.driver).pulls == pytest.approx((0.01, -0.01), abs=CLOSE)
        assert made.check()


def ignore_writes(servo):
    servo.write = lambda *_: Error.NONE


@pytest.mark.parametrize(('fault', 'words'), [
    (ignore_writes, 'servo 2 (second) does not keep the values written to it'),
    (lambda servo: setattr(servo, 'hang', True), 'servo 2 (second): stopped replying'),
    (lambda servo: (servo.power_off(), servo.power_on()), 'was reset or lost power'),
    (lambda servo: setattr(servo.motor, 'caught', True), 'check what blocks the tendon')])
def test_what_ends_a_motion_is_named(monkeypatch, tmp_path, fault, words):
    monkeypatch.setattr(dynamixel_servo, 'BOOT_TIME', 0.0)
    with two(tmp_path) as made:
        in_motion(made)
        made.emulator.read(lambda: fault(made.emulator.servos[1]))
        made.driver.move((-0.04, 0.04), 2.0)
        assert words in failed(made.driver)
        made.rest()


@pytest.mark.parametrize('moving', [False, True])
def test_a_torque_that_another_program_switched_off_is_noticed_within_a_second(tmp_path, moving):
    with two(tmp_path) as made:
        if moving:
            in_motion(made)
        servo, clock = made.emulator.servos[1], made.emulator.clock
        made.emulator.read(lambda: servo.write(64, b'\0'))
        begin = clock()
        assert 'switched off the torque of servo 2 (second)' in failed(made.driver)
        assert clock() - begin < 1.0
        made.driver.close()
        assert not servo.torque  # and nobody but open switches it on
        made.driver.open()
        assert servo.torque and made.driver.read().referenced


@pytest.mark.parametrize(('status', 'words'), [
    (0x20, 'overload (find what blocks the tendon'), (0x04, 'overheating'),
    (0x01, 'input voltage'), (0x10, 'electrical shock'), (0x08, 'motor encoder')])
def test_a_hardware_error_is_explained_and_nothing_is_rebooted(tmp_path, status, words):
    with two(tmp_path) as made:
        in_motion(made)
        servo = made.emulator.servos[1]
        servo.broken = status
        message = failed(made.driver)
        assert words in message
        assert 'servo 2 (second)' in message
        made.driver.close()
        made.emulator.read(lambda: servo.set_up('Torque Enable', 0))
        assert 'has no tension' in refusal(made.driver)
        assert all(p.instruction != Instruction.REBOOT for p in made.emulator.packets)


def test_a_stop_of_a_spool_that_runs_away_is_not_confirmed(tmp_path):
    with two(tmp_path) as made:
        in_motion(made)
        made.driver.stop()
        for servo in made.emulator.servos:
            servo.motor.tendon.weight = -70.0
        assert 'not confirmed a stop' in failed(made.driver)
        made.emulator.repair()


def test_torque_is_never_switched_off_and_no_eeprom_is_written(tmp_path):
    with two(tmp_path) as made:
        in_motion(made)
        made.driver.close()
        assert values(made.emulator, 'Torque Enable') == [1, 1]
        written = list(writes(made.emulator))
        assert all(address >= 64 for address, _ in written)
        assert all(data[0] == 1 for address, data in written if address == 64)
        assert sum(address == 116 for address, _ in written) > 10  # goals
