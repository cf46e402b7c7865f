# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The four nodes drive the twin as they drive a rig, and see no more of it."""

from pathlib import Path
import signal

from geometry_msgs.msg import PoseArray
import numpy as np
from processes import module_command, Processes
import pytest
from ros_rig import Rig, STREAM
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

from soft_continuum.nodes.up import description_file
from soft_continuum.parameters.files import load_arm
from soft_continuum.ros.conversions import poses_from_ros
from soft_continuum.twin.differences import read_differences
from soft_continuum.twin.rig import TwinRig
from soft_continuum.twin.truth import Truth

BEND = (0.0, 0.3, -0.2)


def test_the_nodes_set_a_shape_on_the_ideal_twin_and_it_has_it(
        rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', str(rig.domain))  # of the twin, as in its own process
    arm = load_arm(description_file())
    ideal = read_differences(description_file().with_name('twin.yaml'), 'ideal')
    with (TwinRig(arm, ideal, tmp_path / 'grbl', tmp_path / 'modbus') as twin,
          Truth(twin, rig.namespace)):
        discs = rig.record(PoseArray, 'twin/disc_poses', STREAM)
        joints = rig.record(JointState, 'twin/joint_states', STREAM)
        rig.start_arm(**twin.parameters(), tendon_speed=0.01, tendon_acceleration=0.1,
                      speed_limit=0.03, acceleration_limit=0.3, silence_timeout=2.0)
        assert rig.call(SetBool, 'jamming_valves/set_all_stiff', data=True).success
        rig.wait_for(lambda: rig.all_stiff, 'a stiff arm')
        assert rig.trigger('tendon_actuation/reference').success
        rig.wait_for(lambda: len(rig.joints), 'joint_states')
        assert rig.goal(BEND).result()[0] == 'SUCCEEDED'
        rig.wait_for_more(discs, 20)
        is_there = poses_from_ros(discs.last)
        bent = np.reshape(joints.last.position, (3, -1)).sum(axis=1)
        # A step of a motor is 5 um.
        assert bent == pytest.approx(BEND, abs=np.radians(0.1))
        said = poses_from_ros(rig.segment_poses.last)
        assert is_there[2::2, :3] == pytest.approx(said[:, :3], abs=5e-4)
        # The truth is for tests: what the suite knows comes through the serial ports.
        of_twin = [name for name, _ in rig.observer.get_topic_names_and_types()
                   if '/twin/' in name]
        assert len(of_twin) == 3
        for topic in of_twin:
            assert {info.node_name for info in
                    rig.observer.get_subscriptions_info_by_topic(topic)} <= {'observer'}


def test_up_starts_the_twin_too_and_ends_it(
        rig: Rig, processes: Processes, tmp_path: Path) -> None:
    up = processes.start([*module_command('up'), '--twin', 'ideal'],
                         environment={'TMPDIR': str(tmp_path)})
    rig.wait_for(lambda: 'position not referenced' in up.output, 'the answer of a board')
    boards = list(tmp_path.rglob('grbl'))
    assert len(boards) == 1
    up.send(signal.SIGINT)
    assert up.wait() == 0, up.output
    assert 'Traceback' not in up.output, up.output
    assert not list(tmp_path.glob('soft_continuum_*'))


@pytest.mark.parametrize(('arguments', 'named'), [
    (['--twin', 'perfect'], 'ideal, typical, bad'),
    (['--twin', '--tendon-driver', 'grbl'], 'leave out --tendon-driver'),
])
def test_a_twin_that_cannot_be_is_refused_before_anything_starts(
        processes: Processes, arguments: list[str], named: str) -> None:
    up = processes.start([*module_command('up'), *arguments])
    assert up.wait() == 2
    assert named in up.output
    assert 'Traceback' not in up.output, up.output
