# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of an arm by another program."""

from mcap_ros2.writer import Writer

JOINTS = """\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def other_run(path, spaces=('/left',), times=(0, 1, 2), extra=False):
    """
    Write a bag as another program does: pulls of two tendons in each namespace.

    extra: with topics of other robots that have names like ours.
    """
    with path.open('wb') as file:
        writer = Writer(file)
        schema = writer.register_msgdef('sensor_msgs/msg/JointState', JOINTS)
        if extra:
            text = writer.register_msgdef('std_msgs/msg/String', 'string data\n')
            for name in ('/gripper/status', '/left/kinematics/status', '/segment_1/pressure',
                         f'/segment_{"9" * 50}/pressure'):
                writer.write_message(name, text, {'data': 'x'}, log_time=5)
        for n, time in enumerate(times):
            for space in spaces:
                writer.write_message(f'{space}/tendon_states', schema, {
                    'header': {'stamp': {'sec': n, 'nanosec': 0}, 'frame_id': ''},
                    'name': ['b', 'a'], 'position': [0.001 * n, -0.002 * n], 'velocity': [],
                    'effort': []}, log_time=time * 10**9 + 5, publish_time=n)
        writer.finish()
