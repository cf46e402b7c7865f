# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A jamming rig on a Modbus line says what is so or that it does not know, whatever fails."""

from contextlib import suppress
import fcntl
from itertools import pairwise
from math import isnan
import os
import random
import re
import sys
import termios

import pytest

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.jamming_controller import (
    JammingController,
    JammingSettings,
    RESPONSE_TIME,
)
from soft_continuum.hardware.modbus.bus import ModbusBus
from soft_continuum.hardware.modbus.jamming import (
    COILS_INTERVAL,
    ModbusJamming,
    ModbusRegulators,
    Outputs,
)
from soft_continuum.hardware.protocols import HardwareError, RegulatorDriver
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.sim.emulators.modbus import crc, execute_command
from support.modbus_line import (
    AMBIENT,
    connected,
    driver_of,
    emulated,
    eventually,
    parameters,
    TIMEOUT,
)

READ_COILS, READ_REGISTERS, WRITE_COIL = 1, 4, 5


@pytest.fixture
def emulator(tmp_path):
    with emulated(link=tmp_path / 'rig') as rig:
        yield rig


@pytest.fixture
def driver(emulator):
    with connected(emulator) as jamming:
        yield jamming


def functions(emulator):
    """The function codes of all requests so far."""
    return [request[1] for request in emulator.requests]


def send_unasked(emulator, data):
    """Put bytes on the line and wait until they are at the other end."""
    emulator.send(data)
    port = os.open(emulator.port, os.O_RDWR | os.O_NOCTTY)
    eventually(emulator, lambda: fcntl.ioctl(port, termios.FIONREAD, b'\0' * 4),
               lambda waiting: int.from_bytes(waiting, sys.byteorder) == len(data))
    os.close(port)


def fail(call, *arguments):
    """The words of the error that a call must raise."""
    with pytest.raises(HardwareError) as error:
        call(*arguments)
    return str(error.value)


# A rig without faults.


@pytest.mark.parametrize('stiff', [True, False])
def test_opening_reads_the_rig_and_switches_nothing(stiff):
    with emulated(initially_stiff=stiff) as emulator:
        with connected(emulator) as driver:
            reading = eventually(emulator, driver.read)
        assert reading.evacuated == (stiff,) * 3 and reading.pump == stiff
        assert WRITE_COIL not in functions(emulator)
        assert emulator.coils == (stiff,) * 4


def test_closing_and_opening_again_leaves_pump_and_valves_as_they_are(emulator, driver):
    driver.set_pump(True)
    driver.set_evacuated(1, True)
    driver.close()
    assert 'not open' in fail(driver.read)
    assert emulator.coils == (True, False, True, False)
    with connected(emulator) as again:  # the port was free
        reading = eventually(emulator, again.read)
    assert reading.pump and reading.evacuated == (False, True, False)
    assert emulator.coils == (True, False, True, False)


@pytest.mark.parametrize('segments', [1, 3])
def test_each_valve_is_switched_alone_and_read_back_at_once_and_twice_is_no_toggle(segments):
    with emulated(segments) as emulator, connected(emulator) as driver:
        for segment in range(segments):
            expected = tuple(i == segment for i in range(segments))
            for _ in range(2):
                driver.set_evacuated(segment, True)
                driver.set_pump(True)
                assert emulator.coils == (True, *expected)
                assert eventually(emulator, driver.read).evacuated == expected
            driver.set_evacuated(segment, False)
            driver.set_pump(False)
            assert not any(emulator.coils)


def test_an_evacuated_segment_shows_the_vacuum_that_it_has(emulator, driver):
    driver.set_pump(True)
    driver.set_evacuated(1, True)
    reading = eventually(emulator, driver.read, lambda r: r.pressures[1] < AMBIENT - 93e3)
    assert AMBIENT - reading.pressures[1] == pytest.approx(emulator.vacuum(1), abs=1e3)
    assert reading.pressures[0] == AMBIENT


