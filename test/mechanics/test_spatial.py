# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Spatial arms: where planar ones, symmetry, SoRoSim and a real arm say that they are."""

from dataclasses import replace
from math import pi, sqrt
from pathlib import Path
import re

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from benchmarks.measured import aligned, IDENTIFIED, IDENTIFIED_V6, read, rms, V6
from benchmarks.rods import shapes, STEEL, TPU
from soft_continuum.mechanics import Jam, Statics, StaticsError
from soft_continuum.mechanics.arm import Arm, Disc, Segment, Wrench
from soft_continuum.mechanics.chain import SLACK
from soft_continuum.mechanics.self_contact import exceeds_pi, self_intersections
from soft_continuum.mechanics.space.chain import SpaceChain
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.ros.description import load_arm
from support import paper_arm as paper
from support.spatial_arms import mirrored, near_its_limit, three_segments, turned
from support.spatial_arms import three_segments as arm

CONFIG = Path(__file__).resolve().parents[2] / 'config'
PULLS = (0.006, -0.004, -0.003)


def solved(an_arm, pulls=PULLS, soft=(True, True, True), start=None, **more):
    statics = SpaceStatics(an_arm)
    return statics.solve(start or statics.chain.straight(), pulls, soft, **more)


# What the planar statics say.


@pytest.mark.parametrize('drive', [
    lambda statics, start: statics.bend(start, 1, 0.4),
    lambda statics, start: statics.bend(start, 0, -0.3, (True, False, True)),
    lambda statics, start: statics.solve_tensions(start, (1.5, 0.0), (True,) * 3),
    lambda statics, start: statics.solve(
        start, (0.0, 0.004), (True,) * 3, tensions=(2.0, np.nan)),
    lambda statics, _: statics.solve(statics.chain.straight(), (0.004, -0.006), (True,) * 3)],
    ids=['a segment', 'of two soft ones', 'tensions', 'a tension and a length', 'it buckles'])
@pytest.mark.parametrize('height', [0.03, 0.0])
def test_an_arm_is_driven_alike_in_its_plane_and_in_space(drive, height):
    flat = replace(paper.build(bodies_per_segment=6), discs=(Disc(height, 0.05),) * 4)
    one, other = (drive(statics, statics.chain.uniform([(0.0, 0.1)] * 3))
                  for statics in (Statics(flat), SpaceStatics(flat)))
    assert other.jumped or not one.jumped
    assert other.bending == pytest.approx(one.bending, abs=1e-7)
    assert other.tensions == pytest.approx(one.tensions, abs=1e-5)
    assert other.pulls == pytest.approx(one.pulls, abs=1e-8)


# Symmetry.


def end_of(an_arm, pulls, soft):
    """Return whether an arm jumps and where its tip goes, or what kind of error there is."""
    try:
        state = solved(an_arm, pulls, soft)
    except StaticsError as error:
        return type(error), np.zeros(3)
    return state.jumped, state.tip


# The arms of 700 which once had several answers, and some that had one.
@pytest.mark.parametrize('seed', [2, 23, 108, 146, 189, 220, 420, 476, 533, 598, *range(10, 13)])
def test_a_problem_has_one_answer_in_every_frame(seed):
    an_arm, pulls, soft = near_its_limit(seed)
    kind, tip = end_of(an_arm, pulls, soft)
    for angle in np.arange(1, 9, 2) * 2.0 * pi / 9.0 + 0.1:
        there, end = end_of(turned(an_arm, angle), pulls, soft)
        assert there == kind
        assert Rotation.from_euler('z', -angle).apply(end) == pytest.approx(tip, abs=1e-7)
    there, end = end_of(mirrored(an_arm), pulls, soft)
    assert there == kind
    assert end * [1.0, -1.0, 1.0] == pytest.approx(tip, abs=1e-7)


