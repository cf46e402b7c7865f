# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes drive the twin as they drive a rig, and see no more of it."""

from pathlib import Path
import signal

from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
import numpy as np
import pytest
from sensor_msgs.msg import Imu, JointState

from soft_continuum.mechanics.rotations import planar_pose
from soft_continuum.ros.conversions import poses_from_ros
from soft_continuum.ros.names import NODES
from soft_continuum.sim.emulators.tendon_motors import board_links, driving_parameters
from soft_continuum.sim.twin.model_errors import load_cell_parameters
from soft_continuum.user_files import description_file
from support.descriptions import given_in
from support.processes import module_command
from support.ros_rig import STREAM, trajectory

BEND = (0.0, 0.0, -0.3)
START_TIMEOUT = 120.0  # s for eight processes to import what they need, on a busy machine


def ideal_twin(rig, processes, *options):
    """Start the ideal twin; return its disc_poses, its tendon_states, and load_cells."""
    twin = processes.start([*module_command('twin'), '--preset', 'ideal', '--namespace',
                            rig.namespace, *options])
    rig.wait_for(lambda: 'Ctrl-C ends it' in twin.output, 'the twin')
    for kind, topic in ((PoseArray, 'twin/disc_poses'), (JointState, 'twin/tendon_states'),
                        (JointState, 'load_cells')):
        yield rig.record(kind, topic, STREAM)


def test_the_nodes_set_a_shape_on_the_ideal_twin_and_it_has_it(rig, processes, tmp_path):
    links = {name: tmp_path / name for name in ('grbl', 'modbus')}
    discs, tendons, cells = ideal_twin(
        rig, processes, *(f'--{name}-link={link}' for name, link in links.items()))
    joints = rig.record(JointState, 'twin/joint_states', STREAM)
    imus = [rig.record(Imu, f'disc_{n}/imu', STREAM) for n in range(4)]
    rig.start_arm(**driving_parameters(**links), tendon_speed=0.01, tendon_acceleration=0.1,
                  speed_limit=0.03, acceleration_limit=0.3)
    rig.stiffen()
    assert rig.trigger('tendon_actuation/reference').success
    rig.wait_for_shape()
    assert rig.goal_when_heard(BEND).result()[0] == 'SUCCEEDED'
    rig.wait_for_more(discs, 20)
    is_there = poses_from_ros(discs.last)
    bent = np.reshape(joints.last.position, (3, -1)).sum(axis=1)
    # A step of a motor is 5 um.
    assert bent == pytest.approx(BEND, abs=np.radians(0.1))
    said = poses_from_ros(rig.segment_poses.last)
    assert is_there[2::2, :3] == pytest.approx(said[:, :3], abs=5e-4)
    # The sensors show the same arm.
    rig.wait_for_more(cells, 5)
    assert cells.last.name == ['right_tendon', 'left_tendon']
    assert cells.last.effort == pytest.approx(tendons.last.effort, abs=0.05)
    for n, (imu, (_, _, angle)) in enumerate(zip(imus, planar_pose(is_there[::2]), strict=True)):
        force = imu.last.linear_acceleration
        assert np.arctan2(-force.x, force.z) == pytest.approx(angle, abs=0.01)
        assert imu.last.angular_velocity.y == pytest.approx(0.0, abs=0.01)
        assert imu.last.header.frame_id == 'arm_under_test/' + (f'disc_{n}' if n else 'base_link')
        assert imu.last.orientation_covariance[0] == -1.0
    # The truth is for tests: what the suite knows comes through the serial ports.
    of_twin = [name for name, _ in rig.observer.get_topic_names_and_types() if '/twin/' in name]
    assert len(of_twin) == 3
    for topic in of_twin:
        assert {info.node_name for info in
                rig.observer.get_subscriptions_info_by_topic(topic)} <= {'observer'}


