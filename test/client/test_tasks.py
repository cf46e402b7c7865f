# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What nobody waits for any more is withdrawn, and nothing else is."""

from unittest.mock import Mock

import pytest
from std_srvs.srv import Trigger

from soft_continuum.client.errors import ClientError
from soft_continuum.client.tasks import Tasks

STOP = 'tendon_actuation/stop'


def step(call):
    """Let a call see whether its answer has come; return that."""
    try:
        return call.send(None)
    except StopIteration as end:
        return end.value


def test_a_call_that_fails_withdraws_no_request_of_another_one():
    node, futures = Mock(), []
    node.get_node_names_and_namespaces.return_value = []

    def call_async(_):
        futures.append(Mock())
        futures[-1].done.return_value = False
        return futures[-1]
    node.create_client.return_value.call_async = call_async
    tasks = Tasks(node, 0.0, 1.0)
    first, second = tasks.call(Trigger, STOP), tasks.call(Trigger, STOP, within=100.0)
    step(second)
    with pytest.raises(ClientError):
        step(first)
    node.destroy_client.assert_not_called()
    futures[0].done.return_value = True
    assert step(second) is futures[0].result()
    with pytest.raises(ClientError):
        step(tasks.call(Trigger, STOP))
    node.destroy_client.assert_called_once()
