# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The guard of a plan tells once that it failed, and whether it has looked at a plan."""

from math import inf
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import pytest

from soft_continuum.mechanics.chain import Chain
from soft_continuum.planning.plan_watch import PlanGuard
from soft_continuum.planning.plans import PlannedStep, Shape, ShapePlan
from soft_continuum.ros.description import load_arm

ARM = load_arm(Path(__file__).parents[2] / 'config' / 'manipulator.yaml')
STATE = Chain(ARM).straight()
PLAN = ShapePlan(Shape('straight', (0.0,) * 3), (), STATE,
                 (PlannedStep((STATE,), inf, '', 0.0, 0.0),))


def guard(clearances):
    around = SimpleNamespace(obstacles=('one',), clearances=clearances)
    return PlanGuard({'obstacles.margin': 0.005, 'reach.max_deviation': 0.02}, lambda: around)


def test_a_look_that_fails_is_told_once_so_that_the_run_can_be_wound_down():
    def fail(states):
        raise MemoryError

    watching = guard(fail)
    watching.problems(PLAN, 0, STATE)
    watching.close()  # waits for the look
    with pytest.raises(MemoryError):
        watching.problems(PLAN, 0, STATE)
    assert watching.problems(PLAN, 0, STATE)[:2] == ('', '')


def test_a_plan_is_unseen_until_its_states_were_looked_at():
    go = Event()
    watching = guard(lambda states: go.wait() and [SimpleNamespace(distance=1.0, obstacle='one')])
    assert watching.problems(PLAN, 0, STATE) == ('', '', True)
    go.set()
    watching.close()
    assert watching.problems(PLAN, 0, STATE) == ('', '', False)
    assert watching.problems(None, 0, STATE) == ('', '', False)
