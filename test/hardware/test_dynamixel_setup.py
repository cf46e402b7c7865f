# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Servos that are missing, doubled or set up wrongly are refused with words; nothing moves."""

from dataclasses import replace
from itertools import count
import random
from types import SimpleNamespace

import pytest

from soft_continuum.commissioning.calibrate import main as calibrate
from soft_continuum.commissioning.calibrate_servos import main as calibrate_servos
from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.commissioning import FAIL, OK, WARN
from soft_continuum.hardware.drivers import families, TENDON_DRIVERS
from soft_continuum.hardware.dynamixel import setup
from soft_continuum.hardware.dynamixel.bus import DamagedReplyError, DynamixelBus, NoReplyError
from soft_continuum.hardware.dynamixel.commissioning import checks, clear_zero
from soft_continuum.hardware.dynamixel.reference import mark, marked_zero, zero_within_turn
from soft_continuum.hardware.dynamixel.setup import ServoState, Written
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.description import load_rig
from soft_continuum.sim.emulators.dynamixel_packets import crc, Instruction, packet, STATUS
from support.driver_waits import at_rest
from support.servo_rig import driver_of, PULSE_PULL, refusal, rig, servos, spools


def each(**changes):
    """Change items of the control table of the first servo, or of both: ID=3, Baud_Rate=(1, 1)."""
    def change(servos):
        for name, given in changes.items():
            for servo, value in zip(servos, given if isinstance(given, tuple) else (given,),
                                    strict=False):
                servo.values[name.replace('_', ' ')] = value
    return change


def model(number):
    """Let the first servo say that it is another model."""
    return lambda servos: setattr(servos[0], 'model', replace(servos[0].model, number=number))


@pytest.mark.parametrize(('change', 'words'), [
    (lambda servos: servos[1].power_off(), 'servo 2 (second) does not answer at 1000000 baud, but '
     'servo 1 does'),
    (each(ID=(3, 4)), 'servo 1 (first) does not answer at 1000000 baud, but servos 3, 4 do'),
    (each(Baud_Rate=(1, 1)), 'at 57600 baud: set dynamixel.baud to 57600'),
    (each(Protocol_Type=(1, 1)), 'answers in Protocol 1.0'),
    (model(9), 'has the model number 9, which this driver does not support'),
    (model(1060), 'servo 1 (first) is an XL430-W250, which can neither measure nor limit its '
     'current'),
    (each(Operating_Mode=3), 'Operating Mode (11) is 3, needed: 5'),
    (each(Drive_Mode=1), 'Drive Mode (10) is 1, needed: 0, not reversed'),
    (each(Drive_Mode=4), 'profile by velocity'),
    (each(Secondary_ID=7), 'Secondary ID (12) is 7'),
    (each(Current_Limit=30), 'Current Limit (38) is 30, needed: 125, at least'),
    (each(Velocity_Limit=20), 'Velocity Limit (44) is 20'),
    (each(PWM_Limit=100), 'PWM Limit (36) is 100'),
    (each(Startup_Configuration=2), 'Startup Configuration (60) is 2, needed: 0'),
    (each(Shutdown=32), 'Shutdown (63) is 32'),
])
def test_what_makes_the_driver_wrong_is_refused(tmp_path, change, words):
    with servos(2) as emulator:
        change(emulator.servos)
        assert words in refusal(driver_of(emulator, tmp_path))
        assert not any(servo.torque for servo in emulator.servos) and not emulator.moving


def test_servos_without_fast_sync_read_do(tmp_path):
    with servos(2) as emulator:
        read_many = emulator._read_many
        emulator._read_many = lambda packet, *rest: (
            packet.instruction == Instruction.FAST_SYNC_READ or read_many(packet, *rest))
        line = DynamixelBus(emulator.port, 1000000, emulator.clock)
        line.fast = True
        with pytest.raises(NoReplyError, match='no reply from the servos on'):  # not of servo 254
            line.sync_read((1, 2), 132, 136)
        line.close()
        tendons = driver_of(emulator, tmp_path)
        tendons.open()
        tendons.reference()
        emulator.clock.sleep(0.2)
        tendons.move((0.002, -0.002), 0.2)
        assert at_rest(tendons).pulls == pytest.approx((0.002, -0.002), abs=1e-4)
        tendons.close()


