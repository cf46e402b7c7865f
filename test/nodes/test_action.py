# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Sequences that run to their end, one after the other on one arm."""

from dataclasses import dataclass
from itertools import groupby, pairwise
import time

import numpy as np
import pytest

from soft_continuum.hardware.tendon_controller import Reason
from soft_continuum.mechanics.arm import Array
from soft_continuum.nodes.shape_sequencer import error_code
from soft_continuum.parameters.shapes import PAPER_SHAPES
from soft_continuum.planning.planner import Planner, PlanSettings
from soft_continuum.planning.plans import Shape
from soft_continuum.planning.shape_plans import plans_to
from soft_continuum.ros.conversions import poses_from_ros
from soft_continuum.ros.description import load_arm
from soft_continuum.sequencing import Code, Phase
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import MotionRequest
from soft_continuum_interfaces.msg import Shape as ShapeMessage

ARM, LIBRARY = load_arm(description_file()), PAPER_SHAPES
NAMES = ('c_form', 'upright_c_form', 's_form')
HOLD = 0.5  # s
QUICK_PLAN = PlanSettings(speed=0.1, acceleration=5.0)


def planned_tips(*shapes):
    """Return x and z of the tip in each shape, m, as the model plans them from straight."""
    plans = plans_to(Planner(ARM, QUICK_PLAN), [Shape('', s) for s in shapes])
    return [plan.state.tip[::2] for plan in plans]


@dataclass
class Reached:
    """Pulls (m), tangents of the segments (rad) and tip (m) of the arm at rest."""

    pulls: tuple[float, ...]
    tangents: Array
    tip: Array

    @classmethod
    def of(cls, rig):
        for recording in (rig.tendons, rig.segment_poses, rig.disc_poses):
            rig.wait_for_more(recording, 3)
        return cls.before(rig, time.time_ns())

    @classmethod
    def before(cls, rig, end):
        """Return what was said last before a time, ns, when it has been heard."""
        tendons, segments, discs = (
            max((h for h in list(recording.heard) if h.time < end), key=lambda h: h.time).message
            for recording in (rig.tendons, rig.segment_poses, rig.disc_poses))
        poses = poses_from_ros(segments)
        return cls(tuple(tendons.position), 2 * np.arctan2(poses[:, 4], poses[:, 6]),
                   poses_from_ros(discs)[-1, [0, 2]])

    def check(self, angles, tip):
        assert np.degrees(self.tangents) == pytest.approx(np.degrees(np.cumsum(angles)), abs=0.1)
        assert self.tip == pytest.approx(tip, abs=0.5e-3)


@pytest.fixture(scope='module')
def sequence(shared_arm):
    """Return a run of the paper's three shapes on the straight arm, and what each reached."""
    goal = shared_arm.goal(*NAMES, hold=HOLD)
    goal.result()
    Reached.of(shared_arm)  # then all that was said before has been heard
    shared_arm.wait_for(lambda: not shared_arm.sequencer.last.running, 'its end')
    states = [h for h in shared_arm.sequencer.heard if h.message.goal_id == goal.goal_id]
    holds = [after.time for state, after in pairwise(states)
             if state.message.phase == Phase.HOLDING != after.message.phase]
    return shared_arm, goal, [Reached.before(shared_arm, end) for end in holds]


def test_the_three_shapes_of_the_paper_are_reached_by_name(sequence):
    arm, goal, reached = sequence
    result = goal.assert_ended('SUCCEEDED')
    assert result.shapes_completed == 3
    angles = [LIBRARY[name] for name in NAMES]
    tips = planned_tips(*angles)
    for shape, a, tip in zip(reached, angles, tips, strict=True):
        shape.check(a, tip)
    # Without sensors it is a prediction.
    assert (result.source, result.corrections) == (RunShapeSequence.Result.PREDICTED, 0)
    assert list(result.bending_angles) == pytest.approx(angles[-1], abs=2e-3)
    position = result.tip.pose.position
    assert (position.x, position.z) == pytest.approx(tips[-1], abs=0.5e-3)
    assert not len(result.angle_stddevs) and not result.tip.covariance.any()


def test_a_sequence_keeps_every_promise_about_motion_and_stiffness(sequence):
    arm, _, _ = sequence
    arm.assert_rests_stiff()
    arm.assert_only_one_was_soft()
    arm.assert_never_moved_all_stiff()
    arm.assert_stiff_only_by_pressure()
    pulls = np.array([m.position for m in arm.tendons])
    speeds = np.array([m.velocity for m in arm.tendons])
    assert np.ptp(pulls, axis=0).min() > 5e-3  # it did move
    assert np.abs(pulls).max() <= 0.06
    assert np.abs(speeds).max() <= 1.0


