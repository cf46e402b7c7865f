# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What part of full vacuum does to the stiffness and the limit of a jam."""

import numpy as np
import pytest

from soft_continuum.mechanics import SLACK, Statics, Wrench
from soft_continuum.mechanics.laws import Jam, linear, MomentCurvature
from support.energy_reference import Reference
from support.general_arms import paper_like, STIFFNESS
from support.spatial_arms import three_segments


@pytest.mark.parametrize('exponent', [0.5, 1.0, 2.0])
@pytest.mark.parametrize('vacuum', [0.2, 0.7])
def test_the_jams_stiffness_grows_with_vacuum_to_its_power(exponent, vacuum):
    part = Statics(paper_like(1, Jam(5.0, stiffness_exponent=exponent)))
    full = Statics(paper_like(1, Jam(1.0 + 4.0 * vacuum**exponent)))
    straight = part.chain.straight()
    one = part.solve(straight, (0.01, SLACK), (False,), vacuum=(vacuum,))
    other = full.solve(straight, (0.01, SLACK), (False,))
    assert one.joint_angles == pytest.approx(other.joint_angles, abs=1e-12)
    assert one.tensions == pytest.approx(other.tensions, rel=1e-12)


@pytest.mark.parametrize('exponent', [0.0, 0.5, 1.0])
@pytest.mark.parametrize('vacuum', [0.1, 0.5, 1.0])
def test_the_limit_is_proportional_to_vacuum(exponent, vacuum):
    statics = Statics(paper_like(
        1, Jam(6.0, yield_moment=0.05, stiffness_exponent=exponent)))
    state = statics.solve(statics.chain.straight(), (0.014, SLACK), (False,), vacuum=(vacuum,))
    moments = Reference(statics.chain.arm, state.stiff, state.held,
                        vacuum=(vacuum,)).jam_moments(state.joint_angles)
    assert moments == pytest.approx(0.05 * vacuum, rel=1e-9)


@pytest.mark.parametrize('jam', [
    Jam(), Jam(5.0), Jam(5.0, yield_moment=0.1), Jam(law=linear(1.0)),
    Jam(5.0, stiffness_exponent=0.0), Jam(5.0, yield_moment=0.1, stiffness_exponent=0.0)])
def test_without_vacuum_a_jam_holds_nothing(jam):
    statics = Statics(paper_like(2, jam, gravity=9.80665, mounting_angle=2.0))
    straight = statics.chain.straight()
    stiff = statics.solve(straight, (0.01, SLACK), (True, False), vacuum=(0.0, 0.0))
    soft = statics.solve(straight, (0.01, SLACK), (True, True))
    assert stiff.joint_angles == pytest.approx(soft.joint_angles, abs=1e-10)


@pytest.mark.parametrize('arm', [paper_like(3), three_segments()], ids=['plane', 'space'])
def test_a_rigid_jam_has_all_its_vacuum_or_none(arm):
    statics = Statics(arm)
    with pytest.raises(ValueError, match='vacuum of segment 2 is 0.3; its jam is rigid'):
        statics.solve(statics.chain.straight(), [0.0] * len(arm.tendons), (True, False, True),
                      vacuum=(0.3, 0.3, 0.3))


def test_more_vacuum_moves_nothing_beyond_the_last_row_of_a_table():
    soft_law = MomentCurvature((0.0, 5.0), (0.0, 0.05))
    statics = Statics(paper_like(1, Jam(5.0), soft_law))
    some = statics.solve(statics.chain.straight(), (0.012, SLACK), (False,), vacuum=(0.3,))
    assert some.joint_angles.max() > 1.2 * 5.0 * statics.chain.joint_lengths[0]
    full = statics.solve(some, (0.012, SLACK), (False,))
    assert full.joint_angles == pytest.approx(some.joint_angles, abs=1e-9)
    assert full.tensions == pytest.approx(some.tensions, abs=1e-6)


def test_bending_keeps_the_vacuum_unless_another_is_given():
    statics = Statics(paper_like(3, Jam(5.0)))
    start = statics.solve(
        statics.chain.straight(), (0.005, SLACK), (False, True, False), vacuum=(0.3, 1.0, 1.0))
    assert statics.bend(start, 1, 0.3).vacuum == (0.3, 1.0, 1.0)
    assert statics.bend(start, 1, 0.3, vacuum=(0.5, 1.0, 1.0)).vacuum == (0.5, 1.0, 1.0)


@pytest.mark.parametrize('vacuum', [1.0, 0.4, 0.1, 0.01])
def test_a_segment_turns_by_the_moments_of_a_load_over_the_stiffness_at_its_vacuum(vacuum):
    """By hand: each of the n + 1 joints turns by F lever / (c (1 + (K - 1) v^a)), c (5)."""
    force, length, height, bodies, bending = 0.02, 0.07, 0.03, 12, STIFFNESS[0]
    statics = Statics(paper_like(1, Jam(9.0, stiffness_exponent=0.7), bodies=bodies,
                                 wrenches=(Wrench(1, (force, 0.0, 0.0)),)))
    stiff = statics.solve(statics.chain.straight(), (SLACK, SLACK), (False,), vacuum=(1.0,))
    state = statics.solve(stiff, (SLACK, SLACK), (False,), vacuum=(vacuum,))
    levers = height / 2 + length * np.arange(bodies + 1) / bodies
    joint = (bodies + 1) * bending / length * (1.0 + 8.0 * vacuum**0.7)
    assert state.bending_angles[0] == pytest.approx(force * levers.sum() / joint, rel=2e-3)
    # More vacuum holds the shape that is there.
    more = statics.solve(state, (SLACK, SLACK), (False,), vacuum=(1.0,))
    assert more.bending_angles == pytest.approx(state.bending_angles, rel=1e-9)
