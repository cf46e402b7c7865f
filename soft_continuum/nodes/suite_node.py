# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What all nodes have in common."""

from typing import Any

from rclpy.node import Node

from soft_continuum.nodes.node_info import NodeInfoPublisher
from soft_continuum.nodes.node_parameters import NodeParameters
from soft_continuum.nodes.parameter_table import NODE_PARAMETERS
from soft_continuum.nodes.status import FAILURE_PERIOD, Status
from soft_continuum.nodes.threads import on_ros_thread


class SuiteNode(Node):
    """
    A node with checked parameters, a heartbeat and a status, which reports what callbacks raise.

    Its ``start`` is called when it can be spun, ``quit`` before the process ends.
    """

    def __init__(self, name: str, hardware_id: str, **options: Any) -> None:
        """
        Declare the parameters of ``name``; raises ParameterError.

        hardware_id: for diagnostics (REP-107); {parameter} in it stands for the value of one.
        """
        super().__init__(name, **options)
        self.parameters = NodeParameters(self, NODE_PARAMETERS[name])
        self.hardware_id = hardware_id.format_map(self.parameters)
        self.status = Status(self, self.hardware_id)
        self.node_info = NodeInfoPublisher(self, self.parameters)

    def callback_failed(self, error: Exception) -> None:
        """Report what a callback raised, on the thread of ROS."""
        self.status.alarm('callback', f'{type(error).__name__}: {error}', FAILURE_PERIOD)

    def thread_failed(self, error: Exception) -> None:
        """Report what a thread of its own raised; any thread may call this."""
        on_ros_thread(self, self.callback_failed, error)

    def quit(self) -> None:
        """End; a node that moves something holds it."""
