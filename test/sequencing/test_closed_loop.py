# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes set by measurements on an arm that is not the model's, and what happens without them."""

from dataclasses import replace
from datetime import datetime
import re

import numpy as np
import pytest

from soft_continuum.planning.plans import Shape
from soft_continuum.planning.settings import ABORT, GO_ON, PAUSE
from soft_continuum.sequencing import Code, Phase
from support.measured_rig import LOOP, MeasuredRig, REACHED, SHAPE
from support.virtual_rig import (
    ARM,
    asked_to_soften,
    at_rest_and_stiff,
    one_soft_at_most_and_none_moved_stiff,
    PLAN_SETTINGS,
    reaches,
    STEP,
    TICK_STEPS,
)


def measuring(segment=1, **changes):
    """Return a rig that measures a soft segment (1-based)."""
    rig = MeasuredRig((SHAPE,), **changes)
    rig.run(until=reaches(Phase.MEASURING, segment))
    assert rig.runner.outcome is None
    return rig


@pytest.fixture(scope='module')
def corrected():
    """A run by measurements, checked at every step."""
    rig = MeasuredRig((SHAPE,))
    rig.run(one_soft_at_most_and_none_moved_stiff)
    return rig


# By measurements.


def test_without_them_this_arm_misses_its_shape():
    rig = MeasuredRig((SHAPE,), open_loop=True)
    assert rig.run().code is Code.SUCCESSFUL
    assert rig.error > np.radians(1.0)


def test_measurements_bring_every_segment_within_tolerance(corrected):
    outcome = corrected.runner.outcome
    assert (outcome.code, outcome.message, outcome.shapes_completed) == (Code.SUCCESSFUL, '', 1)
    assert corrected.error < REACHED
    assert outcome.measured
    at_rest_and_stiff(corrected)


def test_at_most_three_corrections_are_made_of_a_segment(corrected):
    made = [p.correction for p in corrected.progress]
    assert 1 <= max(made) <= LOOP.max_corrections
    assert 1 <= corrected.runner.outcome.corrections <= 2 * LOOP.max_corrections
    assert asked_to_soften(corrected) == [0, 1]  # nothing is worth a second pass


def test_three_segments_of_the_papers_arm_are_each_set_once():
    rig = MeasuredRig((Shape('bow', tuple(np.radians([25.0, -20.0, 30.0])), 0.2),),
                      arm=replace(ARM, bodies_per_segment=4))
    assert rig.run(one_soft_at_most_and_none_moved_stiff).code is Code.SUCCESSFUL
    assert rig.error < REACHED
    assert asked_to_soften(rig) == [0, 1, 2]
    assert 1 <= max(p.correction for p in rig.progress) <= LOOP.max_corrections


def test_progress_says_how_far_the_shape_is_from_its_aim(corrected):
    errors = [p.error for p in corrected.progress if p.error is not None]
    assert max(errors) == pytest.approx(np.abs(SHAPE.bending_angles).max(), abs=0.1)
    assert errors[-1] < 0.05 * max(errors)
    fractions = [p.fraction for p in corrected.progress]
    assert fractions[0] >= 0.0 and fractions[-1] == 1.0
    assert fractions == sorted(fractions)


def test_nothing_is_measured_before_the_arm_rests(corrected):
    begins, rest = [], None
    for before, now in zip(corrected.progress, corrected.progress[1:], strict=False):
        if before.phase != Phase.MEASURING and now.phase == Phase.MEASURING:
            rest = 0
        elif rest is not None and now.phase == Phase.MEASURING:
            rest += 1
        elif rest is not None:
            begins.append(rest * TICK_STEPS * STEP)
            rest = None
    assert len(begins) >= 4
    assert min(begins) >= LOOP.settling_time + LOOP.measuring_time - 4 * TICK_STEPS * STEP