@pytest.mark.parametrize(('change', 'words'), [
    ({'radii': (10.0, 10.0)}, 'spool_radii has 10 m; allowed: 0.001 to 0.1 m; 10 mm are 0.01 m'),
    ({'radii': (1e-5, 0.01)}, 'spool_radii has 1e-05 m'),
    ({'ids': (1, 1)}, 'every servo needs an ID of its own'),
    ({'ids': (1, 2, 3)}, 'has 3 values; the tendons are first, second'),
    ({'signs': (1.0, 0.5)}, 'allowed: 1 or -1'),
    ({'take_up_tension': 60.0}, 'must be less than each of dynamixel.tension_limits'),
])
def test_parameters_that_cannot_be_right(change, words):
    with pytest.raises(ParameterError) as error:
        spools(2, **change)
    assert words in str(error.value)


def test_a_tension_or_speed_that_a_servo_has_not(tmp_path):
    with servos(2) as emulator:
        # an XM430-W350 stalls at 4.1 N m and turns at 46 rev/min
        for change, words in (({'tension_limits': (500.0, 20.0)}, 'stalls at 410 N'),
                              ({'speed_limit': 0.1}, '46 rev/min at most, 0.0482 m/s')):
            assert words in refusal(driver_of(emulator, tmp_path, **change))


# The zero


def test_a_mark_is_read_back_and_nothing_else_is_a_mark():
    zeros = [0, 1, -1, 2048, -131073, 1_048_575, -1_048_575]
    assert [marked_zero(7, mark(7, zero)) for zero in zeros] == zeros
    assert marked_zero(7, 0) is None
    assert marked_zero(8, mark(7, 2048)) is None
    rng = random.Random(1)
    taken = sum(marked_zero(7, rng.getrandbits(32)) is not None for _ in range(10_000))
    assert taken < 30  # one in 1,000 of what another program leaves there by chance


@pytest.mark.parametrize(('position', 'limits', 'known'), [
    (300, (-0.02, 0.02), True), (300 + 4096, (-0.02, 0.02), True),
    (2000, (-0.02, 0.02), False),  # 30 mm
    (300, (-0.06, 0.06), False)])  # -58 mm is possible too
def test_a_turn_is_known_where_only_one_is_possible(position, limits, known):
    scale = PULSE_PULL
    zero = zero_within_turn('servo', position, 5, scale, limits)
    assert bool(zero.unknown) is not known
    if known:
        assert (position - zero.position) % 4096 == 295
        assert limits[0] <= scale * (position - zero.position) <= limits[1]


# Packets


def test_a_reply_that_a_busy_computer_sees_late_is_believed():
    written = Written(watchdog=10, current=42, velocity=100, goal=0)

    def state(asked, time, position, tick):
        return ServoState(asked, time, written, position, 0, tick, False)

    late = state(5.000, 5.180, 400, 1001)  # answered at once, seen 0.18 s later
    fastest = 1500.0  # pulses/s
    assert state(5.185, 5.187, 670, 1186).follows(late, fastest)
    assert not state(5.185, 5.187, 670, 1001).follows(late, fastest)  # the same reply again
    assert not state(5.185, 5.187, 1000, 1186).follows(late, fastest)  # never so fast
    assert not state(5.185, 5.187, 670, 1400).follows(late, fastest)  # another servo's clock


def test_no_damaged_packet_is_taken_for_a_reply(tmp_path):
    """Also such as have a right CRC: another ID, length, goal or clock than was asked for."""
    rng = random.Random(5)

    def damaged(reply):
        kind = rng.randrange(6)
        data = bytearray(reply)
        if kind == 0:
            for _ in range(rng.randint(1, 4)):
                data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        elif kind == 1:
            del data[rng.randrange(len(data))]
        elif kind == 2:
            data[8:-2] = rng.randbytes(len(data) - 10)
            data[-2:] = crc(bytes(data[:-2])).to_bytes(2, 'little')
        elif kind == 3:
            return packet(data[4], STATUS, rng.randbytes(rng.randrange(1, 200)))
        elif kind == 4:
            return rng.randbytes(len(data))
        else:
            return packet(rng.randrange(254), STATUS, bytes(data[8:-2]))
        return bytes(data) if bytes(data) != reply else b''

    with rig(tmp_path, tendons=2) as made:
        made.driver.move((0.005, -0.005), 0.5)
        replies = count()
        made.emulator.transform = lambda reply: damaged(reply) if next(replies) % 2 else reply
        for _ in range(150):
            made.wait(0.02)
            assert made.check()
        assert next(replies) > 100
        made.emulator.transform = None
        assert at_rest(made.driver).pulls == pytest.approx((0.005, -0.005), abs=1e-4)


# Commands