def test_nine_tendons_of_an_arm_in_space_move_the_twin_through_three_boards(
        rig, processes, tmp_path):
    file = description_file().with_name('tendon_arm.yaml')
    discs, tendons, cells = ideal_twin(
        rig, processes, '--params-file', str(file), f'--grbl-link={tmp_path / "grbl"}')
    boards = driving_parameters(' '.join(board_links(tmp_path / 'grbl', 9)), '', 9)
    given = given_in(file) | boards | load_cell_parameters(9)
    rig.start('kinematics', 'tendon_actuation', **given, speed_limit=0.03, acceleration_limit=0.3)
    rig.wait_for(lambda: len(rig.tendons), 'tendons')
    assert rig.trigger('tendon_actuation/reference').success
    rig.wait_for_shape()
    rig.wait_for_more(cells, 20)  # without them it refuses to move
    names = given['arm.tendon_names']
    pulls = dict(zip(names, [0.0] * 6 + [0.004, -0.002, -0.002], strict=True))
    rig.send(trajectory([(1.0, list(pulls.values()))], names))
    rig.wait_for(lambda: rig.tendons.last.position == pytest.approx(
        [*pulls.values()], abs=1e-5), 'the end of the motion')
    rig.wait_for_more(rig.disc_poses, 1)
    rig.wait_for_more(discs, 1)

    def apart():
        truth, known = (poses_from_ros(each.last) for each in (discs, rig.disc_poses))
        return float(np.abs(truth - known).max())
    rig.wait_for(lambda: apart() < 3e-4, 'an arm at rest where the model has it')
    assert poses_from_ros(discs.last)[-1, 1] > 0.02  # y: out of the plane
    assert tendons.last.name == list(names)
    assert max(tendons.last.effort) > 0.4
    rig.wait_for(lambda: rig.tendons.last.effort == pytest.approx(tendons.last.effort, abs=0.1),
                 'load cells that have settled')


def children(up):
    """Return the names of the processes that one of `up` started and that run."""
    found = set()
    for path in Path('/proc').glob('[0-9]*/cmdline'):
        try:
            words = path.read_text(encoding='utf-8', errors='replace').split('\0')
        except OSError:  # it has ended
            continue
        if words[1:2] == ['-c'] and words[3:4] == [str(up.process.pid)]:
            found.add(words[4])
    return found


def test_up_starts_the_twin_and_a_camera_too_and_both_end_with_it(rig, processes, tmp_path):
    tip = rig.record(PoseWithCovarianceStamped, 'disc_3/measured_pose', STREAM)
    own = tmp_path / 'own_rig.yaml'  # of another camera and other load cells
    own.write_text('/**: {ros__parameters: {camera: {source: /dev/video99, '
                   'calibration: none.yaml}, '
                   'load_cells: {zeros: [1000.0, 1000.0]}}}')
    up = processes.start(
        [*module_command('up'), '--twin', 'ideal', '--camera', '--namespace', rig.namespace,
         '--params-file', str(own)], environment={'TMPDIR': str(tmp_path)})
    rig.wait_for(lambda: 'position not referenced' in up.output, 'the answer of a board',
                 START_TIMEOUT)
    rig.wait_for(lambda: len(tip), 'a measured disc', START_TIMEOUT)
    assert children(up) == {*NODES, 'camera', 'twin', 'twin_camera'}
    assert tip.last.pose.pose.position.z == pytest.approx(0.3, abs=1e-3)
    rig.wait_for(lambda: rig.tendons.last and
                 rig.tendons.last.effort == pytest.approx([0.0, 0.0], abs=1.0),
                 'what the load cells of the twin show')
    assert len(list(tmp_path.rglob('grbl'))) == 1
    up.send(signal.SIGINT)
    assert up.wait() == 0, up.output
    assert not children(up)
    assert 'Traceback' not in up.output, up.output
    assert 'did not end within' not in up.output, up.output
    assert not list(tmp_path.glob('soft_continuum_*'))
