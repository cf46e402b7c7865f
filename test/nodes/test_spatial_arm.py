# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Arms in space over DDS: described in a file, moved by trajectories, where geometry has them."""

from math import cos, radians, sin

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from soft_continuum.nodes import conflicts
from soft_continuum.ros.conversions import poses_from_ros
from soft_continuum.ros.description import load_arm
from soft_continuum_interfaces.msg import MotionRequest, TeleopState
from support.descriptions import check_urdf, given, JAMMING, TENDON_ARM
from support.ros_rig import DEADLINE, LATCHED, RELIABLE, trajectory

NAMES = load_arm(TENDON_ARM).tendon_names
OFFSET, SEGMENT, BASE, DISC = 0.008, 0.08, 0.01, 0.005  # m, as config/tendon_arm.yaml has them
PULL = 0.004  # m
SLACK = -0.02  # m: of the tendons that are not to do anything


class Driven:
    """An arm that runs, and trajectories for it."""

    def __init__(self, rig, names):
        self.rig, self._names = rig, names
        self._count = 0
        self.rig.wait_for_shape()

    def send(self, pulls, others=0.0, names=()):
        """Send a trajectory of half a second; return what happened to it, once it has ended."""
        self._count += 1
        names = names or self._names
        this = f'motion {self._count}'
        points = [(0.5, [pulls.get(name, others) for name in names])]
        self.rig.send(trajectory(points, names), this)
        states = self.rig.states['tendon_actuation']

        def ended():
            return next((one for one in (states.last.accepted, states.last.refused)
                         if one.id == this and one.status != MotionRequest.FOLLOWING), None)
        return self.rig.wait_for(ended, 'an end of the motion')

    def poses(self):
        """Return the poses (2 * discs, 7) of the arm at rest, as published."""
        self.rig.wait_for_more(self.rig.tendons, 3)
        return poses_from_ros(list(self.rig.wait_for_more(self.rig.disc_poses, 2))[-1])


@pytest.fixture(scope='module')
def tendon_arm(module_rig):
    """Return the tendon arm without gravity: kinematics and tendon_actuation, nothing else."""
    module_rig.start('kinematics', 'tendon_actuation', **given(TENDON_ARM, arm__gravity=0.0))
    return Driven(module_rig, NAMES)


def constant_curvature(direction, angle):
    """
    Return the tip of an arm whose three segments are arcs, between rigid discs.

    direction: about z from x, towards which it bends.  angle: of the whole arm, rad.
    """
    x, z, theta = 0.0, BASE, 0.0
    radius = SEGMENT / (angle / 3.0)
    for _ in range(3):
        after = theta + angle / 3.0
        x += radius * (cos(theta) - cos(after)) + DISC * sin(after)
        z += radius * (sin(after) - sin(theta)) + DISC * cos(after)
        theta = after
    return np.array([x * cos(direction), x * sin(direction), z])


def test_a_pulled_tendon_bends_the_arm_towards_itself(tendon_arm):
    for name, degrees in (('tip_1', 80.0), ('tip_2', 200.0)):
        assert tendon_arm.send({name: PULL}, SLACK).status == MotionRequest.DONE
        poses = tendon_arm.poses()
        wanted = constant_curvature(radians(degrees), PULL / OFFSET)
        assert poses[-1, :3] == pytest.approx(wanted, abs=1.5e-3)
        assert np.hypot(*wanted[:2]) > 0.05  # of which the tolerance is little
        # A tendon that runs straight on bends the arm in one plane: the tip turns about its normal
        turn = Rotation.from_quat(poses[-1, 3:]).as_rotvec()
        assert np.linalg.norm(turn) == pytest.approx(PULL / OFFSET, rel=0.02)
        assert turn[2] == pytest.approx(0.0, abs=1e-3)


def test_a_tendon_bends_the_segments_up_to_its_end_only(tendon_arm):
    assert tendon_arm.send({'base_1': PULL}, SLACK).status == MotionRequest.DONE
    discs = tendon_arm.poses()[2::2]
    turns = [np.linalg.norm(Rotation.from_quat(pose[3:]).as_rotvec()) for pose in discs]
    assert turns == pytest.approx([PULL / OFFSET] * 3, rel=0.02)
    assert discs[-1, 0] > 0.05  # base_1 is at +x
    assert abs(discs[-1, 1]) < 1e-4


