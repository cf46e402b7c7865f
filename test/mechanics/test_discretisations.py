# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Both chains have the compliance l/EI of the rod; they share it out differently."""

from dataclasses import replace

from hypothesis import given
import numpy as np
import pytest

from soft_continuum.mechanics import ArmError, SLACK, Statics
from soft_continuum.mechanics.arm import PAPER, SECOND_ORDER, Wrench
from soft_continuum.mechanics.plane.chain import PlaneChain
from support.general_arms import arms, FEW, paper_like

KINDS = pytest.mark.parametrize('kind', [PAPER, SECOND_ORDER])


@FEW
@given(arms(bodies=(1, 30)))
def test_all_springs_of_a_segment_together_give_way_as_its_rod_does(arm):
    for kind in (PAPER, SECOND_ORDER):
        chain = PlaneChain(replace(arm, discretisation=kind))
        compliance = (1.0 / chain.joint_stiffness).reshape(len(arm.segments), -1).sum(axis=1)
        rods = [s.length / s.stiffness_y for s in arm.segments]
        assert compliance == pytest.approx(rods, rel=1e-12)
        lengths = chain.joint_lengths.reshape(len(arm.segments), -1).sum(axis=1)
        assert lengths == pytest.approx([s.length for s in arm.segments], rel=1e-12)


@pytest.mark.parametrize('bodies', [1, 2, 3, 12])
def test_springs_of_the_papers_chain_are_equal(bodies):
    chain = PlaneChain(paper_like(1, bodies=bodies))
    rod = 0.0265 / 0.07
    assert chain.joint_stiffness == pytest.approx([(bodies + 1) * rod] * (bodies + 1))


@pytest.mark.parametrize('bodies', [1, 2, 3, 12])
def test_end_springs_of_the_second_order_chain_are_twice_as_stiff_as_those_between(bodies):
    chain = PlaneChain(paper_like(1, bodies=bodies, discretisation=SECOND_ORDER))
    rod = 0.0265 / 0.07
    expected = [2 * bodies * rod, *[bodies * rod] * (bodies - 1), 2 * bodies * rod]
    assert chain.joint_stiffness == pytest.approx(expected)


@KINDS
@pytest.mark.parametrize('bodies', [1, 2, 5, 20])
def test_a_moment_bends_a_segment_as_its_rod_however_many_bodies(kind, bodies):
    # Two heavy forces a disc apart are nearly a moment: dead ones, on a straight arm, a small one.
    arm = paper_like(2, bodies=bodies, discretisation=kind,
                     wrenches=(Wrench(1, (-1e-4, 0.0, 0.0)), Wrench(2, (1e-4, 0.0, 0.0))))
    statics = Statics(arm)
    state = statics.solve(statics.chain.straight(), (SLACK, SLACK), (True, False))
    moment = 1e-4 * (0.03 + 0.07)  # between the centres of the discs
    angle = state.bending_angles[0]
    assert angle == pytest.approx(moment * 0.07 / 0.0265, rel=1e-6)


@KINDS
def test_both_chains_are_the_same_rod_in_the_limit(kind):
    arm = paper_like(1, bodies=400, discretisation=kind)
    fine, rough = Statics(arm), Statics(paper_like(1, bodies=50, discretisation=SECOND_ORDER))
    one, other = (s.solve(s.chain.straight(), (0.012, SLACK), (True,)) for s in (fine, rough))
    assert one.joint_angles.sum() == pytest.approx(other.joint_angles.sum(), rel=2e-3)
    assert one.tensions == pytest.approx(other.tensions, rel=2e-3)


def test_a_discretisation_that_is_none_is_refused():
    with pytest.raises(ArmError, match='paper, second_order'):
        paper_like(1, discretisation='third_order')
    assert np.isclose(PlaneChain(paper_like(1)).joint_lengths.sum(), 0.07)