def test_coils_registers_and_scales_may_be_in_any_order(emulator):
    with connected(emulator, pump_coil=2, valve_coils=(3.0, 0.0, 1.0), vacuum_at_4_ma=100e3,
                   vacuum_at_20_ma=0.0, pressure_registers=(2.0, 0.0, 1.0)) as driver:
        for segment, current in zip(emulator.segments, (4000, 12000, 20000), strict=True):
            segment.stuck_at = current
        driver.set_evacuated(0, True)
        driver.set_pump(True)
        reading = eventually(emulator, driver.read)
    assert emulator.coils == (False, False, True, True)
    assert reading.evacuated == (True, False, False) and reading.pump
    assert reading.pressures == pytest.approx((AMBIENT, AMBIENT - 100e3, AMBIENT - 50e3))


def test_a_valve_may_be_plumbed_to_evacuate_without_power(emulator):
    with connected(emulator, energised_valve_evacuates=False) as driver:
        assert eventually(emulator, driver.read).evacuated == (True, True, True)
        driver.set_evacuated(1, False)
        assert emulator.coils == (False, False, True, False)
        assert eventually(emulator, driver.read).evacuated == (True, False, True)


def test_an_idle_line_carries_the_pressures_and_now_and_then_the_relays(emulator, driver):
    emulator.requests.clear()
    start = emulator.clock()
    for _ in range(40):
        driver.read()
    seen = functions(emulator)
    assert seen.count(READ_REGISTERS) == 40
    assert seen.count(READ_COILS) <= 2 + (emulator.clock() - start) / COILS_INTERVAL


# Sensors and relays.


@pytest.mark.parametrize('current, broken', [
    (0, True), (3599, True), (3600, False), (21000, False), (21001, True), (65535, True)])
def test_a_current_that_no_transmitter_gives_is_no_pressure(emulator, driver, current, broken):
    emulator.segments[1].stuck_at = current
    pressures = eventually(emulator, driver.read).pressures
    assert isnan(pressures[1]) == broken
    assert pressures[0] == pressures[2] == AMBIENT


def test_a_stuck_sensor_is_a_fault_and_its_segment_not_stiff_until_it_moves_again():
    with emulated(initially_stiff=True) as emulator, connected(emulator) as driver:
        controller = JammingController(driver, 3, JammingSettings(), emulator.clock)
        emulator.stick_sensor(1)
        controller.set_stiff(1, False)
        eventually(emulator, controller.update)
        emulator.clock.sleep(RESPONSE_TIME)
        eventually(emulator, controller.update)
        assert 'segment 2' in controller.faults[1] and 'stuck' in controller.faults[1]
        controller.set_stiff(1, True)
        eventually(emulator, controller.update)
        assert controller.stiff == [True, False, True]
        emulator.repair()
        controller.set_stiff(1, False)
        eventually(emulator, lambda: controller.update() and controller.faults[1], lambda f: not f)
        controller.set_stiff(1, True)
        eventually(emulator, lambda: controller.update() and controller.stiff[1], bool)


@pytest.mark.parametrize('coil, name, switch', [
    (2, 'valve of segment 2', lambda driver: driver.set_evacuated(1, True)),
    (0, 'pump', lambda driver: driver.set_pump(True))])
def test_a_coil_that_does_not_follow_is_named(emulator, driver, coil, name, switch):
    emulator.stuck.add(coil)
    words = fail(switch, driver)
    assert f'coil {coil} ({name})' in words and 'does not follow' in words
    reading = eventually(emulator, driver.read)
    assert not reading.pump and not any(reading.evacuated)
    emulator.repair()
    switch(driver)
    assert emulator.coils[coil]


def test_relays_that_fell_off_are_noticed_and_not_switched_again():
    with emulated(initially_stiff=True) as emulator, connected(emulator) as driver:
        emulator.power_cycle()
        eventually(emulator, driver.read, lambda r: not r.pump and r.evacuated == (False,) * 3)
        assert WRITE_COIL not in functions(emulator)


