# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes held with less than the full vacuum: set stiff, then relaxed to the wanted angles."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics import Jam, Statics
from soft_continuum.mechanics.arm import mounted
from soft_continuum.planning.obstacles import CollisionScene, Obstacle, Sphere
from soft_continuum.planning.plan_watch import PlanWatch
from soft_continuum.planning.planner import Planner
from soft_continuum.planning.plans import PlanError, Shape, TipGoal
from soft_continuum.planning.reach import ReachSettings
from soft_continuum.planning.settings import ABORT
from soft_continuum.planning.shape_plans import plan_shapes, plans_to
from soft_continuum.ros.description import load_arm
from soft_continuum.sequencing import Code, Phase
from soft_continuum.sequencing.runner import Failure
from soft_continuum.user_files import description_file
from support.measured_rig import LOOP, MeasuredRig, OffsetStatics
from support.virtual_rig import (
    asked_to_soften,
    PLAN_SETTINGS,
    reaches,
    RUNNER_SETTINGS,
    VirtualRig,
)

DEGREE = np.radians(1.0)
VACUUMS = (30e3, 80e3, 60e3)


def jammed(ratio=10.0):
    """The paper's arm, lying, with a law for its jams, of few bodies."""
    arm = load_arm(description_file())
    return replace(arm, bodies_per_segment=4, gravity=mounted(1.2), segments=tuple(
        replace(segment, jam=Jam(ratio)) for segment in arm.segments))


ARM = jammed()
LOWERED = [i for i, vacuum in enumerate(VACUUMS, start=1) if vacuum < 80e3]
HELD = Shape('held', (0.3, 0.2, -0.2), 0.5, vacuums=VACUUMS)
STIFF = Shape('stiff', (0.1, 0.2, 0.1), 0.2)
WEAK = replace(HELD, vacuums=(20e3, 20e3, 20e3))
SETTINGS = ReachSettings(margin=0.005, lock_in=0.0, time_limit=np.inf)


def plan(arm, shape):
    return plans_to(Planner(arm, PLAN_SETTINGS), [shape])[0]


def found(shape, *obstacles):
    """Plan among obstacles."""
    planner = Planner(ARM, PLAN_SETTINGS)
    plans = plan_shapes(planner, planner.statics.chain.straight(), (0.0, 0.0), [shape],
                        CollisionScene(ARM, obstacles), SETTINGS, first=True)
    return next(plans)


def before(plan, gap):
    """Return a ball that far (m) from the arm where the plan ends, to where it gives way."""
    way = plan.state.backbone[-1] - plan.stiff.backbone[-1]
    way /= np.linalg.norm(way)
    place = plan.state.backbone[-1] + 0.1 * way
    for _ in range(20):
        ball = Obstacle('ball', Sphere(0.02), tuple(place.tolist()))
        place -= (CollisionScene(ARM, [ball]).clearance(plan.state).distance - gap) * way
    return ball


def test_a_plan_makes_up_for_what_the_arm_gives_way_by():
    found = plan(ARM, HELD)
    assert found.state.bending_angles == pytest.approx(HELD.bending_angles, abs=0.2 * DEGREE)
    assert found.state.vacuum == pytest.approx(np.array(VACUUMS) / 80e3)
    # It is set to other angles, from which the arm falls: no plan without vacuums would do.
    assert np.abs(found.stiff.bending_angles - HELD.bending_angles).max() > DEGREE
    alone = Statics(ARM).solve(found.stiff, found.moves[-1].pulls[-1], [False] * 3,
                               vacuum=np.array(VACUUMS) / 80e3)
    assert alone.bending_angles == pytest.approx(found.state.bending_angles, abs=1e-6)


def test_with_the_full_vacuum_nothing_is_made_up_for_but_what_stiff_segments_give_way_by():
    found = plan(ARM, replace(HELD, vacuums=(80e3,) * 3))
    assert found.stiff.bending_angles == pytest.approx(found.state.bending_angles, abs=1e-6)