def test_no_correction_when_none_is_allowed(corrected):
    rig = MeasuredRig((SHAPE,), loop=replace(LOOP, max_corrections=0, max_passes=1))
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff)
    assert (outcome.code, outcome.corrections) == (Code.SUCCESSFUL, 0)
    assert rig.error > corrected.error


@pytest.mark.parametrize('passes', [1, 2])
def test_a_second_pass_makes_up_for_what_stiffening_shifted(passes):
    rig = MeasuredRig((SHAPE,), loop=replace(LOOP, max_passes=passes), shift={1: 0.05})
    assert rig.run(one_soft_at_most_and_none_moved_stiff).code is Code.SUCCESSFUL
    again = asked_to_soften(rig)[2:]
    assert again in ([[]] if passes == 1 else PASSES)
    assert (rig.error < 1.5 * REACHED) == (passes == 2)
    assert ('degrees off' in rig.runner.warning) == (passes == 1)


PASSES = ([1], [0, 1])


@pytest.mark.parametrize('once', [False, True])
def test_a_pass_that_makes_the_shape_worse_is_the_last_and_is_taken_back_and_said(once):
    rig = MeasuredRig((SHAPE,), loop=replace(LOOP, max_passes=4), shift={1: 0.05})
    errors = []

    def check(rig):
        if len(asked_to_soften(rig)) > 2 and not (once and errors):
            errors.append(rig.error)
            rig.shift.setdefault(1, 0.12)  # when it is stiffened, or from then on

    assert rig.run(check).code is Code.SUCCESSFUL
    again = asked_to_soften(rig)[2:]  # once, and once more to set it back
    assert again in [a + b for a in PASSES for b in PASSES]
    assert 'correcting it made it worse, it was 2.' in rig.runner.warning
    assert not once or (rig.error < errors[0] + REACHED and 'and was undone' in rig.runner.warning)


def test_several_shapes_are_set_one_after_the_other():
    other = Shape('back', tuple(np.radians([-20.0, 10.0])), 0.0)
    rig = MeasuredRig((SHAPE, other))
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff)
    assert (outcome.code, outcome.shapes_completed) == (Code.SUCCESSFUL, 2)
    assert rig.error < REACHED


# Held.


def held(**changes):
    """Return a rig that still holds the shape, after it drifted."""
    rig = MeasuredRig((replace(SHAPE, hold_time=5.0),), **changes)
    rig.run(until=reaches(Phase.HOLDING))
    rig.softened = len(asked_to_soften(rig))
    rig.go_on(2.0)
    assert rig.runner.warning == ''
    rig.bend_by_itself(1, 0.08)
    return rig


@pytest.mark.parametrize(('correct_drift', 'words'), [
    (False, 'degrees'), (True, 'release_limit')])  # what carries too much is not softened for it
def test_a_drift_is_reported_and_moves_nothing(correct_drift, words):
    rig = held(loop=replace(LOOP, correct_drift=correct_drift, release_limit=0.0))
    commands = list(rig.commands)
    assert rig.run().code is Code.SUCCESSFUL
    assert 'bow drifted' in rig.runner.warning
    assert words in rig.runner.warning
    assert rig.commands == commands


def test_a_drift_is_corrected_when_that_is_asked_for():
    rig = held(loop=replace(LOOP, correct_drift=True, release_limit=0.1))
    assert rig.error > 0.07
    assert rig.run(one_soft_at_most_and_none_moved_stiff).code is Code.SUCCESSFUL
    assert rig.error < 1.5 * REACHED
    assert len(asked_to_soften(rig)) > rig.softened
    assert rig.runner.warning == ''


@pytest.mark.parametrize('aborts', [False, True])
def test_measurements_that_stop_while_a_drift_is_corrected(aborts):
    rig = held(loop=replace(LOOP, correct_drift=True, release_limit=0.1, abort_when_lost=aborts))
    rig.run(until=lambda rig: len(asked_to_soften(rig)) > rig.softened)
    rig.lost_after = 0.0
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff)
    assert outcome.code is (Code.HARDWARE_FAULT if aborts else Code.SUCCESSFUL)
    assert not outcome.measured
    at_rest_and_stiff(rig)


