# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Pages of msg_docs and policy of SROS 2 list what running nodes do: no more, no less.

All nodes run at once, as a start of each for each claim would take a minute.
"""

from functools import partial
import re

import pytest
from rclpy.action import (
    get_action_client_names_and_types_by_node,
    get_action_server_names_and_types_by_node,
)

from soft_continuum.ros.description import load_rig
from soft_continuum.ros.names import CAMERA, DISC_SENSORS, RECORDER, SERVO, TELEOP
from soft_continuum.ui.cli.policy import (
    documented_nodes,
    interfaces,
    OF_EVERY_NODE,
    OF_LIFECYCLE_NODES,
    policy,
)
from soft_continuum.user_files import description_file
from support.policies import allowed, used
from support.ros_rig import ALL, DEADLINE

OTHERS = (CAMERA, DISC_SENSORS, RECORDER, SERVO, TELEOP)
LEFT_OUT = {one.name for one in OF_EVERY_NODE} | {'/clock'}
LIFECYCLE = {one.name for one in OF_LIFECYCLE_NODES}


def documented(node, kind, role):
    """Return type by name; without what the recorder subscribes to while it records."""
    return {one.name: one.type for one in interfaces(node)
            if (one.kind, one.role) == (kind, role)
            and not (node == RECORDER and role in ('subscribes', 'calls'))}


def in_graph(rig, node, found):
    """Return type by name as the pages write it."""
    names = {}
    for name, types in found:
        short = name.removeprefix(f'{rig.namespace}/')
        short = re.sub(rf'^{node}/', '~/', short)
        short = re.sub(r'(segment|disc)_\d+', r'\1_N', short)
        short = re.sub(r'^\w+/heartbeat$', 'NODE/heartbeat', short)
        if '/_' not in short and short not in LEFT_OUT:
            names[short] = re.sub('/(msg|srv|action)/', '/', types[0])
    return names


def assert_same(node, kind, on_page, in_graph, rig):
    """Claim that page and graph agree; what every lifecycle node has may be left out."""
    on_page = {name: re.sub('/(msg|srv|action)/', '/', of) for name, of in on_page.items()}

    def found():
        return {name: of for name, of in in_graph().items()
                if name in on_page or name not in LIFECYCLE}

    rig.until(lambda: on_page == found(), DEADLINE)
    assert on_page == found(), (
        f'msg_docs/{node}.md with README.md, {kind}: the pages have the first, the graph')


@pytest.fixture(scope='module')
def suite(module_rig):
    """Return every node of the suite, with load cells, and jams that are not rigid."""
    module_rig.start_arm(load_cells__enabled=True, arm__stiffness_ratios=(10.0,))
    module_rig.start(*OTHERS, ready=False, arm__stiffness_ratios=(10.0,))
    return module_rig


@pytest.mark.parametrize('node', [*ALL, *OTHERS])
def test_the_page_of_a_node_lists_its_topics_services_and_actions(suite, node):
    observer, space = suite.observer, suite.namespace
    for kind, role, found in (
            ('topic', 'publishes', observer.get_publisher_names_and_types_by_node),
            ('topic', 'subscribes', observer.get_subscriber_names_and_types_by_node),
            ('service', 'serves', observer.get_service_names_and_types_by_node),
            ('service', 'calls', observer.get_client_names_and_types_by_node),
            ('action', 'serves', partial(get_action_server_names_and_types_by_node, observer)),
            ('action', 'calls', partial(get_action_client_names_and_types_by_node, observer))):
        assert_same(node, f'{role} {kind}s', documented(node, kind, role),
                    lambda of=found: in_graph(suite, node, of(node, space)), suite)


@pytest.mark.parametrize('node', sorted({*documented_nodes()} - {RECORDER}))
def test_the_policy_of_a_node_is_what_it_does(suite, node):
    may = allowed(policy(load_rig([description_file()]), suite.namespace),
                  f'{suite.namespace}/{node}')
    suite.until(lambda: used(suite, node) == may, DEADLINE)
    assert used(suite, node) == may


def test_there_is_a_page_for_every_node_and_no_other_node():
    assert {*documented_nodes()} == {*ALL, *OTHERS}
