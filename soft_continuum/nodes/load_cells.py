# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Load cells of another node: the tension of each tendon from the topic load_cells."""

from collections.abc import Mapping, Sequence
from math import nan
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import JointState

from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.entries import subscribe
from soft_continuum.ros.names import LOAD_CELLS
from soft_continuum.ros.qos import SENSOR
from soft_continuum.ros.ros_time import Age


class LoadCells:
    """
    Tensions from effort in load_cells (sensor_msgs/JointState), with the names of the tendons.

    They may share a message or have one each.  The ROS thread writes, any thread reads.
    """

    def __init__(self, node: Node, tendons: Sequence[str], parameters: Mapping[str, Any]) -> None:
        """Subscribe if load_cells.enabled is set; raises ParameterError."""
        self._tendons = tuple(tendons)
        self._enabled: bool = parameters['load_cells.enabled']
        self._parameters = parameters
        self._zeros, self._scales = (
            _per_tendon(name, parameters[name], tendons) if self._enabled else ()
            for name in ('load_cells.zeros', 'load_cells.scales'))
        self._last = {name: (nan, Age()) for name in tendons}  # N
        if 0.0 in self._scales:
            raise ParameterError('parameter load_cells.scales has a 0, which hides every tension; '
                                 'soft_continuum calibrate load_cells finds the scales')
        if self._enabled:
            subscribe(node, JointState, LOAD_CELLS, self._on_message, SENSOR)

    def _on_message(self, message: JointState) -> None:
        for name, effort in zip(message.name, message.effort, strict=False):
            if name in self._last:
                t = self._tendons.index(name)
                self._last[name] = self._scales[t] * (effort - self._zeros[t]), Age.now()

    def tensions(self) -> tuple[float, ...] | None:
        """Return the tension of each tendon, N, nan for a stale cell; None without load cells."""
        if not self._enabled:
            return None
        timeout = self._parameters['stale_timeout']
        return tuple(tension if age.seconds <= timeout else nan
                     for tension, age in map(self._last.__getitem__, self._tendons))


def _per_tendon(name: str, values: Sequence[float], tendons: Sequence[str]) -> tuple[float, ...]:
    if len(values) != len(tendons):
        raise ParameterError(f'parameter {name} has {len(values)} numbers; needed: one for each '
                             f'of {", ".join(tendons)}')
    return tuple(values)