@pytest.mark.parametrize('twist', [20.0, -20.0])
def test_helical_tendons_twist_an_arm_towards_their_straightening(twist):
    segments = tuple(replace(s, torsional_stiffness=1e-3) for s in arm().segments)
    pulled = solved(arm(segments=segments, gravity=(0.0, 0.0, 0.0), spacers=3).with_tendons(
        twist=twist), np.zeros(3), tensions=(0.3, 0.3, 0.3))
    turn = np.arctan2(pulled.orientations[-1, 1, 0], pulled.orientations[-1, 0, 0])
    assert turn * twist < 0.0
    assert abs(turn) > 0.01
    assert np.hypot(*pulled.tip[:2]) < 1e-6


# Energy.


def test_by_tensions_is_the_same_as_by_lengths():
    at = solved(arm())
    again = solved(arm(), np.zeros(3), tensions=at.tensions)
    assert again.points == pytest.approx(at.points, abs=1e-9)
    mixed = solved(arm(), PULLS, tensions=(np.nan, *at.tensions[1:]))
    assert mixed.points == pytest.approx(at.points, abs=1e-9)


def test_tendons_that_stretch_are_longer_by_what_they_carry():
    an_arm = arm().with_compliant_tendons(1e-4)
    at = solved(an_arm)
    taut = at.tensions > 0.0
    assert taut.any()
    assert at.pulls[taut] == pytest.approx((np.array(PULLS) - 1e-4 * at.tensions)[taut], abs=1e-9)


def test_a_column_stands_up_to_the_load_of_euler_and_buckles_beyond():
    length, stiffness = 0.3, 0.05
    critical = pi**2 * stiffness / (4.0 * length**2)
    for part, jumps in ((0.98, False), (1.05, True)):
        column = Arm((Segment(length, stiffness, stiffness, stiffness),),
                            (Disc(),) * 2, (), 40, 0, 'second_order', gravity=(0.0,) * 3,
                            wrenches=(Wrench(1, (0.0, 0.0, -part * critical)),))
        at = solved(column, [], (True,))
        assert at.jumped == jumps
        assert (np.hypot(*at.tip[:2]) > 0.01) == jumps


# Other solvers.


@pytest.mark.parametrize('rod', [STEEL, TPU], ids=lambda rod: rod.name)
def test_rods_are_where_sorosim_has_them(rod):
    tips = []
    for shape in shapes(rod):
        statics = SpaceStatics(shape.arm(rod, 50))
        state = statics.solve(statics.chain.straight(), [], [True, True])
        assert not state.jumped
        tips.append(shape.errors(state)[-1])
    assert len(tips) == 42
    assert np.mean(tips) < 3e-4
    assert np.max(tips) < 1e-3


# Friction.


def rubbing(friction, presliding=0.5, **changes):
    """Return a weightless arm whose segments have friction."""
    an_arm = arm(gravity=(0.0, 0.0, 0.0), **changes)
    return replace(an_arm, segments=tuple(
        replace(s, friction=friction, presliding=presliding) for s in an_arm.segments))


def followed(an_arm, *pulls):
    """Return the state after some pulls in turn, all segments soft."""
    statics = SpaceStatics(an_arm)
    state = statics.chain.straight()
    for each in pulls:
        state = statics.solve(state, each, (True,) * 3)
    return state


def test_an_arm_with_friction_stays_bent_when_its_tendons_are_let_go_as_far_as_friction_holds():
    state = followed(rubbing(2e-3), PULLS, (-0.02,) * 3)
    assert not state.tensions.any()
    held = np.linalg.norm(state.chain.laws.stiffness * state.joint_angles, axis=1)
    assert held.max() < 2e-3 * (1.0 + 1e-9)
    assert 0.001 < np.hypot(*state.tip[:2]) < np.hypot(*followed(rubbing(2e-3), PULLS).tip[:2])


def test_friction_that_does_not_slide_is_a_spring():
    friction, presliding = 10.0, 500.0
    sticking = followed(rubbing(friction, presliding), PULLS)
    springs = tuple(replace(s, stiffness_x=s.stiffness_x + friction / presliding,
                            stiffness_y=s.stiffness_y + friction / presliding)
                    for s in arm().segments)
    assert sticking.tip == pytest.approx(
        followed(arm(gravity=(0.0, 0.0, 0.0), segments=springs), PULLS).tip, abs=1e-9)
    assert np.hypot(*followed(rubbing(friction, presliding), PULLS, (-0.02,) * 3).tip[:2]) < 1e-9


