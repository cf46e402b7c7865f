# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Spatial arms: where planar ones, symmetry, energy, MuJoCo and SoRoSim say that they are."""

from dataclasses import replace
from math import cos, pi, sin, sqrt
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.measured import aligned, IDENTIFIED, read, rms
from benchmarks.rods import shapes, STEEL, TPU
from soft_continuum.mechanics import (
    _kernel,
    ArmError,
    Jam,
    OverconstrainedError,
    Statics,
    StaticsError,
)
from soft_continuum.mechanics.arm import Arm, Disc, mounted, Segment, Tendon, Wrench
from soft_continuum.mechanics.chain import SLACK
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.parameters.files import load_arm
from support import paper_arm as paper
from support.spatial_arms import in_space, mirrored, near_its_limit, turned

CONFIG = Path(__file__).resolve().parents[2] / 'config'
BODIES = 4
PULLS = (0.006, -0.004, -0.003)


def arm(turn=0.0, jam=None, torsion=0.03, **changes):
    """Return three segments with three tendons each 120 degrees apart, turned about z."""
    segments = tuple(Segment(0.07, k, k, torsion, 0.05, jam or Jam())
                     for k in (0.03, 0.02, 0.015))
    tendons = tuple(Tendon(f't{i}', turn + 2.0 * pi * i / 3.0, 0.025, 3) for i in range(3))
    discs = (Disc(0.02, 0.02),) * 4
    return replace(Arm(segments, discs, tendons, BODIES), **changes)


def solved(an_arm, pulls=PULLS, soft=(True, True, True), start=None, **more):
    statics = SpaceStatics(an_arm)
    return statics.solve(start or statics.chain.straight(), pulls, soft, **more)


# What the planar statics say.


@pytest.mark.parametrize('drive', [
    lambda statics, start: statics.bend(start, 1, 0.4),
    lambda statics, start: statics.bend(start, 0, -0.3, (True, False, True)),
    lambda statics, start: statics.solve_tensions(start, (1.5, 0.0), (True,) * 3),
    lambda statics, start: statics.solve(
        start, (0.0, 0.004), (True,) * 3, tensions=(2.0, np.nan))],
    ids=['a segment', 'of two soft ones', 'tensions', 'a tension and a length'])
def test_an_arm_is_driven_alike_in_its_plane_and_in_space(drive):
    flat = paper.build(bodies_per_segment=6)
    one, other = (drive(statics, statics.chain.uniform([(0.0, 0.1)] * 3))
                  for statics in (Statics(flat), SpaceStatics(flat)))
    assert other.bending == pytest.approx(one.bending, abs=1e-7)
    assert other.tensions == pytest.approx(one.tensions, abs=1e-5)
    assert other.pulls == pytest.approx(one.pulls, abs=1e-8)


@pytest.mark.parametrize('soft', [(True, False, False), (False, True, False),
                                  (False, False, True)])
@pytest.mark.parametrize('pulls', [(0.004, -0.006), (-0.006, 0.004), (0.012, -0.02)])
@pytest.mark.parametrize('jam', [Jam(), Jam(20.0)])
@pytest.mark.parametrize('height', [0.03, 0.0])
def test_a_planar_arm_is_where_the_planar_statics_have_it(soft, pulls, jam, height):
    flat = paper.build(bodies_per_segment=6)
    flat = replace(flat, discs=(Disc(height, 0.05),) * 4, gravity=mounted(0.4), segments=tuple(
        replace(s, jam=jam) for s in flat.segments))
    planar = Statics(flat)
    wanted = planar.solve(planar.chain.straight(), pulls, soft)
    found = solved(in_space(flat), pulls, soft)
    assert found.points[:, 0] == pytest.approx(wanted.points[:, 0], abs=1e-10)
    assert found.points[:, 2] == pytest.approx(wanted.points[:, 1], abs=1e-10)
    assert found.points[:, 1] == pytest.approx(0.0, abs=1e-12)
    assert found.tensions == pytest.approx(wanted.tensions, abs=1e-8)
    assert found.bending[:, 1] == pytest.approx(wanted.bending_angles, abs=1e-10)


def test_segments_set_one_after_the_other_are_as_in_the_plane():
    flat = paper.build(bodies_per_segment=6)
    planar, solid = Statics(flat), SpaceStatics(flat)
    one, other = planar.chain.straight(), solid.chain.straight()
    for segment, pulls in ((0, (0.005, -0.007)), (1, (0.001, 0.003)), (2, (0.006, -0.006))):
        soft = [s == segment for s in range(3)]
        one, other = planar.solve(one, pulls, soft), solid.solve(other, pulls, soft)
        assert not one.jumped
        assert other.tip[[0, 2]] == pytest.approx(one.tip[:2], abs=1e-10)


