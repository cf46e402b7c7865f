# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans for arms in space end where they should, by the statics that follow their pulls."""

from dataclasses import replace
from math import pi, radians
from pathlib import Path

import numpy as np
import pytest

from soft_continuum.mechanics import Jam
from soft_continuum.mechanics.batch import solve_path
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.nodes.goals import shape_library
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import load_arm, load_description
from soft_continuum.sequencing.arm_port import Observation
from soft_continuum.sequencing.planner import (
    PlanError,
    Planner,
    PlanSettings,
    Shape,
    WHOLE_ARM,
)
from soft_continuum.sequencing.progress import Code, Phase
from soft_continuum.sequencing.runner import Runner
from soft_continuum.sequencing.settings import RunnerSettings
from support.spatial_arms import in_space

CONFIG = Path(__file__).resolve().parents[2] / 'config'
JAMMING, TENDON_ARM = CONFIG / 'spatial_jamming.yaml', CONFIG / 'tendon_arm.yaml'
SETTINGS = PlanSettings()
STRAIGHT = Shape('straight', (0.0, 0.0, 0.0))
ANGLE_ERROR = radians(0.05)
TRIPLES = {JAMMING: [[0, 1, 2]], TENDON_ARM: [[0, 1, 2], [3, 4, 5], [6, 7, 8]]}
CO_CONTRACTION = 0.5  # N: what three opposing tendons may carry at once while they change over


class Followed:
    """A plan for a described arm, from straight, and the states that its pulls lead through."""

    def __init__(self, path, *names):
        self.values = load_description(path, node='shape_sequencer')
        arm, self.settings = arm_from_parameters(self.values), PlanSettings.of(self.values)
        library = shape_library(self.values, arm) | {'straight': STRAIGHT}
        planner, self.statics = Planner(arm, self.settings), SpaceStatics(arm)
        self.plans = planner.plan(self.statics.chain.straight(), [0.0] * len(arm.tendon_names),
                                  [library[name] for name in names])
        self.triples, self.paths, self.ends, state = TRIPLES[path], [], [], None
        for plan in self.plans:
            for move in plan.moves:
                state = state or self.statics.chain.straight()
                soft = [move.segment in (i, WHOLE_ARM) for i in range(3)]
                path = solve_path(self.statics, state, move.pulls, soft)
                self.paths.append((move, state, path))
                state = path[len(move.pulls) - 1]
            self.ends.append(state)

    def wanted(self, plan):
        return bending_vectors(self.statics.chain.arm, plan.shape.bending_angles,
                          plan.shape.bending_directions)


@pytest.fixture(scope='module', params=[JAMMING, TENDON_ARM], ids=lambda path: path.stem)
def followed(request):
    """A helix from straight, and straight again."""
    return Followed(request.param, 'helix', 'straight')


def test_the_pulls_of_a_plan_end_at_the_bending_that_was_asked_for(followed):
    for plan, end in zip(followed.plans, followed.ends, strict=True):
        away = np.linalg.norm(end.bending - followed.wanted(plan), axis=1)
        assert away.max() < ANGLE_ERROR + followed.settings.angle_tolerance
        assert end.bending == pytest.approx(plan.state.bending, abs=1e-4)
    helix = followed.ends[0]
    turned = np.diff(np.unwrap(helix.bending_directions))
    assert np.degrees(turned) == pytest.approx([80.0, 80.0], abs=0.5)  # as the file has it


def test_nothing_jumps_and_no_tension_is_more_than_planned(followed):
    for move, _, path in followed.paths:
        assert not path.jumped.any()
        assert path.tensions.max() <= 1.02 * move.largest_tension + 0.05
        assert move.largest_tension <= followed.settings.tension_limit
        assert move.largest_tension > 0.5  # it does carry


def test_opposing_tendons_do_not_pull_against_each_other(followed):
    for _, _, path in followed.paths:
        for triple in followed.triples:
            assert path.tensions[:, triple].min(axis=1).max() < CO_CONTRACTION


def test_bending_goes_straight_to_its_goal(followed):
    for move, before, path in followed.paths:
        soft = [move.segment in (i, WHOLE_ARM) for i in range(3)]
        for s in np.flatnonzero(soft):
            way = path.bending[-1, s] - path.bending[0, s]
            along = way / np.linalg.norm(way)
            from_start = path.bending[:, s] - path.bending[0, s]
            aside = from_start @ np.array([-along[1], along[0]])
            assert np.abs(aside).max() < radians(1.0)
        for s in np.flatnonzero(np.logical_not(soft)):
            assert path.bending[:, s] == pytest.approx(
                np.tile(before.bending[s], (len(path.bending), 1)), abs=1e-9)


