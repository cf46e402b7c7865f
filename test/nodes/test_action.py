# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Sequences that run to their end."""

import numpy as np
import pytest
from ros_rig import DEADLINE, Rig

from soft_continuum.mechanics.chain import Array
from soft_continuum.nodes.up import description_file
from soft_continuum.parameters.files import load_arm, load_shapes
from soft_continuum.ros.conversions import poses_from_ros
from soft_continuum.sequencing.planner import Planner, PlanSettings, Shape
from soft_continuum_interfaces.action import RunShapeSequence

LIBRARY = load_shapes(description_file())
QUICK_PLAN = PlanSettings(speed=0.1, acceleration=5.0)


def planned_points(*shapes: tuple[float, ...]) -> list[Array]:
    """Return (x, z, angle) at the calculation points of each shape, as the model plans them."""
    planner = Planner(load_arm(description_file()), QUICK_PLAN)
    chain = planner.statics.chain
    plans = planner.plan(chain.straight(), (0.0, 0.0), [Shape('', s) for s in shapes])
    return [chain.points(plan.state.joint_angles) for plan in plans]


def assert_reached(rig: Rig, angles: tuple[float, ...], points: Array) -> None:
    """Claim that the arm has the bending angles and lies where the model planned it."""
    rig.wait_for_more(rig.segment_poses, 3)
    poses = poses_from_ros(rig.segment_poses.last)
    tangents = 2 * np.arctan2(poses[:, 4], poses[:, 6])
    assert np.degrees(tangents) == pytest.approx(np.degrees(np.cumsum(angles)), abs=0.1)
    tip = poses_from_ros(rig.disc_poses.last)[-1]
    assert tip[[0, 2]] == pytest.approx(points[-1, :2], abs=0.5e-3)


def test_the_three_shapes_of_the_paper_are_reached_by_name(arm: Rig) -> None:
    names = ('c_form', 'upright_c_form', 's_form')
    plans = planned_points(*(LIBRARY[name] for name in names))
    for name, points in zip(names, plans, strict=True):
        goal = arm.goal(name)
        status, result = goal.result()
        assert (status, result.error_code, result.error_string, result.shapes_completed) == (
            'SUCCEEDED', RunShapeSequence.Result.SUCCESSFUL, '', 1)
        arm.assert_stiff_since(goal)
        assert_reached(arm, LIBRARY[name], points)


def test_a_sequence_keeps_every_promise_about_motion_and_stiffness(arm: Rig) -> None:
    status, result = arm.goal('c_form', 'upright_c_form', 's_form').result()
    assert (status, result.shapes_completed) == ('SUCCEEDED', 3)
    arm.assert_rests_stiff()
    arm.assert_only_one_was_soft()
    arm.assert_never_moved_all_stiff()
    arm.assert_stiff_only_by_pressure()
    pulls = np.array([m.position for m in arm.tendons])
    speeds = np.array([m.velocity for m in arm.tendons])
    assert np.ptp(pulls, axis=0).min() > 5e-3  # it did move
    assert np.abs(pulls).max() <= 0.06
    assert np.abs(speeds).max() <= 1.0
    assert_reached(arm, LIBRARY['s_form'], planned_points(*(
        LIBRARY[name] for name in ('c_form', 'upright_c_form', 's_form')))[-1])


def test_bending_angles_can_be_given_instead_of_a_name(arm: Rig) -> None:
    angles = (0.2, -0.35, 0.5)
    status, result = arm.goal(angles).result()
    assert (status, result.error_code, result.shapes_completed) == ('SUCCEEDED', 0, 1)
    assert_reached(arm, angles, planned_points(angles)[0])


def test_given_angles_win_over_the_name_beside_them(arm: Rig) -> None:
    from soft_continuum_interfaces.msg import Shape as ShapeMessage
    goal = arm.goal(ShapeMessage(name='c_form', bending_angles=[0.0, 0.0, 0.3]))
    assert goal.result()[0] == 'SUCCEEDED'
    assert {shape for shape, _, _ in goal.phases} == {'c_form'}
    assert_reached(arm, (0.0, 0.0, 0.3), planned_points((0.0, 0.0, 0.3))[0])