# The line.


def test_a_device_that_does_not_answer_holds_its_caller_for_one_timeout_and_then_not_at_all(
        emulator, driver):
    emulator.hang = True
    start = emulator.clock()
    words = fail(driver.read)
    assert emulator.clock() - start <= TIMEOUT + 0.005
    assert 'does not answer' in words and 'unit' in words and 'power' in words
    for call in (driver.read, lambda: driver.set_evacuated(0, True)):
        assert 'waiting until the line is quiet' in eventually(emulator,
            lambda call=call: fail(call), lambda words: 'waiting' in words)
    assert WRITE_COIL not in functions(emulator)


@pytest.mark.parametrize(('lost', 'longest'), [((1,), 0.3), ((2,), 0.3), ((1, 2), 0.45),
                                               ((1, 3), 0.45), ((1, 4), 0.45)])
def test_two_lost_replies_close_together_do_not_make_the_pressures_stale(lost, longest):
    with emulated(baud_rate=9600, initially_stiff=True) as rig:
        jamming, clock, replies = driver_of(rig, baud_rate=9600), rig.clock, []
        jamming.open()

        def lose(reply):
            replies.append(reply)
            return b'' if len(replies) in lost else reply
        rig.transform = lose
        begin, readings = clock(), [clock()]
        for cycle in range(20):  # as jamming_valves does
            clock.sleep(begin + 0.05 * cycle - clock())
            with suppress(HardwareError):
                jamming.read()
                readings.append(clock())
        assert len(replies) > 4
        assert max(b - a for a, b in pairwise(readings)) < longest
        jamming.close()


@pytest.mark.parametrize('timeout', [0.1, 1.0])
def test_one_lost_reply_costs_one_reading_however_long_it_was_waited_for(timeout):
    with emulated() as rig:
        driver = driver_of(rig, timeout=timeout)
        driver.open()
        rig.transform = lambda _: b''
        assert 'does not answer' in fail(driver.read)
        rig.transform = None
        driver.set_evacuated(1, True)
        assert driver.read().evacuated == (False, True, False)
        driver.close()


def test_a_write_that_was_not_acknowledged_is_an_error_and_is_not_repeated(emulator, driver):
    emulator.drop = 1.0
    assert 'does not answer' in fail(driver.set_evacuated, 1, True)
    emulator.drop = 0.0
    assert eventually(emulator, driver.read).evacuated == (False, True, False)  # it was executed
    assert functions(emulator).count(WRITE_COIL) == 1


def test_relays_that_cannot_be_read_back_are_not_known(emulator):
    with connected(emulator, timeout=0.05) as driver:
        eventually(emulator, driver.read)
        refused = bytes([1, 0x81, 4])
        emulator.transform = lambda reply: (
            refused + crc(refused) if reply[:2] == b'\1\1' else reply)
        for call in (lambda: driver.set_evacuated(0, True), driver.read):
            eventually(emulator, lambda call=call: fail(call),
                       lambda words: 'reports an internal failure' in words)


@pytest.mark.parametrize(('fault', 'words'), [
    ('hang', 'does not answer'), ('unplug', 'rig: .*check the cable')])
def test_what_is_lost_is_an_error_and_read_again_when_it_is_back_and_nothing_is_switched(
        emulator, driver, fault, words):
    driver.set_evacuated(0, True)
    emulator.requests.clear()
    execute_command(emulator, fault)
    assert re.search(words, fail(driver.read))
    for call in (driver.read, lambda: driver.set_evacuated(0, False), driver.read):
        fail(call)
    emulator.repair()
    emulator.plug()
    assert eventually(emulator, driver.read).evacuated == (True, False, False)
    assert WRITE_COIL not in functions(emulator)
    assert emulator.coils == (False, True, False, False)


