# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Both chains have the compliance l/EI of the rod; they share it out differently."""


import pytest

from soft_continuum.mechanics import SLACK, Statics
from soft_continuum.mechanics.arm import PAPER, SECOND_ORDER, Wrench
from soft_continuum.mechanics.plane.chain import PlaneChain
from support.general_arms import paper_like

KINDS = pytest.mark.parametrize('kind', [PAPER, SECOND_ORDER])


@pytest.mark.parametrize('bodies', [1, 2, 3, 12])
def test_springs_are_equal_or_of_second_order_twice_as_stiff_at_the_ends(bodies):
    rod = 0.0265 / 0.07
    paper, second = (PlaneChain(paper_like(1, bodies=bodies, discretisation=kind))
                     for kind in (PAPER, SECOND_ORDER))
    assert paper.joint_stiffness == pytest.approx([(bodies + 1) * rod] * (bodies + 1))
    assert second.joint_stiffness == pytest.approx(
        [2 * bodies * rod, *[bodies * rod] * (bodies - 1), 2 * bodies * rod])
    assert paper.joint_lengths.sum() == pytest.approx(0.07, rel=1e-12)
    assert second.joint_lengths.sum() == pytest.approx(0.07, rel=1e-12)


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
