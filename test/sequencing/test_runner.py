# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A run sets its shapes or ends with a reason, and always leaves the arm in a defined state."""

from concurrent.futures import Future
from dataclasses import replace
from itertools import product
from math import inf
import re

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.planning.planner import Planner, PlanSettings
from soft_continuum.planning.plans import Shape
from soft_continuum.planning.settings import RunnerSettings
from soft_continuum.planning.shape_plans import plans_to
from soft_continuum.ros.description import load_description
from soft_continuum.sequencing import Code, Phase, Progress
from soft_continuum.sequencing.runner import Failure, Observation, Runner
from support.flat_arm import of_segments
from support.virtual_rig import (
    ARM,
    at_rest_and_stiff,
    DESCRIPTION,
    LIBRARY,
    one_soft_at_most_and_none_moved_stiff,
    PLAN_SETTINGS,
    reaches,
    RUNNER_SETTINGS,
    STEP,
    TICK_STEPS,
    VirtualRig,
)

SHAPES = tuple(Shape(name, angles, 0.2) for name, angles in LIBRARY.items())
C_FORM, UPRIGHT, S_FORM = SHAPES
BOW = Shape('bow', (0.3, 0.0, 0.2), 0.2)
LETTERS = dict(zip(Phase, 'psmetrhz', strict=True))
WORKING_PHASES = (Phase.SOFTENING, Phase.MOVING, Phase.STIFFENING, Phase.HOLDING)
REACTION = 0.2  # s from an event until the tendons rest

property_test = settings(deadline=None, derandomize=True, max_examples=40)


def phase_letters(rig):
    """The phases of a run, each change one letter."""
    letters = ''.join(LETTERS[p.phase] for p in rig.progress)
    return re.sub(r'(.)\1+', r'\1', letters)


def check_progress(rig):
    """Progress never goes back, and phases come in their order."""
    fractions = [p.fraction for p in rig.progress]
    assert fractions == sorted(fractions) and fractions[0] >= 0.0 and fractions[-1] <= 1.0
    shapes = [p.shape_index for p in rig.progress]
    assert shapes == sorted(shapes)
    assert re.fullmatch(r'p?((smt)*h?p?)*(smt?|s|t)?t?', phase_letters(rig))


def running(phase, segment=None, **rig):
    """A rig in the middle of a phase of its run."""
    rig = VirtualRig((BOW, C_FORM), **rig)
    rig.run(until=reaches(phase, segment))
    assert rig.runner.outcome is None
    rig.go_on(2 * TICK_STEPS * STEP)
    return rig


def check_ends(rig, code, message=''):
    """The run ends soon, with a code and a reason, and leaves the arm at rest and stiff."""
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff, most=10.0)
    assert outcome.code is code
    assert message in outcome.message
    check_progress(rig)
    at_rest_and_stiff(rig)
    return outcome


# Undisturbed runs.


@pytest.fixture(scope='module')
def undisturbed():
    """A run of the paper's three shapes, checked at every step."""
    rig = VirtualRig(SHAPES)
    rig.angles_at = {}

    def check(rig):
        one_soft_at_most_and_none_moved_stiff(rig)
        if rig.runner.progress.phase == Phase.HOLDING:
            rig.angles_at[rig.runner.progress.shape] = rig.angles

    rig.run(check)
    return rig


def test_a_run_sets_every_segment_to_its_angle_and_leaves_the_arm_at_rest_and_stiff(undisturbed):
    outcome = undisturbed.runner.outcome
    assert (outcome.code, outcome.message, outcome.shapes_completed) == (Code.SUCCESSFUL, '', 3)
    for shape in SHAPES:
        assert np.degrees(undisturbed.angles_at[shape.name]) == pytest.approx(
            np.degrees(shape.bending_angles), abs=0.1)
    at_rest_and_stiff(undisturbed)


def test_phases_come_in_their_order_and_progress_only_grows(undisturbed):
    check_progress(undisturbed)
    assert phase_letters(undisturbed) == 'psmtsmtsmth' + 'psmth' + 'psmtsmth'
    assert undisturbed.progress[-1].fraction == 1.0


