# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tendons on the joints of another node over real DDS: what is followed, and what is refused."""

from math import nan
import threading
import time

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64MultiArray

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.drivers import families, TENDON_DRIVERS
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.ros.description import load_description
from soft_continuum.ros.parameter_table import NODE_PARAMETERS
from soft_continuum.ros_topics import device
from support.ros2_control import Controllers, DEADLINE, JOINTS, OtherNodes, until

PERIOD = 0.02  # s
SPEED = 0.03  # m/s


@pytest.fixture
def make(domain, monkeypatch):
    """Return a maker of a driver and of the controllers that it talks to."""
    monkeypatch.setattr(device, 'OPEN_TIMEOUT', 1.0)
    closing = []

    def make_both(kind='positions', *, start=0.3, **parameters):
        controllers = Controllers(domain, kind, start=start)
        lender = OtherNodes(domain, 'tendon_actuation')
        given = {f'ros_tendons.{name}': value for name, value in parameters.items()}
        values = {**{p.name: p.default for p in NODE_PARAMETERS['tendon_actuation']},
                  **load_description(), 'ros_tendons.joints': JOINTS,
                  # A busy machine may keep the threads of this test waiting.
                  'ros_tendons.timeout': 2.0, **given}
        if kind == 'trajectory':
            values |= {'ros_tendons.command_type': 'trajectory',
                       'ros_tendons.command_topic': 'trajectory_controller/joint_trajectory'}
        driver = families(TENDON_DRIVERS)['ros_topics'].make(values, STEADY, lender.node)
        closing.extend([driver, controllers, lender])
        return driver, controllers

    yield make_both
    for one in closing:
        one.close()


def ready(make, kind='positions', **options):
    """Return a driver that is open and referenced."""
    driver, controllers = make(kind, **options)
    driver.open()
    until(lambda: not driver.read().moving)
    driver.reference()
    return driver, controllers


def move(driver, way, tendons=(0, 1), speed=SPEED):
    """Send set-points as the node does: the right tendon by ``way`` (m), the left one back."""
    begin = driver.read().pulls
    steps = round(abs(way) / speed / PERIOD)
    for step in range(1, steps + 1):
        share = way * step / steps
        driver.move(tuple(pull + (share if i == 0 else -share) * (i in tendons)
                          for i, pull in enumerate(begin)), PERIOD)
        driver.read()
        time.sleep(PERIOD)


@pytest.mark.parametrize('kind', ['positions', 'trajectory'])
def test_tendons_go_where_they_are_sent_and_a_stop_holds_them(make, kind):
    driver, controllers = ready(make, kind)
    assert controllers.commands == 0  # nothing is commanded before a motion
    move(driver, 0.006)
    until(lambda: not driver.read().moving)
    assert driver.read().pulls == pytest.approx((0.006, -0.006), abs=1e-6)
    assert controllers.pulls == pytest.approx((0.006, -0.006), abs=1e-6)
    move(driver, 0.003)
    driver.stop()
    until(lambda: not driver.read().moving)
    rests_at = controllers.pulls
    assert driver.read().pulls == pytest.approx(rests_at, abs=1e-9)
    assert rests_at[0] > 0.006  # how far it came depends on how busy the machine is
    assert not controllers.refused


@pytest.mark.parametrize('kind', ['positions', 'trajectory'])
def test_a_motion_that_is_to_take_long_goes_in_steps_while_the_driver_is_read(make, kind):
    driver, _ = ready(make, kind)
    sent = []
    message = driver._message

    def noted(positions, duration):
        sent.append(positions[0])
        assert duration <= PERIOD
        return message(positions, duration)
    driver._message = noted
    driver.move((0.005, -0.005), 0.5)
    time.sleep(0.1)  # who does not read for a while
    until(lambda: not driver.read().moving)
    assert driver.read().pulls == pytest.approx((0.005, -0.005), abs=1e-6)
    steps = [b - a for a, b in zip([0.3, *sent], sent, strict=False)]
    assert min(steps) >= 0.0 and max(steps) <= 0.5 * PERIOD / 0.5 + 1e-9  # rad, of 0.5 in 0.5 s
    driver.move((0.0, 0.0), 0.5)
    driver.stop()
    until(lambda: not driver.read().moving)
    assert driver.read().pulls[0] > 0.0045


def test_a_stop_that_is_asked_for_again_and_again_is_confirmed(make):
    driver, _ = ready(make)
    move(driver, 0.003)
    until(lambda: driver.stop() or not driver.read().moving)


def frozen():
    stamps = []

    def show(message):
        stamps.append(message.header.stamp)
        message.header.stamp = stamps[0]
        return message
    return show


def with_positions(change):
    def show(message):
        message.position = [change(p) for p in message.position]
        return message
    return show


def without(field, count):
    def show(message):
        setattr(message, field, list(getattr(message, field))[:-count])
        return message
    return show