def test_a_plan_that_cannot_hold_the_angles_says_how_far_off_they_are():
    limit = ARM.segments[0].bending_angle_limit
    found = plan(ARM, replace(HELD, bending_angles=(-limit, 0.2, -0.2), vacuums=(12e3,) * 3))
    off = np.abs(found.state.bending_angles - (-limit, 0.2, -0.2)).max()
    assert f'{np.degrees(off):.1f} degrees off' in found.warning and off > DEGREE


def test_an_arm_that_gives_way_beyond_its_limits_has_no_plan():
    weak = replace(ARM, payload=0.5)
    with pytest.raises(PlanError, match='held: '):
        plan(weak, replace(HELD, bending_angles=(1.0, 0.8, 0.8), vacuums=(12e3,) * 3))


def test_a_shape_is_set_stiff_then_held_with_its_vacuums_and_left_stiff_for_the_next():
    rig = VirtualRig(arm=ARM, shapes=[HELD, STIFF], regulators=True)
    softened, moved, relaxed = set(), [], []

    def check(rig):
        told = rig.jamming.reading.vacuums
        if rig.runner.progress.phase is Phase.RELAXING:
            relaxed.append(rig.runner.progress.segment)
        softened.add(tuple(i for i, v in enumerate(told) if v == 0.0))
        if rig.tendons.following:
            moved.append(sum(v < 77e3 for v in told))

    rig.run(check, until=reaches(Phase.HOLDING))
    assert rig.vacuum == pytest.approx(VACUUMS, abs=3e3)
    rig.go_on(0.3, check)
    assert rig.angles == pytest.approx(HELD.bending_angles, abs=0.3 * DEGREE)
    assert rig.run(check).code is Code.SUCCESSFUL
    assert max(map(len, softened)) == 1  # at a time
    assert list(dict.fromkeys(relaxed)) == LOWERED  # from base to tip
    assert set(moved) == {1}  # a tendon moves one soft segment, with all others stiff
    assert min(rig.vacuum) > 77e3
    planned = rig.runner.plan.state.bending_angles
    assert rig.angles == pytest.approx(planned, abs=0.3 * DEGREE)


def holding(seconds=60.0):
    """A rig that holds the shape for long."""
    rig = VirtualRig(arm=ARM, shapes=[replace(HELD, hold_time=seconds)], regulators=True)
    rig.run(until=reaches(Phase.HOLDING))
    return rig


@pytest.mark.parametrize('code', [Code.SUCCESSFUL, Code.STOPPED, Code.CANCELED],
                         ids=lambda c: c.name)
def test_a_run_that_ends_or_is_stopped_leaves_the_vacuums_and_a_canceled_one_is_stiff(code):
    rig = holding(0.5 if code is Code.SUCCESSFUL else 60.0)
    if code is Code.STOPPED:
        rig.tendons.stop('a stop')
    if code is Code.CANCELED:
        rig.runner.cancel(code, 'canceled')
    assert rig.run().code is code
    if code is Code.CANCELED:
        assert all(rig.jamming.stiff) and min(rig.vacuum) > 77e3
    else:
        rig.go_on(2.0)
        assert rig.vacuum == pytest.approx(VACUUMS, abs=3e3)


def test_a_regulator_that_does_not_follow_ends_the_run():
    rig = VirtualRig(arm=ARM, shapes=[HELD], regulators=True)
    rig.run(until=lambda rig: rig.runner.move == 1)
    rig.broken.add(0)
    outcome = rig.run()
    assert outcome.code is Code.TIMEOUT and 'set to 30.0 kPa' in outcome.message


def test_a_vacuum_that_is_lost_while_a_shape_is_held_ends_the_run():
    rig = holding()
    rig.jamming.set_vacuum(2, 45e3)  # by somebody else; the pressure alone would keep it stiff
    outcome = rig.run()
    assert outcome.code is Code.HARDWARE_FAULT and 'segment 3 lost its vacuum' in outcome.message


# Among obstacles.


