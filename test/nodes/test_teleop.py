# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The node teleop moves the arm while the enable button of a joystick is held, no longer."""

from contextlib import closing
from math import nan
import time
from time import sleep

import pytest
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool

from soft_continuum.ui.teleop.joystick import MOVE
from soft_continuum_interfaces.msg import TeleopState
from support.command import Terminal
from support.joystick import A, B, BACK, Joystick, LB, LEFT, PATIENT, RB, RIGHT, START, X
from support.ros_rig import DEADLINE, LATCHED


@pytest.fixture(scope='module')
def plugged(shared_arm):
    """Return a joystick that stays plugged in, a teleop and a servo."""
    joystick = Joystick(shared_arm)
    yield joystick
    joystick.close()


@pytest.fixture
def joystick(plugged):
    """Return that joystick at rest, segment 2 soft and chosen, bending angles steered."""
    rig = plugged.rig
    rig.clear()
    rig.soften(2)
    # The first segment that is soft is chosen by itself.
    rig.wait_for(lambda: plugged.states.last and plugged.states.last.segment, 'a segment')
    while (segment := plugged.states.last.segment) != 2:
        plugged.press(RB, '', segment=segment % 3 + 1)
    if plugged.states.last.mode == TeleopState.TIP:
        plugged.press(BACK, '', mode=TeleopState.BENDING)
    plugged.wait_for('ready to move segment 2', connected=True)
    yield plugged
    plugged.show()
    plugged.wait_for('', enabled=False)
    rig.trigger('tendon_actuation/resume')
    rig.stiffen()


def test_it_moves_while_held_to_where_the_stick_points_and_rests_on_release(joystick):
    rig = joystick.rig
    joystick.show(x=RIGHT)  # without the button
    rig.assert_rests()
    joystick.show()
    for x, longer in ((RIGHT, 0), (LEFT, 1)):
        before = rig.tendons.last.position[longer]
        joystick.steer(x)
        rig.wait_for(lambda b=before, t=longer: rig.tendons.last.position[t] > b + 0.001,
                     'the tendon on that side pulled in')
        joystick.show(x=x)
        joystick.wait_for('ready', enabled=False)
        joystick.assert_rests()


def test_it_rests_when_the_joystick_is_unplugged_and_goes_on_only_when_pressed_again(joystick):
    joystick.steer(RIGHT)
    joystick.unplug()
    joystick.wait_for('nothing received', connected=False, enabled=False)
    joystick.assert_rests()
    joystick.plug()
    joystick.wait_for('release the enable button', connected=True, enabled=True)
    joystick.assert_rests()
    joystick.show()
    joystick.wait_for('ready', enabled=False)
    joystick.steer(RIGHT)


@pytest.mark.parametrize(('message', 'text'), [
    (Joy(axes=[nan] * 8, buttons=[0, 0, 0, 0, 1] + [0] * 6), 'axis 0 is nan'),
    (Joy(axes=[RIGHT, 0.0], buttons=[0, 0, 0, 0, 1] + [0] * 6), 'has 2 axes, none with'),
])
def test_it_rests_when_a_message_is_not_one_of_the_pad(joystick, message, text):
    joystick.steer(RIGHT)
    joystick._message = message
    joystick.wait_for(text)
    joystick.assert_rests()


def test_it_rests_when_teleop_is_killed(arm, processes):
    arm.soften(3)
    teleop = processes.node('teleop_node', parameters=PATIENT)
    with closing(Joystick(arm, teleop=False)) as joystick:
        joystick.wait_for('ready to move segment 3')
        joystick.steer(LEFT)
        teleop.kill()
        joystick.assert_rests()


def test_the_emergency_stop_stays_until_it_is_reset_and_nothing_moves_before_a_resume(joystick):
    rig = joystick.rig
    joystick.steer(RIGHT)
    joystick.show(LB, B, x=RIGHT)
    joystick.wait_for('the emergency stop is on', enabled=True)
    rig.wait_for(lambda: rig.states['tendon_actuation'].last.emergency_stop, 'a stop')
    joystick.show()
    joystick.wait_for('the emergency stop is on: reset', enabled=False)
    assert 'emergency_stop is on' in rig.trigger('tendon_actuation/resume').message
    joystick.press(START, 'motion is stopped')
    joystick.assert_rests()
    joystick.press(START, 'ready')
    joystick.assert_rests()
    joystick.steer(LEFT)

    def says_nothing():
        late = rig.record(Bool, 'emergency_stop', LATCHED)
        sleep(0.3)
        return not late.heard
    rig.wait_for(says_nothing, 'silence: what is over is not published for ever')