def test_a_correction_that_cannot_be_planned_leaves_the_shape_as_it_is():
    rig = held(loop=replace(LOOP, correct_drift=True, release_limit=0.1))
    rig.plan_settings = replace(PLAN_SETTINGS, pull_limits=(-1e-4, 1e-4))
    assert rig.run(one_soft_at_most_and_none_moved_stiff).code is Code.SUCCESSFUL
    assert 'pull_limits' in rig.runner.warning
    at_rest_and_stiff(rig)


# Without.


def test_without_measurements_it_does_just_what_an_open_loop_does():
    one, other = (MeasuredRig((SHAPE,), lost_after=-1.0, open_loop=o) for o in (True, False))
    outcomes = [rig.run(one_soft_at_most_and_none_moved_stiff) for rig in (one, other)]
    assert outcomes[0] == outcomes[1]
    assert not outcomes[1].measured and outcomes[1].corrections == 0
    assert len(one.commands) == len(other.commands)
    for ours, theirs in zip(one.commands, other.commands, strict=True):
        assert ours[:2] == theirs[:2]
        for a, b in zip(ours[2:], theirs[2:], strict=True):
            assert np.array_equal(a, b)
    assert [replace(p, error=0.0) for p in one.progress] == [
        replace(p, error=0.0) for p in other.progress]


@pytest.mark.parametrize('lost_after', [1.0, 3.0, 6.0])
def test_when_measurements_stop_it_goes_on_as_predicted(lost_after):
    rig = MeasuredRig((SHAPE,), lost_after=lost_after, loop=replace(LOOP, abort_when_lost=False))
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff)
    assert (outcome.code, outcome.shapes_completed) == (Code.SUCCESSFUL, 1)
    assert outcome.lost and not outcome.measured
    said = re.fullmatch(r'.* has not been measured since (\d\d:\d\d:\d\d): the shape is predicted',
                        outcome.message)
    assert said and outcome.message == rig.runner.warning  # once
    age = (datetime.now() - datetime.strptime(said[1], '%H:%M:%S')).seconds  # noqa: DTZ005, DTZ007
    assert 1.9 < age < 60.0
    assert rig.runner.aim is None
    at_rest_and_stiff(rig)


@pytest.mark.parametrize('aborts', [False, True])
def test_measurements_that_stop_between_two_shapes_are_lost_too(aborts):
    held = replace(SHAPE, hold_time=4.0)
    rig = MeasuredRig((held, held), loop=replace(LOOP, abort_when_lost=aborts))
    rig.run(until=lambda rig: rig.runner.progress.phase is Phase.HOLDING)
    rig.lost_after = rig.now - rig.begin
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff)
    assert not outcome.measured
    assert 'has not been measured' in outcome.message
    assert (outcome.code, outcome.shapes_completed, outcome.lost) == (
        (Code.HARDWARE_FAULT, 1, False) if aborts else (Code.SUCCESSFUL, 2, True))


@pytest.mark.parametrize(('lost_after', 'hidden'), [
    (1.0, (1, 2)), (3.0, (1, 2)), (6.0, (1, 2)), (3.0, (2,)), (6.0, (1,))])
def test_when_measurements_stop_it_ends_with_every_segment_stiff(lost_after, hidden):
    rig = MeasuredRig((SHAPE,), lost_after=lost_after, hidden=hidden)
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff)
    assert (outcome.code, outcome.shapes_completed) == (Code.HARDWARE_FAULT, 0)
    assert 'measured' in outcome.message
    assert not outcome.measured
    at_rest_and_stiff(rig)


# Ended early.


