# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Vacuum regulators on a Modbus line hold what they are told, or it is said that they do not."""

import pytest

from soft_continuum.emulators.modbus import execute_command
from soft_continuum.emulators.modbus_rig import crc
from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.jamming_controller import (
    JammingController,
    JammingSettings,
    RESPONSE_TIME,
)
from soft_continuum.hardware.modbus.jamming import ModbusJamming
from soft_continuum.hardware.modbus.regulators import ModbusRegulators, Outputs
from soft_continuum.hardware.protocols import HardwareError, RegulatorDriver
from soft_continuum.hardware.serial_ports import open_serial
from soft_continuum.parameters.parameter import ParameterError
from support.modbus_line import (
    AMBIENT,
    connected,
    emulated,
    eventually,
    parameters,
    receive,
    TIMEOUT,
)

READ_OUTPUTS, READ_INPUTS, WRITE_OUTPUT = 3, 4, 6


@pytest.fixture
def emulator():
    with emulated(regulators=True) as rig:
        yield rig


@pytest.fixture
def driver(emulator):
    with connected(emulator, regulators=True) as regulators:
        yield regulators


def writes(emulator):
    """The requests that set something."""
    return [request for request in emulator.requests if request[1] not in (3, 4)]


@pytest.mark.parametrize(('request_', 'reply'), [
    ('03 03 0000 0003', '03 03 06 0f a0 0f a0 0f a0'),  # 4 mA three times
    ('03 06 0001 2EE0', '03 06 00 01 2e e0'),  # 12 mA
    ('03 06 0001 0F9F', '03 86 03'),  # less than 4 mA
    ('03 06 0003 2EE0', '03 86 02'),
    ('03 05 0000 FF00', '03 85 01'),
    ('01 01 0000 0001', ''),  # there is no relay board
])
def test_the_emulated_output_board_answers_as_the_standard_has_it(emulator, request_, reply):
    data = bytes.fromhex(request_)
    expected = bytes.fromhex(reply)
    with open_serial(emulator.port, 9600) as line:
        line.write(data + crc(data))
        assert receive(emulator, line, len(expected) + 2 if reply else 5, 0.5) == (
            expected + crc(expected) if reply else b'')


def test_opening_reads_the_set_points_and_sets_none():
    with emulated(regulators=True, initially_stiff=True) as emulator:
        with connected(emulator, regulators=True) as driver:
            reading = eventually(emulator, driver.read)
        assert reading.vacuums == pytest.approx((80e3,) * 3) and all(reading.evacuated)
        assert reading.pressures == pytest.approx((AMBIENT - 80e3,) * 3, abs=500.0)
        assert not writes(emulator) and emulator.outputs == (16800,) * 3


def test_the_modbus_driver_has_regulators_where_the_parameters_say_so():
    driver = ModbusJamming.from_parameters(parameters('port', regulators=True), STEADY)
    assert isinstance(driver, ModbusRegulators) and isinstance(driver, RegulatorDriver)
    assert not isinstance(ModbusJamming.from_parameters(parameters('port'), STEADY),
                          RegulatorDriver)


@pytest.mark.parametrize(('vacuum', 'current'), [(0.0, 4000), (30e3, 8800), (100e3, 20000)])
def test_a_set_point_is_the_current_of_its_share_of_the_range(emulator, driver, vacuum, current):
    driver.set_vacuum(1, vacuum)
    assert emulator.outputs == (4000, current, 4000)
    assert eventually(emulator, driver.read).vacuums == (0.0, vacuum, 0.0)


def test_a_regulator_that_never_vents_for_good_is_told_none_by_the_lowest_output():
    """As one from 1.3 to 80 kPa at 0 to 10 V, its board in mV."""
    outputs = Outputs(3, (0,), (0, 10000), (1.3e3, 80e3))
    assert [outputs.value(v) for v in (0.0, 1.3e3, 40650.0, 80e3)] == [0, 0, 5000, 10000]
    assert [outputs.vacuum(v) for v in (0, 5000, 10000)] == pytest.approx([0.0, 40650.0, 80e3])


def test_the_segment_follows_its_regulator_with_finite_speed(emulator, driver):
    driver.set_vacuum(0, 30e3)
    assert AMBIENT - eventually(emulator, driver.read).pressures[0] < 25e3
    emulator.clock.sleep(3.0)
    reading = eventually(emulator, driver.read)
    assert AMBIENT - reading.pressures[0] == pytest.approx(30e3, abs=500.0)
    assert reading.pressures[1] == AMBIENT


def test_setting_twice_the_same_is_no_toggle_and_closing_changes_nothing(emulator, driver):
    for _ in range(2):
        driver.set_vacuum(2, 40e3)
    driver.close()
    assert emulator.outputs == (4000, 4000, 10400)


def test_an_output_that_does_not_follow_is_named(emulator, driver):
    execute_command(emulator, 'stuck-output 2')
    with pytest.raises(HardwareError, match='register 1 .*segment 2.*8800 was written.*4000'):
        driver.set_vacuum(1, 30e3)


def test_after_a_missed_reply_no_late_one_is_taken_for_a_new_one(emulator, driver):
    driver.set_vacuum(0, 30e3)
    emulator.late = 1.5 * TIMEOUT
    with pytest.raises(HardwareError, match='does not answer'):
        driver.set_vacuum(0, 60e3)
    emulator.late = 0.0
    reading = eventually(emulator, driver.read)
    assert reading.vacuums[0] == 60e3  # what it holds now
    assert len(writes(emulator)) == 2  # nothing is sent twice


def test_a_board_that_lost_its_power_is_seen_to_vent(emulator, driver):
    controller = JammingController(driver, 3, JammingSettings(), emulator.clock)
    for segment in range(3):
        controller.set_stiff(segment, True)
    eventually(emulator, lambda: controller.update() and controller.stiff, all)
    execute_command(emulator, 'power-cycle')
    controller.update()
    assert controller.stiff == [False] * 3
    assert controller.reading.vacuums == (0.0,) * 3


@pytest.mark.parametrize('fault', ['stuck-regulator 1', 'stuck-sensor 1', 'broken-wire 1',
                                   'leak 1 200000'])
def test_a_pressure_that_does_not_follow_is_reported_and_never_stiff(emulator, driver, fault):
    controller = JammingController(driver, 3, JammingSettings(), emulator.clock)
    execute_command(emulator, fault)
    controller.set_stiff(0, True)
    until = emulator.clock() + RESPONSE_TIME + 5.0
    while emulator.clock() < until:
        controller.update()
        assert not controller.stiff[0]
        emulator.clock.sleep(0.25)
    assert 'segment 1' in controller.faults[0] and not controller.faults[1]
    execute_command(emulator, 'repair')
    eventually(emulator, lambda: controller.update() and controller.stiff[0], bool)
    assert not controller.faults[0]


@pytest.mark.parametrize(('changes', 'problem'), [
    ({'output_registers': (0.0, 1.0)}, 'output_registers has 2 .*3 segments'),
    ({'output_registers': (0.0, 0.0, 1.0)}, 'different'),
    ({'output_registers': (0.0, 1.0, 400.0)}, '0 to 400.*125'),
    ({'output_range': (0.5, 10.0)}, 'whole numbers'),
    ({'timeout': 0.001}, 'modbus.timeout'),
])
def test_parameters_that_do_not_fit_are_refused(changes, problem):
    with pytest.raises(ParameterError, match=problem):
        ModbusJamming.from_parameters(parameters('port', regulators=True, **changes), STEADY)