def test_an_arm_that_buckles_ends_where_the_planar_one_does():
    flat = paper.build(bodies_per_segment=6)
    planar = Statics(flat)
    wanted = planar.solve(planar.chain.straight(), (0.004, -0.006), (True,) * 3)
    found = solved(in_space(flat), (0.004, -0.006))
    assert found.jumped == wanted.jumped
    assert found.tip[[0, 2]] == pytest.approx(wanted.tip[:2], abs=1e-9)


# Symmetry.


def test_an_arm_that_is_turned_is_turned():
    turn = Rotation.from_euler('z', 0.7)
    sideways = (2.0, 1.0, -9.0)
    one = solved(arm(gravity=sideways))
    other = solved(arm(turn=0.7, gravity=tuple(turn.apply(sideways))))
    assert other.points == pytest.approx(turn.apply(one.points), abs=1e-10)
    assert other.tensions == pytest.approx(one.tensions, abs=1e-8)


def test_an_arm_that_is_mirrored_is_mirrored():
    one = solved(arm(gravity=(2.0, 1.0, -9.0)), (0.006, 0.002, -0.006))
    other = solved(arm(gravity=(2.0, -1.0, -9.0)), (0.006, -0.006, 0.002))
    assert other.points == pytest.approx(one.points * [1.0, -1.0, 1.0], abs=1e-10)


def end_of(an_arm, pulls, soft):
    """Return whether an arm jumps and where its tip goes, or what kind of error there is."""
    try:
        state = solved(an_arm, pulls, soft)
    except StaticsError as error:
        return type(error), np.zeros(3)
    return state.jumped, state.tip


# The arms of 700 which once had several answers, and some that had one.
@pytest.mark.parametrize('seed', [2, 23, 108, 146, 189, 220, 420, 476, 533, 598, *range(10, 20)])
def test_a_problem_has_one_answer_in_every_frame(seed):
    an_arm, pulls, soft = near_its_limit(seed)
    kind, tip = end_of(an_arm, pulls, soft)
    for angle in np.arange(1, 9) * 2.0 * pi / 9.0 + 0.1:
        there, end = end_of(turned(an_arm, angle), pulls, soft)
        assert there == kind
        assert Rotation.from_euler('z', -angle).apply(end) == pytest.approx(tip, abs=1e-7)
    there, end = end_of(mirrored(an_arm), pulls, soft)
    assert there == kind
    assert end * [1.0, -1.0, 1.0] == pytest.approx(tip, abs=1e-7)


@pytest.mark.parametrize('twist', [20.0, -20.0])
def test_helical_tendons_twist_an_arm_towards_their_straightening(twist):
    tendons = tuple(replace(t, twist=twist) for t in arm().tendons)
    pulled = solved(arm(tendons=tendons, gravity=(0.0, 0.0, 0.0), torsion=1e-3, spacers=3),
                    np.zeros(3), tensions=(0.3, 0.3, 0.3))
    turn = np.arctan2(pulled.orientations[-1, 1, 0], pulled.orientations[-1, 0, 0])
    assert turn * twist < 0.0
    assert abs(turn) > 0.01
    assert np.hypot(*pulled.tip[:2]) < 1e-6


def test_orientations_stay_orthogonal_over_many_solves():
    statics = SpaceStatics(arm(bodies_per_segment=2))
    state = statics.chain.straight()
    for k in range(60):
        part = cos(k / 9.0)
        state = statics.solve(state, (0.006 * part, -0.004, -0.006 * part), (True, False, False))
    squares = state.rotations @ state.rotations.transpose(0, 2, 1)
    assert squares == pytest.approx(np.tile(np.eye(3), (len(squares), 1, 1)), abs=1e-14)


# Energy.


def energy(state):
    """Return the energy of springs and weights, J, from the poses alone."""
    chain = state.chain
    joints = np.array([Rotation.from_matrix(before.T @ now).as_rotvec() for before, now in zip(
        [np.eye(3), *state.rotations[:-1]], state.rotations, strict=True)])
    ends = chain.ends(state.rotations)
    middles = 0.5 * (ends[:-1] + ends[1:])
    return (0.5 * (chain.laws.stiffness * joints**2).sum()
            - chain.body_masses @ middles @ np.array(chain.arm.gravity))