def test_an_arm_that_would_give_way_into_an_obstacle_has_no_plan():
    free = plan(ARM, WEAK)
    ball = before(free, 0.003)
    refused = found(WEAK, ball)
    assert refused.plan is None and refused.blocked_by == ('ball',)
    assert 'ball is in the way' in refused.why
    assert not found(free.as_set, ball).why  # to what it would be set to, there is a way


def test_the_whole_way_of_a_shape_with_vacuums_is_clear():
    around = before(plan(ARM, WEAK), 0.008)
    clear = found(WEAK, around)
    assert clear.plan.state.bending_angles == pytest.approx(WEAK.bending_angles, abs=0.2 * DEGREE)
    ways = [state for path in clear.plan.paths for state in path.states]
    assert ways[-1] is clear.plan.state  # the way on which it gives way is of it
    distances = [near.distance for near in CollisionScene(ARM, [around]).clearances(ways)]
    assert min(distances) == distances[-1] == pytest.approx(0.008, abs=1e-3)
    assert SETTINGS.margin <= clear.clearance[0] <= min(distances)


def test_an_obstacle_that_comes_is_in_the_way_until_the_vacuums_are_lowered():
    free = found(WEAK).plan
    watch = PlanWatch(free, SETTINGS.margin, 0.02)
    watch.look(CollisionScene(ARM, [before(free, 0.003)]))
    stiff = free.stiff
    for way in (0, len(free.moves)):
        assert 'where the vacuums are lowered' in watch.obstructed(way, stiff)
    there = Obstacle('ball', Sphere(0.002), tuple(stiff.backbone[-1].tolist()))
    watch.look(CollisionScene(ARM, [there]))
    assert 'ball' in watch.obstructed(len(free.moves), stiff)


def test_an_obstacle_that_comes_while_vacuums_are_lowered_leaves_the_arm_stiff():
    rig = VirtualRig(arm=ARM, shapes=[HELD], regulators=True,
                     settings=replace(RUNNER_SETTINGS, on_obstacle=ABORT))
    rig.run(until=reaches(Phase.RELAXING))
    rig.obstructed = 'a ball is in the way'
    outcome = rig.run()
    assert (outcome.code, outcome.message) == (Code.OBSTRUCTED, 'a ball is in the way')
    assert all(rig.jamming.stiff) and min(rig.vacuum) > 77e3


# By the tip.


@pytest.mark.parametrize('kind', ['position', 'pose'])
def test_the_tip_is_at_its_goal_once_the_vacuums_are_lowered(kind):
    wanted = plan(ARM, HELD).state
    tip = TipGoal(wanted.backbone[-1], wanted.rotations[-1], kind)
    reached = found(Shape('tip', (), tips=(tip,), vacuums=VACUUMS))
    assert not reached.why
    end, stiff = reached.plan.state, reached.plan.stiff
    assert np.linalg.norm(end.backbone[-1] - tip.position) < 1e-3
    assert np.linalg.norm(stiff.backbone[-1] - tip.position) > 3e-3
    assert reached.plan.shape.bending_angles == pytest.approx(end.bending_angles)
    assert reached.plan.as_set.tips[0].position == pytest.approx(stiff.backbone[-1])
    if kind == 'pose':
        turned = Rotation.from_matrix(end.rotations[-1] @ wanted.rotations[-1].T)
        assert turned.magnitude() < np.radians(2.0)


def test_a_tip_that_cannot_be_held_is_refused():
    tip = TipGoal(np.array((-0.1, 0.0, 0.25)))
    refused = found(Shape('tip', (), tips=(tip,), vacuums=WEAK.vacuums))
    assert 'as the arm relaxes under its vacuums, segment 3 would bend' in refused.why


def test_a_path_is_not_followed_with_vacuums():
    goals = tuple(TipGoal(np.array((x, 0.0, 0.22))) for x in (0.15, 0.16))
    assert 'a path is followed with every segment stiff' in found(
        Shape('path', (), tips=goals, vacuums=VACUUMS)).why


# By measurements, on an arm whose tendons are not as long as the model's.


def measured(shape=WEAK, loop=LOOP):
    rig = MeasuredRig(arm=ARM, shapes=[shape], regulators=True, loop=loop)
    rig.statics = OffsetStatics(ARM)
    return rig