def test_motions_are_within_speed_and_acceleration_and_pull_limits(followed):
    settings = followed.settings
    for move, _, _ in followed.paths:
        speeds = np.diff(move.pulls, axis=0) / np.diff(move.times)[:, None]
        changes = np.diff(speeds, axis=0, prepend=0.0, append=0.0) / move.times[1]
        assert np.abs(speeds).max() <= settings.speed * (1.0 + 1e-6)
        assert np.abs(changes).max() <= settings.acceleration * (1.0 + 1e-6)
        assert settings.pull_limits[0] <= move.pulls.min()
        assert move.pulls.max() <= settings.pull_limits[1]


def test_segments_are_set_from_the_base_and_an_arm_without_jamming_at_once():
    moves = {path: [move.segment for move in Followed(path, 's_form').plans[0].moves]
             for path in (JAMMING, TENDON_ARM)}
    assert moves == {JAMMING: [0, 1, 2], TENDON_ARM: [WHOLE_ARM]}


def coarse(path=JAMMING, turn=0.0, **changes):
    """An arm with fewer bodies, turned about its axis."""
    arm = load_arm(path)
    return replace(arm, bodies_per_segment=4, tendons=tuple(
        replace(tendon, angle=tendon.angle + turn) for tendon in arm.tendons), **changes)


def planned(arm, *shapes, pulls=None, **changes):
    planner = Planner(arm, replace(SETTINGS, **changes))
    start = [0.0] * len(arm.tendon_names) if pulls is None else pulls
    return planner.plan(planner.statics.chain.straight(), start, shapes)


def test_a_turned_arm_and_shape_have_the_same_plan():
    directions, turn = np.array([0.3, 2.0, -1.0]), 0.7
    one, other = (planned(coarse(turn=by), Shape('s', (0.5, 0.4, -0.6), 0.0,
                                                 tuple(directions + by)))[0] for by in (0.0, turn))
    for move, turned in zip(one.moves, other.moves, strict=True):
        assert turned.pulls == pytest.approx(move.pulls, abs=1e-8)
        assert turned.times == pytest.approx(move.times)
    assert np.abs(other.state.tip[:2] - one.state.tip[:2]).max() > 0.01
    assert np.hypot(*other.state.tip[:2]) == pytest.approx(np.hypot(*one.state.tip[:2]))


def test_a_planar_arm_described_in_space_ends_in_the_planned_shape_of_the_plane():
    flat = load_arm(CONFIG / 'manipulator.yaml')
    shapes = [Shape(f'{a}', a) for a in ((0.6, -0.5, 0.4), (0.2, -0.5, -0.7))]
    for one, other in zip(planned(flat, *shapes), planned(in_space(flat), *shapes), strict=True):
        assert other.state.poses[:, :3] == pytest.approx(one.state.poses[:, :3], abs=2e-5)
        for move, there in zip(one.moves, other.moves, strict=True):
            assert move.segment == there.segment
            # Between the points of the plan both are interpolated, of their own paths.
            assert there.pulls[-1] == pytest.approx(move.pulls[-1], abs=2e-5)


def test_a_direction_turned_by_half_a_turn_is_a_negative_angle():
    one, other = (planned(coarse(), Shape('s', (angle, 0.0, 0.0), 0.0, (towards, 0.0, 0.0)))[0]
                  for angle, towards in ((0.4, 0.9 + pi), (-0.4, 0.9)))
    assert one.moves[0].pulls == pytest.approx(other.moves[0].pulls, abs=1e-9)


@pytest.mark.parametrize('changes, words', [
    ({'tension_limit': 1.0}, 'tension_limit: 1 N'),
    ({'pull_limits': (-0.005, 0.06)}, 'pull_limits: -0.005 to 0.06 m')])
def test_what_is_beyond_a_limit_is_refused(changes, words):
    with pytest.raises(PlanError, match=words) as refused:
        planned(coarse(), Shape('bow', (0.6, 0.0, 0.0), 0.0, (1.0, 0.0, 0.0)), **changes)
    assert str(refused.value).startswith('bow: segment 1 to 34.4 degrees in the direction 57.3')


def test_more_bendings_than_tendons_are_refused():
    with pytest.raises(PlanError, match='6 bendings cannot be chosen with 3 tendons'):
        planned(coarse(), Shape('bow', (0.2, 0.2, 0.2)), jamming=False)


def test_an_upright_arm_may_lean_within_the_slack_of_its_tendons():
    planner = Planner(coarse(), SETTINGS)
    chain = planner.statics.chain
    turns = np.random.default_rng(0).normal(0.0, 1e-4, (chain.bodies, 3)) * [1.0, 1.0, 0.0]
    nearly = chain.state_of(turns, turns, (True,) * 3)  # as an arm that was straightened is
    assert planner.statics.solve(nearly, [-1e-4] * 3, [True, False, False]).jumped
    plan, = planner.plan(nearly, [-1e-4] * 3, [Shape('bow', (0.5, 0.0, 0.0), 0.0, (2.0,) * 3)])
    assert plan.state.bending_angles == pytest.approx([0.5, 0.0, 0.0], abs=0.01)


