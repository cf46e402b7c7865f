# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A difference between measured and predicted tension is told when it lasts, and only then."""

from math import nan

import pytest

from soft_continuum.nodes.measurements import REPORT_DELAY, TensionCheck

NAMES = ('right_tendon', 'left_tendon')
TOLERANCES = (5.0, 5.0)


@pytest.mark.parametrize('tendon', NAMES)
@pytest.mark.parametrize(('seen', 'model', 'words'), [
    (20.0, 10.0, 'friction'), (4.0, 10.0, 'friction'), (0.5, 10.0, 'slack'), (-9.0, 10.0, 'sign'),
    (14.9, 10.0, ''), (5.1, 10.0, ''), (nan, 10.0, ''), (20.0, nan, ''), (None, 10.0, '')])
def test_what_differs_for_long_is_told_with_its_tendon(tendon, seen, model, words):
    check = TensionCheck(NAMES)
    other = NAMES[1 - NAMES.index(tendon)]
    measured = {other: 2.0} | ({} if seen is None else {tendon: seen})
    by_model = [model if name == tendon else 2.0 for name in NAMES]
    assert check.problem(100.0, measured, by_model, TOLERANCES) == ''
    assert check.problem(100.0 + 0.99 * REPORT_DELAY, measured, by_model, TOLERANCES) == ''
    problem = check.problem(100.0 + 1.01 * REPORT_DELAY, measured, by_model, TOLERANCES)
    assert words in problem
    assert bool(problem) is bool(words)
    assert (tendon in problem) is bool(words)
    assert other not in problem


def test_what_comes_and_goes_is_not_told_and_what_is_over_is_forgotten():
    check, model = TensionCheck(NAMES), [10.0, 10.0]
    for second in range(20):
        seen = dict.fromkeys(NAMES, 20.0 if second % 2 else 10.0)
        assert check.problem(float(second), seen, model, TOLERANCES) == ''
    wrong, right = dict.fromkeys(NAMES, 20.0), dict.fromkeys(NAMES, 10.0)
    check.problem(30.0, wrong, model, TOLERANCES)
    told = check.problem(33.0, wrong, model, TOLERANCES)
    assert all(name in told for name in NAMES)
    assert check.problem(33.1, dict.fromkeys(NAMES, 20.5), model, TOLERANCES) == told
    torn = check.problem(33.15, dict.fromkeys(NAMES, 0.0), model, TOLERANCES)
    assert torn.count('slack') == 2
    assert check.problem(33.2, right, model, TOLERANCES) == ''
    assert check.problem(33.3, wrong, model, TOLERANCES) == ''