def test_progress_names_the_shape_and_the_segment(undisturbed):
    seen = [(p.shape_index, p.shape, p.segment) for p in undisturbed.progress]
    assert list(dict.fromkeys(seen)) == [
        (0, 'c_form', 0), (0, 'c_form', 1), (0, 'c_form', 2), (0, 'c_form', 3),
        (1, 'upright_c_form', 0), (1, 'upright_c_form', 1),
        (2, 's_form', 0), (2, 's_form', 1), (2, 's_form', 2)]


def test_a_run_asks_for_one_segment_after_the_other(undisturbed):
    asked = [tuple(c[2:]) for c in undisturbed.commands if c[1] == 'set_stiff']
    expected = []
    for segment in (0, 1, 2, 0, 0, 1):
        expected += [(segment, False), (segment, True)]
    assert asked == expected


def test_motions_are_sent_no_further_ahead_than_the_horizon(undisturbed):
    for now, name, *arguments in undisturbed.commands:
        if name == 'follow':
            start, times, _ = arguments
            assert now <= start + times[0]
            assert start + times[-1] <= now + RUNNER_SETTINGS.horizon + 1e-9


def test_the_pieces_of_a_motion_lie_on_the_planned_one():
    rig = VirtualRig((C_FORM,), plan_settings=PlanSettings())
    move = rig.planned(C_FORM).moves[0]
    rig.run(until=reaches(Phase.STIFFENING))
    pieces = [command[2:] for command in rig.commands if command[1] == 'follow']
    assert len(pieces) > 10
    for start, times, pulls in pieces:
        assert start == pytest.approx(pieces[0][0], abs=1e-6)
        for side in (0, 1):
            expected = np.interp(times, move.times, move.pulls[:, side])
            assert pulls[:, side] == pytest.approx(expected, abs=1e-8)
    assert times[-1] == pytest.approx(move.duration)


def test_a_shape_is_held_for_its_time():
    rig = VirtualRig((replace(BOW, hold_time=2.0),))
    rig.run(until=reaches(Phase.HOLDING))
    start = rig.now
    assert rig.run().code is Code.SUCCESSFUL
    assert 2.0 <= rig.now - start <= 2.0 + 2 * TICK_STEPS * STEP


def test_a_shape_that_the_arm_has_already_takes_no_move():
    rig = VirtualRig((Shape('straight', (0.0, 0.0, 0.0), 0.2),))
    assert rig.run().code is Code.SUCCESSFUL
    assert rig.commands == []
    assert phase_letters(rig) == 'h'


def test_the_same_shape_twice_moves_once():
    rig = VirtualRig((BOW, BOW))
    assert rig.run().shapes_completed == 2
    assert sum(c[1] == 'set_stiff' for c in rig.commands) == 4


def test_a_shape_without_hold_time_is_a_shape():
    rig = VirtualRig((replace(BOW, hold_time=0.0), replace(C_FORM, hold_time=0.0)))
    assert rig.run(one_soft_at_most_and_none_moved_stiff).shapes_completed == 2
    assert rig.angles == pytest.approx(C_FORM.bending_angles, abs=np.radians(0.1))


def test_ticks_after_the_end_change_nothing():
    rig = VirtualRig((BOW,))
    outcome = rig.run()
    before = (list(rig.commands), rig.runner.progress)
    rig.runner.cancel(Code.CANCELED, 'too late')
    rig.runner.tick(rig.now, replace(rig.observe(), stopped='too late'))
    assert rig.runner.outcome is outcome
    assert (rig.commands, rig.runner.progress) == before


@pytest.mark.parametrize('segments', [1, 2])
def test_arms_with_fewer_segments_run_alike(segments):
    arm = of_segments(ARM, range(segments))
    shape = Shape('bow', (0.4,) * segments)
    rig = VirtualRig((shape,), arm=arm)
    assert rig.run(one_soft_at_most_and_none_moved_stiff).code is Code.SUCCESSFUL
    assert rig.angles == pytest.approx(shape.bending_angles, abs=np.radians(0.1))


# Latency, pauses, and arms that are not ready.


@pytest.mark.parametrize(('latency', 'plans'), [(0.01, PlanSettings()), *product(
    [0.01, 0.03, 0.06], [replace(PLAN_SETTINGS, speed=speed, acceleration=0.4)
                         for speed in (0.03, 0.035, 0.04, 0.045, 0.05)])])
def test_latency_does_not_end_a_run(latency, plans):
    rig = VirtualRig((C_FORM,), latency=latency, plan_settings=plans)
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff)
    assert (outcome.code, outcome.message) == (Code.SUCCESSFUL, '')
    assert rig.angles == pytest.approx(C_FORM.bending_angles, abs=np.radians(0.1))


