# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tendons that stretch, and tendons of given tension."""

from math import inf

import numpy as np
import pytest

from soft_continuum.mechanics import LEFT, RIGHT, SLACK, Statics
from support.energy_reference import Reference
from support.flat_arm import made_of, path_compliance
from support.general_arms import paper_like


@pytest.mark.parametrize('asked', [(0.015, SLACK), (0.015, -0.002), (-0.004, 0.01)])
@pytest.mark.parametrize('gravity', [0.0, 9.80665])
def test_stretched_tendons_are_springs_in_the_energy(asked, gravity):
    arm = paper_like(2, gravity=gravity, mounting_angle=2.5, tendon=made_of(800.0, 0.5))
    statics = Statics(arm)
    state = statics.solve(statics.chain.straight(), asked, (True, True))
    expected = Reference(arm).rest(
        statics.chain.straight().joint_angles, stretch=(asked, path_compliance(arm)))
    assert state.joint_angles == pytest.approx(expected, abs=1e-6)


def test_the_stiffer_the_tendon_the_closer_to_one_that_does_not_stretch():
    arm = paper_like(3, gravity=9.80665, mounting_angle=2.0)
    apart, shapes = [], {}
    for stiffness in (1e4, 1e5, 1e6, inf):
        statics = Statics(arm.with_tendons(**made_of(stiffness)))
        state = statics.solve(statics.chain.straight(), (0.03, SLACK), (True,) * 3)
        shapes[stiffness] = np.append(state.joint_angles, state.tensions)
    apart = [np.abs(shapes[s] - shapes[inf]).max() for s in (1e4, 1e5, 1e6)]
    assert apart[0] / apart[1] == pytest.approx(10.0, rel=0.05)
    assert apart[1] / apart[2] == pytest.approx(10.0, rel=0.05)


def test_both_tendons_pulled_alike_stretch_where_rigid_ones_buckle_the_arm():
    arm = paper_like(1)
    rigid = Statics(arm)
    buckled = rigid.solve(rigid.chain.straight(), (0.0005, 0.0005), (True,))
    assert buckled.jumped
    assert np.abs(buckled.joint_angles).max() > 0.1
    statics = Statics(arm.with_tendons(**made_of(500.0)))
    state = statics.solve(statics.chain.straight(), (0.0005, 0.0005), (True,))
    assert not state.jumped
    assert state.joint_angles == pytest.approx(0.0, abs=1e-10)
    assert state.tensions == pytest.approx([500.0 * 0.0005 / 0.13] * 2, rel=1e-9)


def test_the_antagonist_stiffens_the_arm():
    # Against a force both tendons of a straight arm work: it gives way less than with none.
    statics = Statics(paper_like(1, gravity=9.80665, mounting_angle=np.pi / 2,
                                 tendon=made_of(500.0)))
    straight = statics.chain.straight()
    hanging = statics.solve(straight, (SLACK, SLACK), (True,))
    held = statics.solve(straight, (0.0005, 0.0005), (True,))
    assert held.tensions[LEFT] > held.tensions[RIGHT] >= 0.0
    assert 0.0 < held.joint_angles.sum() < 0.5 * hanging.joint_angles.sum()


