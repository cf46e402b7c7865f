# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A tendon beyond its limits can come back, and go no further.

A measured tension beyond the limit ends a motion, whichever tendon it is.
"""

from math import inf, nan

import numpy as np
import pytest

from soft_continuum.hardware.protocols import check_limits, HardwareError, MAX_AHEAD, TendonReading
from soft_continuum.hardware.tendon_controller import TensionGuard

NARROW = (-0.01, 0.01)  # m
NAMES = ('right_tendon', 'left_tendon')


@pytest.mark.parametrize(('pull', 'present', 'allowed'), [
    (0.01, 0.0, True), (0.0101, 0.0, False), (-0.0101, 0.0, False),
    (0.02, 0.02, True), (0.02 + 0.9 * MAX_AHEAD, 0.02, True), (0.021, 0.02, False),
    (-0.01, 0.02, True), (-0.0101, 0.02, False), (0.01, -0.02, True), (-0.021, -0.02, False)])
def test_a_tendon_may_be_sent_within_its_limits_and_wherever_is_no_further(pull, present, allowed):
    def check():
        check_limits(NAMES, (0.0, pull), (0.0, present), NARROW)

    if allowed:
        check()
    else:
        with pytest.raises(HardwareError, match='left_tendon'):
            check()


# Tensions

LIMIT = 60.0


def reading(*tensions):
    return TendonReading((0.0, 0.0), (0.0, 0.0), referenced=True, tensions=tensions or None)


def after(begin, now):
    guard = TensionGuard(NAMES)
    guard.begin(begin)
    return guard.problem(now, LIMIT)


@pytest.mark.parametrize('order', [(0, 1), (1, 0)])
@pytest.mark.parametrize(('begin', 'now', 'ends'), [
    (0.0, 59.9, False), (0.0, 61.0, False), (0.0, 61.3, True), (0.0, 1e6, True), (0.0, inf, True),
    (80.0, 79.0, False), (80.0, 81.0, False), (80.0, 81.3, True), (nan, 10.0, False),
    (nan, 70.0, True)])
def test_more_than_the_limit_and_more_than_it_began_with_ends_it(begin, now, ends, order):
    first, second = ([(value, 5.0)[i] for i in order] for value in (begin, now))
    problem = after(reading(*first), reading(*second))
    assert bool(problem) is ends
    if ends:
        assert NAMES[order[0]] in problem


def test_what_was_let_go_is_not_pulled_again_beyond_the_limit():
    guard = TensionGuard(NAMES)
    guard.begin(reading(80.0, 0.0))
    assert not guard.problem(reading(10.0, 0.0), LIMIT)
    assert guard.problem(reading(70.0, 0.0), LIMIT)


@pytest.mark.parametrize('t', [0, 1])
def test_a_tendon_beyond_the_limit_may_only_be_paid_out(t):
    guard, tensions, pulls = TensionGuard(NAMES), [5.0, 5.0], np.zeros((2, 2))
    tensions[t] = 70.0
    pulls[:, 1 - t] = 0.01
    assert not guard.refusal(reading(*tensions), pulls, LIMIT)
    pulls[1, t] = -0.01
    assert not guard.refusal(reading(*tensions), pulls, LIMIT)
    pulls[1, t] = 0.001
    assert NAMES[t] in guard.refusal(reading(*tensions), pulls, LIMIT)


@pytest.mark.parametrize('t', [0, 1])
@pytest.mark.parametrize(('shown', 'words'), [
    (nan, 'is not measured'), (inf, 'is not measured'), (-200.0, 'cannot push'),
    (-0.5, ''), (0.0, ''), (100.0, '')])
def test_a_cell_that_tells_nothing_or_what_cannot_be_is_named(t, shown, words):
    tensions = [5.0, 5.0]
    tensions[t] = shown
    problem = TensionGuard(NAMES).unmeasured(reading(*tensions), LIMIT)
    assert words in problem
    assert (NAMES[t] in problem) is bool(words)


def test_without_load_cells_there_is_nothing_to_guard():
    assert after(reading(), reading()) == ''
    assert TensionGuard(NAMES).unmeasured(reading(), LIMIT) == ''


def test_a_cell_that_appears_in_motion_counts():
    assert after(reading(), reading(70.0, 0.0))