@pytest.mark.parametrize(('fault', 'words'), [
    ('hang', 'does not answer'), ('unplug', 'does not exist')])
def test_what_is_dead_or_missing_from_the_start_is_an_error_on_open_and_the_port_is_free(
        emulator, fault, words):
    execute_command(emulator, fault)
    assert words in fail(driver_of(emulator).open)
    emulator.repair()
    emulator.plug()
    with connected(emulator):
        pass


@pytest.mark.parametrize('part', [4096, 4])
def test_a_reply_to_a_program_that_was_killed_does_not_hold_up_the_next_one(monkeypatch, part):
    # A busy machine hands over what is received in parts, however much is asked for.
    read = os.read
    monkeypatch.setattr(os, 'read', lambda file, size: read(file, min(size, part)))
    with emulated(baud_rate=9600) as rig:
        for age in (0.0, 0.005, 0.02):
            killed, jamming = driver_of(rig, baud_rate=9600), driver_of(rig, baud_rate=9600)
            killed.open()
            request = bytes([2, READ_REGISTERS, 0, 0, 0, 3])
            os.write(killed._bus._serial.fileno(), request + crc(request))
            rig.clock.sleep(age)
            killed.close()
            begin = rig.clock()
            jamming.open()
            assert rig.clock() - begin < 0.3
            jamming.close()


def test_a_second_program_cannot_use_the_line(emulator, driver):
    assert 'in use by another program' in fail(driver_of(emulator).open)
    eventually(emulator, driver.read)


@pytest.mark.parametrize(('changes', 'words'), [
    ({'relay_unit': 7}, ('unit 7', 'does not answer')),
    ({'valve_coils': (1.0, 2.0, 9.0)}, ('unit 1', 'has no such address', 'modbus parameters'))])
def test_a_unit_or_a_coil_that_is_not_there_is_named(emulator, changes, words):
    message = fail(driver_of(emulator, **changes).open)
    assert all(word in message for word in words)


@pytest.mark.parametrize('code, words', [
    (1, 'does not support the function'), (2, 'has no such address'), (3, 'refuses the number'),
    (4, 'internal failure'), (6, 'busy'), (99, 'exception 99')])
def test_a_refusal_says_why_and_is_no_reading(emulator, driver, code, words):
    emulator.refuse = code
    assert words in fail(driver.set_evacuated, 0, True)
    assert emulator.coils == (False,) * 4
    emulator.refuse = 0
    assert eventually(emulator, driver.read).evacuated == (False,) * 3


@pytest.mark.parametrize('whole', [False, True])
def test_what_nobody_asked_for_is_an_error_and_then_forgotten(emulator, driver, whole):
    data = b'\x02\x04\x06\x2e\xe0\x2e\xe0\x2e\xe0'  # 12 mA three times
    eventually(emulator, driver.read)
    send_unasked(emulator, data + crc(data) if whole else data)
    assert 'without a request' in fail(driver.read)
    assert eventually(emulator, driver.read).pressures == (AMBIENT,) * 3


def alter(index, value):
    """A reply with one byte changed, with or without a checksum to fit."""
    return lambda reply: reply[:index] + bytes([value]) + reply[index + 1:]


def resealed(change):
    """The same with the checksum that fits, so that only the content is wrong."""
    return lambda reply: change(reply)[:-2] + crc(change(reply)[:-2])


WRONG_REPLIES = {
    'of another unit': resealed(alter(0, 9)),
    'to another function': resealed(alter(1, 3)),
    'with another byte count': resealed(alter(2, 2)),
    'an exception to another function': resealed(lambda r: bytes([r[0], 0x90, 2, 0, 0])),
    'with a wrong checksum': alter(3, 0xA5),
    'with a byte too few': lambda reply: reply[:-1],
    'with a byte too many in front': lambda reply: b'\x55' + reply,
    'the echo of a request': resealed(lambda reply: bytes.fromhex('0204000000030000')),
    'one byte': lambda reply: b'\x01',
    'only noise': lambda reply: b'\xff' * 300,
}


