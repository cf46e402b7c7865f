# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C while a goal is planned: it is not accepted later and moves with nobody there."""

from concurrent.futures import Future
from types import SimpleNamespace

import pytest

from soft_continuum.client import RefusedError
from soft_continuum.client.arm import Arm


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
