# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is said of the shape of the arm."""

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from soft_continuum.mechanics.statics import Statics
from soft_continuum.nodes import kinematics
from soft_continuum_interfaces.msg import KinematicsState
from support.fake_arm import ARM, FakeArm
from support.ros_rig import assert_declined, RELIABLE

DISC_HEIGHT, LENGTH = 0.03, 0.07
PULLS = (0.006, -0.007)
STEPS = 6


@pytest.fixture
def fake(rig):
    """Return kinematics alone with an arm that it can be told about."""
    rig.start('kinematics')
    return FakeArm(rig)


def shape(rig, count):
    """Return joint angles as (segments, joints), once ``count`` of them were heard."""
    rig.wait_for(lambda: len(rig.joints) >= count, f'{count} joint_states')
    return np.array(rig.joints.last.position).reshape(3, -1)


def bend(rig, fake):
    """Bend the last segment, which is soft, of a straight arm; return its joint angles."""
    fake.say((0.0, 0.0))
    shape(rig, 1)
    fake.say(soft=3)
    rig.wait_for_status('kinematics', 'soft', '3')
    for part in np.arange(1, STEPS + 1) / STEPS:
        before = rig.joints.last.position
        fake.pull((part * PULLS[0], part * PULLS[1]))
        rig.wait_for(lambda b=before: rig.joints.last.position != b, 'another shape')
    return shape(rig, 1)


def test_the_arm_is_straight_in_the_frame_of_the_base_before_anything_was_pulled(rig):
    rig.start('kinematics', frame_id='left_arm/base_link')
    FakeArm(rig).say((0.0, 0.0))
    rig.wait_for(lambda: len(rig.segment_poses) and len(rig.disc_poses) and len(rig.joints), 'it')
    for message, heights in (
            # The end of a segment is the bottom of the disc above it.
            (rig.segment_poses.last, [n * (DISC_HEIGHT + LENGTH) for n in (1, 2, 3)]),
            (rig.disc_poses.last, [0.0, 0.03, 0.10, 0.13, 0.20, 0.23, 0.30, 0.33])):
        assert message.header.frame_id == 'left_arm/base_link'
        assert message.header.stamp.sec > 0
        found = [(p.position.x, p.position.y, p.position.z) for p in message.poses]
        assert found == pytest.approx(np.array([(0.0, 0.0, z) for z in heights]), abs=1e-9)
    joints = rig.joints.last
    assert list(joints.name) == [f'segment_{s}_joint_{j}' for s in (1, 2, 3) for j in range(1, 14)]
    assert len(joints.position) == 39
    assert len(joints.velocity) == len(joints.effort) == 0


@pytest.fixture(scope='module')
def bent(module_rig):
    """Return kinematics with an arm whose last segment is bent and soft, and its joint angles."""
    module_rig.start('kinematics')
    fake = FakeArm(module_rig)
    return module_rig, fake, bend(module_rig, fake)


def test_z_of_a_pose_is_the_tangent_of_the_backbone(bent):
    rig, _, joints = bent
    tangents = np.cumsum(joints.sum(axis=1))
    assert tangents[2] > 0.1  # the right tendon bends the arm towards +x
    rig.wait_for(lambda: len(rig.disc_poses) == len(rig.joints), 'poses of the last joints')
    poses = rig.disc_poses.last.poses
    for pose, angle in zip(poses, np.repeat([0.0, *tangents], 2), strict=True):
        q = pose.orientation
        assert q.x**2 + q.y**2 + q.z**2 + q.w**2 == pytest.approx(1.0)
        z_axis = (2 * (q.x * q.z + q.w * q.y), 2 * (q.y * q.z - q.w * q.x),
                  1 - 2 * (q.x**2 + q.y**2))
        assert z_axis == pytest.approx((np.sin(angle), 0.0, np.cos(angle)), abs=1e-9)
    # From the bottom to the top of a disc the backbone runs along that axis.
    for bottom, top, angle in zip(poses[::2], poses[1::2], [0.0, *tangents], strict=True):
        along = (top.position.x - bottom.position.x, top.position.z - bottom.position.z)
        assert along == pytest.approx((0.03 * np.sin(angle), 0.03 * np.cos(angle)), abs=1e-9)


def test_a_pulled_soft_segment_has_the_shape_that_the_model_gives(bent):
    rig, fake, joints = bent
    statics = Statics(ARM)
    state = statics.chain.straight()
    for part in np.arange(1, STEPS + 1) / STEPS:
        state = statics.solve(state, (part * PULLS[0], part * PULLS[1]), (False, False, True))
    assert joints.ravel() == pytest.approx(state.joint_angles, abs=1e-6)
    assert joints[:2] == pytest.approx(np.zeros((2, 13)), abs=1e-12)  # stiff
    tensions = rig.record(JointState, 'tendon_tensions', RELIABLE)
    rig.wait_for(lambda: fake.pull(PULLS) or len(tensions), 'tensions')
    assert list(tensions.last.name) == ['right_tendon', 'left_tendon']
    assert list(tensions.last.effort) == pytest.approx(list(state.tensions), abs=1e-6)


