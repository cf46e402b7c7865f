# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans that were shown are run unless something has changed, and are watched while they run."""

from dataclasses import replace
from math import inf
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest

from soft_continuum.mechanics.chain import Chain
from soft_continuum.nodes import planning as nodes_planning
from soft_continuum.nodes.planning import Planning
from soft_continuum.planning.obstacles import Box, CollisionScene, Obstacle
from soft_continuum.planning.plan_watch import KeptPlans, PlanGuard
from soft_continuum.planning.planner import Planner
from soft_continuum.planning.plans import PlanError, PlannedStep, Shape, ShapePlan, TipGoal
from soft_continuum.planning.reach import ReachSettings
from soft_continuum.planning.shape_plans import plan_shapes
from soft_continuum.ros.estimates import Model
from soft_continuum.ros.names import SHAPE_SEQUENCER
from soft_continuum.ros.parameter_table import NODE_PARAMETERS
from soft_continuum.sequencing.runner import Observation
from support.virtual_rig import ARM, PLAN_SETTINGS

TIP = Shape('tip', (), 1.0, tips=(TipGoal(np.array((0.15, 0.0, 0.22))),))
BOW = Shape('bow', (0.3, 0.2, 0.1), 0.5)
SHAPES = [TIP, BOW]
SITUATION = 7, 'obstacles'
TOLERANCE = 1e-3  # rad


@pytest.fixture(scope='module')
def found():
    planner = Planner(ARM, PLAN_SETTINGS)
    return list(plan_shapes(planner, planner.statics.chain.straight(), (0.0, 0.0), SHAPES,
                            CollisionScene(ARM), ReachSettings(time_limit=np.inf), first=True))


@pytest.fixture
def kept(found):
    plans = KeptPlans()
    plans.keep(SITUATION, Planner(ARM, PLAN_SETTINGS).statics.chain.straight(), (0.0, 0.0),
               SHAPES, found)
    return plans


def find(kept, shapes, situation=SITUATION, bending=((0.0, 0.0),) * 3, pulls=(0.0, 0.0),
         take=False):
    return kept.find(situation, np.array(bending), lambda begin: np.allclose(begin, pulls),
                     shapes, TOLERANCE, take)


def test_the_same_shapes_from_the_same_place_have_the_plans_that_were_kept(kept, found):
    assert [one.found for one in find(kept, SHAPES)] == found


def test_a_later_shape_has_its_plan_from_where_the_one_before_it_ends(kept, found):
    before = found[0].plan
    begin = {'bending': before.state.bending, 'pulls': before.moves[-1].pulls[-1]}
    assert find(kept, [BOW], **begin)[0].found is found[1]
    assert not find(kept, [BOW])
    assert not find(kept, [TIP], **begin)


@pytest.mark.parametrize('change', [
    {'situation': (8, 'obstacles')}, {'bending': ((0.0, 0.0), (0.0, 0.002), (0.0, 0.0))},
    {'pulls': (0.001, 0.0)}])
def test_nothing_is_found_once_something_has_changed(kept, change):
    assert find(kept, [TIP]) and not find(kept, [TIP], **change)


@pytest.mark.parametrize('shapes', [
    [BOW], [TIP, TIP], [*SHAPES, BOW], [replace(TIP, vacuums=(8e4,) * 3)],
    [replace(TIP, tips=(TipGoal(np.array((0.15, 0.0, 0.221))),))],
    [replace(TIP, tips=(replace(TIP.tips[0], position_tolerance=2e-3),))]])
def test_nothing_is_found_for_other_shapes(kept, shapes):
    assert not find(kept, shapes)


def test_a_plan_that_was_taken_is_not_taken_again_and_the_others_are_still_there(kept, found):
    assert find(kept, [TIP], take=True) and not find(kept, [TIP])
    before = found[0].plan
    assert find(kept, [BOW], bending=before.state.bending, pulls=before.moves[-1].pulls[-1])


