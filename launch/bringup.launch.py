# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Start the four nodes of one arm."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

NODES = ('tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer')


def generate_launch_description():
    """Return the arguments and the four nodes."""
    share = Path(get_package_share_directory('soft_continuum'))
    arguments = [
        DeclareLaunchArgument(
            'namespace', default_value='',
            description='namespace of all nodes, for several arms on one machine'),
        DeclareLaunchArgument(
            'params_file', default_value=str(share / 'config' / 'manipulator.yaml'),
            description='description file of the arm: parameters of all nodes'),
        DeclareLaunchArgument(
            'tendon_driver', default_value='simulated', choices=['simulated'],
            description='driver of the tendon steppers'),
        DeclareLaunchArgument(
            'jamming_driver', default_value='simulated', choices=['simulated'],
            description='driver of pump, valves and pressure sensors'),
    ]
    drivers = {name: LaunchConfiguration(name) for name in ('tendon_driver', 'jamming_driver')}
    nodes = [
        Node(package='soft_continuum', executable=name, name=name, output='screen',
             namespace=LaunchConfiguration('namespace'),
             parameters=[LaunchConfiguration('params_file'), drivers])
        for name in NODES
    ]
    return LaunchDescription(arguments + nodes)