def test_the_tendons_rest_soon_after_the_sequencer_ended():
    rig = running(Phase.MOVING, plan_settings=PlanSettings())
    rig.runner = None
    rig.go_on(RUNNER_SETTINGS.horizon + REACTION)
    assert not rig.moving and not rig.tendons.following


@pytest.mark.parametrize('pause', [0.2, 0.6, 3.0])
def test_a_run_goes_on_after_a_pause_from_where_the_tendons_are(pause):
    rig = running(Phase.MOVING, plan_settings=PlanSettings())
    runner, rig.runner = rig.runner, None
    rig.go_on(pause)
    rig.runner = runner
    assert rig.run(one_soft_at_most_and_none_moved_stiff).code is Code.SUCCESSFUL
    assert rig.angles == pytest.approx(C_FORM.bending_angles, abs=np.radians(0.1))


def planned_with(rig, state):
    """Let a rig set a shape; return what a state of it was when each plan was made."""
    seen = []

    def plan(shapes):
        seen.append(state(rig))
        return rig.plan(shapes)

    rig.runner = rig.run_of((BOW,), plan)
    return seen


@pytest.mark.parametrize('soft', [[0], [2], [0, 1], [0, 1, 2], 'from the start'], ids=str)
def test_a_run_on_a_soft_arm_stiffens_it_first(soft):
    rig = VirtualRig(stiff_at_start=soft != 'from the start')
    if rig.stiff_at_start:
        for segment in soft:
            rig.jamming.set_stiff(segment, False)
        rig.go_on(3.0)
    stiff = planned_with(rig, lambda rig: list(rig.jamming.stiff))
    outcome = rig.run()
    assert (outcome.code, outcome.message) == (Code.SUCCESSFUL, '')
    assert stiff == [[True, True, True]]
    assert phase_letters(rig).startswith('ps')


def test_a_run_waits_until_the_tendons_rest():
    rig = VirtualRig()
    rig.jamming.set_stiff(1, False)
    rig.go_on(2.0)
    rig.follow(0, rig.now, np.array([0.5]), np.array([[0.002, -0.004]]))
    rig.go_on(0.2)
    rig.jamming.set_stiff(1, True)
    assert rig.moving
    moving = planned_with(rig, lambda rig: rig.moving)
    outcome = rig.run()
    assert (outcome.code, outcome.message) == (Code.SUCCESSFUL, '')
    assert moving == [False]


def test_a_plan_is_made_once_the_model_has_the_arm_as_it_is():
    rig = VirtualRig(agreed=False)
    agreed = planned_with(rig, lambda rig: rig.agreed)
    rig.go_on(0.5)
    assert not agreed
    rig.agreed = True
    assert rig.run().code is Code.SUCCESSFUL
    assert agreed == [True]


def test_a_model_that_never_has_the_arm_as_it_is_ends_the_run_and_is_named():
    rig = VirtualRig((BOW,), agreed=False)
    outcome = rig.run()
    assert outcome.code is Code.TIMEOUT
    assert 'kinematics did not report the arm stiff' in outcome.message
    assert not any(command[1] == 'follow' for command in rig.commands)


# Endings.


@pytest.mark.parametrize('phase', WORKING_PHASES)
@pytest.mark.parametrize('code', [Code.CANCELED, Code.PREEMPTED, Code.HARDWARE_FAULT],
                         ids=lambda c: c.name)
def test_a_run_that_is_canceled_or_hears_nothing_of_a_node_ends_at_rest_and_stiff(phase, code):
    rig, why = running(phase), 'nothing received for 0.5 s from kinematics (joint_states)'
    if code is Code.HARDWARE_FAULT:
        rig.fault = why
    else:
        rig.runner.cancel(code, why)
    assert check_ends(rig, code, why).shapes_completed == 0


def test_a_canceled_run_brakes_at_once_and_stiffens_when_the_tendons_rest():
    rig = running(Phase.MOVING, plan_settings=PlanSettings(), acceleration=0.12)
    rig.go_on(0.5)
    moved_at = []

    def check(rig):
        if rig.moving:
            moved_at.append(rig.now)
            assert not rig.air.read().evacuated[0]

    start = rig.now
    rig.runner.cancel(Code.CANCELED, '')
    rig.run(check, most=10.0)
    assert REACTION / 2 < moved_at[-1] - start < 1.5 * REACTION


