# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a policy of SROS 2 allows, and what a node does, by full names."""

import re
from xml.etree import ElementTree

from support.ros_rig import Rig

# What an action is made of, as rcl_action names it: of its server. Its client has the reverse.
ACTION = {'publish': ('feedback', 'status'), 'reply': ('send_goal', 'get_result', 'cancel_goal')}


def allowed(text: str, path: str) -> dict[str, set[str]]:
    """Return the full names that an enclave may use by how, as permissions.xsl makes them."""
    enclave = ElementTree.fromstring(text).find(f"./enclaves/enclave[@path='{path}']")
    assert enclave is not None, f'no enclave {path}'
    found: dict[str, set[str]] = {
        how: set() for how in ('publish', 'subscribe', 'reply', 'request')}
    for profile in enclave.iter('profile'):
        space = profile.get('ns', '').rstrip('/')
        for group in profile:
            for how in group.attrib:
                for element in group:
                    name = re.sub('^~', f"{space}/{profile.get('node')}", element.text or '')
                    name = name if name.startswith('/') else f'{space}/{name}'
                    if group.tag != 'actions':
                        found[how].add(name)
                        continue
                    swap = {'publish': 'subscribe', 'reply': 'request'} if how == 'call' else {}
                    for part, ends in ACTION.items():
                        found[swap.get(part, part)] |= {f'{name}/_action/{end}' for end in ends}
    return found


def used(rig: Rig, node: str) -> dict[str, set[str]]:
    """Return the full names that a node uses, as the graph shows them, hidden ones too."""
    get = rig.observer
    return {how: {name for name, _ in ask(node, rig.namespace)} for how, ask in (
        ('publish', get.get_publisher_names_and_types_by_node),
        ('subscribe', get.get_subscriber_names_and_types_by_node),
        ('reply', get.get_service_names_and_types_by_node),
        ('request', get.get_client_names_and_types_by_node))}