FAULTS = {
    'a topic that stops': (lambda m: None, 'nothing new on /joint_state_broadcaster'),
    'stamps that stand still': (frozen(), 'its stamps do not advance'),
    'a position that is nan': (with_positions(lambda p: nan), 'positions nan, nan'),
    'positions in degrees': (with_positions(lambda p: 57.3 * p), 'jumped by'),
    'positions that jump': (with_positions(lambda p: p + 3.0), 'jumped by (29|30|31)'),
    'too few positions': (without('position', 1), '2 values in position and 3 names'),
    'a missing joint': (without('name', 1), 'must have spool_right exactly once'),
}


@pytest.mark.parametrize('fault', FAULTS)
def test_states_that_cannot_be_true_end_the_motion(make, fault):
    driver, controllers = ready(make)
    move(driver, 0.003)
    change, words = FAULTS[fault]
    controllers.message = change

    def move_on():
        for _ in range(int(DEADLINE / PERIOD)):
            move(driver, 0.0006)
    sent = controllers.commands
    with pytest.raises(HardwareError, match=words):
        move_on()
    for call in driver.read, driver.stop:  # never anything else, as whoever calibrates may ask
        with pytest.raises(HardwareError):
            call()
    driver.close()
    sent = controllers.commands
    with pytest.raises(HardwareError, match='not open'):
        driver.move((0.0, 0.0), PERIOD)
    time.sleep(0.1)
    assert controllers.commands <= sent + 1  # one may have been on its way
    targets = [controllers.targets[name] for name in JOINTS]
    until(lambda: [controllers.positions[name] for name in JOINTS] == targets)


@pytest.mark.parametrize('parameters', [
    {'joints': JOINTS[::-1]}, {'scales': (-0.01, -0.01), 'command': -1.0}], ids=['order', 'signs'])
def test_joints_that_do_something_else_than_they_were_sent_are_stopped(make, parameters):
    driver, controllers = ready(make)
    # The controller has its joints in another order, or its motors turn the other way.
    sign = parameters.pop('command', 1.0)
    taken = controllers.positions.copy()
    controllers.node.destroy_subscription(controllers.commanded)

    def obey(message):
        controllers.targets.update({
            name: taken[name] + sign * (value - taken[name])
            for name, value in zip(parameters.get('joints', JOINTS), message.data, strict=True)})
    controllers.commanded = controllers.node.create_subscription(
        Float64MultiArray, 'position_controller/commands', obey, 10)
    until(lambda: not driver.link.problem)  # the new subscription is found
    with pytest.raises(HardwareError, match='do not follow'):
        move(driver, 0.02)
    assert abs(driver._watch.pulls[0]) < 0.008


def test_a_controller_that_does_not_follow_is_an_error(make):
    driver, controllers = ready(make)
    controllers.follows = False
    with pytest.raises(HardwareError, match='do not follow: sent to right_tendon'):
        move(driver, 0.02)
    until(lambda: controllers.targets['spool_right'] == pytest.approx(0.3))  # where it is


def test_a_stop_that_states_do_not_confirm_is_an_error(make):
    driver, controllers = ready(make)
    move(driver, 0.003)
    begin = time.monotonic()
    at = controllers.positions['spool_right']
    controllers.message = with_positions(lambda p: p + 0.5 * (time.monotonic() - begin))
    driver.move(driver.read().pulls, PERIOD)  # or it may rest already
    driver.stop()
    with pytest.raises(HardwareError, match='a stop was not confirmed'):
        until(lambda: driver.read() and False)
    assert controllers.positions['spool_right'] == pytest.approx(at, abs=0.2)


@pytest.mark.parametrize('kind', ['positions', 'trajectory'])
def test_a_stop_of_joints_that_are_no_longer_seen_does_not_move_them_back(make, kind):
    driver, controllers = ready(make, kind, following_error=0.03)
    move(driver, 0.003)
    until(lambda: not driver.read().moving)
    controllers.message = lambda message: None
    move(driver, 0.012)
    until(lambda: controllers.pulls == pytest.approx((0.015, -0.015), abs=1e-6))
    commands = controllers.commands
    driver.stop()
    until(lambda: controllers.commands > commands)
    controllers.message = lambda message: message
    until(lambda: not driver.read().moving)
    assert driver.read().pulls == pytest.approx((0.015, -0.015), abs=1e-6)


@pytest.mark.parametrize('topic, kind', [
    ('joint_state_broadcaster/joint_states', JointState),
    ('position_controller/commands', Float64MultiArray)])
def test_a_second_publisher_ends_a_motion_and_lets_none_begin(make, domain, topic, kind):
    driver, controllers = ready(make)
    other = OtherNodes(domain, 'somebody_else')
    other.node.create_publisher(kind, topic, 10)
    words = f'/{topic} .* is published by .* and '  # the name of its node may come later
    with pytest.raises(HardwareError, match=words):
        until(lambda: move(driver, 0.0006))
    driver.close()
    sent = controllers.commands
    with pytest.raises(HardwareError, match=words):
        driver.open()
    assert controllers.commands <= sent + 1  # one may have been on its way
    other.close()


