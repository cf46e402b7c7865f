# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tendons on Dynamixel servos go where they are sent, stop, hold, and know where they are."""

import pytest

from soft_continuum.hardware.dynamixel.state import Track
from soft_continuum.hardware.protocols import HardwareError
from support.driver_waits import at_rest, failed, until
from support.dynamixel_rig import driver, in_motion, KEPT, PULSE, refusal, rig, servos, standing
from support.dynamixel_slave import Slave

TORQUE, WATCHDOG, GOAL_CURRENT, GOAL = 64, 98, 102, 116
REBOOT, WRITE, SYNC_WRITE = 8, 3, 0x83


def writes(bus, address):
    """How often a register was written, alone or together."""
    return sum(instruction in (WRITE, SYNC_WRITE) and data[:2] == address.to_bytes(2, 'little')
               for _, instruction, data in bus.instructions)


def loaded(slave, counts=20.0):
    """Hang a load on a tendon that needs so many counts of current (about 9.6 N)."""
    slave.load = lambda turned: counts


def test_opening_moves_nothing_and_lets_the_servos_hold(tmp_path):
    with servos() as bus:
        before = [slave.turned for slave in bus.slaves]
        tendons = driver(bus, tmp_path)
        tendons.open()
        assert not tendons.read().referenced
        bus.clock.sleep(0.5)
        assert [slave.turned for slave in bus.slaves] == pytest.approx(before, abs=1)
        assert all(slave.get(TORQUE) == 1 for slave in bus.slaves)
        # 20 N on 10 mm are 0.2 N m, 112 mA of an XM430-W350 (4.1 N m at 2.3 A), 41.7 x 2.69 mA
        assert [slave.get(GOAL_CURRENT) for slave in bus.slaves] == [42, 42]
        assert all(0 < slave.get(WATCHDOG) <= 10 for slave in bus.slaves)  # 0.2 s
        with pytest.raises(HardwareError, match='the position is not known.*no zero of it'):
            tendons.move((0.0, 0.0), 0.1)
        tendons.close()


