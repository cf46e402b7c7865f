# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Valves and regulators of another node over real DDS: what is switched, and what is refused."""

from itertools import cycle
from math import isnan, nan

import pytest
from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Bool

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.drivers import families, JAMMING_DRIVERS
from soft_continuum.hardware.protocols import HardwareError, RegulatorDriver
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.description import load_description
from soft_continuum.ros.parameter_table import NODE_PARAMETERS
from soft_continuum.ros_topics import device
from support.ros2_control import OtherNodes, until
from support.ros_valves import AMBIENT, REGULATORS, Regulators, VALVES, Valves

TABLE = {p.name: p for p in NODE_PARAMETERS['jamming_valves']}


def checked(given):
    """Return the parameters of the node; of a busy machine no answer is late."""
    values = {**{name: p.default for name, p in TABLE.items()}, **load_description(),
              'ros_jamming.timeout': 1.0, **given}
    return {name: TABLE[name].check(value) for name, value in values.items() if name in TABLE}


@pytest.fixture
def make(domain, monkeypatch):
    """Return a maker of a driver and of the board that it talks to."""
    monkeypatch.setattr(device, 'OPEN_TIMEOUT', 1.0)
    closing = []

    def make_both(of=Valves, **changes):
        board, lender = of(domain), OtherNodes(domain, 'jamming_valves')
        closing.extend([board, lender])
        given = VALVES if of is Valves else REGULATORS
        driver = families(JAMMING_DRIVERS)['ros_topics'].make(checked(
            {**given, **{f'ros_jamming.{name}': value for name, value in changes.items()}}),
            STEADY, lender.node)
        closing.insert(0, driver)
        return driver, board

    yield make_both
    for one in closing:
        one.close()


def test_valves_and_pump_are_switched_and_read_back(make):
    driver, board = make()
    driver.open()
    assert board.switched == 0
    assert driver.read().evacuated == (True, True, True)
    driver.set_evacuated(1, False)
    assert driver.read().evacuated == board.plant.read().evacuated == (True, False, True)
    until(lambda: driver.read().pressures[1] > AMBIENT - 1e3)
    assert driver.read().pressures[0] < AMBIENT - 50e3
    driver.set_pump(False)
    assert not driver.read().pump
    driver.close()
    assert board.plant.read().evacuated == (True, False, True)
    assert not isinstance(driver, RegulatorDriver)


def test_regulators_take_a_set_point_each_and_keep_the_others(make):
    driver, board = make(Regulators)
    assert isinstance(driver, RegulatorDriver)
    driver.open()
    assert board.switched == 0
    driver.set_vacuum(0, 0.0)
    driver.set_vacuum(2, 30e3)
    assert driver.read().vacuums == pytest.approx((0.0, 90e3, 30e3))
    assert board.plant.read().vacuums == pytest.approx((0.0, 90e3, 30e3))
    assert driver.read().evacuated == (False, True, True)
    until(lambda: driver.read().pressures[2] == pytest.approx(AMBIENT - 30e3, abs=600.0))
    until(lambda: driver.read().pressures[0] == pytest.approx(AMBIENT, abs=600.0))


@pytest.mark.parametrize('of', [Valves, Regulators])
def test_what_does_not_follow_its_command_is_named(make, of):
    driver, board = make(of)
    driver.open()
    board.obeys = False
    with pytest.raises(HardwareError, match='of segment 2 does not follow'):
        driver.set_evacuated(1, False) if of is Valves else driver.set_vacuum(1, 0.0)
    assert board.plant.read().evacuated == (True, True, True)


def test_a_board_that_falls_silent_is_an_error_until_it_is_back(make):
    driver, board = make()
    driver.open()
    board.publishes = False
    with pytest.raises(HardwareError, match='nothing new on /board/'):
        until(lambda: driver.read() and False)
    switched = board.switched
    with pytest.raises(HardwareError, match='nothing new on /board/'):
        driver.set_evacuated(0, False)
    board.publishes = True

    def back():
        try:
            return driver.read()
        except HardwareError:
            return None
    assert until(back).evacuated == (True, True, True)
    assert board.switched == switched


@pytest.mark.parametrize('shown', [lambda p: 1e-3 * p, lambda p: 1e-5 * p, lambda p: p - AMBIENT,
                                   lambda p: p + 2 * AMBIENT], ids=['kPa', 'bar', 'gauge', 'high'])
def test_pressures_in_another_unit_are_an_error(make, shown):
    driver, board = make()
    board.pressure = shown
    driver.open()
    with pytest.raises(HardwareError, match='plausible: 2000 to 200000 Pa'):
        driver.read()


def test_a_pressure_that_is_nan_is_a_broken_sensor(make):
    driver, board = make()
    board.pressure = lambda pressure: nan
    driver.open()
    assert all(map(isnan, driver.read().pressures))


def test_set_points_in_another_unit_are_an_error(make):
    driver, _ = make(Regulators, vacuum_scale=-1e5)
    driver.open()
    with pytest.raises(HardwareError, match='check ros_jamming.vacuum_scale'):
        driver.read()


def test_a_set_point_that_is_no_number_is_not_sent_back(make):
    driver, board = make(Regulators)
    driver.open()
    board.setpoint = lambda setpoint: nan
    with pytest.raises(HardwareError, match='reports a set-point of nan'):
        until(lambda: driver.read() and False)
    board.switched = 0
    with pytest.raises(HardwareError, match='reports a set-point of nan'):
        driver.set_vacuum(0, 0.0)
    assert board.switched == 0


def test_noise_of_a_set_point_that_is_read_back_is_no_other_set_point(make):
    driver, board = make(Regulators)
    noise = cycle((0.0, 0.3, -0.3))  # kPa
    board.setpoint = lambda setpoint: setpoint + next(noise)
    driver.open()
    driver.set_vacuum(1, 30e3)
    first = driver.read().vacuums
    seen = []
    until(lambda: seen.append(driver.read().vacuums) or len(seen) > 40)
    assert first[1] == 30e3
    assert set(seen) == {first}


@pytest.mark.parametrize('topic, kind', [
    ('pressure_1', FluidPressure), ('valve_1', Bool), ('pump_state', Bool)])
def test_a_second_publisher_of_any_topic_is_an_error(make, domain, topic, kind):
    driver, board = make()
    driver.open()
    other = OtherNodes(domain, 'somebody_else')
    other.node.create_publisher(kind, f'/board/{topic}', 10)
    with pytest.raises(HardwareError, match=f'/board/{topic} .* is published by .* and '):
        until(lambda: driver.read() and False)
    with pytest.raises(HardwareError, match=f'/board/{topic} .* is published by .* and '):
        driver.set_evacuated(0, False)
    assert board.switched == 0
    other.close()


@pytest.mark.parametrize('given, words', [
    ({'pump_topic': ''}, 'give both, or neither'),
    ({'state_topics': ['one', 'two']}, 'needed: a topic for each of 3 segments'),
    ({'pressure_type': 'std_msgs/Float64MultiArray'}, 'needed: one topic, because'),
    ({'pressure_scales': [1.0, 1.0]}, 'has 2 values; the arm has 3 segments'),
    ({'regulators': True}, 'a regulator takes and reports numbers')])
def test_parameters_that_do_not_fit_together_are_refused(make, given, words):
    with pytest.raises(ParameterError, match=words):
        make(**given)