def test_the_joints_and_the_urdf_give_the_published_poses(tendon_arm):
    rig = tendon_arm.rig
    assert tendon_arm.send({'tip_1': PULL, 'base_2': PULL}, SLACK).status == MotionRequest.DONE
    urdf = rig.record(String, 'robot_description', LATCHED)
    rig.wait_for(lambda: len(urdf), 'a URDF')
    poses = tendon_arm.poses()
    joints = dict(zip(rig.joints.last.name, rig.joints.last.position, strict=True))
    assert len(joints) == 3 * 33
    check_urdf(urdf.last.data, joints, poses)


def test_tensions_are_those_that_bend_the_rod(tendon_arm):
    rig = tendon_arm.rig
    tensions = rig.record(JointState, 'tendon_tensions', RELIABLE)
    assert tendon_arm.send({'tip_1': PULL}, SLACK).status == MotionRequest.DONE
    tendon_arm.poses()
    last = rig.wait_for_more(tensions, 1)[-1]
    moment = 7.07e-4 * PULL / OFFSET / (3 * SEGMENT)  # E I times the curvature
    found = dict(zip(last.name, last.effort, strict=True))
    assert found.pop('tip_1') == pytest.approx(moment / OFFSET, rel=0.03)
    assert set(found.values()) == {0.0}


def test_too_much_tension_is_refused(tendon_arm):
    straight = tendon_arm.send({})
    assert straight.status == MotionRequest.DONE
    before = tendon_arm.poses()
    refused = tendon_arm.send({'tip_1': 0.003, 'tip_2': 0.003, 'tip_3': 0.003})
    assert (refused.status, refused.reason) == (MotionRequest.REFUSED, MotionRequest.TENSION)
    assert 'tip_1 ' in refused.message
    assert 'co_contraction_limit (opposing tendons at once): 2 N' in refused.message
    assert tendon_arm.poses() == pytest.approx(before, abs=1e-9)


def test_names_of_other_tendons_are_refused(tendon_arm):
    for names in ('right_tendon', 'left_tendon'), NAMES[:3], (*NAMES[:-1], 'tip_4'):
        refused = tendon_arm.send({}, names=names)
        assert (refused.status, refused.reason) == (MotionRequest.REFUSED, MotionRequest.INVALID)
        assert "needed: ['base_1', 'base_2'" in refused.message


def test_no_valves_are_needed_and_none_waited_for(tendon_arm):
    rig = tendon_arm.rig
    topics = dict(rig.observer.get_topic_names_and_types())
    counts = {topic: rig.observer.count_subscribers(topic) for topic in topics
              if topic.startswith(f'{rig.namespace}/segment_') and topic.endswith('/pressure')}
    assert set(counts.values()) <= {1}  # that of the observer itself
    assert not rig.observer.count_publishers('jamming_valves/state')
    assert rig.status_value('kinematics', 'soft') == '1 2 3'


def test_the_markers_stand_where_the_arm_is(tendon_arm):
    rig = tendon_arm.rig
    assert tendon_arm.send({'tip_1': PULL}, SLACK).status == MotionRequest.DONE
    markers = rig.record(MarkerArray, 'shape_markers', RELIABLE)
    poses = tendon_arm.poses()
    rig.wait_for_more(markers, 2)
    found = {}
    for marker in markers.last.markers:
        found.setdefault(marker.ns, []).append(marker)
    assert {ns: len(some) for ns, some in found.items()} == {
        'segments': 3, 'discs': 4, 'tendons': 9}
    tip = found['discs'][-1].pose.position
    assert (tip.x, tip.y, tip.z) == pytest.approx(poses[-2:, :3].mean(axis=0), abs=1e-9)
    for name, marker in zip(NAMES, found['tendons'], strict=True):
        last = marker.points[-1]  # at the lower side of the disc where it ends
        disc = poses[2 * (1 + ['base', 'middle', 'tip'].index(name.partition('_')[0])), :3]
        assert np.linalg.norm(np.array([last.x, last.y, last.z]) - disc) == pytest.approx(OFFSET)