def test_tendons_arrive_together_within_two_pulses(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        start = [slave.turned for slave in bus.slaves]
        tendons.move((0.012, -0.006), 0.6)
        bus.clock.sleep(0.3)
        first, second = tendons.read().pulls
        assert 0.003 < first < 0.009
        assert second == pytest.approx(-first / 2, abs=5e-4)
        assert at_rest(tendons).pulls == pytest.approx((0.012, -0.006), abs=1e-4)
        turned = [slave.turned - a for slave, a in zip(bus.slaves, start, strict=True)]
        assert turned == pytest.approx([0.012 / PULSE, -0.006 / PULSE], abs=8)


def test_signs_radii_and_a_loaded_tendon(tmp_path):
    with rig(tmp_path, radii=(0.01, 0.02), signs=(-1.0, 1.0)) as (bus, tendons):
        start = [slave.turned for slave in bus.slaves]
        loaded(bus.slaves[0], -20.0)  # pulls the spool that pulls in by turning backwards
        bus.clock.sleep(1.0)
        reading = at_rest(tendons)
        # 20 counts of 2.69 mA and 1.783 N m/A are 95.9 mN m
        assert reading.tensions == pytest.approx((9.59, 0.0), abs=0.3)
        assert reading.pulls == pytest.approx((0.0, 0.0), abs=1e-4)  # held where it was
        tendons.move((0.01, 0.01), 0.6)
        assert at_rest(tendons).pulls == pytest.approx((0.01, 0.01), abs=1e-4)
        turned = [slave.turned - a for slave, a in zip(bus.slaves, start, strict=True)]
        assert turned == pytest.approx([-0.01 / PULSE, 0.005 / PULSE], abs=8)


def test_a_stop_in_motion_ends_it_within_150_ms_and_holds(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        loaded(bus.slaves[0])
        bus.clock.sleep(0.5)
        in_motion(bus, tendons)
        at = tendons.read().pulls[0]
        begin = bus.clock()
        tendons.stop()
        until(bus, lambda: standing(bus), 'standing')
        assert bus.clock() - begin < 0.15
        rest = at_rest(tendons)
        assert rest.pulls[0] == pytest.approx(at, abs=1.5e-3)
        assert rest.tensions[0] == pytest.approx(9.6, abs=0.5)
        bus.clock.sleep(1.0)
        assert tendons.read().pulls == pytest.approx(rest.pulls, abs=1e-4)


def test_a_speed_that_cannot_be_makes_no_stop_longer(monkeypatch, tmp_path):
    seen = Track.velocities
    with rig(tmp_path) as (bus, tendons):
        in_motion(bus, tendons)  # the reply before last was dated late
        monkeypatch.setattr(Track, 'velocities', lambda track: [10.0 * v for v in seen(track)])
        at = tendons.read().pulls[0]
        tendons.stop()
        assert at_rest(tendons).pulls[0] == pytest.approx(at, abs=2.5e-3)


def test_stops_at_rest_do_not_let_a_loaded_tendon_go(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        loaded(bus.slaves[0])
        bus.clock.sleep(1.0)
        at = bus.slaves[0].turned
        for _ in range(20):
            tendons.stop()
            bus.clock.sleep(0.06)
        assert bus.slaves[0].turned == pytest.approx(at, abs=2)


def test_a_motion_goes_on_where_the_last_one_was_stopped(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        in_motion(bus, tendons)
        tendons.stop()
        tendons.move((0.001, -0.001), 1.0)  # asked for during the stop
        assert at_rest(tendons).pulls == pytest.approx((0.001, -0.001), abs=1e-4)


def test_no_calls_no_motion(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        tendons.move((0.0006, 0.0), 0.02)  # as a control loop does, which then hangs
        bus.clock.sleep(1.0)
        assert tendons.read().pulls[0] == pytest.approx(0.0006, abs=1e-4)
        assert standing(bus)


def test_the_requests_of_the_control_loop_never_wait(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        bus.dead = True
        begin = bus.clock()
        tendons.move((0.001, 0.0), 0.1)
        tendons.read()
        tendons.stop()
        assert bus.clock() == begin
        assert 'no answer any more' in failed(tendons)


# What is known of the position


def test_closing_holds_and_a_restarted_node_knows_the_position(tmp_path):
    with servos() as bus:
        tendons = driver(bus, tmp_path, pull_limits=(-0.2, 0.2))
        tendons.open()
        tendons.reference()
        bus.clock.sleep(0.2)
        tendons.move((0.07, -0.02), 1.0)  # more than a turn
        before = at_rest(tendons).pulls
        loaded(bus.slaves[0])
        bus.clock.sleep(1.0)
        tendons.close()
        (tmp_path / KEPT).unlink()  # it may be another computer
        at = [slave.turned for slave in bus.slaves]
        bus.clock.sleep(2.0)
        assert all(slave.get(TORQUE) and not slave.get(WATCHDOG) for slave in bus.slaves)
        tendons = driver(bus, tmp_path, pull_limits=(-0.2, 0.2))
        tendons.open()
        assert tendons.read().referenced
        assert tendons.read().pulls == pytest.approx(before, abs=1e-4)
        bus.clock.sleep(0.5)
        assert [slave.turned for slave in bus.slaves] == pytest.approx(at, abs=2)
        tendons.close()


def test_a_node_killed_in_motion_leaves_servos_that_stop_and_know_where_they_are(tmp_path):
    with servos() as bus:
        tendons = driver(bus, tmp_path)
        tendons.open()
        tendons.reference()
        bus.clock.sleep(0.2)
        in_motion(bus, tendons)
        tendons._session.fail('as if the process had been killed')
        tendons._session.bus.abort()
        bus.clock.sleep(0.5)
        assert standing(bus)
        assert all(slave.get(WATCHDOG) == 255 for slave in bus.slaves)
        at = [slave.turned for slave in bus.slaves]
        tendons.close()
        again = driver(bus, tmp_path)
        again.open()
        bus.clock.sleep(0.5)
        assert [slave.turned for slave in bus.slaves] == pytest.approx(at, abs=2)
        assert again.read().referenced
        assert again.read().pulls[0] == pytest.approx((at[0] - 1000) * PULSE, abs=1e-4)
        again.close()


@pytest.mark.parametrize('offset', [0, 1500])
def test_after_a_power_cycle_the_position_is_known_within_one_turn(tmp_path, offset):
    limits = (-0.02, 0.02)  # 40 mm of the 62.8 mm of a turn
    slaves = Slave(1, _20=offset), Slave(2, _20=offset)
    with rig(tmp_path, *slaves, pull_limits=limits) as (bus, tendons):
        tendons.move((0.018, -0.018), 1.0)
        before = at_rest(tendons).pulls
        tendons.close()
        for slave in bus.slaves:
            bus.now(slave.powered)
        again = driver(bus, tmp_path, pull_limits=limits)
        again.open()
        assert again.read().referenced
        assert again.read().pulls == pytest.approx(before, abs=1e-4)
        again.move((0.0, 0.0), 1.0)
        at_rest(again)
        assert [slave.turned for slave in bus.slaves] == pytest.approx([1000, 1000], abs=8)
        again.close()


def test_after_a_power_cycle_a_turn_that_cannot_be_told_is_not_guessed(tmp_path):
    with rig(tmp_path) as (bus, tendons):  # 120 mm within pull_limits, two turns
        tendons.move((0.03, 0.0), 1.0)
        at_rest(tendons)
        tendons.close()
        bus.now(bus.slaves[0].powered)  # only one of them
        again = driver(bus, tmp_path)
        again.open()
        reading = again.read()
        assert not reading.referenced
        assert 'servo 1 (right_tendon) was without power' in reading.unreferenced
        assert 'may be at' in reading.unreferenced
        assert '30.0 mm' in reading.unreferenced
        assert '-32.8 mm' in reading.unreferenced
        assert 'servo 2' not in reading.unreferenced
        again.reference()
        bus.clock.sleep(0.2)
        assert again.read().referenced
        again.close()


def test_without_a_kept_zero_a_power_cycle_loses_it(tmp_path):
    with rig(tmp_path, pull_limits=(-0.02, 0.02)) as (bus, tendons):
        tendons.close()
        (tmp_path / KEPT).write_text('{"no": 1, "json')
        for slave in bus.slaves:
            bus.now(slave.powered)
        again = driver(bus, tmp_path, pull_limits=(-0.02, 0.02))
        again.open()
        assert 'no zero of it is kept' in again.read().unreferenced
        again.close()


def test_a_change_of_the_operating_mode_loses_the_turns(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        tendons.close()
        bus.now(lambda: bus.slaves[0].set(112, 0))  # as the firmware does then
        again = driver(bus, tmp_path)
        again.open()
        assert not again.read().referenced
        again.close()


def test_a_zero_that_cannot_be_kept_is_an_error(tmp_path):
    with rig(tmp_path / 'file', referenced=False) as (_, tendons):
        (tmp_path / 'file').write_text('a file where the folder should be')
        tendons.reference()
        assert 'the zero cannot be kept' in failed(tendons)


# Slack


def taut_at(pulses, by_pulse=0.5):
    """A tendon that is slack up to a place and then needs current in proportion."""
    return lambda turned: max(0.0, by_pulse * (turned - 1000 - pulses))


def test_reference_takes_up_the_slack_of_every_tendon(tmp_path):
    with rig(tmp_path, referenced=False, take_up_tension=5.0) as (bus, tendons):
        assert tendons.reference_moves
        bus.slaves[0].load, bus.slaves[1].load = taut_at(300), taut_at(80)
        tendons.reference()
        assert tendons.read().moving
        reading = at_rest(tendons)
        assert reading.referenced
        assert reading.pulls == pytest.approx((0.0, 0.0), abs=1e-4)
        # 5 N are 10.4 counts: about 21 pulses beyond the end of the slack
        assert [s.turned - 1000 for s in bus.slaves] == pytest.approx([320, 100], abs=12)
        bus.clock.sleep(0.5)
        assert [slave.get(GOAL_CURRENT) for slave in bus.slaves] == [42, 42]
        assert tendons.read().tensions == pytest.approx((5.0, 5.0), abs=1.5)


def test_a_tendon_that_is_not_hooked_in_is_not_found_taut(tmp_path):
    with rig(tmp_path, referenced=False, take_up_tension=5.0) as (bus, tendons):
        tendons.reference()
        reading = at_rest(tendons)
        assert not reading.referenced
        assert 'servo 1 (right_tendon) pulled its tendon in by 20' in reading.unreferenced
        assert 'dynamixel.take_up_tension' in reading.unreferenced
        assert bus.slaves[1].turned == pytest.approx(1000, abs=2)


def test_taking_up_slack_can_be_stopped(tmp_path):
    with rig(tmp_path, referenced=False, take_up_tension=5.0) as (bus, tendons):
        tendons.reference()
        bus.clock.sleep(1.0)
        tendons.stop()
        reading = at_rest(tendons)
        assert not reading.referenced
        assert 'the slack was not taken up' in reading.unreferenced
        assert 50 < bus.slaves[0].turned - 1000 < 200


# Faults


def test_a_lost_write_is_noticed_and_repeated(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        tendons.move((0.01, -0.01), 0.5)
        for _ in range(10):
            bus.clock.sleep(0.03)
            bus.now(lambda: setattr(bus, 'deaf_to_writes', 2))
        assert at_rest(tendons).pulls == pytest.approx((0.01, -0.01), abs=1e-4)


def test_lost_and_damaged_replies_do_not_end_a_motion_but_silence_does(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        tendons.move((0.01, -0.01), 0.5)
        for fault in ('lose', 'garble') * 3:
            bus.clock.sleep(0.05)
            bus.now(lambda fault=fault: setattr(bus, fault, 1))
        assert at_rest(tendons).pulls == pytest.approx((0.01, -0.01), abs=1e-4)
        in_motion(bus, tendons)
        bus.now(lambda: setattr(bus, 'slaves', bus.slaves[:1]))
        assert 'servo 2 (left_tendon): no answer any more' in failed(tendons)
        bus.clock.sleep(0.1)
        assert standing(bus)


def test_a_servo_that_ignores_writes_is_an_error(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        bus.slaves[1].ignores_writes = True
        tendons.move((0.01, -0.01), 0.5)
        assert 'servo 2 (left_tendon) does not keep what was written to it' in failed(tendons)


def test_a_servo_that_loses_power_in_motion_is_noticed(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        in_motion(bus, tendons)
        bus.now(bus.slaves[0].powered)
        assert 'was reset or without power' in failed(tendons)


@pytest.mark.parametrize('moving', [False, True])
def test_a_torque_that_another_program_switched_off_is_noticed_within_a_second(tmp_path, moving):
    with rig(tmp_path) as (bus, tendons):
        if moving:
            in_motion(bus, tendons)
        bus.now(lambda: bus.slaves[1].set(TORQUE, 0))
        begin = bus.clock()
        assert 'switched off the torque of servo 2 (left_tendon)' in failed(tendons)
        assert bus.clock() - begin < 1.0
        tendons.close()
        assert bus.slaves[1].get(TORQUE) == 0  # and nobody but open switches it on
        tendons.open()
        assert bus.slaves[1].get(TORQUE) == 1
        assert tendons.read().referenced


@pytest.mark.parametrize(('status', 'words'), [
    (0x20, 'overload (see what caught the tendon'), (0x04, 'overheating'), (0x01, 'input voltage'),
    (0x10, 'electrical shock'), (0x08, 'motor encoder')])
def test_a_hardware_error_is_explained_and_nothing_is_rebooted(tmp_path, status, words):
    with rig(tmp_path) as (bus, tendons):
        in_motion(bus, tendons)
        bus.now(lambda: bus.slaves[1].shut_down(status))
        message = failed(tendons)
        assert words in message
        assert 'servo 2 (left_tendon)' in message
        tendons.close()
        assert 'has no tension' in refusal(driver(bus, tmp_path))
        assert all(instruction != REBOOT for _, instruction, _ in bus.instructions)


def test_a_caught_tendon_is_not_pulled_for_long(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        bus.slaves[0].caught = True
        tendons.move((0.03, 0.0), 1.5)
        message = failed(tendons)
        assert 'servo 1 (right_tendon) is at 0.0' in message
        assert 'see what holds the tendon' in message


def test_a_stop_without_replies_is_not_confirmed(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        in_motion(bus, tendons)
        tendons.stop()
        bus.now(lambda: setattr(bus.slaves[0], 'step', lambda now: setattr(
            bus.slaves[0], 'turned', bus.slaves[0].turned + 2.0)))  # it runs away
        assert 'not confirmed a stop' in failed(tendons)


def test_torque_is_never_switched_off_and_no_eeprom_is_written(tmp_path):
    with rig(tmp_path) as (bus, tendons):
        in_motion(bus, tendons)
        tendons.close()
        assert all(slave.get(TORQUE) == 1 for slave in bus.slaves)
        for _, instruction, data in bus.instructions:
            if instruction in (WRITE, SYNC_WRITE):
                address = int.from_bytes(data[:2], 'little')
                assert address >= 64
                assert address != TORQUE or data[2] == 1
        assert writes(bus, GOAL) > 10