def test_a_stiff_arm_keeps_its_shape_whatever_the_tendons_do(rig, fake):
    bent = bend(rig, fake)
    fake.say()
    rig.wait_for_status('kinematics', 'soft', '')
    before = len(rig.joints)
    for pulls in ((0.0, 0.0), (0.03, -0.03), (0.03, 0.03)):
        fake.pull(pulls)
    rig.wait_for(lambda: fake.pull(PULLS) or len(rig.joints) > before + 3, 'shapes')
    for found in list(rig.joints)[before:]:
        assert np.array(found.position).reshape(3, -1) == pytest.approx(bent, abs=1e-9)


def test_a_jam_holds_the_shape_in_which_it_formed_even_if_it_is_heard_of_before(
        rig, fake, monkeypatch):
    monkeypatch.setattr(kinematics, 'ORDER_TIMEOUT', 600.0)
    states = rig.record(KinematicsState, 'kinematics/state', RELIABLE)
    reached = bend(rig, fake)
    fake.pull((0.0, 0.0), at=10.0)
    rig.wait_for(lambda: np.abs(shape(rig, 1)).max() < 1e-3, 'the straight shape')
    # The jam formed at the full pulls, whose messages are still on their way.
    fake.say(at=20.0)
    for part, at in ((0.5, 19.0), (1.0, 19.9), (1.0, 20.0)):
        fake.pull((part * PULLS[0], part * PULLS[1]), at=at)
    rig.wait_for(lambda: all(states.last.stiff), 'every segment stiff')
    assert list(states.last.joint_angles) == pytest.approx(reached.ravel(), abs=1e-6)


def test_a_jam_does_not_wait_for_ever_for_tendons_of_another_clock(rig, fake, monkeypatch):
    monkeypatch.setattr(kinematics, 'ORDER_TIMEOUT', 0.05)
    states = rig.record(KinematicsState, 'kinematics/state', RELIABLE)
    bend(rig, fake)
    fake.pull(PULLS, at=10.0)
    fake.say(at=20.0)
    rig.wait_for(lambda: all(states.last.stiff), 'every segment stiff')


def test_steppers_that_round_both_pulls_up_do_not_buckle_the_arm(rig, fake):
    fake.say((0.0, 0.0))
    shape(rig, 1)
    fake.say(soft=3)
    rig.wait_for_status('kinematics', 'soft', '3')
    before = len(rig.joints)
    fake.pull((2.5e-6, 2.5e-6))
    rig.wait_for(lambda: len(rig.joints) > before, 'a shape')
    assert np.abs(shape(rig, 1)).max() < 1e-3
    rig.wait_for(lambda: rig.status_value('kinematics', 'tension_right_tendon'), 'tensions')
    assert float(rig.status_value('kinematics', 'tension_right_tendon')) < 1.0


def test_the_shape_is_unknown_after_starting_on_pulled_tendons_even_if_they_nearly_cancel(
        rig, fake):
    fake.say((0.000055, -0.000095))  # as at the end of an S-shape of the paper's arm
    rig.wait_for(lambda: 'unknown' in rig.statuses['kinematics'].last.message, 'an unknown shape')
    assert 'reset' in rig.statuses['kinematics'].last.message
    fake.pull((0.004, -0.005))
    rig.wait_for(lambda: '0.0040' in rig.trigger('kinematics/reset').message, 'the pulls')
    assert_declined(rig.trigger('kinematics/reset'), '0.0040', 'reference')
    assert len(rig.joints) == len(rig.segment_poses) == len(rig.disc_poses) == 0

    fake.pull((0.0, 0.0))  # what tendon_actuation says after a reference
    rig.wait_for(lambda: rig.trigger('kinematics/reset').success, 'reset')
    assert shape(rig, 1) == pytest.approx(np.zeros((3, 13)))


def test_reset_takes_the_arm_to_be_straight_again(rig, fake):
    bend(rig, fake)
    fake.say((0.0, 0.0))
    rig.wait_for_status('kinematics', 'soft', '')
    rig.wait_for(lambda: rig.trigger('kinematics/reset').success, 'reset')
    rig.wait_for(lambda: not np.any(rig.joints.last.position), 'a straight arm')


@pytest.mark.parametrize('how', ['positions', 'state'])
def test_no_shape_is_published_from_a_lost_position_on_until_a_person_says_that_it_is_straight(
        rig, fake, how):
    bend(rig, fake)
    status = rig.statuses['kinematics']
    if how == 'positions':
        fake.pull(())
    else:
        fake.state(connected=True, referenced=False)
    rig.wait_for(lambda: 'not referenced' in status.last.message, 'a lost shape')
    shapes, said = len(rig.joints), len(status)
    fake.say(soft=3)
    assert 'not referenced' in rig.trigger('kinematics/reset').message
    fake.state(connected=True, referenced=True)
    fake.say((0.0, 0.0), soft=3)
    rig.wait_for(lambda: 'segment 3 was bent by 0.' in status.last.message, 'an unknown shape')
    fake.say((0.0, 0.0))
    assert_declined(rig.trigger('kinematics/reset'), 'segment 3 was bent by 0.')
    assert len(rig.joints) == shapes
    assert {s.level for s in list(status)[said:]} <= {DiagnosticStatus.WARN}
    assert rig.trigger('kinematics/reset').success
    rig.wait_for(lambda: len(rig.joints) > shapes, 'a shape')
    assert not np.any(rig.joints.last.position)


