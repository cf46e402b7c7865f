# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Gravity for any mounting, payload, forces on discs, and the compliance of both chains."""

from dataclasses import replace
from math import cos, pi, sin

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import Disc, RIGHT, SLACK, Statics
from soft_continuum.mechanics.arm import mounted, PAPER, SECOND_ORDER, Wrench
from soft_continuum.mechanics.plane.chain import PlaneChain
from support.general_arms import arms, between, FEW, masks, paper_like, pulls

BOTH_SLACK = (SLACK, SLACK)
HANGING, HORIZONTAL = pi, pi / 2


# Payload

@FEW
@given(arms(), st.data(), between(0.0, 0.05))
def test_a_payload_is_a_higher_and_heavier_tip_disc(arm, data, payload):
    # Mass m + p whose middle is where the two have their centre: half of h' = h (m + 2 p)/(m + p).
    tip = arm.discs[-1]
    mass = tip.mass + payload
    height = tip.height * (tip.mass + 2 * payload) / mass if mass > 0.0 else tip.height
    laden = Statics(replace(arm, payload=payload))
    heavier = Statics(replace(arm, discs=(*arm.discs[:-1], Disc(height, mass))))
    straight = laden.chain.straight()
    soft = data.draw(masks(arm))
    asked = data.draw(pulls(arm, straight, soft))
    one, other = (s.solve(straight, asked, soft) for s in (laden, heavier))
    assert one.joint_angles == pytest.approx(other.joint_angles, abs=1e-9)
    assert one.tensions == pytest.approx(other.tensions, rel=1e-8, abs=1e-8)


# Forces

def test_a_force_on_the_base_does_nothing():
    arm = paper_like(2, gravity=9.80665, mounting_angle=2.0)
    pushed, free = Statics(arm.with_force(0, (50.0, 0.0, -30.0))), Statics(arm)
    one, other = (s.solve(s.chain.straight(), (0.01, SLACK), (True, True)) for s in (free, pushed))
    assert np.array_equal(one.joint_angles, other.joint_angles)
    assert np.array_equal(one.tensions, other.tensions)


def test_forces_on_one_disc_add_up():
    arm = paper_like(2)
    parts = tuple(Wrench(2, f) for f in ((0.05, 0.0, 0.0), (0.02, 0.0, -0.1), (0.0, 0.0, 0.03)))
    at_once = (Wrench(2, (0.07, 0.0, -0.07)),)
    split, whole = (Statics(replace(arm, wrenches=f)) for f in (parts, at_once))
    one, other = (s.solve(s.chain.straight(), BOTH_SLACK, (True, True)) for s in (split, whole))
    assert one.joint_angles == pytest.approx(other.joint_angles, abs=1e-12)


# Mounting

@FEW
@given(arms(), st.data())
def test_gravity_of_a_mounted_arm_is_forces_turned_the_other_way(arm, data):
    # Weightless segments: the discs' weights act at their centres, where the forces do.
    g, mounting = 9.80665, arm.mounting_angle
    heavy = replace(arm, gravity=mounted(mounting, g),
                    segments=tuple(replace(s, mass=0.0) for s in arm.segments))
    forces = tuple(Wrench(i, (g * d.mass * sin(mounting), 0.0, -g * d.mass * cos(mounting)))
                   for i, d in enumerate(arm.discs))
    pushed = replace(heavy.without_gravity(), wrenches=forces)
    one, other = Statics(heavy), Statics(pushed)
    straight = one.chain.straight()
    soft = data.draw(masks(arm))
    asked = data.draw(pulls(arm, straight, soft))
    states = [s.solve(straight, asked, soft) for s in (one, other)]
    assert states[0].joint_angles == pytest.approx(states[1].joint_angles, abs=1e-9)
    assert states[0].tensions == pytest.approx(states[1].tensions, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize('angle', [0.2, 1.0])
def test_a_hanging_arm_swings_back_and_is_harder_to_bend_than_a_weightless_one(angle):
    tensions = []
    for gravity in (0.0, 9.80665):
        statics = Statics(paper_like(1, gravity=gravity, mounting_angle=HANGING))
        bent = statics.bend(statics.chain.straight(), 0, angle)
        tensions.append(bent.tensions[RIGHT])
        back = statics.solve(bent, BOTH_SLACK, (True,))
        assert back.joint_angles == pytest.approx(0.0, abs=1e-9)
    assert tensions[1] > 1.01 * tensions[0]


@pytest.mark.parametrize('side', [1.0, -1.0])
def test_a_horizontal_arm_sags_down_and_its_tendon_above_holds_it(side):
    # Mounted at +90 degrees, base x points down: the tendon above is the left one.
    statics = Statics(paper_like(2, gravity=9.80665, mounting_angle=side * HORIZONTAL))
    sagging = statics.solve(statics.chain.straight(), BOTH_SLACK, (True, True))
    assert np.all(side * sagging.bending_angles > 0.02)
    level = statics.bend(statics.chain.straight(), 0, 0.0)
    above = 1 if side > 0.0 else 0
    assert level.tensions[above] > 0.1
    assert level.tensions[1 - above] == 0.0


def test_the_moment_at_the_base_of_a_rigid_horizontal_arm_is_its_weight_times_its_lever():
    # A stiff spring bends so little that the moment is that of the straight arm.
    arm = paper_like(1, gravity=9.80665, mounting_angle=HORIZONTAL, payload=0.03, bodies=1)
    arm = replace(arm, segments=(replace(arm.segments[0], stiffness_y=500.0),))
    statics = Statics(arm)
    state = statics.solve(statics.chain.straight(), BOTH_SLACK, (True,))
    moment = statics.chain.joint_stiffness[0] * state.joint_angles[0]
    expected = 9.80665 * (0.05 * 0.035 + 0.04 * 0.085 + 0.03 * 0.100)
    assert moment == pytest.approx(expected, rel=1e-3)


# Both chains have the compliance l/EI of the rod; they share it out differently.


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