def test_the_tension_is_the_energy_that_a_pull_takes():
    an_arm, step = arm(gravity=(3.0, 0.0, 9.0)), 1e-5
    at = solved(an_arm)
    assert at.tensions[0] > 0.0
    for t in np.flatnonzero(at.tensions > 0.0):
        more, less = (solved(an_arm, np.array(PULLS) + change * np.eye(3)[t], start=at)
                      for change in (step, -step))
        slope = (energy(more) - energy(less)) / (2.0 * step)
        assert at.tensions[t] == pytest.approx(slope, rel=1e-4)


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


def rest_in_mujoco(state, soft, pulls):
    """Return where MuJoCo has the tip of each disc at rest, and the pulls that it ends with."""
    an_arm, chain = state.chain.arm, state.chain
    n = an_arm.bodies_per_segment
    lines, guides, below = [], [[] for _ in an_arm.tendons], an_arm.discs[0].height

    def sites(place, height, segment, part):
        for t, tendon in enumerate(an_arm.tendons):
            name, offset = f's{place}_{t}', tendon.offset_at(segment, part)
            guides[t].append(name)
            lines.append(f'<site name="{name}" pos="{offset * cos(tendon.angle)!r} '
                         f'{offset * sin(tendon.angle)!r} {height!r}"/>')

    sites('base', below, 0, 0.0)
    before = np.eye(3)
    for j in range(chain.bodies):
        segment, body = divmod(j, n + 1)
        x, y, z, w = Rotation.from_matrix(before.T @ state.rotations[j]).as_quat().tolist()
        turned = '' if soft[segment] else f' quat="{w!r} {x!r} {y!r} {z!r}"'
        lines.append(f'<body name="b{j}" pos="0 0 {below!r}"{turned}>')
        if soft[segment]:
            stiffness = float(chain.laws.stiffness[j, 0])
            lines.append(f'<joint type="ball" stiffness="{stiffness!r}" damping="0.05" '
                         'armature="1e-5"/>')
        length, mass = float(chain.body_lengths[j]), float(chain.body_masses[j])
        lines.append(f'<inertial pos="0 0 {length / 2!r}" mass="{mass!r}" '
                     'diaginertia="1e-6 1e-6 1e-6"/>')
        if body == n:
            sites(f'{segment}u', 0.0, segment, 1.0)
            if segment + 1 < chain.segments:
                sites(f'{segment}l', length, segment + 1, 0.0)
        before, below = state.rotations[j], length
    gravity = ' '.join(map(repr, an_arm.gravity))
    xml = (f'<mujoco><option timestep="0.002" integrator="implicitfast" gravity="{gravity}"/>'
           '<worldbody>' + ''.join(lines) + '</body>' * chain.bodies + '</worldbody><tendon>'
           + ''.join('<spatial limited="true" range="0 1" solreflimit="0.008 1" '
                     'solimplimit="0.9 0.9 0.001 0.5 1">' + ''.join(
                         f'<site site="{name}"/>' for name in names) + '</spatial>'
                     for names in guides) + '</tendon></mujoco>')
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    begin = data.ten_length.copy()
    straight = begin + state.pulls  # through the discs as well
    for k in range(9000):
        model.tendon_range[:, 1] = begin + min(1.0, k / 2000) * (straight - pulls - begin)
        mujoco.mj_step(model, data)
    assert np.abs(data.qvel).max() < 1e-4
    ended = np.where(data.ten_length > straight - pulls, straight - data.ten_length, pulls)
    return np.array([data.body(f'b{j}').xpos for j in chain.last_body]), ended


