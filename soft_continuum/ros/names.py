# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The names of the nodes, and of what they publish and serve; relative, so namespaces work."""

TENDON_ACTUATION = 'tendon_actuation'
JAMMING_VALVES = 'jamming_valves'
KINEMATICS = 'kinematics'
SHAPE_SEQUENCER = 'shape_sequencer'
CAMERA = 'camera'
DISC_SENSORS = 'disc_sensors'
LOAD_CELLS = 'load_cells'
MEASURED_POSE = 'disc_{}/measured_pose'
"""Of a disc, 0 at the base: the one place where any sensor of a disc comes in."""
OVERLAY = 'camera/overlay/compressed'
RECORDER = 'recorder'
SERVO = 'servo'
GET_NODE_INFO, HEARTBEAT = '~/get_node_info', '~/heartbeat'
"""Of every node: service and topic that say which program it runs, for which arm."""
TELEOP = 'teleop'
TWIN, TWIN_CAMERA = 'twin', 'twin_camera'
UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'
"""What the graph calls a publisher whose node has not been discovered yet."""
NODES = (TENDON_ACTUATION, JAMMING_VALVES, KINEMATICS, SHAPE_SEQUENCER)
"""The nodes that drive an arm, in the order in which they start; sensors come besides."""
HARDWARE = (TENDON_ACTUATION, JAMMING_VALVES)
"""Those of them that own a device: they run on the computer that it is connected to."""
SENSORS = (CAMERA, DISC_SENSORS)
"""The nodes that look at it."""
SHARED = ('/tf', '/tf_static', '/diagnostics', '/rosout', '/clock')
"""Topics outside of the namespace of an arm that belong to it too."""