@pytest.mark.parametrize('change', WRONG_REPLIES.values(), ids=WRONG_REPLIES)
def test_a_wrong_reply_is_never_taken(emulator, driver, change):
    emulator.transform = change
    words = fail(driver.read)
    assert 'is no reply to' in words
    assert ('local echo' in words) == (change is WRONG_REPLIES['the echo of a request'])
    emulator.transform = None
    assert eventually(emulator, driver.read).pressures == (AMBIENT,) * 3


@pytest.mark.parametrize('zeros', [1, 3, 7])
@pytest.mark.parametrize('refuse', [0, 2])
def test_zeros_around_replies_of_a_line_without_bias_fail_nothing(emulator, driver, zeros, refuse):
    eventually(emulator, driver.read)
    emulator.zeros = zeros
    for _ in range(20):
        assert driver.read().pressures == (AMBIENT,) * 3
        emulator.clock.sleep(0.05)
    emulator.refuse = refuse
    if refuse:
        assert 'has no such address' in fail(driver.set_evacuated, 1, True)
    else:
        driver.set_evacuated(1, True)
        assert emulator.coils[2]


def test_nothing_but_zeros_is_called_a_matter_of_the_wires(emulator, driver):
    emulator.transform = lambda reply: bytes(len(reply))
    assert 'termination and bias' in fail(driver.read)


@pytest.mark.parametrize('regulators', [False, True])
def test_an_adapter_with_a_local_echo_is_named_and_its_echo_acknowledges_nothing(regulators):
    with emulated(regulators=regulators) as emulator:
        emulator.echo = emulator.hang = True
        bus = ModbusBus(emulator.port, 115200, TIMEOUT, emulator.clock)
        bus.open()
        for _ in range(3):
            with pytest.raises(HardwareError, match='local echo'):
                if regulators:
                    bus.write_register(3, 0, 9000)
                else:
                    bus.write_coil(1, 2, True)
            emulator.clock.sleep(1.0)
        bus.close()


@pytest.mark.parametrize('hang', [True, False])
def test_an_echo_that_begins_while_the_line_is_used_switches_nothing_unseen(
        emulator, driver, hang):
    eventually(emulator, driver.read)
    emulator.echo, emulator.hang = True, hang
    assert 'local echo' in fail(driver.set_evacuated, 1, True)
    assert 'local echo' in fail(driver.read)
    emulator.repair()
    assert eventually(emulator, driver.read).evacuated == (False, not hang, False)


def test_bytes_after_a_reply_are_forgotten(emulator, driver):
    emulator.transform = lambda reply: reply + b'\x55'
    with suppress(HardwareError):
        driver.read()
    emulator.transform = None
    assert eventually(emulator, driver.read).pressures == (AMBIENT,) * 3


@pytest.mark.parametrize('fault', ['drop', 'garble'])
def test_what_is_read_over_a_bad_line_is_true(emulator, fault):
    with connected(emulator, timeout=0.05) as driver:
        for segment, current in zip(emulator.segments, (5000, 9000, 17000), strict=True):
            segment.stuck_at = current
        truth = eventually(emulator, driver.read)
        setattr(emulator, fault, 0.1)
        failures = 0
        for _ in range(150):
            try:
                assert driver.read() == truth
            except HardwareError:
                failures += 1
        assert failures


# Replies that come too late.

LATENESS = [1.2, 2.9, 3.05, 3.2, 3.6, 6.0]
"""In timeouts; the line is used again after three."""


