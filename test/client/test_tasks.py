# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What nobody waits for any more is withdrawn, and nothing else is."""

from concurrent.futures import Future
from types import SimpleNamespace
from unittest.mock import Mock

import pytest
from std_srvs.srv import Trigger

from soft_continuum.client import RefusedError
from soft_continuum.client.arm import Arm
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


class Interrupted(Future):
    """The answer to a goal; Ctrl-C comes when it is first waited for."""

    came = False

    def result(self, timeout=None):
        if not self.came:
            self.came = True
            raise KeyboardInterrupt
        return super().result(timeout)


class Sequence:
    """One that was accepted; calls: what was asked of it."""

    def __init__(self):
        self.calls, self.done = [], False

    def cancel(self):
        self.calls.append('cancel')

    def result(self, timeout):
        self.calls.append('result')


def arm_of(answer):
    arm = Arm.__new__(Arm)
    arm._sequences = []
    arm._requests = SimpleNamespace(start=lambda work: answer, send=lambda *goal: None)
    return arm


def test_a_goal_that_is_accepted_after_ctrl_c_is_canceled():
    answer, sequence = Interrupted(), Sequence()
    answer.set_result(sequence)
    with pytest.raises(KeyboardInterrupt):
        arm_of(answer).start('c_form')
    assert sequence.calls == ['cancel', 'result']


def test_a_goal_that_is_refused_after_ctrl_c_leaves_nothing_to_do():
    answer = Interrupted()
    answer.set_exception(RefusedError('out of reach'))
    with pytest.raises(KeyboardInterrupt):
        arm_of(answer).start('c_form')