@pytest.fixture
def real(tmp_path, monkeypatch):
    """Servos in real time, the file of a rig for them, and its parameters."""
    monkeypatch.setenv('XDG_STATE_HOME', str(tmp_path))
    with servos(2, clock=STEADY) as emulator:
        each(Operating_Mode=(5, 3), Return_Delay_Time=(0, 250))(emulator.servos)
        file = tmp_path / 'rig.yaml'
        file.write_text(f"""/**:
  ros__parameters:
    tendon_driver: dynamixel
    dynamixel: {{port: {emulator.port}, spool_radii: [0.01, 0.01]}}
""", encoding='utf-8')
        yield emulator, file


def test_doctor_names_what_is_wrong_and_calibrate_servos_sets_it(real, capsys):
    emulator, file = real
    second = emulator.servos[1]
    values = load_rig([file])
    found = {check.step: check for check in checks(values)}
    assert found['tendon port'].status == OK
    assert found['servo 1 (right_tendon)'].status == OK
    assert 'XM430-W350, firmware 48, 12.0 V, 30 °C' in found['servo 1 (right_tendon)'].message
    assert found['servo 2 (left_tendon)'].status == FAIL
    assert 'calibrate servos sets this' in found['servo 2 (left_tendon)'].message
    assert not {Instruction.WRITE, Instruction.SYNC_WRITE} & {
        packet.instruction for packet in emulator.packets}
    second.fail(0x20)
    assert calibrate_servos(['--params-file', str(file), '--yes']) == 0
    shown = capsys.readouterr().out
    assert 'Operating Mode (11) is 3, needed: 5' in shown
    assert 'overload' in shown
    assert 'the tendon must be slack' in shown
    assert 'nothing to change' in shown  # of servo 1
    assert second.values['Operating Mode'] == 5
    assert not second.values['Hardware Error Status']
    found = {check.step: check for check in checks(values)}
    assert found['servo 2 (left_tendon)'].status == WARN
    assert 'Return Delay Time (9) is 250' in found['servo 2 (left_tendon)'].message
    assert found['tendon reference'].status == WARN


def test_calibrate_servos_asks_first(real, monkeypatch, capsys):
    emulator, file = real
    monkeypatch.setattr('builtins.input', lambda _: 'no')
    assert calibrate_servos(['--params-file', str(file)]) == 1
    assert 'nothing more was done' in capsys.readouterr().err
    assert emulator.servos[1].values['Operating Mode'] == 3


def test_calibrate_finds_signs_and_radii(real, tmp_path):
    _, file = real
    given = ['--params-file', str(file), '--output', str(tmp_path), '--yes']
    assert calibrate(['signs', *given, '--seen', 'pulled-in', 'paid-out']) == 0
    found = load_rig([file, tmp_path / 'calibration_signs.yaml'])
    assert found['dynamixel.signs'] == (1.0, -1.0)
    # 5 mm were commanded; where a mark moved by 5.5 mm the spool is 10 % larger than was thought.
    assert calibrate(['steps', *given, '--measured', '5.5', '5']) == 0
    found = load_rig([file, tmp_path / 'calibration_steps.yaml'])
    assert found['dynamixel.spool_radii'] == pytest.approx((0.011, 0.01))


def test_a_provisional_zero_is_forgotten(real, tmp_path):
    emulator, file = real
    each(Operating_Mode=(5, 5))(emulator.servos)
    values = load_rig([file])
    tendons = families(TENDON_DRIVERS)['dynamixel'].make(values, STEADY)
    tendons.open()
    tendons.reference()
    tendons.close()
    assert {check.step: check for check in checks(values)}['tendon reference'].status == OK
    clear_zero(values)
    check = {check.step: check for check in checks(values)}['tendon reference']
    assert check.status == WARN
    assert 'no zero of it is stored' in check.message


@pytest.mark.parametrize(('answers', 'problem'), [
    ([1020, 1020, 1020], ''), ([NoReplyError, DamagedReplyError, 1020], ''),
    ([NoReplyError, 1020, 1020], ''), ([DamagedReplyError, 1020, 1020], 'two servos'),
    ([NoReplyError, DamagedReplyError, DamagedReplyError], 'two servos')])
def test_a_reply_that_comes_with_the_next_one_is_not_that_of_a_second_servo(answers, problem):
    def ping(number):
        answer = answers.pop(0)
        if isinstance(answer, int):
            return answer
        raise answer('nothing')

    bus = SimpleNamespace(ping=ping, clock=SimpleNamespace(sleep=lambda _: None))
    if problem:
        with pytest.raises(HardwareError, match=problem):
            setup._ping(bus, 1, 'servo 1', (1,))
    else:
        assert setup._ping(bus, 1, 'servo 1', (1,)) == 1020