@pytest.mark.parametrize('lateness', LATENESS)
@pytest.mark.parametrize(('segments', 'late'), [(1, 'pressure'), (3, 'pressure'), (3, 'relays')])
def test_a_late_reply_is_never_taken_for_a_new_one(lateness, segments, late):
    timeout = 0.1
    with (emulated(segments, initially_stiff=True) as emulator,
          connected(emulator, timeout=timeout) as driver):
        emulator.segments[0].stuck_at = 20000
        eventually(emulator, lambda: driver.read().pressures[0], lambda p: p < AMBIENT - 99e3)
        if late == 'relays':
            emulator.clock.sleep(COILS_INTERVAL)  # they are read next
        emulator.late = lateness * timeout
        fail(driver.read)
        emulator.late = 0.0
        emulator.segments[0].stuck_at = 4000
        if late == 'relays':
            emulator.power_cycle()
        new = AMBIENT, late == 'pressure'
        end = emulator.clock() + (lateness + 5) * timeout
        while emulator.clock() < end:
            emulator.clock.sleep(0.003)
            with suppress(HardwareError):
                reading = driver.read()
                assert (reading.pressures[0], any(reading.evacuated)) == new
        reading = eventually(emulator, driver.read)
        assert (reading.pressures[0], any(reading.evacuated)) == new


def test_a_late_state_is_not_taken_though_the_other_board_answers_between():
    timeout = 0.2
    with (emulated(initially_stiff=True) as emulator,
          connected(emulator, timeout=timeout) as driver):
        eventually(emulator, driver.read)
        emulator.clock.sleep(COILS_INTERVAL)
        relays_late = [3.5 * timeout, 0.8 * timeout]

        def delay(reply):
            late = relays_late.pop(0) if reply[0] == 1 and relays_late else 0.0
            emulator.late = late
            return reply

        emulator.transform = delay
        fail(driver.read)
        emulator.power_cycle()
        for _ in range(100):
            with suppress(HardwareError):
                assert not any(driver.read().evacuated)
            emulator.clock.sleep(0.01)
        assert not any(eventually(emulator, driver.read).evacuated)


def test_a_late_acknowledgement_is_never_taken_for_that_of_another_command(emulator, driver):
    emulator.late = 3.3 * TIMEOUT
    fail(driver.set_evacuated, 0, True)
    emulator.late = 0.0
    emulator.stuck.add(0)  # so that the pump will not follow
    assert 'does not follow' in eventually(emulator,
        lambda: fail(driver.set_pump, True), lambda words: 'coil 0' in words)
    assert eventually(emulator, driver.read).evacuated == (True, False, False)


@pytest.mark.parametrize('seed', range(2))
def test_no_pressure_is_older_than_its_reading_however_late_replies_come(seed):
    # The device answers in order, each time as late as it likes; every request measures anew.
    timeout = 0.03
    latenesses = random.Random(seed)
    with emulated(2) as emulator, connected(emulator, timeout=timeout) as driver:

        def measure(reply=b''):
            emulator.late = timeout * latenesses.choice([0.0] * 6 + [0.5, 1.1, 1.7, 2.9, 3.1, 4.0])
            for segment in emulator.segments:  # what the reply to the next request says
                segment.stuck_at = 4000 + len(emulator.requests)
            return reply

        measure()
        emulator.transform = measure
        good = 0
        end = emulator.clock() + 3.0
        while emulator.clock() < end or good < 3:
            asked_before = len(emulator.requests)
            try:
                vacuum = AMBIENT - driver.read().pressures[0]
            except HardwareError:
                assert emulator.clock() < end + 30.0
                emulator.clock.sleep(timeout / 10)
                continue
            good += 1
            assert round(vacuum / 100e3 * 16000) >= asked_before


# Configuration.

