# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The elastic rod agrees with closed forms, and the rigid chain converges to it."""

from dataclasses import replace
from math import cos, pi, sin

import numpy as np
import pytest

from references.elastica import Elastica
from soft_continuum.mechanics import (
    Disc,
    LEFT,
    MomentCurvature,
    RIGHT,
    Segment,
    SLACK,
    Statics,
    Wrench,
)
from soft_continuum.mechanics.arm import SECOND_ORDER
from support.flat_arm import flat_arm, made_of
from support.general_arms import paper_like
from support.paper_arm import build

ALL = (True, True, True)
SECOND = (False, True, False)
BOTH_SLACK = (SLACK, SLACK)

def cantilever(length, stiffness, mass=0.0, tip_height=1e-3, tip_mass=0.0):
    """One segment held horizontally, its weight bending it towards +x."""
    return flat_arm([Segment.leaf_spring(length, stiffness, mass)], 0.02,
                    [Disc(1e-3), Disc(tip_height, tip_mass)], bodies_per_segment=24,
                    mounting_angle=pi / 2, gravity=10.0)


def rod_and_chain(arm, angles, pulls, soft):
    """The rod and the chain, and the chain's statics, from the same start."""
    statics = Statics(arm)
    start = statics.chain.uniform(angles)
    return Elastica(arm).solve(start, pulls, soft), statics.solve(start, pulls, soft), statics


def distance(arm, *case):
    """Largest distance of a calculation point of the chain from the rod's, of the arm's length."""
    rod, state, _ = rod_and_chain(arm, *case)
    apart = state.points[:, ::2] - rod.points[:, :2]
    return np.linalg.norm(apart, axis=1).max() / arm.length


CASES = pytest.mark.parametrize('arm, angles, pulls, soft', [
    pytest.param(build(gravity=0.0), (0, 0, 0), (0.042, SLACK), ALL, id='all soft, no gravity'),
    pytest.param(build(gravity=0.0), (0.6, 0, -0.6), (SLACK, 0.0142), SECOND,
                 id='between locked segments, no gravity'),
    pytest.param(build(), (0.6, 0, 0.6), (0.0423, SLACK), SECOND,
                 id='between locked segments, upright'),
    pytest.param(build(), (0.6, 0.6, 0.6), (0.046, SLACK), (True, False, True),
                 id='on both sides of a locked segment, upright'),
    pytest.param(build(mounting_angle=pi / 2), (0, 0, 0), BOTH_SLACK, ALL,
                 id='sagging, horizontal'),
    pytest.param(build(mounting_angle=pi), (0, 0, 0), (0.042, SLACK), ALL, id='hanging'),
])
BOTH_TAUT = build(gravity=0.0), (0, 0, 0), (0.042, -0.0295), ALL


def test_a_moment_at_its_end_bends_the_rod_to_an_arc():
    length, height, weight = 1e-3, 10.0, 3.7  # the lever is so long that the moment is uniform
    arm = cantilever(length, 0.01, tip_height=height, tip_mass=weight / 10.0)
    rod, _, _ = rod_and_chain(arm, [0], BOTH_SLACK, [True])
    angle = rod.bending_angles[0]
    assert angle == pytest.approx(weight * height / 2 * cos(angle) * length / 0.01, rel=2e-4)
    assert angle > 0.9
    arc = length / angle * np.array([1.0 - cos(angle), sin(angle)])
    assert rod.points[2, :2] - [0.0, 1e-3] == pytest.approx(arc, abs=1e-4 * length)


def test_a_cantilever_sags_under_its_own_weight_as_a_beam_does():
    length, stiffness, mass = 0.5, 1.0, 1e-3
    rod, _, _ = rod_and_chain(cantilever(length, stiffness, mass), [0], BOTH_SLACK, [True])
    weight = mass * 10.0
    x, _, angle = rod.points[2]
    assert x == pytest.approx(weight * length**3 / (8 * stiffness), rel=1e-5)
    assert angle == pytest.approx(weight * length**2 / (6 * stiffness), rel=1e-5)


@pytest.mark.parametrize('load, down, shortening', [
    (1.0, 0.30172, 0.05643), (2.0, 0.49346, 0.16064), (5.0, 0.71379, 0.38763),
    (10.0, 0.81061, 0.55500)])
def test_a_load_at_its_tip_bends_the_cantilever_as_the_elastica(load, down, shortening):
    """P l^2 / E I as given: the table of Mattiasson, Int. J. Numer. Meth. Eng. 17, 1981."""
    length, stiffness = 10.0, 1000.0
    mass = load * stiffness / length**2 / 10.0

    def tip(height):
        arm = cantilever(length, stiffness, tip_height=height, tip_mass=mass)
        rod, _, _ = rod_and_chain(arm, [0], BOTH_SLACK, [True])
        return rod.points[2, :2] - rod.points[1, :2]

    # The load hangs at the middle of the tip disc: extrapolated to a disc without height.
    x, z = 2 * tip(1e-3) - tip(2e-3)
    assert x / length == pytest.approx(down, abs=6e-6)
    assert 1 - z / length == pytest.approx(shortening, abs=6e-6)


