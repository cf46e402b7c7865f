# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Angles at which stiff segments that give are to be locked, so that the shape ends right."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from soft_continuum.mechanics import pulls_for_bending, Statics, StaticsError
from soft_continuum.mechanics.arm import mounted
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.laws import Jam
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.mechanics.statics import PRETENSIONS
from soft_continuum.planning.aiming import (
    Aim,
    angles_to_set,
    FARTHEST,
    next_step,
    predicted_state,
    segments_worth_correcting,
)
from soft_continuum.planning.planner import Planner, PlanSettings
from soft_continuum.planning.plans import PlanError, WHOLE_ARM
from soft_continuum.ros.description import load_arm
from support.flat_arm import about_y
from support.virtual_rig import ARM, DESCRIPTION


def elastic(arm, bodies, ratio=15.0):
    """An arm of few bodies with jams that give."""
    return replace(arm, bodies_per_segment=bodies, segments=tuple(
        replace(s, jam=Jam(ratio)) for s in arm.segments))


def arm_in_space(name='spatial_jamming'):
    return load_arm(DESCRIPTION.with_name(f'{name}.yaml'))


ELASTIC = elastic(ARM, 4)
SETTINGS = PlanSettings(angle_step=np.radians(6.0))
ALL = (0, 1, 2)
C_FORM, S_FORM = np.radians([30.0, 30.0, 30.0]), np.radians([25.0, -25.0, 25.0])
LOCK_IN = 0.006
ANGLES, DIRECTIONS = np.radians([25.0, 20.0, 25.0]), (0.6, 2.5, -1.0)  # in space
FALLS = -0.109, -0.178  # rad: where the least tensions leave segment 2 free to fall


@pytest.fixture(scope='module')
def statics():
    return Statics(ELASTIC)


def aim_at(angles, on_tip=False):
    """Return the aim at angles, and at where the tip is when all segments bend evenly by them."""
    state = Statics(ELASTIC).chain.uniform(angles)
    return Aim(state.bending, state.backbone[-1], on_tip)


def walk(statics, state, segments, angles):
    """Set segments one after the other, by the statics alone."""
    angles = np.reshape(angles, (len(segments), -1))[:, -1]  # about y
    for segment, angle in zip(segments, angles, strict=True):
        state = statics.bend(state, segment, float(angle))
    return state


def shifted(statics, state, segment, change):
    """Return a stiff arm whose segment has bent by about ``change`` when it was stiffened."""
    chain = statics.chain
    per_segment = chain.joints_per_segment
    held = state.held.copy()
    held[segment * per_segment:(segment + 1) * per_segment] += change / per_segment
    state = replace(state, held=held, stiff=(True,) * 3)
    return statics.solve(state, state.pulls - 1e-4, (False,) * 3)


def again_of(statics, state, *arguments):
    """Return what is worth setting again of an arm whose motors stand where the tendons do."""
    return segments_worth_correcting(Planner(statics.chain.arm, SETTINGS), state, state.pulls,
                               *arguments)


@pytest.fixture(scope='module')
def spatial():
    return SpaceStatics(elastic(arm_in_space(), 3))


@pytest.fixture(scope='module')
def bending(spatial):
    return bending_vectors(spatial.chain.arm, ANGLES.tolist(), DIRECTIONS)


@pytest.mark.parametrize(('wanted', 'on_tip'), [
    (C_FORM, False), (C_FORM, True), (S_FORM, False), (-C_FORM, False), (None, False),
    (None, True)])
def test_the_angles_or_the_tip_are_right_after_the_last_segment_was_set(
        statics, spatial, bending, wanted, on_tip):
    in_space = wanted is None
    statics, wanted = (spatial, bending) if in_space else (statics, about_y(wanted))
    chain = statics.chain
    aim = Aim(wanted, chain.uniform(wanted).backbone[-1], on_tip)
    found, after = angles_to_set(statics, chain.straight(), ALL, aim)
    there, naive = (
        predicted_state(statics, chain.straight(), ALL, one) for one in (found, wanted))
    assert after.coordinates == pytest.approx(there.coordinates, abs=1e-9)
    off, far = (np.linalg.norm(one.bending - wanted, axis=1).max() for one in (there, naive))
    miss, wide = (np.linalg.norm(one.backbone[-1] - aim.tip) for one in (there, naive))
    assert aim.error(there) == pytest.approx(miss if on_tip else off)
    if on_tip:
        assert miss < 1e-4
        assert wide > (1e-3 if in_space else 2e-3)
        assert off < np.radians(5.0)  # of that kind of shape
    else:
        assert off < np.radians(0.1)
        assert far > np.radians(0.5 if in_space else 0.9)


def test_the_later_segments_bring_the_tip_where_it_belongs_past_a_wrong_first_one(statics):
    first = statics.bend(statics.chain.straight(), 0, C_FORM[0] + np.radians(4.0))
    aim = aim_at(C_FORM, on_tip=True)
    found, _ = angles_to_set(statics, first, (1, 2), aim)
    assert np.linalg.norm(walk(statics, first, (1, 2), found).backbone[-1] - aim.tip) < 1e-4
    kept, _ = angles_to_set(statics, first, (1, 2), replace(aim, on_tip=False))
    there = walk(statics, first, (1, 2), kept)
    assert there.bending_angles[1:] == pytest.approx(C_FORM[1:], abs=np.radians(0.1))
    assert np.linalg.norm(there.backbone[-1] - aim.tip) > 5e-3  # angles do not make up for it