def test_a_canceled_run_counts_the_shapes_that_were_completed():
    rig = VirtualRig(SHAPES)
    rig.run(until=lambda rig: rig.runner.progress.shape == 'upright_c_form')
    rig.runner.cancel(Code.CANCELED, '')
    assert check_ends(rig, Code.CANCELED).shapes_completed == 1


def test_a_run_that_is_canceled_before_it_started_softens_and_moves_nothing():
    rig = VirtualRig((BOW,))
    rig.runner.cancel(Code.CANCELED, 'changed my mind')
    check_ends(rig, Code.CANCELED, 'changed my mind')
    assert {c[1] for c in rig.commands} <= {'hold'}


@pytest.mark.parametrize('first', [Code.CANCELED, Code.HARDWARE_FAULT], ids=lambda c: c.name)
def test_the_first_of_two_reasons_to_end_counts(first):
    rig = running(Phase.MOVING)
    if first is Code.CANCELED:
        rig.runner.cancel(first, 'the first')
    else:  # it winds down already when it is canceled
        rig.fault = 'the first'
        rig.go_on(2 * TICK_STEPS * STEP)
    rig.runner.cancel(Code.PREEMPTED, 'preempted')
    check_ends(rig, first, 'the first')


@pytest.mark.parametrize('late', [0.0, 0.05, 0.1, 0.2])
@pytest.mark.parametrize('latency', [0.06, 0.11, 0.2])
def test_a_cancel_right_after_softening_was_asked_for_ends_stiff(latency, late):
    rig = VirtualRig((BOW,), latency=latency)
    rig.run(until=lambda rig: rig.commands)
    rig.go_on(late)
    rig.runner.cancel(Code.CANCELED, '')
    rig.run(one_soft_at_most_and_none_moved_stiff)
    rig.go_on(2 * latency)
    at_rest_and_stiff(rig)


@pytest.mark.parametrize(('phase', 'canceled'), [
    *((phase, None) for phase in WORKING_PHASES), *((Phase.MOVING, n) for n in (0, 1, 2, 5))])
def test_a_stop_ends_a_run_at_once_also_while_it_winds_down_and_leaves_everything_as_it_is(
        phase, canceled):
    """After so many ticks since it was canceled."""
    rig = running(phase)
    if canceled is not None:
        rig.runner.cancel(Code.CANCELED, 'canceled')
        rig.go_on(canceled * TICK_STEPS * STEP)
    before, valves = list(rig.commands), rig.air.read().evacuated
    rig.tendons.stop('~/stop was called')
    rig.go_on(TICK_STEPS * STEP)
    outcome = rig.runner.outcome
    assert (outcome.code, outcome.message) == (Code.STOPPED, 'stopped: ~/stop was called')
    rig.go_on(5.0)
    assert not rig.moving
    assert rig.commands == before
    assert rig.air.read().evacuated == valves


def test_a_run_does_not_begin_while_tendon_motion_is_stopped():
    rig = VirtualRig((BOW,))
    rig.tendons.stop('~/stop was called')
    assert rig.run().code is Code.STOPPED
    assert rig.commands == []


@pytest.mark.parametrize('phase', WORKING_PHASES)
def test_a_run_that_loses_the_rig_ends_at_once_and_leaves_the_segments_as_they_are(phase):
    rig = running(phase)
    rig.fault, rig.lost = 'nothing received for 0.5 s', True
    before = len(rig.commands)
    outcome = rig.run(most=0.5)
    assert outcome.code is Code.HARDWARE_FAULT
    assert outcome.message.startswith(rig.fault)
    assert {command[1] for command in rig.commands[before:]} <= {'hold'}
    assert 'left as they are' in outcome.message or all(rig.jamming.stiff)


def test_nothing_moves_before_the_model_has_the_segment_soft():
    rig = VirtualRig((BOW,))
    rig.run(until=reaches(Phase.SOFTENING))
    rig.agreed = False
    rig.go_on(2.0)
    assert not any(rig.jamming.stiff[:1])
    assert not any(command[1] == 'follow' for command in rig.commands)
    rig.agreed = True
    assert rig.run(one_soft_at_most_and_none_moved_stiff).code is Code.SUCCESSFUL