def test_a_device_that_comes_back_with_its_position_finds_the_shape_as_it_was(rig, fake):
    bent, status = bend(rig, fake), rig.statuses['kinematics']
    fake.state(connected=False)
    rig.wait_for(lambda: 'no device' in status.last.message, 'a warning')
    shapes = len(rig.joints)
    fake.say()  # the segment is stiffened meanwhile, as a sequence that ends does
    assert 'no device' in rig.trigger('kinematics/reset').message
    assert len(rig.joints) == shapes
    fake.state(connected=True, referenced=True)
    fake.pull(PULLS)
    rig.wait_for(lambda: len(rig.joints) > shapes, 'a shape')
    assert shape(rig, 1) == pytest.approx(bent)
    assert status.last.level == DiagnosticStatus.OK


def test_a_reference_on_a_straight_arm_asks_nothing(rig, fake):
    fake.say((0.0, 0.0))
    shape(rig, 1)
    fake.state(connected=True, referenced=False)
    rig.wait_for(lambda: 'not referenced' in rig.statuses['kinematics'].last.message, 'a loss')
    shapes = len(rig.joints)
    fake.state(connected=True, referenced=True)
    fake.pull((0.0, 0.0))
    rig.wait_for(lambda: len(rig.joints) > shapes, 'a shape')
    assert not np.any(rig.joints.last.position)


def test_reset_is_refused_before_the_tendons_were_heard(rig):
    rig.start('kinematics')
    assert_declined(rig.trigger('kinematics/reset'), 'tendon_states')


def test_tendon_states_of_no_arm_or_of_no_shape_are_named_and_change_nothing(rig, fake):
    joints, status = bend(rig, fake), rig.statuses['kinematics']
    for pulls, names, word in (
            ((0.001,), ('right_tendon',), 'tendon_states'),
            ((0.001, 0.002), ('a', 'b'), 'tendon_states'),
            ((0.001,), ('right_tendon', 'left_tendon'), 'tendon_states'),
            ((), (), 'tendon_states'),
            ((float('nan'), 0.0), None, 'finite'),
            ((float('inf'), 0.0), None, 'finite'),
            # Each tendon is shorter than the discs it runs along.
            ((0.5, 0.5), None, 'tendons')):
        fake.pull(pulls, names)
        rig.wait_for(lambda w=word: w in status.last.message, word)
        assert (status.last.level == DiagnosticStatus.ERROR) == (word == 'tendons')
        assert np.array(rig.joints.last.position).reshape(3, -1) == pytest.approx(joints)
        before = len(rig.joints)
        fake.pull(PULLS)  # and the last good shape is where it goes on from
        assert shape(rig, before + 1) == pytest.approx(joints, abs=1e-6)
        rig.wait_for(lambda: status.last.level == DiagnosticStatus.OK, 'no problem')


def test_markers_show_segments_discs_and_tendons_in_the_frame_of_the_base(bent):
    rig, fake, _ = bent
    heard = rig.record(MarkerArray, 'shape_markers', RELIABLE)
    rig.wait_for(lambda: fake.pull(PULLS) or len(heard), 'markers')
    markers = heard.last.markers
    assert {m.header.frame_id for m in markers} == {'base_link'}
    kinds = {name: [m for m in markers if m.ns == name] for name in (
        'segments', 'discs', 'tendons')}
    assert {name: len(found) for name, found in kinds.items()} == {
        'segments': 3, 'discs': 4, 'tendons': 2}
    assert {m.type for m in kinds['segments'] + kinds['tendons']} == {Marker.LINE_STRIP}
    assert {m.type for m in kinds['discs']} == {Marker.CYLINDER}
    assert len({(m.ns, m.id) for m in markers}) == 9
    soft, stiff = kinds['segments'][2].color, kinds['segments'][0].color
    assert (soft.r, soft.g, soft.b) != (stiff.r, stiff.g, stiff.b)
    # The right tendon carries, the left one is slack: the darker, the tauter.
    carries, slack = (c.r + c.g + c.b for c in (m.color for m in kinds['tendons']))
    assert carries < slack
    # The strip of a segment ends where the pose of its end is.
    end = rig.segment_poses.last.poses[2].position
    last = kinds['segments'][2].points[-1]
    assert (last.x, last.z) == pytest.approx((end.x, end.z), abs=1e-9)
    for marker in markers:
        assert min(marker.scale.x, marker.color.a) > 0.0