def test_an_anomaly_may_pause_it_until_somebody_says_go_on():
    rig = measuring(loop=replace(LOOP, on_anomaly=PAUSE))
    rig.anomaly = 'the right tendon slipped'
    rig.go_on(0.5)
    commands = list(rig.commands)
    rig.go_on(3.0)
    assert rig.runner.progress.phase == Phase.PAUSED
    rig.anomaly = ''  # which does not mean that nobody is at the arm
    rig.go_on(3.0)
    assert rig.runner.progress.phase == Phase.PAUSED
    assert 'slipped' in rig.runner.warning
    assert rig.commands == commands
    rig.runner.loop_settings = LOOP
    assert rig.run(one_soft_at_most_and_none_moved_stiff).code is Code.SUCCESSFUL
    assert rig.error < REACHED


@pytest.mark.parametrize('on_anomaly', [PAUSE, ABORT])
def test_nothing_is_softened_any_more_after_an_anomaly(on_anomaly):
    rig = MeasuredRig((SHAPE,), loop=replace(LOOP, on_anomaly=on_anomaly))
    rig.run(until=reaches(Phase.STIFFENING))
    rig.anomaly, before = 'the right tendon slipped', asked_to_soften(rig)
    rig.go_on(5.0)
    assert asked_to_soften(rig) == before == [0]
    assert all(rig.jamming.stiff)


def test_an_anomaly_may_be_passed_over():
    rig = measuring()
    rig.anomaly = 'the right tendon slipped'
    assert rig.run(one_soft_at_most_and_none_moved_stiff).code is Code.SUCCESSFUL


def slip(rig):
    rig.anomaly = 'the right tendon slipped'


def cancel(rig):
    rig.runner.cancel(Code.CANCELED, 'enough')


def cancel_once_it_is_paused(rig):
    slip(rig)
    rig.go_on(0.5)
    assert rig.runner.progress.phase is Phase.PAUSED
    cancel(rig)


def forbid_pulls(rig):  # so that no step can be planned
    rig.plan_settings = replace(PLAN_SETTINGS, pull_limits=(-1e-4, 1e-4))


@pytest.mark.parametrize(('until', 'happens', 'on_anomaly', 'code', 'message'), [
    (reaches(Phase.MEASURING, 1), slip, ABORT, Code.HARDWARE_FAULT, 'the right tendon slipped'),
    (lambda rig: reaches(Phase.MOVING)(rig) and rig.moving, slip, ABORT, Code.HARDWARE_FAULT,
     'the right tendon slipped'),
    (reaches(Phase.MEASURING, 1), cancel_once_it_is_paused, PAUSE, Code.CANCELED, 'enough'),
    *((reaches(Phase.MEASURING, n), cancel, GO_ON, Code.CANCELED, 'enough') for n in (0, 1, 2)),
    (reaches(Phase.MEASURING, 1), forbid_pulls, GO_ON, Code.MODEL_FAILURE, 'pull_limits')])
def test_ended_early_it_leaves_every_segment_stiff(until, happens, on_anomaly, code, message):
    rig = MeasuredRig((SHAPE,), loop=replace(LOOP, on_anomaly=on_anomaly))
    rig.run(until=until)
    assert rig.runner.outcome is None
    happens(rig)
    outcome = rig.run(one_soft_at_most_and_none_moved_stiff, most=5.0)
    assert outcome.code is code and message in outcome.message
    at_rest_and_stiff(rig)


@pytest.mark.parametrize('segment', [1, 2])
def test_stopped_while_it_measures_it_leaves_everything_as_it_is(segment):
    rig = measuring(segment)
    commands = list(rig.commands)
    rig.tendons.stop('e-stop')
    assert rig.run(most=2.0).code is Code.STOPPED
    assert rig.commands == commands
    assert rig.soft[segment - 1]


def test_a_segment_that_loses_its_stiffness_while_it_measures_ends_it():
    rig = measuring(2)
    rig.leaking.add(0)
    outcome = rig.run(most=10.0)
    assert outcome.code is Code.HARDWARE_FAULT
    assert 'segment 1' in outcome.message