def test_only_the_soft_segment_of_a_jamming_arm_bends(make_rig):
    rig = make_rig()
    rig.start('kinematics', 'tendon_actuation', 'jamming_valves', **given(JAMMING))
    arm = Driven(rig, ('tendon_1', 'tendon_2', 'tendon_3'))
    pulls = {'tendon_1': -0.005, 'tendon_2': 0.004, 'tendon_3': -0.005}
    assert arm.send(pulls).reason == MotionRequest.ALL_STIFF
    rig.soften(3)
    assert arm.send(pulls).status == MotionRequest.DONE
    poses = arm.poses()
    assert poses[4, :3] == pytest.approx([0.0, 0.0, 0.2], abs=1e-9)
    turn = Rotation.from_quat(poses[-1, 3:]).as_rotvec()
    # tendon_2, at 120 degrees, turns the tip about the axis that is 90 degrees further.
    assert np.degrees(np.arctan2(turn[1], turn[0])) % 360.0 == pytest.approx(210.0, abs=1e-3)
    # Without spacers the tendon is the chord of an arc of 0.07 m.
    angle = np.linalg.norm(turn)
    chord = 2.0 * (0.07 / angle - 0.0175) * sin(angle / 2.0)
    assert 0.07 - chord == pytest.approx(0.004, rel=0.02)


def test_a_planar_arm_without_jamming_bends_as_a_whole(make_rig):
    rig = make_rig()
    _, actuation = rig.start('kinematics', 'tendon_actuation', arm__jamming=False,
                             arm__gravity=0.0)
    arm = Driven(rig, ('right_tendon', 'left_tendon'))
    assert arm.send({'right_tendon': 0.004, 'left_tendon': -0.006}).status == MotionRequest.DONE
    poses = arm.poses()
    angles = 2.0 * np.arctan2(poses[2::2, 4], poses[2::2, 6])
    assert np.all(np.diff(angles, prepend=0.0) > 0.01)
    assert not poses[:, 1].any()
    # Nothing holds it while tendons are paid out to switches.
    assert 'without jamming' in actuation._arm.homing_interlock().message
    # And no segment of it can be steered.
    teleop, = rig.start('teleop', ready=False)
    states = rig.record(TeleopState, 'teleop/state', LATCHED)
    joystick = rig.publisher(Joy, 'joy')

    def refuses():
        joystick.publish(Joy(axes=[0.0] * 8, buttons=[0] * 11))
        return 'without jamming' in states.last.message if states.heard else False
    rig.wait_for(refuses, 'a reason')
    rig.end(teleop)


def test_nothing_moves_if_the_nodes_disagree_about_jamming(make_rig, monkeypatch):
    monkeypatch.setattr(conflicts, 'ENDED_AFTER', DEADLINE)  # of a busy machine
    rig = make_rig()
    rig.start('kinematics', 'jamming_valves')
    rig.soften(3)  # while nobody disagrees
    rig.start('tendon_actuation', arm__jamming=False)
    arm = Driven(rig, ('right_tendon', 'left_tendon'))
    pulls = {'right_tendon': 0.002, 'left_tendon': -0.003}
    # Whatever it has received by then, from the others or of what they say of themselves.
    assert arm.send(pulls).status == MotionRequest.REFUSED
    rig.wait_for(lambda: 'digest' in rig.statuses['tendon_actuation'].last.message, 'a conflict')
    assert arm.send(pulls).reason == MotionRequest.CONFLICT
    rig.assert_rests()
    # From when jamming_valves knows of it, no other segment becomes soft either.
    rig.wait_for(lambda: 'tendon_actuation on' in rig.statuses['jamming_valves'].last.message,
                 'a conflict')
    refused = rig.set_stiff(2, False)
    assert not refused.success
    assert 'not softened: tendon_actuation on' in refused.message
    assert 'start every node with the same description' in refused.message
    assert rig.set_stiff(3, True).success  # what is safe is done
