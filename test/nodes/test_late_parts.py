# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A motion that comes late, in whole or in part, is later and has the path that was planned."""

import pytest

from soft_continuum.hardware import tendon_controller
from support.steered_tendons import PATH, PERIOD, Steered

MAX_DELAY = tendon_controller.MAX_DELAY


@pytest.fixture
def steered(monkeypatch: pytest.MonkeyPatch) -> Steered:
    return Steered(monkeypatch)


@pytest.mark.parametrize('late', [0.0, 0.3, 2.0])
def test_a_motion_that_comes_late_keeps_its_path(steered: Steered, late: float) -> None:
    steered.now += late
    steered.send(0.0, 1.0)
    steered.go_on(1.5)
    steered.assert_path_kept()


@pytest.mark.parametrize('late', [0.0, 0.3])
@pytest.mark.parametrize('gap', [0.2, 0.5, 0.9, 3.0])
def test_a_part_that_comes_late_goes_on_where_the_one_before_it_ends(
        steered: Steered, late: float, gap: float) -> None:
    steered.now += late
    steered.send(0.0, 0.5)
    steered.go_on(gap)
    steered.send(0.4, 1.0)
    steered.go_on(2.0)
    steered.assert_path_kept()


@pytest.mark.parametrize('busy', [0.1, 0.4, 0.9])
def test_a_part_that_is_judged_while_a_cycle_is_due_keeps_the_path(
        steered: Steered, busy: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tendon_controller, 'MAX_DELAY', MAX_DELAY)  # as for a user
    steered.send(0.0, 0.5)
    steered.go_on(0.3)
    steered.now += busy  # no cycle came: a busy computer
    steered.send(0.4, 0.5)  # no longer than what was sent, such as the last one
    steered.send(0.4, 1.0)
    steered.go_on(2.0)
    steered.assert_path_kept()


def test_of_a_trajectory_without_an_id_points_that_are_past_are_left_out(
        steered: Steered) -> None:
    steered.now += 0.5
    steered.send(0.0, 1.0, motion='')
    steered.go_on(0.5 + 3 * PERIOD)
    assert steered.pulls[-1] == pytest.approx(PATH[-1], abs=1e-5)
