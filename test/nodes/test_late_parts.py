# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A late motion, or part of one, keeps its path; and late states of other nodes refuse none."""

from contextlib import nullcontext
from unittest.mock import Mock

import numpy as np
import pytest

from soft_continuum.hardware import tendon_controller
from soft_continuum.hardware.tendon_controller import MotionRefusedError, Reason
from soft_continuum.nodes import tendon_actuation
from soft_continuum.nodes.tendon_actuation import TendonActuation
from support.steered_tendons import PATH, PERIOD, Steered

MAX_DELAY = tendon_controller.MAX_DELAY


@pytest.fixture
def steered(monkeypatch):
    return Steered(monkeypatch)


@pytest.mark.parametrize('late', [0.0, 0.3, 2.0])
def test_a_motion_that_comes_late_keeps_its_path(steered, late):
    steered.now += late
    steered.send(0.0, 1.0)
    steered.go_on(1.5)
    steered.assert_path_kept()


@pytest.mark.parametrize('late', [0.0, 0.3])
@pytest.mark.parametrize('gap', [0.2, 0.5, 0.9, 3.0])
def test_a_part_that_comes_late_goes_on_where_the_one_before_it_ends(steered, late, gap):
    steered.now += late
    steered.send(0.0, 0.5)
    steered.go_on(gap)
    steered.send(0.4, 1.0)
    steered.go_on(2.0)
    steered.assert_path_kept()


@pytest.mark.parametrize('busy', [0.1, 0.4, 0.9])
def test_a_part_that_is_judged_while_a_cycle_is_due_keeps_the_path(steered, busy, monkeypatch):
    monkeypatch.setattr(tendon_controller, 'MAX_DELAY', MAX_DELAY)  # as for a user
    steered.send(0.0, 0.5)
    steered.go_on(0.3)
    steered.now += busy  # no cycle came: a busy computer
    steered.send(0.4, 0.5)  # no longer than what was sent, such as the last one
    steered.send(0.4, 1.0)
    steered.go_on(2.0)
    steered.assert_path_kept()


def test_of_a_trajectory_without_an_id_points_that_are_past_are_left_out(steered):
    steered.now += 0.5
    steered.send(0.0, 1.0, motion='')
    steered.go_on(0.5 + 3 * PERIOD)
    assert steered.pulls[-1] == pytest.approx(PATH[-1], abs=1e-5)


@pytest.mark.parametrize(('arrives', 'refused'), [
    ('allowed', False), ('refused', True), ('', True)])
def test_only_a_shape_from_after_a_trajectory_arrived_refuses_it(arrives, refused, monkeypatch):
    begin, model, tried = 10.0, Mock(offsets=0.0), []
    arm = Mock(agreed=True, stiffness='old', timeout=5.0, shape_and_model=('refused', model),
               jammed=lambda stiffness: (stiffness == 'old',))

    def check(pulls, shape, *_):
        tried.append((shape, arm.stiffness))
        if shape == 'refused':
            raise MotionRefusedError(Reason.TENSION, 'too much')

    node = Mock(_arm=arm, _prediction=Mock(check=check), _shape_time=begin - 0.1,
                parameters={'tension_limit': 60.0, 'co_contraction_limit': 5.0})
    clock = Mock(return_value=begin)

    def sleep(seconds):
        clock.return_value += seconds
        if arrives:
            arm.stiffness, arm.shape_and_model = 'new', (arrives, model)
            node._shape_time = clock.return_value

    clock.sleep = sleep
    monkeypatch.setattr(tendon_actuation, 'STEADY', clock)
    expected = pytest.raises(MotionRefusedError) if refused else nullcontext()
    with expected:
        assert TendonActuation._predict(
            node, np.zeros((2, 2)), begin, lambda: False) == arm.stiffness
    assert tried == [('refused', 'old')] + [(arrives, 'new')] * bool(arrives)
    assert clock.return_value <= begin + arm.timeout + 0.1
