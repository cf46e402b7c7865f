# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a recording says of itself: which arm, by which version, with which parameters."""

from collections.abc import Callable
from datetime import datetime
from typing import Any

from rcl_interfaces.srv import ListParameters
from rclpy.node import Node
import yaml

from soft_continuum import version
from soft_continuum.analysis.recording import DESCRIPTION
from soft_continuum.client.errors import ClientError
from soft_continuum.client.requests import Requests
from soft_continuum.client.tasks import ATTEMPTS, until
from soft_continuum.parameters.arm import ARM_PARAMETERS
from soft_continuum.parameters.files import parameters_text
from soft_continuum.ros.names import CAMERA, DISC_SENSORS, KINEMATICS, NODES, running_nodes
from soft_continuum.text import printable

PARAMETERS = 'parameters.yaml'
"""Attachment: every parameter of every node that ran."""
DISCOVERY = 2.0
"""s in which nodes are found: a recorder that has just started knows their topics before them."""


def about(node: Node) -> dict[str, str]:
    """Return what to begin the recording of an arm with."""
    return {'version': version(), 'namespace': node.get_namespace(),
            'begun': datetime.now().astimezone().isoformat(timespec='seconds')}


async def attach_parameters(requests: Requests, attach: Callable[[str, str], None]) -> None:
    """Attach the parameters of the nodes that run; what goes wrong is logged."""
    try:
        await _attach_parameters(requests, attach)
    except Exception as error:  # the rest is worth recording without them
        requests.node.get_logger().warning(
            f'the parameters of the nodes are not recorded: {printable(repr(error))}')


async def _attach_parameters(requests: Requests, attach: Callable[[str, str], None]) -> None:
    found: dict[str, Any] = {}
    await until(lambda: all(running_nodes(requests.node).values()), DISCOVERY)
    running = running_nodes(requests.node, (*NODES, CAMERA, DISC_SENSORS))
    for name in (name for name, runs in running.items() if runs):
        try:
            listed = await requests.call(
                ListParameters, f'{name}/list_parameters', attempts=ATTEMPTS)
            values = await requests.parameters(name, sorted(listed.result.names))
        except ClientError as error:  # the rest is worth recording without it
            requests.node.get_logger().warning(
                f'the parameters of {name} are not recorded: {printable(str(error))}')
            continue
        found[name] = {'ros__parameters': values}
        if name == KINEMATICS:
            arm = {p.name: values[p.name] for p in ARM_PARAMETERS if p.name in values}
            attach(DESCRIPTION, parameters_text(arm, ['The arm that was recorded.']))
    if found:
        attach(PARAMETERS, yaml.safe_dump(found, default_flow_style=None))
