# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The tare of all sensors of the arm."""

from typing import TYPE_CHECKING

from soft_continuum.client.errors import NodesMissingError
from soft_continuum.client.tasks import until

if TYPE_CHECKING:
    from soft_continuum.client.requests import Requests

SERVICE = 'tare'


async def tare(requests: 'Requests') -> dict[str, str]:
    """Call ~/tare of every node that has it; return the responses by node, as Arm.tare."""
    node = requests.node
    space = f'{node.get_namespace().rstrip("/")}/'

    def nodes() -> list[str]:
        found = [name.removeprefix(space).split('/')
                 for name, _ in node.get_service_names_and_types() if name.startswith(space)]
        return sorted(parts[0] for parts in found if parts[1:] == [SERVICE])

    if not await until(nodes, requests.discovery_timeout):
        raise NodesMissingError(f'no node that can be tared runs in namespace {space}: neither a '
                                'camera nor disc_sensors')
    return {name: await requests.trigger(f'{name}/{SERVICE}') for name in nodes()}