def test_no_other_publisher_turns_its_emergency_stop_off(joystick):
    rig = joystick.rig
    states = rig.states['tendon_actuation']
    joystick.press(B, 'the emergency stop is on')
    rig.wait_for(lambda: states.last.emergency_stop, 'a stop')
    other = rig.on_ros_thread(rig.observer.create_publisher, Bool, 'emergency_stop', 5)
    rig.wait_for(lambda: other.get_subscription_count() >= 2, 'all nodes to listen')
    stops = states.last.stops
    for _ in range(20):
        other.publish(Bool(data=False))
        assert not rig.trigger('tendon_actuation/resume').success
    assert states.last.stops == stops
    joystick.show(START, RB)
    joystick.wait_for('observer may hold it on too', segment=3)  # both buttons were seen
    joystick.show()
    rig.on_ros_thread(rig.observer.destroy_publisher, other)
    joystick.wait_for('reset turns it off')  # it has seen that the other one is gone
    joystick.press(START, 'motion is stopped')
    joystick.assert_rests()
    joystick.press(START, 'ready')


def test_a_stop_by_others_ends_it_and_a_resume_does_not_move_it(joystick):
    rig = joystick.rig
    joystick.steer(RIGHT)
    rig.trigger('tendon_actuation/stop')
    joystick.wait_for('motion is stopped')
    rig.trigger('tendon_actuation/resume')
    joystick.wait_for('release the enable button')
    joystick.assert_rests()


def test_only_one_segment_is_soft_at_a_time_and_none_is_switched_while_it_is_held(joystick):
    rig = joystick.rig
    joystick.show(LB)
    joystick.wait_for('', enabled=True)
    joystick.show(LB, RB)
    joystick.wait_for('release the enable button first', segment=2)
    joystick.show()
    for segment in (3, 1, 2):  # which disables the servo, not to be enabled for a second
        joystick.press(RB, '', segment=segment)
    enabled = rig.record(Bool, 'servo/enabled', LATCHED)
    joystick.show(LB)
    joystick.wait_for('', enabled=True)
    joystick.show(LB, RB)
    rig.wait_for(lambda: enabled.last and enabled.last.data, 'a servo that is enabled')
    joystick.wait_for('release the enable button first', segment=2)
    joystick.show()
    joystick.press(RB, 'segment 3 is not soft', segment=3)
    soft = rig.record(Bool, 'segment_3/stiff', LATCHED)
    joystick.press(A, 'segment 3 is soft')
    stiff_2 = [h.time for h in rig.stiff[1].heard if h.message.data][-1]
    soft_3 = [h.time for h in soft.heard if not h.message.data][-1]
    assert stiff_2 < soft_3
    joystick.press(BACK, 'ready to move the tip with segment 3', mode=TeleopState.TIP)
    joystick.steer(RIGHT)
    joystick.show()
    joystick.press(X, 'segment 3 is stiff')
    assert rig.stiff[2].last.data


def test_two_joysticks_or_two_teleops_move_nothing(joystick):
    rig = joystick.rig
    other = rig.on_ros_thread(rig.observer.create_publisher, Joy, 'joy', 5)
    joystick.wait_for('joy is published by observer and observer')
    joystick.show(LB)
    joystick.show(LB, x=RIGHT)
    joystick.assert_rests()
    joystick.show()
    rig.on_ros_thread(rig.observer.destroy_publisher, other)
    joystick.wait_for('ready')
    second, = rig.start('teleop', ready=False)
    joystick.wait_for('another /arm_under_test/teleop is running')
    rig.end(second)
    joystick.wait_for('ready')


RIGHT_ARROW = '\x1bOC'  # the arrow, as an xterm sends it
REPEAT = 0.03  # s


def test_a_key_that_is_held_moves_the_arm_until_the_terminal_is_closed(make_rig, tmp_path):
    rig = make_rig()
    rig.start_arm(arm__gravity=9.806650001)  # the servo has to have every digit
    path = tmp_path / 'patient.yaml'
    path.write_text('/**: {ros__parameters: {teleop: {timeout: 2.0}}}', encoding='utf-8')
    states = rig.record(TeleopState, 'teleop/state', LATCHED)
    terminal = Terminal(
        'teleop', '--namespace', rig.namespace, '--timeout', DEADLINE, '--params-file', path,
        size=(12, 60), ROS_DOMAIN_ID=str(rig.domain), TERM='xterm')

    def wait_for(text, **fields):
        rig.wait_for(
            lambda: states.last and text in states.last.message and all(
                getattr(states.last, name) == value for name, value in fields.items()),
            f'{text}; {states.last}; {terminal.output[-500:]}')

    wait_for('no segment is chosen', connected=True)
    terminal.type('n')
    wait_for('segment 1 is not soft', segment=1)
    terminal.type('s')
    wait_for(f'segment 1 is soft: {MOVE}')
    assert 'STOP' in terminal.output

    deadline = time.monotonic() + DEADLINE
    while not (rig.moving and abs(rig.pulls[0]) > 0.001):
        assert time.monotonic() < deadline, terminal.output[-500:]
        terminal.type(RIGHT_ARROW)
        time.sleep(REPEAT)
    terminal.stop_reading()  # it closes
    assert terminal.process.wait(DEADLINE) in (0, 1)
    rig.come_to_rest()
