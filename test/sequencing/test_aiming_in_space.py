# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Bendings in space at which segments are to be locked, for the shape or the tip to end right."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from soft_continuum.mechanics import Jam, pulls_for_bending, StaticsError
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.mechanics.statics import PRETENSIONS
from soft_continuum.parameters.files import load_arm
from soft_continuum.sequencing.aiming import (
    Aim,
    angles_to_set,
    next_step,
    predicted,
    worth_setting_again,
)
from soft_continuum.sequencing.planner import PlanError, Planner, PlanSettings, WHOLE_ARM
from soft_continuum.user_files import description_file

ALL = (0, 1, 2)
FALLS = -0.109, -0.178  # rad: where the least tensions leave segment 2 free to fall
ANGLES, DIRECTIONS = np.radians([25.0, 20.0, 25.0]), (0.6, 2.5, -1.0)


@pytest.fixture(scope='module')
def statics():
    arm = load_arm(description_file().with_name('spatial_jamming.yaml'))
    return SpaceStatics(replace(arm, bodies_per_segment=3, segments=tuple(
        replace(s, jam=Jam(15.0)) for s in arm.segments)))


@pytest.fixture(scope='module')
def bending(statics):
    return bending_vectors(statics.chain.arm, ANGLES.tolist(), DIRECTIONS)


def test_a_segment_that_would_fall_over_is_held_by_all_tendons():
    arm = load_arm(description_file().with_name('spatial_jamming.yaml'))
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


@pytest.mark.parametrize('on_tip', [False, True])
def test_the_shape_or_the_tip_is_right_after_the_last_segment_was_set(statics, bending, on_tip):
    chain = statics.chain
    aim = Aim(bending, chain.uniform(bending).tip, on_tip)
    found, after = angles_to_set(statics, chain.straight(), ALL, aim)
    there, naive = (predicted(statics, chain.straight(), ALL, one) for one in (found, bending))
    assert after.points == pytest.approx(there.points, abs=1e-9)
    assert aim.error(there) < (1e-4 if on_tip else np.radians(0.1))
    assert aim.error(naive) > (1e-3 if on_tip else np.radians(0.5))
    assert np.linalg.norm(there.bending - bending, axis=1).max() < np.radians(5.0)


def test_what_is_not_wanted_any_more_ends(statics, bending):
    planner = Planner(statics.chain.arm, PlanSettings(), lambda: True)
    with pytest.raises(PlanError, match='abandoned'):
        worth_setting_again(planner, statics.chain.straight(), [0.0] * 3, ALL,
                            Aim(bending, np.zeros(3)), 0.006)


def test_the_error_of_a_bending_counts_in_every_direction(statics, bending):
    aim = Aim(bending, np.zeros(3))
    turned = bending_vectors(statics.chain.arm, ANGLES.tolist(), (0.6, 2.5 + pi / 2, -1.0))
    assert aim.error(statics.chain.uniform(turned)) == pytest.approx(
        np.sqrt(2.0) * ANGLES[1], rel=1e-6)


def test_an_arm_without_jamming_is_set_as_a_whole():
    arm = load_arm(description_file().with_name('tendon_arm.yaml'))
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