def test_a_shape_that_is_there_already_moves_nothing(arm: Rig) -> None:
    assert arm.goal((0.0, 0.2, 0.0)).result()[0] == 'SUCCEEDED'
    before, heard = arm.pulls, [len(r) for r in arm.stiff]
    assert arm.goal((0.0, 0.2, 0.0)).result()[0] == 'SUCCEEDED'
    arm.assert_rests()
    assert arm.pulls == before
    assert [len(r) for r in arm.stiff] == heard  # nor softened anything


def test_a_shape_is_held_stiff_for_its_hold_time(arm: Rig) -> None:
    goal = arm.goal((0.0, 0.0, 0.3), (0.0, 0.0, -0.3), hold=0.6)
    status, result = goal.result()
    assert (status, result.shapes_completed) == ('SUCCEEDED', 2)
    assert {f.shape_index for _, f in goal.feedback
            if f.phase == RunShapeSequence.Feedback.HOLDING} == {0, 1}
    arm.assert_rests_stiff(goal)
    first, soft, stiff, soft_again, last = arm.stiff[2].heard
    assert [h.message.data for h in (first, soft, stiff, soft_again, last)] == [
        True, False, True, False, True]
    assert soft_again.time - stiff.time >= 0.6e9
    assert goal.ended_time - last.time >= 0.6e9


def test_feedback_names_every_phase_in_order_and_counts_up(arm: Rig) -> None:
    goal = arm.goal('c_form', (0.0, 0.0, -0.2), hold=0.2)
    assert goal.result()[0] == 'SUCCEEDED'
    steps = [phase for phase in goal.phases if phase[2] != 'preparing']
    once = ['softening', 'moving', 'stiffening']
    assert steps == [
        *(('c_form', n, phase) for n in (1, 2, 3) for phase in once), ('c_form', 0, 'holding'),
        *(('shape 2', n, phase) for n in (1, 2, 3) for phase in once), ('shape 2', 0, 'holding')]
    progress = [f.progress for _, f in goal.feedback]
    assert progress == sorted(progress)
    assert 0.0 <= progress[0] < 0.1
    assert progress[-1] == 1.0
    assert {f.shape_index for _, f in goal.feedback if f.shape == 'shape 2'} == {1}


def test_feedback_comes_at_five_hertz_or_more(rig: Rig) -> None:
    # An arm as slow as a real one, so that every phase lasts.
    rig.start_arm(simulated_jamming__evacuation_time=0.4, simulated_jamming__venting_time=0.3,
                  tendon_speed=0.02, tendon_acceleration=0.2)
    goal = rig.goal((0.0, 0.0, 0.4), hold=1.0)
    assert goal.result(2 * DEADLINE)[0] == 'SUCCEEDED'
    times = [t for t, _ in goal.feedback]
    lasted = times[-1] - times[0]
    assert lasted > 1.5
    assert len(times) / lasted >= 5.0
    for phase in ('softening', 'moving', 'stiffening', 'holding'):
        assert sum(f.phase == phase for _, f in goal.feedback) >= 2


def test_the_tip_is_deflected_by_gravity_as_the_model_says(arm: Rig) -> None:
    # The pulls of a plan hold the arm under its weight: not those of constant curvature.
    angles = LIBRARY['c_form']
    assert arm.goal('c_form').result()[0] == 'SUCCEEDED'
    points = planned_points(angles)[0]
    assert_reached(arm, angles, points)
    pulls = arm.pulls
    expected = sum(0.5 * d * a for d, a in zip((0.05, 0.0425, 0.035), angles, strict=True))
    assert pulls[0] == pytest.approx(expected, rel=0.1)
    assert pulls[0] != pytest.approx(expected, abs=5e-5)
    assert pulls[1] < 0.0