def test_a_shape_without_vacuums_is_not_corrected_for_the_vacuum_a_soft_segment_lacks():
    rig = measured(replace(WEAK, vacuums=()))
    assert rig.run().code is Code.SUCCESSFUL
    assert rig.error < 3.0 * DEGREE


def test_a_shape_is_measured_as_it_is_held():
    rig = measured(loop=replace(LOOP, max_passes=1, max_corrections=0))
    outcome = rig.run()
    assert (outcome.code, outcome.measured, outcome.corrections) == (Code.SUCCESSFUL, True, 0)
    assert rig.vacuum == pytest.approx(WEAK.vacuums, abs=3e3)
    assert rig.error > np.radians(2.0)
    assert rig.runner.aim.error(rig.estimated()[1]) == pytest.approx(rig.error, abs=0.5 * DEGREE)
    said, end = rig.runner.warning.removeprefix('held is ').split(' ', 1)
    assert float(said) == pytest.approx(np.degrees(rig.error), abs=0.5)
    assert end == 'degrees off with its vacuums'


def test_a_shape_that_is_off_as_it_is_held_is_stiffened_set_again_and_relaxed_again():
    rig = measured(loop=replace(LOOP, settling_time=0.3, measuring_time=0.6))
    moved = []

    def check(rig):
        if rig.tendons.following:
            moved.append(sum(vacuum < 77e3 for vacuum in rig.jamming.reading.vacuums))

    outcome = rig.run(check)
    assert (outcome.code, outcome.measured) == (Code.SUCCESSFUL, True)
    assert asked_to_soften(rig) == [0, 1, 2] * 2
    assert rig.vacuum == pytest.approx(WEAK.vacuums, abs=3e3)
    assert rig.error < LOOP.angle_tolerance and rig.runner.warning == ''
    assert set(moved) == {1}  # with all others stiff


def test_a_shape_that_is_worse_after_it_was_set_again_is_not_set_a_third_time():
    rig = measured(loop=replace(LOOP, max_passes=4))

    def check(rig):
        if len(asked_to_soften(rig)) > 3:
            rig.shift.setdefault(1, 0.3)  # when it is stiffened from then on

    assert rig.run(check).code is Code.SUCCESSFUL
    assert asked_to_soften(rig) == [0, 1, 2] * 2
    assert 'correcting it made it worse, it was' in rig.runner.warning


def test_a_camera_that_is_lost_leaves_a_shape_held_as_predicted():
    rig = measured(loop=replace(LOOP, abort_when_lost=False))
    rig.run(until=reaches(Phase.RELAXING))
    rig.lost_after = rig.now - rig.begin
    outcome = rig.run()
    assert (outcome.code, outcome.measured) == (Code.SUCCESSFUL, False)
    assert 'the shape is predicted' in outcome.message
    assert rig.runner.aim is None
    assert rig.vacuum == pytest.approx(WEAK.vacuums, abs=3e3)


def test_a_shape_that_cannot_be_planned_again_is_held_as_it_was_and_watched():
    rig = measured()
    plans, first = rig.planned, []

    def planned(shape):
        if first:
            raise PlanError('out of reach')
        first.append(plans(shape))
        return first[0]

    rig.planned = planned
    outcome = rig.run()
    assert outcome.code is Code.SUCCESSFUL
    assert rig.vacuum == pytest.approx(WEAK.vacuums, abs=3e3)
    assert 'it cannot be corrected: out of reach' in rig.runner.warning
    assert (rig.runner.plan, rig.runner.move) == (first[0], len(first[0].moves) + 1)


def test_an_arm_that_was_set_again_by_halves_is_not_relaxed():
    rig = measured()
    rig.run(until=lambda rig: rig.runner._corrections and rig.tendons.following)
    rig.motion_failure = Failure(Code.MODEL_FAILURE, 'too much tension')
    outcome = rig.run()
    assert (outcome.code, outcome.message) == (Code.MODEL_FAILURE, 'too much tension')
    assert all(rig.jamming.stiff) and min(rig.vacuum) > 77e3