def test_angles_to_set_stay_within_the_limits(statics):
    limits = ELASTIC.bending_angle_limits
    aim = aim_at(0.6 * limits, on_tip=True)
    aim = replace(aim, tip=np.array([10.0, 0.0, 0.0]))  # nobody reaches that
    found, _ = angles_to_set(statics, statics.chain.straight(), ALL, aim)
    assert np.all(np.abs(found) <= limits[:, None])


def test_no_segment_is_set_far_from_where_it_is_to_end():
    floppy = Statics(replace(ELASTIC, gravity=mounted(1.2), segments=tuple(
        replace(s, jam=Jam(1.5)) for s in ELASTIC.segments)))
    aim = aim_at(0.3 * C_FORM)
    found, _ = angles_to_set(floppy, floppy.chain.straight(), ALL, aim)
    assert np.abs(found - aim.bending).max() <= FARTHEST


def test_mirrored_aims_have_mirrored_angles(statics):
    straight = statics.chain.straight()
    for on_tip in (False, True):
        aim = aim_at(S_FORM, on_tip)
        image = aim_at(-S_FORM, on_tip)
        one, other = (angles_to_set(statics, straight, ALL, a)[0] for a in (aim, image))
        assert one == pytest.approx(-other, abs=1e-4)


def test_prediction_is_one_segment_after_the_other(statics):
    straight = statics.chain.straight()
    bending = about_y([0.3, -0.2, 0.1])
    there = walk(statics, straight, (2, 0, 1), bending)
    found = predicted_state(statics, straight, (2, 0, 1), bending)
    assert np.array_equal(found.joint_angles, there.joint_angles)


def test_what_is_soft_now_counts_as_locked_by_the_full_vacuum_later(statics):
    soft = statics.bend(statics.chain.straight(), 0, 0.2)
    full = predicted_state(statics, soft, ALL, aim_at(C_FORM).bending)
    vented = predicted_state(statics, replace(soft, vacuum=(0.01, 1.0, 1.0)), ALL,
                             aim_at(C_FORM).bending)
    assert vented.bending_angles == pytest.approx(full.bending_angles, abs=1e-6)


# The next step.


def soft(planner, segment, angle=0.3):
    """Return an arm with one segment soft and bent, and the pulls there."""
    statics = planner.statics
    state = statics.bend(statics.chain.straight(), segment, angle)
    return state, statics.commanded_pulls(state)


def test_the_next_step_leads_to_the_angle_that_is_to_be_locked():
    planner = Planner(ELASTIC, SETTINGS)
    state, pulls = soft(planner, 0)
    aim = aim_at(C_FORM)
    wanted, _ = angles_to_set(planner.statics, state, ALL, aim)
    step = next_step(planner, state, pulls, ALL, aim, 5e-5)
    assert step.change == pytest.approx(wanted[0, 1] - 0.3, abs=1e-6)
    assert step.error == pytest.approx(np.abs(C_FORM - state.bending_angles).max())
    assert step.predicted < np.radians(0.1)
    there = planner.statics.solve(state, step.move.pulls[-1], (True, False, False))
    assert there.bending_angles[0] == pytest.approx(wanted[0, 1], abs=np.radians(0.1))
    assert step.move.pulls[0] == pytest.approx(pulls)


@pytest.mark.parametrize(('turn', 'dead_band', 'moves'), [  # turn: in angle_tolerance
    (2.0, 5e-5, True), (2.0, 1.0, False),  # friction does not let it through
    (0.5, 0.0, False)])
def test_what_is_within_tolerance_or_friction_does_not_let_through_is_not_sent(
        turn, dead_band, moves):
    planner = Planner(ELASTIC, SETTINGS)
    state, pulls = soft(planner, 2)
    turn *= SETTINGS.angle_tolerance
    step = next_step(planner, state, pulls, (2,),
                     aim_at(state.bending_angles + [0.0, 0.0, turn]), dead_band)
    assert (step.move is not None) == moves
    assert not moves or step.change == pytest.approx(turn, rel=0.1)


def test_a_step_beyond_the_limits_names_its_segment():
    planner = Planner(ELASTIC, replace(SETTINGS, pull_limits=(-0.012, 0.012)))
    state, pulls = soft(planner, 1, 0.2)
    with pytest.raises(PlanError, match='segment 2: .*pull_limits'):
        next_step(planner, state, pulls, (1,), aim_at(2.0 * C_FORM), 5e-5)


# Again.


@pytest.fixture(scope='module')
def good(statics):
    """Return an aim, and a stiff arm that was set to it."""
    aim = aim_at(C_FORM)
    angles, after = angles_to_set(statics, statics.chain.straight(), ALL, aim)
    state = statics.solve(after, after.pulls, (False,) * 3)
    return Aim(state.bending, state.backbone[-1]), state


