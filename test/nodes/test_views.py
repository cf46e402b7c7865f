# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""RViz and Foxglove find all that their layouts show and call, and see where the arm goes."""

import json
from pathlib import Path
import re

from builtin_interfaces.msg import Time
import pytest
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray
import yaml

from soft_continuum.colours import PREDICTED, WRONG
from soft_continuum.mechanics import Chain
from soft_continuum.nodes.markers import alarm_marker, prediction_marker, shape_markers
from soft_continuum.ros.conversions import poses_from_ros
from soft_continuum.ros.description import load_arm
from soft_continuum.user_files import description_file
from support.descriptions import check_urdf
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
    joints = dict(zip(arm.joints.last.name, arm.joints.last.position, strict=True))
    check_urdf(robot.last.data, joints, poses_from_ros(arm.disc_poses.last))


# What is shown beside the arm: where the model alone has it, and what is wrong with it.

CHAIN = Chain(load_arm(description_file()))
BENT = CHAIN.uniform((0.3, -0.2, 0.25))
ALARM = ('left_tendon is 4.0 mm longer than its motor reports: it slipped in its clamp or left a '
         'guide')


def colour(marker):
    """Return red, green and blue, 0 to 255."""
    return tuple(round(255 * part) for part in (marker.color.r, marker.color.g, marker.color.b))


def is_gone_when_not_repeated(marker):
    """Whether a view removes a marker by itself."""
    return 0.0 < marker.lifetime.sec + 1e-9 * marker.lifetime.nanosec <= 1.0


def test_the_prediction_is_a_translucent_ghost_along_the_backbone():
    marker = prediction_marker(BENT, 'base_link', Time(sec=3))
    assert (marker.type, marker.header.frame_id, marker.header.stamp.sec) == (
        Marker.LINE_STRIP, 'base_link', 3)
    assert colour(marker) == PREDICTED and 0.0 < marker.color.a < 1.0
    x, _, z = BENT.tip
    assert (marker.points[-1].x, marker.points[-1].z) == pytest.approx((x, z))
    assert is_gone_when_not_repeated(marker)


def test_what_is_wrong_stands_above_the_arm_in_lines_that_can_be_read():
    marker = alarm_marker([ALARM, 'the camera has moved'], 0.4, 'base_link', Time())
    assert marker.type == Marker.TEXT_VIEW_FACING and colour(marker) == WRONG
    assert marker.text.replace('\n', ' ') == f'{ALARM} the camera has moved'
    assert max(map(len, marker.text.splitlines())) <= 60
    assert marker.pose.position.z >= 0.4 and marker.scale.z > 0.0
    assert is_gone_when_not_repeated(marker)


def test_rviz_shows_both_beside_the_arm():
    displays = yaml.safe_load((CONFIG / 'arm.rviz').read_text(encoding='utf-8'))[
        'Visualization Manager']['Displays']
    namespaces, = (one['Namespaces'] for one in displays
                   if one.get('Topic', {}).get('Value') == 'shape_markers')
    arm = shape_markers(CHAIN, BENT, (True,) * 3, 50.0, 'base_link', Time()).markers
    extra = [prediction_marker(BENT, 'base_link', Time()), alarm_marker([], 0.4, '', Time())]
    assert namespaces.keys() == {marker.ns for marker in [*arm, *extra]}
    assert all(namespaces[marker.ns] for marker in extra)