def test_a_plan_that_does_not_get_there_is_not_kept(kept, found):
    kept.keep(SITUATION, found[0].plan.state, (0.0, 0.0), [TIP],
              [replace(found[0], why='out of reach')])
    assert not find(kept, [TIP])


@pytest.fixture
def planning():
    model = Model(Chain(ARM), np.zeros(2), np.zeros(2))
    straight, scene = model.chain.straight(), CollisionScene(ARM)
    rests = Observation((0.0, 0.0), False, (True,) * 3, (80e3,) * 3)
    observed = SimpleNamespace(
        tendons=SimpleNamespace(stops=0), shape=straight, pulls=(0.0, 0.0),
        shape_and_model=(straight, model), observation=lambda *_: rests)
    parameters = {p.name: p.default for p in NODE_PARAMETERS[SHAPE_SEQUENCER]}
    parameters['reach.states'] = 1500
    planning = Planning(ARM, parameters, observed, lambda: planning.around, print)
    planning.parameters, planning.observed, planning.around = parameters, observed, scene
    yield planning
    planning.close()


def moves_of(plans):
    return plans.result()[0].moves


@pytest.mark.parametrize('shape', SHAPES)
def test_names_and_hold_times_are_those_that_are_asked_for(planning, shape):
    planning.plan([shape], first=True).result()
    plan, = planning.plan([replace(shape, name='other', hold_time=9.0)]).result()
    assert (plan.shape.name, plan.shape.hold_time) == ('other', 9.0)


def test_a_shape_by_angles_is_planned_once_to_be_accepted_and_run(planning):
    accepted = moves_of(planning.plan([BOW], first=True))
    assert moves_of(planning.plan([BOW])) is accepted
    assert moves_of(planning.plan([BOW])) is not accepted  # on its way it is planned again


def test_whoever_was_shown_a_plan_is_not_warned_again_when_it_is_run(planning, monkeypatch):
    def cut_short(*_):
        yield replace(next(plan_shapes(*_)), cut_short=True)

    plan_shapes, warnings = nodes_planning.plan_shapes, []
    monkeypatch.setattr(nodes_planning, 'plan_shapes', cut_short)
    monkeypatch.setattr(planning, '_warn', warnings.append)
    planning.explain([BOW], 0.0, 0).result()
    planning.plan([BOW], first=True).result()
    planning.plan([BOW]).result()
    assert len(warnings) == 1


def test_each_goal_is_checked_by_a_plan_of_its_own(planning):
    accepted = moves_of(planning.plan([BOW], first=True))
    assert moves_of(planning.plan([BOW], first=True)) is not accepted


def test_the_search_that_accepted_a_goal_of_the_tip_goes_on_to_the_plan_that_is_run(
        planning, monkeypatch):
    planning.around = CollisionScene(ARM, [
        Obstacle('wall', Box((0.02, 0.2, 0.02)), (0.05, 0.0, 0.32))])
    accepted = moves_of(planning.plan([TIP], first=True))
    monkeypatch.setattr(nodes_planning, 'plan_shapes', None)  # it is not planned once more
    run = moves_of(planning.plan([TIP]))
    monkeypatch.undo()
    best = moves_of(planning.plan([TIP]))  # on its way it is planned again, all of it
    assert run is not best and pulls_of(run) == pulls_of(best) != pulls_of(accepted)


def pulls_of(moves):
    return [move.pulls.tolist() for move in moves]


def test_a_search_that_goes_on_is_abandoned_like_any_other(planning):
    planning.parameters['reach.states'] = 100_000_000
    planning.plan([TIP], first=True).result()
    plans = planning.plan([TIP])
    planning.abandon()
    with pytest.raises(PlanError, match='abandoned'):
        plans.result()


def test_a_search_is_given_up_when_something_has_changed_since_the_goal_was_accepted(planning):
    planning.plan([TIP], first=True).result()
    planning.observed.tendons.stops += 1
    planning.parameters['reach.states'] = 10
    with pytest.raises(PlanError, match='too small'):
        planning.plan([TIP]).result()


# While a plan runs.

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
