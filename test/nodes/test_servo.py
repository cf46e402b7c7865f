# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The node servo moves the soft segment after a target, and stops whenever anything interferes."""

from math import degrees, nan, radians
import time
from unittest.mock import Mock

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

from soft_continuum.mechanics import Statics
from soft_continuum.nodes.reported_arm import ArmObserver
from soft_continuum.ros.conversions import equilibrium_to_ros
from soft_continuum.ros.description import load_arm
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import TendonTrajectory
from support.ros_rig import assert_declined, LATCHED, pairs, RELIABLE, trajectory

SEGMENT = 2
PERIOD = 0.05  # s between two targets
SPEED = 0.02  # m/s: a segment takes a second or two
SLOW = 0.001  # m/s: it takes many


class Follower:
    """The servo of a running arm, and a publisher of its target."""

    def __init__(self, rig):
        self.rig = rig
        self.node, = rig.start('servo', ready=False, tendon_speed=SPEED)
        self.statuses = rig.record(DiagnosticStatus, 'servo/status', LATCHED)
        self.sent = rig.record(TendonTrajectory, 'tendon_actuation/tendon_trajectory', RELIABLE)
        self._target = None
        self._timer = rig.observer.create_timer(PERIOD, self._publish)
        self._publishers = {kind: rig.publisher(kind, f'servo/{topic}') for kind, topic in (
            (Float64, 'target_angle'), (PointStamped, 'target_tip'))}

    def _publish(self):
        if self._target is not None:
            self._publishers[type(self._target)].publish(self._target)

    def enable(self, data=True):
        """Call servo/enable."""
        return self.rig.call(SetBool, 'servo/enable', data=data)

    def enabled(self):
        """Enable it, as soon as it may be."""
        self.rig.wait_for(lambda: self.enable().success, 'an enabled servo')

    def target(self, angle):
        """Publish a target angle, degrees, all the time from now on; None: none."""
        self._target = None if angle is None else Float64(data=radians(angle))

    def tip(self, x, z, frame='base_link'):
        """Publish a target of the tip all the time from now on."""
        self._target = PointStamped()
        self._target.header.frame_id = frame
        self._target.point.x, self._target.point.z = x, z

    def wait_for_status(self, text, after=0):
        """Return the first status with ``text``."""
        return self.rig.wait_for(
            lambda: next((h for h in self.statuses.heard[after:] if text in h.message.message),
                         None),
            f'servo/status: {text}; was: {[s.message for s in self.statuses]}')

    def sent_after(self, time):
        """Return what was sent to the tendons after a time, as that of Heard."""
        return [h.message for h in self.sent.heard if h.time > time]

    @property
    def angle(self):
        """Bending angle of the segment that is followed, degrees."""
        joints = self.rig.joints.last
        return degrees(sum(position for name, position in zip(
            joints.name, joints.position, strict=True) if name.startswith(f'segment_{SEGMENT}_')))

    def wait_for_angle(self, angle, within=0.5):
        """Wait until the segment is there, degrees."""
        self.rig.wait_for(lambda: abs(self.angle - angle) < within, f'{angle} degrees')

    def move(self):
        """Enable it and let it move, for long."""
        assert self.rig.set_parameter('servo', 'tendon_speed', SLOW).successful
        self.enabled()
        self.target(-30.0 if self.angle > 0.0 else 30.0)
        self.rig.wait_for(lambda: self.rig.moving, 'a motion')

    def end(self):
        """End the node."""
        if self.node is not None:
            self.rig.on_ros_thread(self._timer.cancel)
            self.rig.end(self.node)
            self.node = None


@pytest.fixture
def follower(shared_arm):
    """Return a servo of an arm with one soft segment, that is not enabled."""
    rig = shared_arm
    follower = Follower(rig)
    rig.soften(SEGMENT)
    yield follower
    follower.end()
    rig.trigger('tendon_actuation/resume')
    rig.stiffen()


def test_it_follows_an_angle_and_a_tip_and_holds_without_a_target(follower):
    follower.enabled()
    follower.target(12.0)
    follower.wait_for_angle(12.0)
    follower.target(-12.0)
    follower.wait_for_angle(-12.0)
    pieces = [m for m in follower.sent if m.trajectory.points]
    assert len({m.id for m in pieces}) == 1
    assert all(m.trajectory.points[-1].time_from_start.nanosec <= 350_000_000 for m in pieces)
    statics = Statics(load_arm(description_file()))
    tip = statics.bend(statics.chain.straight(), SEGMENT - 1, radians(8.0)).tip
    follower.tip(tip[0], tip[1])
    follower.wait_for_angle(8.0, 1.0)
    follower.target(None)
    follower.wait_for_status('holding: no target', after=len(follower.statuses))
    follower.rig.wait_for(lambda: not follower.rig.moving, 'rest')
    follower.rig.assert_rests()
    follower.target(0.0)
    follower.wait_for_angle(0.0)
    assert follower.enable(False).success
    follower.rig.wait_for(lambda: pairs(follower.statuses.last)['enabled'] == 'false', 'its end')


@pytest.fixture
def measured(monkeypatch):
    """Let the servo see an arm that turns 0.8 times as far as kinematics predicts, as measured."""
    on_shape = ArmObserver._on_shape

    def on_measured(observer, message):
        message.joint_angles = (0.8 * np.array(message.joint_angles)).tolist()
        message.held_angles = (0.8 * np.array(message.held_angles)).tolist()
        message.measured = message.stamp
        on_shape(observer, message)

    monkeypatch.setattr(ArmObserver, '_on_shape', on_measured)