def test_feedback_names_every_phase_in_order_and_counts_up(sequence):
    _, goal, _ = sequence
    moved = {'c_form': (1, 2, 3), 'upright_c_form': (1,), 's_form': (1, 2)}
    assert [phase for phase in goal.phases if phase[2] != 'preparing'] == [
        step for name in NAMES for step in (
            *((name, n, phase) for n in moved[name]
              for phase in ('softening', 'moving', 'stiffening')), (name, 0, 'holding'))]
    progress = [f.progress for _, f in goal.feedback]
    assert progress == sorted(progress)
    assert 0.0 <= progress[0] < 0.1
    assert progress[-1] == 1.0
    assert {(f.shape_index, f.shape) for _, f in goal.feedback} == set(enumerate(NAMES))


def test_feedback_is_repeated_while_a_phase_lasts(sequence):
    arm, *_ = sequence
    goal = arm.goal(NAMES[-1], hold=60.0)  # the shape that it has
    assert goal.accepted
    arm.wait_for(lambda: sum(f.phase == 'holding' for _, f in goal.feedback) >= 3, 'repetitions')
    goal.cancel()
    assert goal.result()[0] == 'CANCELED'


def test_a_shape_is_held_stiff_for_its_hold_time(sequence):
    arm, goal, _ = sequence
    # C-form ends when segment 3 is stiff; the next shape begins with softening segment 1.
    stiff = [flag.time for flag in arm.stiff[2].heard if flag.message.data][1]
    soft = next(flag.time for flag in arm.stiff[0].heard
                if not flag.message.data and flag.time > stiff)
    assert soft - stiff >= HOLD * 1e9
    last = max(flag.time for flag in arm.stiff[1].heard if flag.time < goal.ended_time)
    assert goal.ended_time - last >= HOLD * 1e9


def test_the_tip_is_deflected_by_gravity_as_the_model_says(sequence):
    # The pulls of a plan hold the arm under its weight: not those of constant curvature.
    right, left = sequence[2][0].pulls
    angles = LIBRARY['c_form']
    expected = sum(0.5 * d * a for d, a in zip((0.05, 0.0425, 0.035), angles, strict=True))
    assert right == pytest.approx(expected, rel=0.1)
    assert right != pytest.approx(expected, abs=5e-5)
    assert left < 0.0


def test_the_state_of_the_sequencer_follows_the_goal_and_says_how_it_ended(sequence):
    arm, goal, _ = sequence
    states = [s for s in arm.sequencer if s.goal_id == goal.goal_id]
    # A state that lasts is repeated.
    seen = [step for step, _ in groupby(
        (s.shape, s.segment, s.phase) for s in states if s.running)]
    assert [s for s in seen if s[2] != 'preparing'] == [
        phase for phase in goal.phases if phase[2] != 'preparing']
    assert not states[-1].running
    assert (states[-1].error_code, states[-1].error_string) == (0, '')


def test_bending_angles_win_over_a_name_beside_them(shared_arm):
    angles = (0.2, -0.35, 0.3)
    goal = shared_arm.goal(ShapeMessage(name='c_form', bending_angles=angles))
    assert goal.assert_ended('SUCCEEDED').shapes_completed == 1
    assert {shape for shape, _, _ in goal.phases} == {'c_form'}
    Reached.of(shared_arm).check(angles, planned_tips(angles)[0])


def test_a_shape_that_the_arm_has_already_moves_nothing(shared_arm):
    angles = (0.2, -0.35, 0.4)
    assert shared_arm.goal(angles).result()[0] == 'SUCCEEDED'  # by angles alone
    shared_arm.assert_rests_stiff()
    before, received = shared_arm.pulls, [len(r) for r in shared_arm.stiff]
    assert shared_arm.goal(angles).result()[0] == 'SUCCEEDED'
    shared_arm.assert_rests()
    assert shared_arm.pulls == before
    assert [len(r) for r in shared_arm.stiff] == received  # nor softened anything


def test_an_aim_that_does_not_exist_is_rejected(shared_arm):
    shared_arm.goal('c_form', aim=7).assert_rejected('7', 'angles', 'tip')


def test_outcomes_phases_and_reasons_are_those_of_action_and_message():
    def constants(message, kind):
        every = {name: getattr(message, name) for name in dir(message) if name.isupper()}
        return {name: value for name, value in every.items()
                if isinstance(value, kind) and name not in ('PREDICTED', 'MEASURED')}

    codes = constants(RunShapeSequence.Result, int)
    assert {code.name: error_code(code) for code in Code} == codes
    assert codes['SUCCESSFUL'] == 0 and all(v < 0 for n, v in codes.items() if n != 'SUCCESSFUL')
    phases = constants(RunShapeSequence.Feedback, str)
    assert {phase.name: phase.value for phase in Phase} == phases
    states = {'NONE', 'FOLLOWING', 'DONE', 'REFUSED', 'ENDED'}
    assert {reason.name for reason in Reason} == constants(MotionRequest, int).keys() - states