@CASES
@pytest.mark.parametrize('discretisation, order, low, high', [
    ('paper', 1, 0.0013, 0.014), ('second_order', 2, 2e-5, 8e-4)])
def test_the_chain_converges_to_the_rod(
        arm, angles, pulls, soft, discretisation, order, low, high):
    """And with twelve bodies it is so far off, of the arm's length, at the calculation points."""
    arm = replace(arm, discretisation=discretisation)
    twelve, coarse, fine = (distance(arm.with_bodies(bodies), angles, pulls, soft)
                            for bodies in (12, 16, 64))
    assert low <= twelve <= high
    assert order - 0.1 <= np.log2(coarse / fine) / 2.0 <= order + 0.1
    rod, state, _ = rod_and_chain(arm.with_bodies(64), angles, pulls, soft)
    assert state.tensions == pytest.approx(rod.tensions, rel=0.02 if order == 1 else 1e-3)
    if order == 2:
        assert state.bending_angles == pytest.approx(rod.bending_angles, abs=1e-3)


def test_with_both_tendons_taut_the_first_order_shows_from_more_bodies_on():
    """Two tendons nearly fix the shape, so that errors of higher order stay visible for longer."""
    arm, *case = BOTH_TAUT
    coarse, fine = (distance(arm.with_bodies(bodies), *case) for bodies in (100, 200))
    assert 0.95 <= np.log2(coarse / fine) <= 1.05


@pytest.mark.parametrize('arm, angles, pulls, soft', [*CASES.args[1], BOTH_TAUT])
def test_a_taut_tendon_has_the_length_asked_for_and_a_slack_one_carries_nothing(
        arm, angles, pulls, soft):
    rod, _, _ = rod_and_chain(arm, angles, pulls, soft)
    assert rod.residual < 2e-9
    for asked, pull, tension, slack in zip(pulls, rod.pulls, rod.tensions, rod.slack, strict=True):
        assert min(tension, slack) == 0.0
        if asked != SLACK:
            assert pull - slack == pytest.approx(asked, abs=1e-12)


@pytest.mark.parametrize('angle, soft, side, taut_in_rod', [
    (0.6, SECOND, RIGHT, False), (0.3, (True, False, False), LEFT, True)])
def test_a_tendon_that_is_taut_in_only_one_model_is_found_out(angle, soft, side, taut_in_rod):
    """Both models sag, not equally far: a tendon as long as between the two decides."""
    arm, angles = build(), [angle] * 3
    rod, state, _ = rod_and_chain(arm, angles, BOTH_SLACK, soft)
    pulls = [SLACK, SLACK]
    pulls[side] = (rod.pulls[side] + state.pulls[side]) / 2
    rod, state, _ = rod_and_chain(arm, angles, pulls, soft)
    assert state.taut[side] != taut_in_rod
    assert (rod.tensions[side] > 0.0) == taut_in_rod
    assert (rod.slack[side] > 0.0) != taut_in_rod


# Loads, and what is not modelled

@pytest.mark.parametrize('change', [
    {'payload': 0.05}, {'wrenches': (Wrench(2, (0.3, 0.0, 0.1)),)},
    {'wrenches': (Wrench(1, (-0.2, 0.0, 0.4)),)}],
    ids=['payload', 'force on the tip', 'force on a disc between'])
def test_the_rod_bears_the_loads_that_the_chain_bears(change):
    arm = paper_like(2, gravity=9.80665, mounting_angle=pi / 2, bodies=60,
                     discretisation=SECOND_ORDER, **change)
    rod, state, _ = rod_and_chain(arm, (0.0, 0.0), BOTH_SLACK, (True, True))
    assert state.bending_angles == pytest.approx(rod.bending_angles, abs=1e-4)


@pytest.mark.parametrize('change', [
    {'soft_law': MomentCurvature((0.0, 2.0, 8.0), (0.0, 0.08, 0.15))}, {'tendon': made_of(500.0)},
    {'tendon': made_of(friction=0.3)}], ids=['table', 'stretch', 'friction'])
def test_the_rod_does_not_pass_over_what_it_does_not_model(change):
    with pytest.raises(ValueError, match='rod'):
        Elastica(paper_like(1, **change))
    Elastica(paper_like(1, tendon=made_of(friction=0.3)).without_friction())