def test_a_request_that_was_lost_is_repeated():
    rig = VirtualRig((BOW,))
    rig.broken.add(0)
    rig.run(until=reaches(Phase.SOFTENING))
    rig.go_on(1.0)
    rig.broken.clear()
    assert rig.run(one_soft_at_most_and_none_moved_stiff).code is not Code.HARDWARE_FAULT
    assert [c[2:] for c in rig.commands if c[1] == 'set_stiff'][:2] == [(0, False)] * 2


def test_a_segment_that_never_stiffens_ends_the_run_with_the_tendons_holding():
    rig = running(Phase.MOVING)
    rig.broken.add(0)
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff, most=10.0)
    assert outcome.code is Code.TIMEOUT
    assert 'segment 1 did not become stiff within 3 s' in outcome.message
    at_rest_and_stiff(rig, without=[0])


@pytest.mark.parametrize(('phase', 'segment', 'leak'), [
    *((phase, None, 2) for phase in WORKING_PHASES), (Phase.MOVING, 3, 0)])
def test_a_segment_that_loses_its_vacuum_ends_the_run_and_keeps_no_other_one_soft(
        phase, segment, leak):
    rig = running(phase, segment)
    rig.leaking.add(leak)
    outcome = rig.run(most=20.0)
    assert outcome.code is Code.HARDWARE_FAULT
    assert f'segment {leak + 1} lost its stiffness' in outcome.message
    at_rest_and_stiff(rig, without=[leak])


@pytest.mark.parametrize(('segment', 'stiff', 'message'), [
    (0, True, 'segment'), (1, False, 'segment 2 lost its stiffness')])
def test_a_segment_that_others_switch_during_a_motion_ends_the_run_stiff(segment, stiff, message):
    rig = running(Phase.MOVING, plan_settings=PlanSettings())
    rig.jamming.set_stiff(segment, stiff)
    outcome = rig.run(most=10.0)
    assert outcome.code is Code.HARDWARE_FAULT
    assert message in outcome.message
    at_rest_and_stiff(rig)


def limit_speed(rig):
    rig.tendons.limits = replace(rig.tendons.limits, speed_limit=1e-4)


@pytest.mark.parametrize(('happens', 'code', 'messages', 'moves'), [
    (lambda rig: rig.broken.add(0), Code.TIMEOUT, [
        'segment 1 did not become soft within 3 s; its vacuum is 92.4 kPa'], False),
    (limit_speed, Code.HARDWARE_FAULT, [
        'the tendon motion was refused: ', 'speed_limit: 0.0001 m/s'], True),
    (lambda rig: setattr(rig, 'stuck', True), Code.TIMEOUT, [
        'right_tendon is at 0.000 mm instead of ', 'after 1 s'], True)])
def test_hardware_that_does_not_do_what_it_should_ends_the_run(happens, code, messages, moves):
    rig = VirtualRig((BOW,))
    happens(rig)
    outcome = check_ends(rig, code)
    assert all(message in outcome.message for message in messages)
    assert outcome.shapes_completed == 0
    assert any(c[1] == 'follow' for c in rig.commands) == moves


@pytest.mark.parametrize(('tension_limit', 'completed'), [(1.0, 0), (3.0, 1)])
def test_a_shape_out_of_reach_ends_the_run_before_anything_is_softened_for_it(
        tension_limit, completed):
    rig = VirtualRig((BOW, C_FORM) if completed else (C_FORM,),
                     plan_settings=replace(PLAN_SETTINGS, tension_limit=tension_limit))
    outcome = check_ends(rig, Code.MODEL_FAILURE, 'c_form: segment ')
    assert outcome.shapes_completed == completed
    assert sum(command[1] == 'set_stiff' for command in rig.commands) == 4 * completed
    assert completed or {command[1] for command in rig.commands} <= {'hold'}


def observed(stiff=(True, True, True), **changes):
    seen = Observation((0.0, 0.0), False, stiff, tuple(90e3 * s for s in stiff))
    return replace(seen, **changes)


def test_a_segment_that_is_seen_stiff_during_its_motion_ends_the_run():
    rig = VirtualRig()
    runner = rig.run_of((BOW,))
    seen = [observed()] + 4 * [observed((False, True, True))] + 40 * [observed()]
    for number, observation in enumerate(seen):
        runner.tick(0.05 * number, observation)
    assert runner.outcome.code is Code.HARDWARE_FAULT
    assert runner.outcome.message == 'segment 1 was stiffened during its motion'


