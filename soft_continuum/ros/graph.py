# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Which nodes run."""

from collections.abc import Sequence

from rclpy.node import Node

from soft_continuum.ros.names import NODES


def running_nodes(node: Node, names: Sequence[str] = NODES) -> dict[str, bool]:
    """Return which nodes are in the ROS graph, in the namespace of ``node``."""
    graph = node.get_node_names_and_namespaces()
    return {name: (name, node.get_namespace()) in graph for name in names}
