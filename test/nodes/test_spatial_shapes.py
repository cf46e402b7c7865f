# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes of arms in space over DDS: reached by name and by direction, stopped, refused."""

from contextlib import closing
from functools import partial
from math import radians
from threading import Event
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Vector3
from matplotlib.figure import Figure
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from std_srvs.srv import SetBool

from soft_continuum.client.arm import Arm
from soft_continuum.client.errors import ClientError
from soft_continuum.client.observed import ObservedArm
from soft_continuum.nodes import servo
from soft_continuum.ros.conversions import pose_from_ros, poses_from_ros
from soft_continuum.ros.description import load_arm, load_description
from soft_continuum.ros.entries import SENSOR
from soft_continuum.sequencing.servo import AngleServo
from soft_continuum.ui.teleop import steered_arm
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Shape
from support.descriptions import given, JAMMING, TENDON_ARM
from support.joystick import Joystick, LB, LEFT, RIGHT
from support.ros_rig import DEADLINE, LATCHED

HELIX = load_description(JAMMING)['shapes.helix'], load_description(
    JAMMING)['shape_directions.helix']
ANGLE_ERROR = radians(0.3)  # of motors that step, and of the model between them


def bent(angles, directions):
    """Return a shape by angles and directions, rad."""
    return Shape(bending_angles=angles, bending_directions=directions)


def check_orientations(rig, angles, directions):
    """Claim that each disc is turned from the one below as the shape says."""
    rig.wait_for_more(rig.tendons, 3)
    turns = Rotation.from_quat(
        poses_from_ros(list(rig.wait_for_more(rig.disc_poses, 2))[-1])[::2, 3:])
    for n, (angle, towards) in enumerate(zip(angles, directions, strict=True)):
        axis = (turns[n].inv() * turns[n + 1]).apply([0.0, 0.0, 1.0])  # of the disc above
        leans = np.sin(angle) * np.array([np.cos(towards), np.sin(towards)])
        assert axis[:2] == pytest.approx(leans, abs=ANGLE_ERROR)


def test_an_arm_with_jamming_reaches_shapes_in_space_one_soft_segment_at_a_time(make_rig):
    rig = make_rig()
    rig.start_arm(**given(JAMMING))
    goal = rig.goal('helix')
    result = goal.assert_ended('SUCCEEDED')
    check_orientations(rig, *HELIX)
    assert result.bending_angles == pytest.approx(HELIX[0], abs=ANGLE_ERROR)
    assert result.bending_directions == pytest.approx(HELIX[1], abs=2.0 * ANGLE_ERROR)
    there, shown = (np.array(pose_from_ros(pose)) for pose in (
        result.tip.pose, rig.disc_poses.last.poses[-1]))
    assert there[:3] == pytest.approx(shown[:3], abs=2e-3)
    turn = Rotation.from_quat(there[3:]).inv() * Rotation.from_quat(shown[3:])
    assert turn.magnitude() < 2e-3
    assert result.source == result.PREDICTED
    assert [phase for phase in goal.phases if phase[2] == 'moving'] == [
        ('helix', n, 'moving') for n in (1, 2, 3)]
    rig.assert_rests_stiff()
    rig.assert_only_one_was_soft()
    rig.assert_never_moved_all_stiff()


@pytest.fixture(scope='module')
def tendon_arm(module_rig):
    """Return the tendon arm and its sequencer; there are no valves."""
    module_rig.start('kinematics', 'tendon_actuation', 'shape_sequencer', **given(TENDON_ARM))
    module_rig.wait_for_shape()
    return module_rig


def test_an_arm_without_jamming_is_moved_as_a_whole_and_stopped_as_one(tendon_arm):
    goal = tendon_arm.goal_when_heard('helix').wait_for_phase('moving')
    assert tendon_arm.trigger('tendon_actuation/stop').success
    goal.assert_ended('ABORTED', code=RunShapeSequence.Result.STOPPED)
    assert not tendon_arm.goal('helix').accepted
    assert tendon_arm.trigger('tendon_actuation/resume').success
    angles, directions = [0.5, 0.4, 0.6], [1.0, -2.0, 0.3]
    goal = tendon_arm.goal_when_heard(bent(angles, directions), 's_form')
    assert goal.assert_ended('SUCCEEDED').shapes_completed == 2
    assert {(segment, phase) for _, segment, phase in goal.phases} <= {
        (0, 'preparing'), (0, 'moving'), (0, 'holding')}
    values = load_description(TENDON_ARM)
    check_orientations(tendon_arm, values['shapes.s_form'], values['shape_directions.s_form'])