@pytest.mark.parametrize('ticks', [1, 3, 6], ids=['planning', 'softening', 'moving'])
def test_a_stop_that_was_resumed_between_two_ticks_ends_the_run(ticks):
    rig = VirtualRig()
    runner = rig.run_of((BOW,))
    for number in range(ticks):
        runner.tick(0.05 * number, observed((number < 3, True, True), stops=2))
    assert runner.outcome is None
    runner.tick(0.05 * ticks, observed((ticks < 3, True, True), stops=3))
    assert runner.outcome.code is Code.STOPPED
    assert 'stopped and resumed' in runner.outcome.message


def test_an_unexpected_error_of_the_planner_ends_the_run_with_its_name():
    plan = Future()
    plan.set_exception(ZeroDivisionError('half a shape'))
    runner = VirtualRig().run_of((BOW,), lambda shapes: plan)
    for number in range(10):
        runner.tick(0.05 * number, observed())
    assert runner.outcome.code is Code.MODEL_FAILURE
    assert runner.outcome.message == 'ZeroDivisionError: half a shape'


def test_nothing_is_requested_while_a_plan_is_being_made():
    rig = VirtualRig((BOW,), plan_ticks=20)
    rig.go_on(0.9)
    assert rig.commands == []
    assert rig.runner.progress.phase is Phase.PREPARING
    assert rig.run().code is Code.SUCCESSFUL


@pytest.mark.parametrize('event, code', [
    (lambda rig: rig.runner.cancel(Code.CANCELED, 'event'), Code.CANCELED),
    (lambda rig: rig.tendons.stop('event'), Code.STOPPED),
    (lambda rig: setattr(rig, 'fault', 'event'), Code.HARDWARE_FAULT),
    (lambda rig: rig.leaking.add(1), Code.HARDWARE_FAULT),
], ids=['cancel', 'stop', 'fault', 'leak'])
def test_a_run_ends_while_its_plan_is_still_being_made(event, code):
    rig = VirtualRig((BOW,), plan_ticks=10000)
    rig.go_on(0.2)
    event(rig)
    assert rig.run(most=8.0).code is code
    assert {command[1] for command in rig.commands} <= {'hold', 'set_stiff'}


@pytest.mark.parametrize('code', [Code.STOPPED, Code.TIMEOUT, Code.MODEL_FAILURE])
def test_the_end_of_a_motion_ends_the_run_at_the_next_tick_with_its_code_and_reason(code):
    rig = running(Phase.MOVING, plan_settings=PlanSettings())
    before = list(rig.commands)
    rig.runner.tick(rig.now, replace(rig.observe(), motion_failure=Failure(code, 'the reason')))
    if code is Code.STOPPED:  # everything stays as it is
        assert rig.commands == before
        assert rig.runner.outcome.message == 'the reason'
    else:
        assert [command[1] for command in rig.commands[len(before):]] == ['hold']
        check_ends(rig, code, 'the reason')


def test_tendons_that_never_rest_end_the_run():
    runner = VirtualRig().run_of((BOW,))
    for number in range(2000):
        runner.tick(0.05 * number, observed(moving=True))
    assert runner.outcome is not None and runner.outcome.code is Code.TIMEOUT


def test_a_run_begins_with_its_first_shape_in_preparation():
    runner = VirtualRig(SHAPES).runner
    assert runner.progress == Progress(0, 'c_form', 0, Phase.PREPARING, 0.0)
    assert runner.outcome is None


@pytest.mark.parametrize('code', [Code.CANCELED, Code.HARDWARE_FAULT], ids=lambda c: c.name)
def test_a_shape_held_for_ever_can_be_canceled_and_a_lost_vacuum_is_noticed(code):
    rig = VirtualRig((replace(BOW, hold_time=inf),))
    rig.run(until=reaches(Phase.HOLDING))
    if code is Code.CANCELED:
        rig.go_on(30.0)
        rig.runner.cancel(code, 'enough')
        check_ends(rig, code, 'enough')
    else:
        rig.leaking.add(1)
        outcome = rig.run(most=10.0)
        assert (outcome.code, outcome.shapes_completed) == (code, 0)