def test_friction_does_not_depend_on_where_x_is():
    one = followed(rubbing(2e-3), PULLS, (-0.004, 0.003, 0.0), (0.0, 0.0, 0.0))
    other = followed(rubbing(2e-3, turn=0.7), PULLS, (-0.004, 0.003, 0.0), (0.0, 0.0, 0.0))
    turn = Rotation.from_euler('z', 0.7)
    assert other.points == pytest.approx(turn.apply(one.points), abs=1e-9)


def test_a_real_arm_that_was_identified_on_other_motions_is_where_the_model_says():
    recording = read('val')
    stddevs = IDENTIFIED.stddevs(recording)
    assert len(stddevs) == 443
    assert rms(aligned(stddevs)) < 0.0065


def test_creep_of_tendons_is_part_of_what_a_real_arm_does():
    recording = read('train', V6)
    errors = [rms(aligned(replace(IDENTIFIED_V6, creep=creep).stddevs(recording)))
              for creep in (IDENTIFIED_V6.creep, 0.0)]
    assert errors[0] < 0.0076 < 0.0083 < errors[1]


# What cannot be.


@pytest.mark.parametrize('soft', [(True, True, True), (False, True, False)])
def test_many_small_steps_lead_where_one_large_step_does(soft):
    # Rounding tripled in each solve: after thirty the backbone was longer than it is.
    statics = SpaceStatics(arm())
    state = statics.chain.straight()
    for part in np.linspace(0.0, 1.0, 101)[1:]:
        state = statics.solve(state, part * np.array(PULLS), soft)
    squares = state.rotations.transpose(0, 2, 1) @ state.rotations
    assert squares == pytest.approx(np.tile(np.eye(3), (len(squares), 1, 1)), abs=1e-13)
    assert state.points == pytest.approx(solved(arm(), soft=soft).points, abs=1e-9)


def test_a_jam_holds_the_shape_in_which_it_was_stiffened():
    bent = solved(arm())
    held = solved(arm(), bent.pulls - 0.002, (False,) * 3, start=bent)
    assert np.array_equal(held.points, bent.points)
    elastic = arm(jam=Jam(50.0))
    bent = solved(elastic)
    held = solved(elastic, bent.pulls - 0.02, (False,) * 3, start=bent)
    sprung = np.linalg.norm(held.bending - bent.bending, axis=1)
    assert 0.0 < sprung.max() < 0.1 * np.linalg.norm(bent.bending, axis=1).max()


@pytest.mark.parametrize('out', [0.02, 0.03, 0.06])
def test_an_arm_that_falls_over_as_tendons_are_paid_out_far_lies_as_one_in_a_plane_does(out):
    planar, solid = (load_arm(CONFIG / f'{name}.yaml')
                       for name in ('manipulator', 'spatial_jamming'))
    plane, space = Statics(replace(planar, segments=tuple(
        replace(segment, stiffness_y=other.stiffness_y)
        for segment, other in zip(planar.segments, solid.segments, strict=True)
    ))), SpaceStatics(solid)
    limp = plane.solve(plane.chain.straight(), (SLACK, SLACK), (True,) * 3)
    fallen = space.solve(space.chain.straight(), (-out,) * 3, (True,) * 3)
    assert fallen.jumped
    assert fallen.bending_angles == pytest.approx(abs(limp.bending_angles), abs=1e-6)
    assert not fallen.tensions.any() and (fallen.slack > 0.0).all()


def test_bending_is_that_of_the_rotation_between_two_discs():
    statics = SpaceStatics(arm())
    bend = np.array([[0.3, 0.2], [-0.1, 0.4], [0.0, -0.5]])
    state = statics.chain.uniform(bend)
    assert state.bending == pytest.approx(bend, abs=1e-12)
    assert np.linalg.norm(state.bending[0]) == pytest.approx(sqrt(0.13))


