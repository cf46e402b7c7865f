# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a recording says of itself: which arm, by which version, with which parameters."""

from concurrent.futures import Future
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
from soft_continuum.recordings.topics import TopicRecorder
from soft_continuum.ros.graph import running_nodes
from soft_continuum.ros.names import CAMERA, DISC_SENSORS, KINEMATICS, NODES
from soft_continuum.text import printable

PARAMETERS = 'parameters.yaml'
"""Attachment: every parameter of every node that ran."""
DISCOVERY = 2.0
"""s in which nodes are found: a recorder that has just started knows their topics before them."""
LOOK_PERIOD = 0.5
"""s between two looks for nodes that are found later."""
ATTACH_TIMEOUT = 10.0
"""s that the end of a recording waits for parameters: without those of its arm none is drawn."""


def about(node: Node) -> dict[str, str]:
    """Return what to begin the recording of an arm with."""
    return {'version': version(), 'namespace': node.get_namespace(),
            'begun': datetime.now().astimezone().isoformat(timespec='seconds')}


async def attach_parameters(requests: Requests, recording: TopicRecorder) -> None:
    """Attach the parameters of the nodes as they are found; log what goes wrong."""
    found: dict[str, Any] = {}
    asked: set[str] = set()
    try:
        await until(lambda: all(running_nodes(requests.node).values()), DISCOVERY)
        while not set(NODES) <= asked:
            ending = recording.ending
            running = running_nodes(requests.node, (*NODES, CAMERA, DISC_SENSORS))
            for name in (name for name, runs in running.items() if runs and name not in asked):
                asked.add(name)
                await _attach_those_of(name, requests, recording, found)
            if ending:
                return
            await until(lambda: recording.ending, LOOK_PERIOD)
    except Exception as error:  # the rest is worth recording without them
        requests.node.get_logger().warning(
            f'the parameters of the nodes are not recorded: {printable(repr(error))}')


async def end_recording(recording: TopicRecorder, attaching: Future[None],
                        requests: Requests) -> None:
    """Close a recording once ``attaching`` is done, in ATTACH_TIMEOUT or without the rest."""
    recording.ending = True
    if not recording.failure and not await until(attaching.done, ATTACH_TIMEOUT):
        requests.node.get_logger().warning(
            f'the parameters of the nodes are not all recorded: no answer in {ATTACH_TIMEOUT:g} s')
    recording.close()


async def _attach_those_of(name: str, requests: Requests, recording: TopicRecorder,
                           found: dict[str, Any]) -> None:
    """Ask a node for its parameters and attach all that are found; the last attached counts."""
    try:
        listed = await requests.call(ListParameters, f'{name}/list_parameters', attempts=ATTEMPTS)
        values = await requests.parameters(name, sorted(listed.result.names))
    except ClientError as error:  # the rest is worth recording without it
        requests.node.get_logger().warning(
            f'the parameters of {name} are not recorded: {printable(str(error))}')
        return
    found[name] = {'ros__parameters': values}
    if name == KINEMATICS:
        arm = {p.name: values[p.name] for p in ARM_PARAMETERS if p.name in values}
        recording.attach(DESCRIPTION, parameters_text(arm, ['The arm that was recorded.']))
    recording.attach(PARAMETERS, yaml.safe_dump(found, default_flow_style=None))