@pytest.fixture(autouse=True)
def log_elsewhere(monkeypatch, tmp_path):
    """Keep the log of MuJoCo out of the sources."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(('soft', 'pulls', 'gravity'), [
    ((True, True, True), PULLS, (3.0, -2.0, -4.0)),
    ((True, True, True), (0.004, 0.003, -0.01), (0.0, 0.0, 9.8)),
    ((False, True, False), (-0.002, 0.012, 0.0005), (0.0, 9.8, 0.0)),
])
def test_mujoco_comes_to_rest_there(soft, pulls, gravity):
    # A ball joint of MuJoCo resists twist as it does bending.
    segments = tuple(replace(s, torsional_stiffness=s.stiffness_x) for s in arm().segments)
    statics = SpaceStatics(arm(segments=segments, gravity=gravity))
    start = statics.chain.uniform([(0.2, -0.1), (0.0, 0.0), (-0.1, 0.3)])
    if all(soft):
        start = statics.chain.straight()
    pulls = start.pulls + pulls
    there, ended = rest_in_mujoco(start, soft, pulls)
    found = statics.solve(start, ended, soft)
    assert not found.jumped
    assert found.points[2::2] == pytest.approx(there, abs=2e-5)


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


def test_a_hundred_solves_leave_no_more_error_than_one():
    weightless = arm(gravity=(0.0, 0.0, 0.0))
    state = followed(weightless, *(np.array(PULLS) * sin(0.3 * i) for i in range(100)), PULLS)
    assert state.tip == pytest.approx(followed(weightless, PULLS).tip, abs=1e-9)
    assert state.rotations.transpose(0, 2, 1) @ state.rotations == pytest.approx(
        np.tile(np.eye(3), (len(state.rotations), 1, 1)), abs=1e-13)


def test_a_real_arm_that_was_identified_on_other_motions_is_where_the_model_says():
    recording = read('val')
    deviations = IDENTIFIED.deviations(recording)
    assert len(deviations) == 443
    assert rms(aligned(deviations)) < 0.0065


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


def test_a_locked_arm_cannot_be_pulled():
    with pytest.raises(OverconstrainedError, match='t0 passes is stiff .* cannot be pulled in'):
        solved(arm(), soft=(False,) * 3)
    slackened = solved(arm(), (-0.001,) * 3, soft=(False,) * 3)
    assert slackened.slack == pytest.approx(0.001)
    assert not slackened.tensions.any()


def test_nothing_determines_what_a_tendon_carries_along_a_locked_arm():
    bent = solved(arm())
    locked = solved(arm(), bent.pulls, (False,) * 3, start=bent)
    assert np.isnan(locked.tensions).all()
    again = solved(arm(), bent.pulls, start=locked)
    assert again.points == pytest.approx(bent.points, abs=1e-9)


def test_tendons_that_stretch_carry_in_a_locked_arm_what_they_are_stretched_by():
    compliance = 1e-4
    an_arm = arm().with_compliant_tendons(compliance)
    bent = solved(an_arm)
    locked = solved(an_arm, PULLS, (False,) * 3, start=bent)  # where the motors stand
    assert locked.tensions == pytest.approx(bent.tensions, abs=1e-8)
    stretch = compliance * bent.tensions[0]
    eased = solved(an_arm, np.array(PULLS) - 2.0 * stretch, (False,) * 3, start=bent)
    assert eased.tensions[0] == 0.0
    assert eased.slack[0] == pytest.approx(stretch, abs=1e-9)
    forced = solved(an_arm, np.zeros(3), (False,) * 3, start=bent, tensions=(1.0, 2.0, 3.0))
    assert forced.tensions == pytest.approx([1.0, 2.0, 3.0])


def test_a_tendon_that_passes_rigid_segments_only_cannot_be_pulled():
    short = arm(tendons=(*arm().tendons, Tendon('low', 0.0, 0.02, 1)))
    with pytest.raises(OverconstrainedError, match='low passes'):
        solved(short, (0.0, 0.0, 0.0, 0.002), (False, True, True))


def test_a_start_of_another_arm_is_refused():
    other = SpaceStatics(arm(bodies_per_segment=2)).chain.straight()
    with pytest.raises(ValueError, match='another arm'):
        solved(arm(), start=other)


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


@pytest.mark.parametrize(('name', 'pulls', 'words'), [
    ('spatial_jamming', (0.03, 0.03, 0.03), 'no shape .* has tendons as short as'),
    ('tendon_arm', (0.1, 0.0, 0.0) * 3, 'loses its equilibrium after')])
def test_an_arm_that_is_pulled_beyond_every_equilibrium_is_soon_given_up(
        name, pulls, words, monkeypatch):
    functions, iterations = _kernel.functions(), []

    def follow(*arguments):
        found = functions.spatial_follow(*arguments)
        iterations.append(found[1])
        return found

    counting = functions._replace(spatial_follow=follow)
    monkeypatch.setattr(_kernel, 'functions', lambda: counting)
    statics = SpaceStatics(load_arm(CONFIG / f'{name}.yaml'))
    with pytest.raises(StaticsError, match=f'{words} .* pay out a tendon'):
        statics.solve(statics.chain.straight(), pulls, (True,) * 3)
    assert sum(iterations) < 4000  # hence less than a second


def test_where_the_search_for_first_tensions_does_not_end_others_do(monkeypatch):
    def endless(*_):
        raise RuntimeError('Maximum number of iterations reached.')

    there = solved(arm(), (0.006, -0.002, -0.005), (False, True, False), start=solved(arm()))
    monkeypatch.setattr('scipy.optimize.nnls', endless)
    again = solved(arm(), (0.006, -0.002, -0.005), (False, True, False), start=solved(arm()))
    assert again.points == pytest.approx(there.points, abs=1e-9)


@pytest.mark.parametrize(('make', 'words'), [
    (lambda: Tendon('t', 0.0, 0.025, 0), 'ends at disc 0; the base is 0'),
    (lambda: Tendon('t', 0.0, (0.02, 0.02, 0.02), 2), '3 offsets; needed: one, or 4'),
    (lambda: Tendon('t', np.nan, 0.025, 1), 'angle of t is nan'),
    (lambda: arm(tendons=arm().tendons[:1] * 2), 'each its own name'),
    (lambda: arm(tendons=(Tendon('t', 0.0, 0.025, 4),)), 'the last one is 3'),
    (lambda: arm(wrenches=(Wrench(5),)), 'the discs are 0 to 3'),
    (lambda: arm(gravity=(0.0, 9.8)), 'gravity is .*give x, y and z'),
    (lambda: arm(spacers=2), 'a multiple of spacers'),
    (lambda: arm(tendons=None), 'tendons are None; give a tuple'),
    (lambda: arm(wrenches=(Wrench(1.5),)), 'there is no disc 1.5'),
    (lambda: arm(bodies_per_segment=0), 'bodies'),
    (lambda: Segment(0.07, np.inf, np.inf), 'bend about one axis'),
    (lambda: Segment(70.0, 0.1, 0.1), 'segment length is 70'),
    (lambda: Segment(0.07, 0.1, 0.1, soft_law=0.1), 'soft law is 0.1; give a Moment'),
])
def test_what_is_no_arm_is_refused(make, words):
    with pytest.raises(ArmError, match=words):
        make()


PLANE = Statics(paper.build())
SPACE = SpaceStatics(arm())


@pytest.mark.parametrize('statics', [PLANE, SPACE], ids=['plane', 'space'])
@pytest.mark.parametrize(('given', 'words'), [
    *(({'pulls': pulls}, 'pulls must be finite numbers .m., or SLACK') for pulls in (
        (0.0, np.nan, 0.0), (0.0, np.inf, 0.0), (), None, 'abc', (True, True, True),
        (1j, 0.0, 0.0), ((0.0,), 0.0, 0.0), 0.0)),
    *(({'soft': soft}, 'soft must have a true or false for each of the 3 segments') for soft in (
        'abc', (0.5, np.nan, 'x'), (True,), (True,) * 4, None, 1, (None,) * 3,
        np.ones((3, 1)))),
    *(({'start': start}, 'the start must be one of .*Equilibrium') for start in (None, 0, 'a')),
    *(({'vacuum': vacuum}, 'vacuum must be one number from 0 to 1') for vacuum in (
        (0.5,), (2.0, 0.0, 0.0), 'abc', (True,) * 3)),
    *(({'sliding': sliding}, 'sliding must be 1, 0 or -1') for sliding in (
        (2, 0, 0), (1,), ('a', 0, 0), None, (True, False, True))),
    *(({'tensions': tensions}, 'tensions must be finite numbers of 0 N and more') for tensions in (
        (1.0, -1.0, 0.0), (np.inf, 0.0, 0.0), (True,) * 3, 'abc', (1j, 0.0, 0.0), (1.0,)))])
def test_what_is_no_command_is_refused_alike_in_plane_and_space(statics, given, words):
    tendons = len(statics.chain.arm.tendon_names)

    def fit(values):
        """As many as there are tendons, of three."""
        return values[:tendons] if isinstance(values, tuple) and len(values) == 3 else values

    given = {name: fit(value) if name in ('pulls', 'sliding', 'tensions') else value
             for name, value in given.items()}
    call = statics.solve
    if 'tensions' in given and statics is PLANE:
        call = statics.solve_tensions
    else:
        given = {'pulls': (0.0,) * tendons} | given
    with pytest.raises(ValueError, match=words):
        call(**{'start': statics.chain.straight(), 'soft': (True,) * 3} | given)


@pytest.mark.parametrize('statics', [PLANE, SPACE], ids=['plane', 'space'])
def test_a_tendon_that_is_pulled_by_more_than_its_path_fits_no_shape(statics):
    others = (0.0,) * (len(statics.chain.arm.tendon_names) - 1)
    for pulls in ((1.0, *others), (*others, 1.0)):
        with pytest.raises(OverconstrainedError, match='no shape .* has tendons as short as'):
            statics.solve(statics.chain.straight(), pulls, (True,) * 3)


def test_bending_is_that_of_the_rotation_between_two_discs():
    statics = SpaceStatics(arm())
    bend = np.array([[0.3, 0.2], [-0.1, 0.4], [0.0, -0.5]])
    state = statics.chain.uniform(bend)
    assert state.bending == pytest.approx(bend, abs=1e-12)
    assert np.linalg.norm(state.bending[0]) == pytest.approx(sqrt(0.13))
