# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The names of the nodes, and of what they publish and serve; relative, so namespaces work."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.node import Node

TENDON_ACTUATION = 'tendon_actuation'
JAMMING_VALVES = 'jamming_valves'
KINEMATICS = 'kinematics'
SHAPE_SEQUENCER = 'shape_sequencer'
CAMERA = 'camera'
DISC_SENSORS = 'disc_sensors'
LOAD_CELLS = 'load_cells'
MEASURED_POSE = 'disc_{}/measured_pose'
"""Topic of a disc, 0 at the base: input of all sensors of a disc."""
OVERLAY = 'camera/overlay/compressed'
RECORDER = 'recorder'
SERVO = 'servo'
GET_NODE_INFO, HEARTBEAT = '~/get_node_info', '~/heartbeat'
"""Service and topic of every node with its version and arm."""
TELEOP = 'teleop'
TWIN, TWIN_CAMERA = 'twin', 'twin_camera'
UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'
"""Name in the graph of a node that has not been discovered yet."""
NODES = (TENDON_ACTUATION, JAMMING_VALVES, KINEMATICS, SHAPE_SEQUENCER)
"""The nodes that drive an arm, in starting order; sensor nodes are extra."""
HARDWARE = (TENDON_ACTUATION, JAMMING_VALVES)
"""Those that own a device: they run on the computer of the device."""
SENSORS = (CAMERA, DISC_SENSORS)
"""The sensor nodes."""
SHARED = ('/tf', '/tf_static', '/diagnostics', '/rosout', '/clock')
"""Topics of an arm outside of its namespace."""


def running_nodes(node: 'Node', names: Sequence[str] = NODES) -> dict[str, bool]:
    """Return which nodes are in the ROS graph, in the namespace of ``node``."""
    graph = node.get_node_names_and_namespaces()
    return {name: (name, node.get_namespace()) in graph for name in names}
