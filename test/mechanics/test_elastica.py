# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The elastic rod agrees with closed forms, and the rigid chain converges to it."""

from dataclasses import fields, replace
from math import cos, pi, radians, sin

import numpy as np
import pytest

from references import elastica
from references.elastica import Elastica
from soft_continuum.mechanics import Arm, Disc, LEFT, RIGHT, Segment, SLACK, Statics, StaticsError
from support.flat_arm import flat_arm

BODIES = np.array([8, 16, 32, 64, 128])
ALL = (True, True, True)
SECOND = (False, True, False)
BOTH_SLACK = (SLACK, SLACK)

has_discretisation = pytest.mark.skipif(
    'discretisation' not in {field.name for field in fields(Arm)},
    reason='the chain has one discretisation only')


def paper_arm(gravity=9.80665, mounting_angle=0.0, bodies=12):
    """The paper's arm with the masses that MECHANICS.md estimates."""
    thickness, diameters = (0.50e-3, 0.35e-3, 0.25e-3), (0.050, 0.0425, 0.035)
    segments = [Segment.leaf_spring(0.07, 200e9 * 12.7e-3 * t**3 / 12, mass)
                for t, mass in zip(thickness, (0.069, 0.050, 0.034), strict=True)]
    discs = [Disc(0.03, mass) for mass in (0.0, 0.060, 0.045, 0.033)]
    return flat_arm(segments, [(d / 2, d / 2) for d in diameters], discs,
                    mounting_angle=mounting_angle, gravity=gravity, bodies_per_segment=bodies)


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


def distance(arm, angles, pulls, soft):
    """Largest distance of a calculation point of the chain from the rod's, of the arm's length."""
    rod, state, statics = rod_and_chain(arm, angles, pulls, soft)
    apart = (state.points - rod.points)[:, :2]
    return np.linalg.norm(apart, axis=1).max() / arm.length


def slope(arm, *case):
    apart = [distance(arm.with_bodies(int(n)), *case) for n in BODIES]
    return -np.polyfit(np.log(BODIES), np.log(apart), 1)[0]


CASES = pytest.mark.parametrize('arm, angles, pulls, soft', [
    pytest.param(paper_arm(0.0), (0, 0, 0), (0.042, SLACK), ALL, id='all soft, no gravity'),
    pytest.param(paper_arm(0.0), (0.6, 0, -0.6), (SLACK, 0.0142), SECOND,
                 id='between locked segments, no gravity'),
    pytest.param(paper_arm(), (0.6, 0, 0.6), (0.0423, SLACK), SECOND,
                 id='between locked segments, upright'),
    pytest.param(paper_arm(), (0.6, 0.6, 0.6), (0.046, SLACK), (True, False, True),
                 id='on both sides of a locked segment, upright'),
    pytest.param(paper_arm(mounting_angle=pi / 2), (0, 0, 0), BOTH_SLACK, ALL,
                 id='sagging, horizontal'),
    pytest.param(paper_arm(mounting_angle=pi), (0, 0, 0), (0.042, SLACK), ALL, id='hanging'),
])
BOTH_TAUT = paper_arm(0.0), (0, 0, 0), (0.042, -0.0295), ALL


def test_a_moment_at_its_end_bends_the_rod_to_an_arc():
    length, height, weight = 1e-3, 10.0, 3.7  # the lever is so long that the moment is uniform
    arm = cantilever(length, 0.01, tip_height=height, tip_mass=weight / 10.0)
    rod, _, _ = rod_and_chain(arm, [0], BOTH_SLACK, [True])
    angle = rod.bending_angles[0]
    assert angle == pytest.approx(weight * height / 2 * cos(angle) * length / 0.01, rel=2e-4)
    assert angle > 0.9
    s = np.linspace(0.0, 1.0, elastica.SAMPLES)
    arc = length / angle * np.stack([1 - np.cos(angle * s), np.sin(angle * s)], axis=1)
    assert rod.backbone[:-1, :2] - [0.0, 1e-3] == pytest.approx(arc, abs=1e-4 * length)


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
def test_the_papers_chain_converges_to_the_rod_at_first_order(arm, angles, pulls, soft):
    assert 0.9 <= slope(arm, angles, pulls, soft) <= 1.1