# The examples of the page about mechanics run, one after the other.


PAGE = Path(__file__).parents[2] / 'docs' / 'explanation' / 'mechanics.md'


def test_the_examples_of_the_page_run():
    blocks = re.findall(r'```python\n(.*?)```', PAGE.read_text(encoding='utf-8'), re.DOTALL)
    assert len(blocks) == 2
    names = {}
    for block in blocks:
        exec(compile(block, str(PAGE), 'exec'), names)
    assert names['tip'].reached
    assert abs(names['shape'].tip - (0.12, 0.05, 0.2)).max() < 1e-6
    assert names['path'].found.all()


def ring(angle, rise=0.0):
    """Return an arm of one segment bent to an arc, 0.3 m long, and turned out of its plane."""
    arm = Arm((Segment(0.3, 0.1, 0.1),), (Disc(),) * 2, (), 60)
    joints = np.zeros((61, 3))
    joints[:, 0], joints[:, 2] = angle / 61, rise
    return SpaceChain(arm).state(joints)


def test_a_straight_arm_does_not_run_into_itself():
    chain = SpaceChain(three_segments())
    assert self_intersections(chain.straight(), 0.03) == []
    assert not exceeds_pi(chain.straight()).any()


@pytest.mark.parametrize(('angle', 'meets'), [(1.6 * pi, False), (1.95 * pi, True)])
def test_a_segment_that_closes_a_ring_runs_into_itself(angle, meets):
    state = ring(angle)
    gap = np.linalg.norm(state.tip)
    assert bool(self_intersections(state, 0.01)) == meets
    assert meets == (gap < 0.02)
    # The parts are the discs, which are points here, and the segment.
    assert set(self_intersections(state, 0.01)) <= {(0, 1), (0, 2), (1, 1), (1, 2)}


def test_a_coil_out_of_plane_passes_by():
    assert self_intersections(ring(2.4 * pi), 0.01)
    assert not self_intersections(ring(2.4 * pi, 0.05), 0.005)


@pytest.mark.parametrize('seed', range(6))
def test_the_pairs_are_those_of_points_sampled_along_the_backbone(seed):
    draw = np.random.default_rng(seed)
    arm = three_segments(bodies_per_segment=6)
    chain = SpaceChain(arm)
    state = chain.uniform(draw.uniform(-3.0, 3.0, (3, 2)))
    ends = np.concatenate([np.zeros((1, 3)), chain.ends(state.rotations)])
    lengths = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    parts = np.array([0] + [p for s in range(3) for p in [2 * s + 1] * 6 + [2 * s + 2]])
    part = np.linspace(0.0, 1.0, 41)[:, None]
    points = [a + part * (b - a) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    begins = np.concatenate([[0.0], np.cumsum(lengths)])
    for radius in (0.005, 0.012, 0.02):
        near = {}
        for i in range(len(points)):
            for j in range(i + 1, len(points)):
                if begins[j] - begins[i + 1] >= pi * radius:
                    key = (int(parts[i]), int(parts[j]))
                    near[key] = min(near.get(key, 1.0), cdist(points[i], points[j]).min())
        found = set(self_intersections(state, radius))
        assert {k for k, d in near.items() if d < 2.0 * radius - 1e-9} <= found
        assert found <= {k for k, d in near.items() if d < 2.0 * radius + 2e-4}


@pytest.mark.parametrize('angle', [0.9, 1.1, 1.9, -1.1])
def test_a_segment_bent_beyond_pi_is_wound_up_though_its_discs_hide_it(angle):
    state = ring(angle * pi)
    assert exceeds_pi(state).tolist() == [abs(angle) > 1.0]
    assert np.linalg.norm(state.bending) <= pi


@pytest.mark.parametrize('radius', [0.0, -1.0, np.nan, 'thin'])
def test_what_is_no_radius_is_refused(radius):
    with pytest.raises(ValueError, match='radius'):
        self_intersections(ring(1.0), radius)