def test_an_arm_that_nothing_bends_has_tendons_that_are_just_slack():
    bow = Shape('bow', (0.0, 0.4, 0.0), 0.0, (2.0,) * 3)
    assert planned(coarse(), bow, STRAIGHT)[1].moves[-1].pulls[-1] == pytest.approx(-1e-4)


def test_the_jams_of_a_plan_have_the_vacuum_that_they_have():
    arm = coarse()
    arm = replace(arm, segments=tuple(replace(s, jam=Jam(8.0)) for s in arm.segments))
    planner, part = Planner(arm, SETTINGS), (0.5,) * 3
    start = replace(planner.statics.chain.straight(), vacuum=part)
    goal = bending_vectors(arm, (0.0, 0.5, 0.0), (1.0,) * 3)
    move, end = planner.move(start, np.zeros(3), 1, goal)
    state = start
    for pulls in move.pulls:
        state = planner.statics.solve(state, pulls, (False, True, False), vacuum=part)
    assert state.bending == pytest.approx(end.bending, abs=1e-4)
    assert state.bending_angles[1] == pytest.approx(0.5, abs=ANGLE_ERROR)


def test_softening_what_nothing_holds_is_refused():
    with pytest.raises(PlanError, match='goes over to another shape: its tendons do not hold it'):
        planned(coarse(payload=1.0), Shape('bow', (0.2, 0.0, 0.0)), pulls=(-0.02,) * 3)


def test_a_plan_that_is_not_wanted_any_more_ends():
    arm = coarse()
    planner = Planner(arm, SETTINGS, lambda: True)
    with pytest.raises(PlanError, match='abandoned'):
        planner.plan(planner.statics.chain.straight(), [0.0] * 3, [Shape('bow', (0.2, 0.0, 0.0))])


# The state machine of an arm without jamming.


class Tendons:
    """Nine tendons that are where they were sent last; nothing can be switched."""

    def __init__(self):
        self.pulls, self.holds, self.sent = (0.0,) * 9, 0, []

    def set_stiff(self, segment, stiff):
        raise AssertionError(f'segment {segment} of an arm without jamming was switched')

    def follow(self, motion, start, times, pulls):
        self.sent.append(start + times[0])
        self.pulls = tuple(pulls[-1])

    def hold(self):
        self.holds += 1


def run_of(tendons, **settings):
    values = load_description(TENDON_ARM, node='shape_sequencer')
    planner = Planner(arm_from_parameters(values), PlanSettings.of(values))

    def plan(shapes):
        from concurrent.futures import Future
        future = Future()
        future.set_result(planner.plan(
            planner.statics.chain.straight(), tendons.pulls, shapes))
        return future
    return Runner([Shape('bow', (0.8, 0.5, 0.4))], plan, tendons,
                  RunnerSettings(jamming=False, **settings), tuple('abcdefghi'))


def tick(runner, tendons, until, cancel_at=None):
    """Tick every 50 ms; return the phases seen."""
    phases, now = [], 0.0
    while runner.outcome is None and now < until:
        runner.tick(now, Observation(tendons.pulls, False, (False,) * 3, (float('nan'),) * 3))
        phases.append((runner.progress.phase, runner.progress.segment))
        now += 0.05
        if cancel_at is not None and phases[-1][0] == Phase.MOVING and now > cancel_at:
            runner.cancel(Code.CANCELED, 'canceled')
    return phases


def test_an_arm_without_jamming_moves_as_a_whole_and_switches_nothing():
    tendons = Tendons()
    runner = run_of(tendons, piece_period=0.2)
    phases = set(tick(runner, tendons, 60.0))
    assert runner.outcome.code is Code.SUCCESSFUL
    assert phases <= {(Phase.PREPARING, 0), (Phase.MOVING, 0), (Phase.HOLDING, 0)}
    assert (Phase.MOVING, 0) in phases
    assert len(tendons.sent) > 2
    assert np.diff(tendons.sent).min() > 0.1  # pieces are not sent with every tick


def test_a_canceled_run_of_an_arm_without_jamming_holds_the_tendons():
    tendons = Tendons()
    runner = run_of(tendons)
    phases = tick(runner, tendons, 60.0, cancel_at=0.2)
    assert runner.outcome.code is Code.CANCELED
    assert tendons.holds == 1
    assert Phase.STIFFENING not in {phase for phase, _ in phases}