# An arm without jamming.


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
    values = load_description(DESCRIPTION.with_name('tendon_arm.yaml'), node='shape_sequencer')
    planner = Planner(arm_from_parameters(values), PlanSettings.of(values))

    def plan(shapes):
        future = Future()
        future.set_result(plans_to(planner, shapes, pulls=tendons.pulls))
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


# Any event at any moment.

EVENTS = {
    'cancel': (lambda rig, i: rig.runner.cancel(Code.CANCELED, 'event'), {Code.CANCELED}),
    'preempt': (lambda rig, i: rig.runner.cancel(Code.PREEMPTED, 'event'), {Code.PREEMPTED}),
    'stop': (lambda rig, i: rig.tendons.stop('event'), {Code.STOPPED}),
    'fault': (lambda rig, i: setattr(rig, 'fault', 'event'), {Code.HARDWARE_FAULT}),
    'a valve breaks': (lambda rig, i: rig.broken.add(i), {Code.TIMEOUT, Code.SUCCESSFUL}),
    'a segment leaks': (
        lambda rig, i: rig.leaking.add(i), {Code.HARDWARE_FAULT, Code.TIMEOUT, Code.SUCCESSFUL}),
    'a stepper gets stuck': (
        lambda rig, i: setattr(rig, 'stuck', True), {Code.TIMEOUT, Code.SUCCESSFUL}),
    'someone stiffens': (
        lambda rig, i: rig.jamming.set_stiff(i, True),
        {Code.HARDWARE_FAULT, Code.TIMEOUT, Code.SUCCESSFUL}),
    'someone softens': (
        lambda rig, i: rig.jamming.set_stiff(i, False),
        {Code.HARDWARE_FAULT, Code.SUCCESSFUL}),
    'the limits change': (
        lambda rig, i: setattr(
            rig.tendons, 'limits', replace(rig.tendons.limits, speed_limit=1e-4)),
        {Code.HARDWARE_FAULT, Code.SUCCESSFUL}),
}
events = st.tuples(st.sampled_from(sorted(EVENTS)), st.integers(0, 2), st.floats(0.0, 8.0))


class NeverMovedStiff:
    """Tendons that still move when everything became stiff come to rest at once."""

    def __init__(self):
        self.since = None

    def __call__(self, rig):
        if rig.moving and all(rig.jamming.stiff):
            self.since = self.since or rig.now
            assert rig.now - self.since <= REACTION
        else:
            self.since = None


def disturbed(script, latency):
    """A run with events (name, segment, s after the one before), and its outcome."""
    rig = VirtualRig((BOW, replace(C_FORM, hold_time=0.0)), latency=latency)
    for name, segment, time in script:
        due = rig.now + time
        rig.run(NeverMovedStiff(), until=lambda rig, due=due: rig.now >= due)
        if rig.runner.outcome is None:
            EVENTS[name][0](rig, segment)
    outcome = rig.run(NeverMovedStiff(), most=60.0)
    rig.go_on(1.0, NeverMovedStiff())
    return rig, outcome


@property_test
@given(events, st.sampled_from([0.0, 0.01, 0.04]))
def test_any_event_at_any_moment_ends_a_run_in_a_defined_state(event, latency):
    rig, outcome = disturbed([event], latency)
    name, segment, _ = event
    assert outcome.code in EVENTS[name][1] | {Code.SUCCESSFUL}
    assert bool(outcome.message) == (outcome.code is not Code.SUCCESSFUL)
    assert outcome.shapes_completed == 2 or outcome.code is not Code.SUCCESSFUL
    check_progress(rig)
    assert not rig.moving
    if outcome.code is not Code.STOPPED:
        faulty = {segment} if name in ('a valve breaks', 'a segment leaks') else set()
        # What others soften after the end is not the run's.
        late = {segment} if name == 'someone softens' and outcome.code is Code.SUCCESSFUL else ()
        at_rest_and_stiff(rig, without=faulty.union(late))


@property_test
@given(st.lists(events, min_size=2, max_size=4), st.sampled_from([0.0, 0.01]))
def test_further_events_while_a_run_winds_down_do_not_keep_it_from_ending(script, latency):
    rig, outcome = disturbed(script, latency)
    assert outcome is not None
    check_progress(rig)
    before = list(rig.commands)
    rig.go_on(2.0)
    assert not rig.moving
    assert rig.commands == before
