# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Start the nodes of one arm, and RViz with its TF frames if asked for."""

import os
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

from launch import LaunchDescription
from soft_continuum.hardware.drivers import families, JAMMING_DRIVERS, TENDON_DRIVERS
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.description import load_description
from soft_continuum.ros.environment import PARENT, SAID
from soft_continuum.ros.names import KINEMATICS, NODES, TELEOP
from soft_continuum.ros.urdf import arm_urdf
from soft_continuum.ui.cli.up import (
    ALL,
    asked_file,
    check_launch,
    COMPUTER_HELP,
    COMPUTERS,
    nodes_of,
    nodes_on,
    STEERING,
)

DRIVERS = {'tendon_driver': ('driver of the tendon motors', TENDON_DRIVERS),
           'jamming_driver': ('driver of pump, valves and pressure sensors', JAMMING_DRIVERS)}
FROM_FILE = 'as in the parameter files'
EXECUTABLES = {TELEOP: 'teleop_node'}  # where it is not the name of the node
SHARE = Path(get_package_share_directory('soft_continuum'))


def generate_launch_description():
    """Return the arguments, and what they start."""
    return LaunchDescription([
        DeclareLaunchArgument(
            'namespace', default_value='',
            description='namespace of all nodes, for several arms on one machine'),
        DeclareLaunchArgument(
            'params_file', default_value=str(SHARE / 'config' / 'manipulator.yaml'),
            description='description file of the arm: parameters of all nodes'),
        DeclareLaunchArgument(
            'more_params_file', default_value='',
            description='a second parameter file, which overrides the first: such as that of the '
                        'hardware'),
        *(DeclareLaunchArgument(
            name, default_value=FROM_FILE, choices=[FROM_FILE, *families(group)],
            description=description) for name, (description, group) in DRIVERS.items()),
        DeclareLaunchArgument(
            'computer', default_value=ALL, choices=COMPUTERS, description=COMPUTER_HELP),
        DeclareLaunchArgument(
            'rviz', default_value='false', choices=['true', 'false'],
            description='also start robot_state_publisher (TF) and RViz'),
        DeclareLaunchArgument(
            'teleop', default_value='false', choices=['true', 'false'],
            description='also start the nodes servo and teleop, to steer by a joystick'),
        OpaqueFunction(function=start),
    ])


def start(context):
    """Return the nodes for the arguments given, when all of them can be started."""
    given = context.launch_configurations
    namespace, with_rviz = given['namespace'].strip('/'), given['rviz'] == 'true'
    files = [str(Path(path).expanduser())
             for path in (given['params_file'], given['more_params_file']) if path]
    steering = STEERING * (given['teleop'] == 'true')
    try:
        check_launch(namespace, files, ('robot_state_publisher', 'rviz2') if with_rviz else (),
                     nodes_on(given['computer'], (*NODES, *steering)))
        names = nodes_on(given['computer'], (*nodes_of(files, namespace), *steering))
    except ParameterError as error:
        raise RuntimeError(f'nothing was started: {error}') from None
    asked = {name: given[name] for name in DRIVERS if given[name] != FROM_FILE}
    # Not a dict: launch_ros puts it into a section with the name of the node, which may not win.
    last = [str(asked_file(files, asked))] if asked else []
    nodes = [
        Node(package='soft_continuum', executable=EXECUTABLES.get(name, name), name=name,
             output='screen', namespace=namespace, parameters=[*files, *last],
             additional_env={PARENT: str(os.getpid()), **({SAID: 'yes'} if others else {})})
        for others, name in enumerate(names)
    ]
    if with_rviz:
        values = load_description(*files, node=KINEMATICS, namespace=namespace)
        arm, frame = arm_from_parameters(values), values['frame_id']
        nodes += [
            Node(package='robot_state_publisher', executable='robot_state_publisher',
                 namespace=namespace,
                 parameters=[{'robot_description': arm_urdf(arm, frame)}]),
            Node(package='rviz2', executable='rviz2', namespace=namespace,
                 arguments=['-d', str(SHARE / 'config' / 'arm.rviz'), '-f', frame]),
        ]
    return nodes
