# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""RViz and Foxglove find all that their layouts show and call, and see where the arm goes."""

import json
from pathlib import Path
import re

import mujoco
import pytest
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray
import yaml

from soft_continuum.mechanics import Chain
from soft_continuum.parameters.files import load_arm
from support.ros2_commands import interface
from support.ros_rig import LATCHED

CONFIG = Path(__file__).resolve().parents[2] / 'config'
RVIZ = yaml.safe_load((CONFIG / 'arm.rviz').read_text(encoding='utf-8'))
FOXGLOVE = json.loads((CONFIG / 'foxglove.json').read_text(encoding='utf-8'))
RVIZ_TYPES = {'RobotModel': 'std_msgs/msg/String',
              'MarkerArray': 'visualization_msgs/msg/MarkerArray',
              'PoseArray': 'geometry_msgs/msg/PoseArray'}
VALUE = re.compile(r'(/[\w/]+)((?:\.\w+(?:\[\d\])?)*)')


@pytest.fixture
def arm(shared_arm):
    """Return an arm that all of these tests only look at, but for one goal."""
    return shared_arm


def topics(rig):
    """Return the type of each topic by its name as it is without a namespace."""
    return {name.removeprefix(rig.namespace): types[0]
            for name, types in rig.observer.get_topic_names_and_types()}


def panel_ids(part):
    """Return the panels that a part of a Foxglove layout has, in their order."""
    if isinstance(part, str):
        yield part
    else:
        yield from panel_ids(part['first'])
        yield from panel_ids(part['second'])


def test_rviz_shows_topics_that_there_are(arm):
    shown = [(display['Class'].split('/')[1], display.get('Topic') or display['Description Topic'])
             for display in RVIZ['Visualization Manager']['Displays']
             if display['Class'] != 'rviz_default_plugins/Grid']
    there = topics(arm)
    assert len(shown) == 5
    for kind, topic in shown:
        assert there['/' + topic['Value']] == RVIZ_TYPES[kind]
    latched = {topic['Value'] for _, topic in shown
               if topic.get('Durability Policy') == 'Transient Local'}
    assert latched == {'robot_description', 'target_markers', 'known_obstacles'}


def test_foxglove_lays_out_every_panel_once():
    assert sorted(panel_ids(FOXGLOVE['layout'])) == sorted(FOXGLOVE['configById'])


def test_foxglove_plots_fields_that_there_are_and_calls_services_that_there_are(arm):
    there = topics(arm)
    services = {name.removeprefix(arm.namespace): types[0]
                for name, types in arm.observer.get_service_names_and_types()}
    scene = FOXGLOVE['configById']['3D!arm']
    urdf = scene['layers']['urdf']
    assert {*scene['topics'], urdf['topic'], urdf['jointStatesTopic']} <= there.keys()
    series = [path['value'] for panel in FOXGLOVE['configById'].values()
              for path in panel.get('paths', [])]
    assert len(series) == 10
    for value in series:
        topic, fields = VALUE.fullmatch(value).groups()
        message = interface(there[topic])()
        for field in re.findall(r'\.(\w+)', fields):
            assert hasattr(message, field), value
            message = getattr(message, field)
    calls = [panel for key, panel in FOXGLOVE['configById'].items() if key.startswith('Call')]
    assert len(calls) == 8
    for panel in calls:
        request = interface(services[panel['serviceName']]).Request
        request(**json.loads(panel['requestPayload']))


def test_a_ghost_stands_where_the_arm_goes_and_the_published_robot_where_the_poses_are(arm):
    heard = arm.record(MarkerArray, 'target_markers', LATCHED)
    robot = arm.record(String, 'robot_description', LATCHED)
    angles = (0.3, -0.2, 0.25)
    assert arm.goal(angles).result()[0] == 'SUCCEEDED'
    arm.wait_for(lambda: len(heard) > 1 and heard.last.markers[0].action == Marker.DELETE,
                 'the ghost and its end')
    ghost, end = (message.markers[0] for message in list(heard)[-2:])
    assert ghost.header.frame_id == 'base_link'
    assert (ghost.action, end.action) == (Marker.ADD, Marker.DELETE)
    assert (ghost.ns, ghost.id) == (end.ns, end.id)
    chain = Chain(load_arm(CONFIG / 'manipulator.yaml'))
    x, z, _ = chain.plane_points(chain.uniform(angles).joint_angles)[-1]
    assert (ghost.points[-1].x, ghost.points[-1].z) == pytest.approx((x, z), abs=1e-6)
    assert 0.0 < ghost.color.a < 1.0
    arm.assert_rests()
    arm.wait_for(lambda: len(robot), 'robot_description')
    keep = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco></robot>'
    model = mujoco.MjModel.from_xml_string(robot.last.data.replace('</robot>', keep))
    data = mujoco.MjData(model)
    joints, poses = arm.joints.last, arm.segment_poses.last
    for name, angle in zip(joints.name, joints.position, strict=True):
        data.joint(name).qpos[:] = angle
    mujoco.mj_kinematics(model, data)
    for number, pose in enumerate(poses.poses, start=1):
        p, q = pose.position, pose.orientation
        assert data.body(f'disc_{number}').xpos == pytest.approx((p.x, p.y, p.z), abs=1e-9)
        assert data.body(f'disc_{number}').xquat == pytest.approx((q.w, q.x, q.y, q.z), abs=1e-9)