def test_with_both_tendons_taut_the_first_order_shows_from_more_bodies_on():
    """Two tendons nearly fix the shape, so that errors of higher order stay visible for longer."""
    arm, *case = BOTH_TAUT
    coarse, fine = (distance(arm.with_bodies(bodies), *case) for bodies in (100, 200))
    assert 0.95 <= np.log2(coarse / fine) <= 1.05


@has_discretisation
@CASES
def test_the_second_order_chain_converges_to_the_rod_at_second_order(arm, angles, pulls, soft):
    arm = replace(arm, discretisation='second_order')
    assert 1.9 <= slope(arm, angles, pulls, soft) <= 2.1


@CASES
def test_the_extrapolated_chain_is_the_rod(arm, angles, pulls, soft):
    """With first- and second-order errors extrapolated away nothing else is left."""
    states = []
    for bodies in (64, 128, 256):
        rod, state, statics = rod_and_chain(arm.with_bodies(bodies), angles, pulls, soft)
        states.append(np.concatenate([
            state.bending_angles - rod.bending_angles,
            state.tensions - rod.tensions]))
    coarse, middle, fine = states
    assert (coarse - 6 * middle + 8 * fine) / 3 == pytest.approx(0.0, abs=2e-5)


@pytest.mark.parametrize('gravity, low, high', [(0.0, 0.009, 0.013), (9.80665, 0.009, 0.017)])
@pytest.mark.parametrize('signs', [(1, 1, 1), (-1, 1, 1), (1, -1, 1)], ids=['C', 'upright C', 'S'])
def test_twelve_bodies_are_about_one_percent_off(signs, gravity, low, high):
    """In the bending angle of the segment that is set, in each step of the paper's shapes."""
    arm = paper_arm(gravity)
    angles = [0.0, 0.0, 0.0]
    for k, sign in enumerate(signs):
        start, soft = Statics(arm).chain.uniform(angles), [i == k for i in range(3)]
        angles[k] = sign * radians(36)
        held = Statics(arm).bend(start, k, angles[k])
        rod = Elastica(arm).solve(start, np.where(held.tensions > 0, held.pulls, SLACK), soft)
        assert low < abs(angles[k] / rod.bending_angles[k] - 1) < high


DISCRETISATIONS = [('paper', 0.0013, 0.014),
                   pytest.param('second_order', 2e-5, 8e-4, marks=has_discretisation)]


@CASES
@pytest.mark.parametrize('discretisation, low, high', DISCRETISATIONS)
def test_how_far_twelve_bodies_are_off(arm, angles, pulls, soft, discretisation, low, high):
    """Of the arm's length, at the calculation points."""
    if discretisation != 'paper':
        arm = replace(arm, discretisation=discretisation)
    assert low <= distance(arm, angles, pulls, soft) <= high


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
    arm, angles = paper_arm(), [angle] * 3
    rod, state, _ = rod_and_chain(arm, angles, BOTH_SLACK, soft)
    pulls = [SLACK, SLACK]
    pulls[side] = (rod.pulls[side] + state.pulls[side]) / 2
    rod, state, _ = rod_and_chain(arm, angles, pulls, soft)
    assert state.taut[side] != taut_in_rod
    assert (rod.tensions[side] > 0.0) == taut_in_rod
    assert (rod.slack[side] > 0.0) != taut_in_rod


def test_the_tensions_are_the_derivatives_of_the_energy_by_the_pulls():
    """Without gravity, the work of the tendons is stored in the rods (Castigliano)."""
    arm = paper_arm(0.0)

    def energy_and_tension(pull):
        rod, _, _ = rod_and_chain(arm, (0, 0, 0), (pull, SLACK), ALL)
        energy, row = 0.0, 0
        for segment in arm.segments:
            theta = rod.backbone[row:row + elastica.SAMPLES, 2]
            step = segment.length / (elastica.SAMPLES - 1)
            energy += 0.5 * segment.stiffness_y * (np.diff(theta)**2).sum() / step
            row += elastica.SAMPLES
        return energy, rod.tensions[0]

    (low, _), (_, tension), (high, _) = map(energy_and_tension, (0.0299, 0.03, 0.0301))
    assert (high - low) / 0.0002 == pytest.approx(tension, rel=1e-4)