REGULATED = {'regulators': True}
BAD = {
    'valves for another arm': ({'valve_coils': (1.0, 2.0)}, 'valve_coils has 2.*3 segments'),
    'sensors for another arm': (
        {'pressure_registers': (0.0,) * 4}, 'pressure_registers has 4.*3 segments'),
    'half a coil': ({'valve_coils': (1.0, 2.5, 3.0)}, 'valve_coils.*2.5.*whole'),
    'one coil for two valves': ({'valve_coils': (1.0, 2.0, 2.0)}, 'valve_coils.*different'),
    'one sensor for two segments': ({'pressure_registers': (1.0, 1.0, 2.0)}, 'different'),
    'one coil for pump and valve': ({'pump_coil': 2}, 'pump_coil is 2'),
    'coils too far apart': ({'pump_coil': 5000}, '1 to 5000.*2000'),
    'registers too far apart': ({'pressure_registers': (0.0, 1.0, 400.0)}, '0 to 400.*125'),
    'a scale without a range': ({'vacuum_at_4_ma': 1e5, 'vacuum_at_20_ma': 1e5}, 'vacuum_at_4_ma'),
    'no time for a reply': (
        {'timeout': 0.01, 'baud_rate': 9600}, 'modbus.timeout is 0.01 s.*9600'),
    'no time for regulators': ({**REGULATED, 'timeout': 0.001}, 'modbus.timeout'),
    'outputs for another arm': (
        {**REGULATED, 'output_registers': (0.0, 1.0)}, 'output_registers has 2 .*3 segments'),
    'one output for two regulators': (
        {**REGULATED, 'output_registers': (0.0, 0.0, 1.0)}, 'different'),
    'outputs too far apart': (
        {**REGULATED, 'output_registers': (0.0, 1.0, 400.0)}, '0 to 400.*125'),
    'half an output': ({**REGULATED, 'output_range': (0.5, 10.0)}, 'whole numbers'),
}


@pytest.mark.parametrize('changes, words', BAD.values(), ids=BAD)
def test_a_configuration_that_does_not_fit_together_is_refused(changes, words):
    with pytest.raises(ParameterError, match=words):
        made('/dev/null', **changes)


def test_every_default_is_allowed_and_lacks_only_the_port(tmp_path):
    for parameter in ModbusJamming.PARAMETERS:
        assert parameter.name.startswith('modbus.')
        assert parameter.check(parameter.default) == parameter.default
    assert 'no serial port is configured' in fail(made('').open)
    path = tmp_path / 'notes.txt'
    path.touch()
    assert str(path) in fail(made(path).open)
    assert path.exists()


def made(port, **changes):
    """What the node makes of its parameters."""
    return ModbusJamming.from_parameters(parameters(port, **changes), STEADY)


# Regulators.


@pytest.fixture
def outputs():
    with emulated(regulators=True) as rig:
        yield rig


@pytest.fixture
def regulators(outputs):
    with connected(outputs, regulators=True) as driver:
        yield driver


def writes(emulator):
    """The requests that set something."""
    return [request for request in emulator.requests if request[1] not in (3, 4)]


def test_opening_reads_the_set_points_and_sets_none():
    with emulated(regulators=True, initially_stiff=True) as emulator:
        with connected(emulator, regulators=True) as driver:
            reading = eventually(emulator, driver.read)
        assert reading.vacuums == pytest.approx((80e3,) * 3) and all(reading.evacuated)
        assert reading.pressures == pytest.approx((AMBIENT - 80e3,) * 3, abs=500.0)
        assert not writes(emulator) and emulator.outputs == (16800,) * 3


def test_the_modbus_driver_has_regulators_where_the_parameters_say_so():
    driver = made('port', regulators=True)
    assert isinstance(driver, ModbusRegulators) and isinstance(driver, RegulatorDriver)
    assert not isinstance(made('port'), RegulatorDriver)


@pytest.mark.parametrize(('vacuum', 'current'), [(0.0, 4000), (30e3, 8800), (100e3, 20000)])
def test_a_set_point_is_the_current_of_its_share_of_the_range(
        outputs, regulators, vacuum, current):
    regulators.set_vacuum(1, vacuum)
    assert outputs.outputs == (4000, current, 4000)
    assert eventually(outputs, regulators.read).vacuums == (0.0, vacuum, 0.0)