REFUSED = {
    'no publisher': ({'state_topic': 'nowhere'}, r'state_topic\) has no publisher'),
    'no subscriber': ({'command_topic': 'nowhere'}, r'command_topic\) has no subscriber'),
    'another type': ({'command_topic': 'joint_state_broadcaster/joint_states'},
                     'cannot be used: .* incompatible type'),
    'no topic': ({'state_topic': 'a topic'}, "ros_tendons.state_topic is 'a topic', which is no"),
    'no such joint': ({'joints': ('spool_right', 'spool')}, 'have spool exactly once; they have'),
    'positions of 90 degrees': ({'start': 90.0}, 'reports 90, a pull of 900.0 mm'),
    'known zeros in degrees': ({'start': 8.0, 'absolute': True}, 'reports 8, a pull of 80.0 mm'),
    'no effort': ({'effort_scales': (100.0, 100.0)}, 'no effort, or nan'),
}


@pytest.mark.parametrize('case', REFUSED)
def test_what_does_not_fit_the_parameters_is_refused_before_anything_moves(make, case):
    parameters, words = REFUSED[case]
    driver, controllers = make(**parameters)
    with pytest.raises(HardwareError, match=words):
        driver.open()
    assert controllers.commands == 0


def test_a_zero_lasts_as_long_as_the_node_that_reports_the_joints(make):
    driver, controllers = ready(make)
    move(driver, 0.003)
    until(lambda: not driver.read().moving)
    driver.close()
    driver.open()  # as after states that came late
    assert driver.read().referenced
    assert driver.read().pulls == pytest.approx((0.003, -0.003), abs=1e-6)
    driver.close()
    controllers.close()
    driver, _ = make()
    driver.open()
    assert not driver.read().referenced
    with pytest.raises(HardwareError, match='not referenced'):
        driver.move((0.0, 0.0), PERIOD)


def test_a_publisher_that_was_restarted_at_rest_at_zero_has_lost_its_zero(make):
    driver, controllers = ready(make)

    def restart(message):
        controllers.message = lambda message: message
        old, controllers._states = controllers._states, controllers.node.create_publisher(
            JointState, 'joint_state_broadcaster/joint_states', 10)
        controllers.node.destroy_publisher(old)
        return message

    sent = controllers.commands
    controllers.message = restart
    with pytest.raises(HardwareError, match='was restarted'):
        until(lambda: not driver.read().referenced)
    driver.close()
    assert controllers.commands == sent  # not even a stop: positions may mean another place
    driver.open()
    assert not driver.read().referenced


def test_what_came_while_nobody_looked_was_not_missed(make):
    driver, controllers = ready(make, timeout=1.0)
    controllers.message = lambda message: None
    time.sleep(2.0)  # as on a computer on which neither this program nor DDS ran for a while
    driver.read()
    controllers.message = lambda message: message
    number = driver._states.number
    until(lambda: driver.read() and driver._states.number > number)
    controllers.message = lambda message: None
    with pytest.raises(HardwareError, match='nothing new on'):
        until(lambda: driver.read() and False)


def test_absolute_joints_need_no_reference_after_a_start(make):
    driver, _ = make(start=0.5, absolute=True, zeros=(0.3, 0.7), scales=(0.01, -0.01))
    driver.open()
    assert driver.read().referenced
    assert driver.read().pulls == pytest.approx((0.002, 0.002))


def test_efforts_become_tensions(make):
    driver, controllers = make(effort_scales=(100.0, -100.0))

    def with_effort(message):
        message.effort = [-0.02 if name == 'spool_left' else 0.05 for name in message.name]
        return message
    controllers.message = with_effort
    driver.open()
    assert driver.read().tensions == pytest.approx((5.0, 2.0))


def test_a_driver_that_is_closed_while_it_waits_for_topics_ends_at_once(make):
    driver, _ = make(state_topic='nowhere')
    raised = []

    def open_driver():
        try:
            driver.open()
        except HardwareError as error:
            raised.append(str(error))
    thread = threading.Thread(target=open_driver)
    thread.start()
    until(lambda: driver.link is not None)
    driver.close()
    thread.join(DEADLINE)
    assert len(raised) == 1


def test_a_message_of_another_type_of_bool_is_not_taken(make, domain):
    driver, _ = make(state_topic='flags')
    other = OtherNodes(domain, 'flags')
    publisher = other.node.create_publisher(Bool, 'flags', 10)
    publisher.publish(Bool(data=True))
    with pytest.raises(HardwareError, match='needed: sensor_msgs/msg/JointState'):
        driver.open()
    other.close()