@pytest.mark.parametrize(('shift', 'on_tip', 'lock_in', 'again'), [
    (None, False, LOCK_IN, [()]), (None, True, LOCK_IN, [()]),  # it is good
    (2, False, LOCK_IN, [(2,)]), (1, False, LOCK_IN, [(1, 2)]), (0, False, LOCK_IN, [ALL]),
    (0, True, LOCK_IN, [(1, 2), (2,)]),  # the first one may stay as it is
    (2, False, 0.1, [()])])  # stiffening would shift it as much again
def test_as_few_segments_are_set_again_as_make_up_for_one_that_shifted(
        statics, good, shift, on_tip, lock_in, again):
    aim, state = good
    off = state if shift is None else shifted(statics, state, shift, 0.05)
    assert again_of(statics, off, ALL, replace(aim, on_tip=on_tip), lock_in) in again


def test_what_would_fall_is_not_softened_by_itself(good):
    aim, state = good
    planner = Planner(ELASTIC, SETTINGS, offsets=(5e-4, -5e-4))
    off = shifted(planner.statics, state, 1, 0.05)
    # As it comes over ROS: joint angles alone, and nothing of the tendons.
    seen = replace(planner.statics.chain.state(off.joint_angles), held=off.held)
    limit = 0.01
    taut = off.pulls - (5e-4, -5e-4)
    assert segments_worth_correcting(planner, seen, taut, ALL, aim, LOCK_IN, limit) == (1, 2)
    slack = taut - 0.01  # nothing but the jams holds the arm up
    assert segments_worth_correcting(planner, seen, slack, ALL, aim, LOCK_IN, limit) == ()
    assert segments_worth_correcting(planner, seen, slack, ALL, aim, LOCK_IN) != ()


def test_a_jam_that_seems_to_yield_is_not_set_to_an_angle_again(good):
    aim, state = good
    for ratio, again in ((9.0, ALL), (7.0, ())):
        weak = Statics(replace(ELASTIC, segments=tuple(
            replace(s, jam=Jam(ratio)) for s in ELASTIC.segments)))
        off = shifted(weak, replace(state, chain=weak.chain), 0, 0.05)
        assert again_of(weak, off, ALL, aim, LOCK_IN) == again
        assert again_of(weak, off, ALL, replace(aim, on_tip=True), LOCK_IN)


# In space.


def test_a_segment_that_would_fall_over_is_held_by_all_tendons():
    arm = arm_in_space()
    soft_one = replace(arm.segments[1], **{name: 0.7 * getattr(arm.segments[1], name)
                                           for name in ('stiffness_x', 'stiffness_y')})
    statics = SpaceStatics(replace(arm, bodies_per_segment=4, payload=0.03, segments=(
        arm.segments[0], soft_one, arm.segments[2])))
    wanted, soft = np.full((3, 2), np.nan), (False, True, False)
    wanted[1] = FALLS
    with pytest.raises(StaticsError, match='on the way'):
        pulls_for_bending(statics, statics.chain.straight(), wanted, soft)
    fit = statics.hold(statics.chain.straight(), wanted, soft)
    assert fit.state.bending[1] == pytest.approx(FALLS, abs=1e-8)
    assert fit.state.tensions.min() >= PRETENSIONS[1] - 1e-6


def test_what_is_not_wanted_any_more_ends(spatial, bending):
    planner = Planner(spatial.chain.arm, PlanSettings(), lambda: True)
    with pytest.raises(PlanError, match='abandoned'):
        segments_worth_correcting(planner, spatial.chain.straight(), [0.0] * 3, ALL,
                            Aim(bending, np.zeros(3)), 0.006)


def test_the_error_of_a_bending_counts_in_every_direction(spatial, bending):
    aim = Aim(bending, np.zeros(3))
    turned = bending_vectors(spatial.chain.arm, ANGLES.tolist(), (0.6, 2.5 + pi / 2, -1.0))
    assert aim.error(spatial.chain.uniform(turned)) == pytest.approx(
        np.sqrt(2.0) * ANGLES[1], rel=1e-6)


def test_an_arm_without_jamming_is_set_as_a_whole():
    arm = arm_in_space('tendon_arm')
    planner = Planner(arm, PlanSettings(jamming=False, angle_step=0.3))
    goal = bending_vectors(arm, (0.2, 0.1, 0.2), (0.5, 2.0, -1.0))
    state = planner.statics.solve(planner.statics.chain.straight(), np.zeros(9), (True,) * 3)
    step = next_step(planner, state, np.zeros(9), (WHOLE_ARM,), Aim(goal, np.zeros(3)), 5e-5)
    assert step.move.segment == WHOLE_ARM
    assert step.predicted < np.radians(0.1) < step.error
    there = planner.statics.solve(state, step.move.pulls[-1], (True,) * 3)
    assert there.bending == pytest.approx(goal, abs=np.radians(0.5))
    assert next_step(planner, there, step.move.pulls[-1], (WHOLE_ARM,),
                     Aim(there.bending, np.zeros(3)), 5e-5).move is None