def test_a_regulator_that_never_vents_for_good_is_told_none_by_the_lowest_output():
    """As one from 1.3 to 80 kPa at 0 to 10 V, its board in mV."""
    outputs = Outputs(3, (0,), (0, 10000), (1.3e3, 80e3))
    assert [outputs.value(v) for v in (0.0, 1.3e3, 40650.0, 80e3)] == [0, 0, 5000, 10000]
    assert [outputs.vacuum(v) for v in (0, 5000, 10000)] == pytest.approx([0.0, 40650.0, 80e3])


def test_the_segment_follows_its_regulator_with_finite_speed(outputs, regulators):
    regulators.set_vacuum(0, 30e3)
    assert AMBIENT - eventually(outputs, regulators.read).pressures[0] < 25e3
    outputs.clock.sleep(3.0)
    reading = eventually(outputs, regulators.read)
    assert AMBIENT - reading.pressures[0] == pytest.approx(30e3, abs=500.0)
    assert reading.pressures[1] == AMBIENT


def test_setting_twice_the_same_is_no_toggle_and_closing_changes_nothing(outputs, regulators):
    for _ in range(2):
        regulators.set_vacuum(2, 40e3)
    regulators.close()
    assert outputs.outputs == (4000, 4000, 10400)


def test_an_output_that_does_not_follow_is_named(outputs, regulators):
    execute_command(outputs, 'stuck-output 2')
    with pytest.raises(HardwareError, match='register 1 .*segment 2.*8800 was written.*4000'):
        regulators.set_vacuum(1, 30e3)


def test_after_a_missed_reply_no_late_one_is_taken_for_a_new_one(outputs, regulators):
    regulators.set_vacuum(0, 30e3)
    outputs.late = 1.5 * TIMEOUT
    with pytest.raises(HardwareError, match='does not answer'):
        regulators.set_vacuum(0, 60e3)
    outputs.late = 0.0
    reading = eventually(outputs, regulators.read)
    assert reading.vacuums[0] == 60e3  # what it holds now
    assert len(writes(outputs)) == 2  # nothing is sent twice


def test_a_board_that_lost_its_power_is_seen_to_vent(outputs, regulators):
    controller = JammingController(regulators, 3, JammingSettings(), outputs.clock)
    for segment in range(3):
        controller.set_stiff(segment, True)
    eventually(outputs, lambda: controller.update() and controller.stiff, all)
    execute_command(outputs, 'power-cycle')
    controller.update()
    assert controller.stiff == [False] * 3
    assert controller.reading.vacuums == (0.0,) * 3


@pytest.mark.parametrize(('regulators', 'fault'), [
    (True, 'stuck-regulator 2'), (True, 'stuck-sensor 2'), (True, 'broken-wire 2'),
    (True, 'leak 2 200000'), (False, 'broken-wire 2'), (False, 'leak 2 200000')])
def test_a_pressure_that_does_not_follow_is_a_fault_of_its_segment_and_never_stiff(
        regulators, fault):
    with (emulated(regulators=regulators) as emulator,
          connected(emulator, regulators=regulators) as driver):
        controller = JammingController(driver, 3, JammingSettings(), emulator.clock)
        execute_command(emulator, fault)
        for segment in (1, 2):
            controller.set_stiff(segment, True)
        until = emulator.clock() + RESPONSE_TIME + 5.0
        while emulator.clock() < until:
            controller.update()
            assert not controller.stiff[1]
            emulator.clock.sleep(0.25)
        assert controller.stiff == [False, False, True]
        assert 'segment 2' in controller.faults[1] and not controller.faults[2]
        execute_command(emulator, 'repair')
        eventually(emulator, lambda: controller.update() and controller.stiff[1], bool)
        assert not controller.faults[1]