def test_the_mirrored_arm_has_the_mirrored_shape():
    one, _, _ = rod_and_chain(paper_arm(), (0.6, 0.2, 0.6), (0.0423, SLACK), SECOND)
    other, _, _ = rod_and_chain(paper_arm(), (-0.6, -0.2, -0.6), (SLACK, 0.0423), SECOND)
    assert other.points == pytest.approx(one.points * [-1, 1, -1], abs=1e-11)
    assert other.tensions == pytest.approx(one.tensions[::-1], abs=1e-9)


def test_stiff_segments_keep_their_polyline():
    arm = paper_arm()
    rod, state, statics = rod_and_chain(arm, (0.6, 0.2, -0.4), (0.03, SLACK), SECOND)
    held = statics.chain.backbone(state.joint_angles)
    assert rod.bending_angles[[0, 2]] == pytest.approx([0.6, -0.4], abs=1e-14)
    assert rod.backbone[:14] == pytest.approx(held[:14], abs=1e-14)
    lengths = np.linalg.norm(np.diff(rod.backbone[-14:, :2], axis=0), axis=1)
    assert lengths == pytest.approx([0.07 / 12] * 12 + [0.03], abs=1e-14)
    turns = np.diff(rod.backbone[-14:, 2])
    assert turns[1:] == pytest.approx(-0.4 / 13, abs=1e-14)


def test_backbone_and_calculation_points_agree():
    rod, _, statics = rod_and_chain(paper_arm(), (0.6, 0.2, -0.4), (0.03, SLACK), SECOND)
    assert rod.points.shape == statics.chain.points(np.zeros(statics.chain.bodies)).shape
    rows = [0, 12, 13, 13 + elastica.SAMPLES - 1, 13 + elastica.SAMPLES, -2, -1]
    assert rod.backbone[rows, :2] == pytest.approx(rod.points[1:, :2], abs=1e-14)
    assert np.diff(rod.points[2::2, 2], prepend=0.0) == pytest.approx(rod.bending_angles)
    for bottom, top in zip(rod.points[::2], rod.points[1::2], strict=True):
        along = 0.03 * np.array([sin(bottom[2]), cos(bottom[2]), 0.0])
        assert top - bottom == pytest.approx(along, abs=1e-14)


def test_an_arm_without_a_soft_segment_is_the_chain():
    rod, state, statics = rod_and_chain(
        paper_arm(), (0.6, 0.2, -0.4), BOTH_SLACK, (False, False, False))
    assert np.array_equal(rod.points, state.points)
    assert np.array_equal(rod.pulls, state.pulls)
    assert rod.residual == 0.0


@pytest.mark.parametrize('limits, message', [
    ({'MAX_NODES': 10}, 'no equilibrium of the rods'),
    ({'SAME_BRANCH': 1e-6}, 'more bodies per segment'),
    ({'SAME_BRANCH': np.inf, 'JUST_TAUT': -1.0}, 'with every set of taut tendons')])
def test_a_search_that_fails_says_so_and_keeps_the_chains_state(monkeypatch, limits, message):
    for name, value in limits.items():
        monkeypatch.setattr(elastica, name, value)
    statics = Statics(paper_arm(0.0))
    pulls = (0.0142, -0.0135)
    with pytest.raises(StaticsError, match=message) as error:
        Elastica(paper_arm(0.0)).solve(statics.chain.straight(), pulls, SECOND)
    expected = statics.solve(statics.chain.straight(), pulls, SECOND)
    assert np.array_equal(error.value.state.joint_angles, expected.joint_angles)


def test_input_of_the_wrong_size_is_refused():
    rods = Elastica(paper_arm())
    with pytest.raises(ValueError, match='true or false for each'):
        rods.solve(rods.chain.straight(), (0.0, 0.0), (True, True))
    with pytest.raises(ValueError, match='pulls'):
        rods.solve(rods.chain.straight(), (0.0,), ALL)