def test_measurements_correct_it(measured, follower):
    follower.enabled()
    follower.target(10.0)
    follower.wait_for_angle(12.5, 0.2)
    follower.wait_for_status('following')
    follower.rig.wait_for(
        lambda: pairs(follower.statuses.last)['corrected'] == 'by measurements', 'measurements')
    follower.target(0.0)
    follower.wait_for_angle(0.0)


@pytest.mark.parametrize('resumed', [False, True])
def test_a_stop_disables_it_also_when_it_is_resumed_at_once(follower, resumed):
    follower.move()
    follower.rig.trigger('tendon_actuation/stop')
    if resumed:
        follower.rig.trigger('tendon_actuation/resume')
    disabled = follower.wait_for_status('disabled: tendon motion was stopped')
    follower.rig.wait_for(lambda: not follower.rig.moving, 'rest')
    follower.rig.assert_rests()
    assert not follower.sent_after(disabled.time)
    assert abs(follower.angle) < 25.0
    if not resumed:
        assert_declined(follower.enable(), 'stopped')


@pytest.mark.parametrize('killed', [False, True])
def test_when_it_ends_the_arm_stops(follower, killed):
    rig = follower.rig
    follower.move()
    if killed:
        follower.node._commander._trajectory.publish = lambda _: None
    else:
        follower.end()
    ended = time.time_ns()
    rig.wait_until_rests()  # what was sent before may come late
    assert len(follower.sent_after(ended)) <= 1  # that was on its way
    assert abs(follower.angle) < 25.0


def test_a_bad_target_or_what_is_none_changes_nothing_and_is_reported(follower):
    def no_messages():
        targets, now = follower.node._targets, time.monotonic()
        targets.clear()  # the last one is reported
        targets[Float64] = now, b'no message'
        targets[PointStamped] = now, serialize_message(PointStamped()) * 99

    follower.enabled()
    pulls = follower.rig.pulls
    for send, reason in (
            (lambda: follower.target(degrees(nan)), 'finite number'),
            (lambda: follower.target(80.0), 'allowed by bending_angle_limits'),
            (lambda: follower.tip(0.1, 0.3, 'map'), "a tip in frame 'map'; needed: 'base_link'"),
            (lambda: follower.tip(nan, 0.3), 'finite numbers')):
        send()
        follower.wait_for_status(reason)
    follower.target(None)
    follower.node.executor.create_task(no_messages)
    follower.wait_for_status('a message of')
    follower.rig.assert_rests(5)
    assert follower.rig.pulls == pulls


def test_a_flood_of_targets_is_read_once_a_cycle(follower, monkeypatch):
    follower.enabled()
    taken = []
    monkeypatch.setattr(follower.node, '_take_target', lambda *target: taken.append(target))
    publisher = follower._publishers[Float64]
    begin = time.monotonic()
    for _ in range(2000):
        publisher.publish(Float64(data=0.1))
    assert len(taken) <= 2 + 25.0 * (time.monotonic() - begin) * 2.0


def test_it_is_not_enabled_unless_exactly_one_segment_is_soft(follower):
    rig = follower.rig
    follower.enabled()
    rig.set_stiff(SEGMENT, True)
    follower.wait_for_status('disabled: a segment changed between soft and stiff')
    assert_declined(follower.enable(), 'exactly one segment has to be soft; soft: none')
    rig.soften(1)
    rig.soften(SEGMENT)
    # The servo may hear later than this test that both are soft.
    rig.wait_for(lambda: 'soft: 1, 2' in follower.enable().message, 'a refusal')


def test_a_sequence_ends_it_and_it_is_not_enabled_while_one_runs(follower):
    follower.enabled()
    goal = follower.rig.goal('c_form', hold=60.0)
    assert goal.accepted
    follower.wait_for_status('disabled: a se')  # a sequence, or a segment that it stiffens
    follower.rig.wait_for(lambda: follower.rig.sequencer.last.running, 'a sequence that runs')
    follower.rig.wait_for(lambda: 'a sequence runs' in follower.enable().message, 'a refusal')
    goal.cancel()
    assert goal.result()[0] == 'CANCELED'
    straight = follower.rig.goal([0.0, 0.0, 0.0])
    assert straight.result()[0] == 'SUCCEEDED'


def test_it_knows_when_the_arm_had_its_shape_and_when_it_was_measured(monkeypatch):
    for module in ('ros.ros_time', 'hardware.clock'):
        monkeypatch.setattr(f'soft_continuum.{module}.monotonic', lambda: 100.0)
    node = Mock()
    node.count_publishers.return_value = 0
    node.get_clock().now().nanoseconds = 105_000_000_000
    observed = ArmObserver(
        node, load_arm(description_file()), {'stale_timeout': 10.0, 'arm.jamming': True},
        Mock())
    shape = equilibrium_to_ros(observed.chain.straight())
    shape.stamp = stamp(104.9)
    observed._on_shape(shape)
    assert observed.estimate.time == pytest.approx(99.9)
    assert observed.estimate.measured_time is None  # as kinematics is without sensors
    shape.measured = stamp(104.7)
    observed._on_shape(shape)
    assert observed.estimate.measured_time == pytest.approx(99.7)
    shape.measured = Time()
    observed._on_shape(shape)
    assert observed.estimate.measured_time is None


def stamp(seconds):
    return Time(sec=int(seconds), nanosec=int(seconds % 1.0 * 1e9))


def test_another_trajectory_disables_it(follower):
    rig = follower.rig
    follower.enabled()
    follower.target(5.0)
    follower.wait_for_angle(5.0)
    follower.target(None)
    rig.wait_for(lambda: rig.at_rest, 'rest')
    rig.send(trajectory([(0.5, [0.0, -0.001])]))
    follower.wait_for_status('replaced by another trajectory')