def test_a_client_has_all_of_an_arm_without_jamming_though_no_valves_report(tendon_arm):
    observed = tendon_arm.on_ros_thread(ObservedArm, tendon_arm.observer)
    tendon_arm.wait_for(lambda: observed.complete, 'everything that such an arm publishes')
    lines = str(observed.snapshot()).splitlines()
    assert [line.partition('  ')[0] for line in lines if 'end at' in line] == [
        'segment 1', 'segment 2', 'segment 3']
    assert observed.snapshot().stiff == ()
    assert 'jamming_valves' not in str(observed.snapshot())
    client = SimpleNamespace(
        description=load_arm(TENDON_ARM), obstacles=SimpleNamespace(known=()),
        _observe=lambda: observed, _connection=SimpleNamespace(node=tendon_arm.observer))
    drawn = Arm.plot(client)
    tip = observed.snapshot().tip.position
    ends = [[part[-1] for part in line.get_data_3d()] for line in drawn.get_lines()]
    assert pytest.approx([1e3 * part for part in tip], abs=0.05) in ends
    with pytest.raises(ClientError, match="projection='3d'"):
        Arm.plot(client, Figure().subplots())


def test_a_goal_that_the_arm_cannot_do_is_rejected_with_the_reason(tendon_arm):
    for shape, words in (
            (bent([0.1] * 3, [0.0, 0.0, 120.0]), 'degrees? 120 degrees are 2.094 rad'),
            (bent([0.1, 1.6, 0.1], [0.0] * 3), 'allowed: -1.571 to 1.571 rad'),
            (bent([1.5] * 3, [1.05] * 3), 'pull_limits: -0.03 to 0.03 m'),
            (Shape(name='upright_c_form'), 'known: c_form, s_form, helix')):
        tendon_arm.goal(shape).assert_rejected(words)


def test_the_servo_bends_a_segment_of_an_arm_without_jamming_to_any_side(tendon_arm):
    rig = tendon_arm
    statuses = rig.record(DiagnosticStatus, 'servo/status', LATCHED)
    node, = rig.start('servo', ready=False, **given(TENDON_ARM) | {'servo__segment': 3})
    targets = rig.publisher(Vector3, 'servo/target_bending')
    rig.wait_for(lambda: rig.call(SetBool, 'servo/enable', data=True).success, 'a servo')
    rig.wait_for(lambda: statuses.last and 'no target' in statuses.last.message, 'its disc')
    wanted = 0.3 * np.exp(2.0j)

    def follows():
        targets.publish(Vector3(x=wanted.real, y=wanted.imag))
        below, above = Rotation.from_quat(poses_from_ros(rig.disc_poses.last)[[-3, -1], 3:])
        axis = (below.inv() * above).apply([0.0, 0.0, 1.0])
        leans = np.sin(abs(wanted)) * wanted / abs(wanted)
        return abs(complex(*axis[:2]) - leans) < 2.0 * ANGLE_ERROR
    rig.wait_for(follows, 'the last segment to lean there')
    assert rig.trigger('tendon_actuation/stop').success
    rig.wait_for(lambda: 'stopped' in statuses.last.message, 'its end')
    assert rig.trigger('tendon_actuation/resume').success
    rig.end(node)


def test_a_segment_that_takes_long_to_prepare_is_prepared_once_and_a_stick_bends_it_to_either_side(
        tendon_arm, monkeypatch):
    rig, made, may_end = tendon_arm, [], Event()

    def make(*arguments):
        made.append(arguments)
        assert may_end.wait(DEADLINE)
        return AngleServo(*arguments) if len(made) > 1 else None  # of which nobody wants the first

    def leans():
        p, below = (rig.disc_poses.last.poses[k].position for k in (-1, -3))
        return complex(p.x - below.x, p.y - below.y)

    def bend(way, **stick):
        joystick.show(LB)
        joystick.assert_rests()
        # Kinematics may be behind the tendons, by what waits in its queue.
        queue = list(rig.wait_for_more(rig.disc_poses, SENSOR.depth + 3))
        assert len({str(each.poses[-1]) for each in queue[-2:]}) == 1
        begin = leans()
        joystick.steer(**stick)
        rig.wait_for(lambda: abs(leans() - begin) > 5e-3, 'a bend')
        moved = (leans() - begin) / way
        assert abs(moved.imag) < 0.3 * moved.real, f'{begin} moved by {moved} along {way}'

    monkeypatch.setattr(servo, 'AngleServo', make)
    monkeypatch.setattr(steered_arm, 'ENABLING_TIMEOUT', 0.2)
    with closing(Joystick(rig, **given(TENDON_ARM))) as joystick:
        joystick.wait_for('ready to move segment 3', connected=True)
        joystick.show(LB)
        for _ in range(2):
            joystick.wait_for(steered_arm.PREPARING)
            joystick.wait_for('has not found the bending range of segment 3')
        assert len(made) == 1
        # Nor is it for whoever has given up before its turn.
        joystick.show()
        joystick.wait_for('has not found the bending range of segment 3', enabled=False)
        enable = partial(rig.call, SetBool, 'servo/enable')
        for _ in range(3):
            assert enable(data=False).success
            assert enable(data=True).message == 'being prepared for segment 3'
        monkeypatch.setattr(steered_arm, 'ENABLING_TIMEOUT', DEADLINE)
        may_end.set()
        joystick.steer(x=RIGHT)
        assert len(made) == 2
        bend(1.0, x=RIGHT)
        bend(1.0j, y=1.0)
        bend(-1.0, x=LEFT)
        assert len(made) == 2
