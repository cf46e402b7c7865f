# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
MuJoCo, an engine of another make, settles where the statics say, in the plane and in space.

The same chain is built from hinges or balls with springs, bodies with masses and spatial tendons
through sites at the guides, with a longest length each.  MuJoCo's limits are soft: a tendon that
carries ends up to some tenths of a millimetre longer than its limit.  So our state is computed for
the lengths that MuJoCo's tendons really reached, and only for those that carry there; a tendon
that is slack in MuJoCo is left at its limit.  Both go from the same start; nothing else is shared.
"""

from dataclasses import dataclass, replace
from math import cos, pi, sin

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics import Jam, RIGHT, SLACK, Statics, Wrench
from support import paper_arm as paper
from support.spatial_arms import three_segments

TOLERANCE = 2e-5  # m, on every calculation point
TIME_STEP = 0.002
RAMP = 20  # hundreds of steps in which the tendons are pulled
SOFT_LIMIT = 'solreflimit="0.008 1" solimplimit="0.9 0.9 0.001 0.5 1"'  # stiffer ones chatter


@pytest.fixture(autouse=True)
def log_elsewhere(monkeypatch, tmp_path):
    """Keep the log that MuJoCo writes into the working directory out of the sources."""
    monkeypatch.chdir(tmp_path)


def movable(arm, soft):
    """Return which segments have joints that move: soft ones and elastic jams."""
    return [flag or not segment.jam.rigid
            for flag, segment in zip(soft, arm.segments, strict=True)]


def text(*numbers):
    return ' '.join(repr(float(number)) for number in numbers)


def quaternion(turn):
    """Return a rotation matrix as MuJoCo has it, w first."""
    return np.roll(Rotation.from_matrix(turn).as_quat(), 1)


def model_xml(arm, turns, soft):
    """
    Return the arm as MJCF, its bodies turned by ``turns`` from those below; no tendon is limited.

    Stiff segments are rigid in their shape or, where their jam is elastic, have its springs about
    that shape beside the leaf spring's.
    """
    n, moves = arm.bodies_per_segment, movable(arm, soft)
    lines, guides = [], [[] for _ in arm.tendons]

    def sites(name, height, segment, part):
        for t, tendon in enumerate(arm.tendons):
            if segment < tendon.end:
                offset = tendon.offset_at(segment, part)
                guides[t].append(f'{name}_{t}')
                lines.append(f'<site name="{name}_{t}" pos="' + text(
                    offset * cos(tendon.angle), offset * sin(tendon.angle), height) + '"/>')

    below = arm.discs[0].height
    sites('base', below, 0, 0.0)
    for k, segment in enumerate(arm.segments):
        stiffness = (n + 1) * segment.stiffness_y / segment.length
        for i in range(n + 1):
            disc, joint = i == n, k * (n + 1) + i
            length = arm.discs[k + 1].height if disc else segment.length / n
            mass = arm.discs[k + 1].mass if disc else segment.mass / n
            turned = '' if moves[k] else f' quat="{text(*quaternion(turns[joint]))}"'
            lines.append(f'<body name="b{joint}" pos="0 0 {text(below)}"{turned}>')
            if moves[k] and arm.bending_axes[k, 0]:
                lines.append(f'<joint type="ball" stiffness="{text(stiffness)}" damping="0.05" '
                             'armature="1e-5"/>')
            elif moves[k]:
                ratio = 1.0 if soft[k] else segment.jam.ratio
                angle = np.arctan2(turns[joint][0, 2], turns[joint][0, 0])
                lines.append(
                    f'<joint type="hinge" axis="0 1 0" stiffness="{text(ratio * stiffness)}" '
                    f'springref="{text((1 - 1 / ratio) * angle)}" damping="0.2" armature="1e-5"/>')
            lines.append(f'<inertial pos="0 0 {text(length / 2)}" mass="{text(mass)}" '
                         'diaginertia="1e-6 1e-6 1e-6"/>')
            if disc:
                sites(f'u{k}', 0.0, k, 1.0)
                if k + 1 < len(arm.segments):
                    sites(f'l{k}', length, k + 1, 0.0)
                elif arm.payload:
                    lines.append(f'<body pos="0 0 {text(length)}"><inertial pos="0 0 0" mass="'
                                 f'{text(arm.payload)}" diaginertia="1e-9 1e-9 1e-9"/></body>')
            below = length
    return (
        '<mujoco><compiler angle="radian" autolimits="false"/>'
        f'<option timestep="{TIME_STEP}" integrator="implicitfast" '
        f'gravity="{text(*arm.gravity)}" tolerance="1e-14" iterations="200"/>'
        '<worldbody>' + ''.join(lines) + '</body>' * (len(arm.segments) * (n + 1))
        + '</worldbody><tendon>' + ''.join(
            f'<spatial limited="true" range="0 1" {SOFT_LIMIT}>' + ''.join(
                f'<site site="{name}"/>' for name in names) + '</spatial>' for names in guides)
        + '</tendon></mujoco>')


@dataclass
class Settled:
    """Where MuJoCo came to rest: points of the backbone, pulls in m, tensions in N."""

    backbone: np.ndarray
    pulls: np.ndarray
    tensions: np.ndarray


def settle(statics, start, asked, soft, steps=40000):
    """Let MuJoCo move from ``start`` until it rests."""
    arm, chain = statics.chain.arm, statics.chain
    straight = np.tile(np.eye(3), (chain.bodies, 1, 1))
    turned = np.concatenate([np.eye(3)[None], start.rotations])
    turns = turned[:-1].transpose(0, 2, 1) @ turned[1:]
    lengths = []
    for each in (straight, turns):
        model = mujoco.MjModel.from_xml_string(model_xml(arm, each, soft))
        data = mujoco.MjData(model)
        free = np.repeat(movable(arm, soft), chain.joints_per_segment)
        data.qpos[:] = np.concatenate([
            quaternion(turn) if arm.bending_axes[0, 0] else [np.arctan2(turn[0, 2], turn[0, 0])]
            for turn in each[free]])
        mujoco.mj_forward(model, data)
        lengths.append(data.ten_length.copy())
    rest, begin = lengths
    for wrench in arm.wrenches:  # MuJoCo applies it in the disc's centre of mass
        disc = wrench.disc * chain.joints_per_segment - 1
        data.xfrc_applied[model.body(f'b{disc}').id, :3] = wrench.force
    wanted = np.minimum(rest - np.asarray(asked), 1.0)
    for k in range(steps // 100):
        model.tendon_range[:, 1] = begin + min(1.0, (k + 1) / RAMP) * (wanted - begin)
        mujoco.mj_step(model, data, 100)
        if k > RAMP and np.abs(data.qvel).max() < 1e-7:
            break
    assert np.abs(data.qvel).max() < 1e-6, 'MuJoCo has not come to rest'
    mujoco.mj_forward(model, data)
    tensions = np.zeros(len(rest))
    for row in range(data.nefc):
        if data.efc_type[row] == mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON:
            tensions[data.efc_id[row]] = data.efc_force[row]
    last = data.body(f'b{chain.bodies - 1}')
    tip = last.xpos + arm.discs[-1].height * last.xmat.reshape(3, 3)[:, 2]
    return Settled(np.array([*(data.body(f'b{j}').xpos for j in range(chain.bodies)), tip]),
                   rest - data.ten_length, tensions)


def check(statics, start, asked, soft):
    """Compare the end state of both and return ours."""
    theirs = settle(statics, start, asked, soft)
    carries = theirs.tensions > 0.0
    reached = np.where(carries, theirs.pulls, asked)
    off = np.abs(theirs.pulls[carries] - np.asarray(asked)[carries])
    assert np.all(off < 1e-3)  # the limit is soft, but not that soft
    ours = statics.solve(start, reached, soft)
    assert np.linalg.norm(ours.backbone - theirs.backbone, axis=1).max() < TOLERANCE
    assert ours.tensions == pytest.approx(theirs.tensions, abs=1e-3)
    return ours


@pytest.mark.parametrize(('mounting', 'pulls'), [
    (0.0, (-0.006, 0.006, 0.014)), (pi / 4, (0.006, 0.014, -0.006)),
    (pi / 2, (0.014, -0.006, 0.006)), (-3 * pi / 4, (-0.006, 0.006, 0.014)),
    (pi, (0.014, 0.006, -0.006))])
@pytest.mark.parametrize('segment', [0, 1, 2])
def test_one_soft_segment_and_one_tendon(mounting, segment, pulls):
    statics = Statics(paper.build(mounting_angle=mounting))
    check(statics, statics.chain.straight(), (pulls[segment], SLACK), paper.only(segment))


@pytest.mark.parametrize('form', paper.FORMS)
def test_the_forms_of_the_paper_step_by_step_with_stiff_segments_bent(form):
    statics = Statics(paper.build())
    start = statics.chain.straight()
    for segment, state in enumerate(paper.set_form(statics, paper.FORMS[form])):
        check(statics, start, np.where(state.tensions > 0.0, state.pulls, SLACK),
              paper.only(segment))
        start = state


def test_the_slack_tendon_of_segment_2_in_the_c_form():
    statics = Statics(paper.build())
    first = statics.bend(statics.chain.straight(), 0, paper.ANGLE)
    state = check(statics, first, (first.pulls[RIGHT] + 0.0142, SLACK), paper.only(1))
    assert state.tensions[RIGHT] == 0.0
    assert state.slack[RIGHT] > 0.004


@pytest.mark.parametrize(('asked', 'mounting'), [
    ((0.012, -0.012), 0.0), ((0.006, -0.012), pi / 2), ((-0.020, 0.012), pi),
    ((0.030, SLACK), 0.0), ((SLACK, 0.025), pi / 2), ((0.012, -0.012), pi)])
def test_all_segments_soft_and_both_tendons(asked, mounting):
    statics = Statics(paper.build(0.5, mounting_angle=mounting))
    check(statics, statics.chain.straight(), asked, (True, True, True))


def test_both_tendons_taut_against_each_other():
    statics = Statics(paper.build())
    bent = statics.bend(statics.chain.straight(), 0, paper.ANGLE)
    assert all(check(statics, bent, bent.pulls + 1e-4, paper.only(0)).taut)


def test_guides_at_different_offsets_and_few_bodies():
    arm = paper.build(bodies_per_segment=3, mounting_angle=0.7)
    statics = Statics(arm.with_tendons(offset=(0.025, 0.019, 0.022, 0.024, 0.012, 0.018)))
    check(statics, statics.chain.straight(), (0.02, SLACK), (True, True, True))
    check(statics, statics.chain.uniform((0.3, 0.0, -0.5)), (SLACK, 0.01), (False, True, False))


@pytest.mark.parametrize(('angles', 'soft'), [
    ((3.0, 3.0, 3.0), (True, True, True)), ((0.0, 0.0, -20.0), (True, True, False)),
    ((0.0, 0.0, 5.0), (True, True, False))])
def test_an_arm_that_leans_and_cannot_stand_falls_to_the_same_side(angles, soft):
    statics = Statics(paper.build())
    state = check(statics, statics.chain.uniform(np.radians(angles)), (SLACK, SLACK), soft)
    assert np.abs(paper.degrees_of(statics, state)[:2]).max() > 10.0


@pytest.mark.parametrize(('mounting', 'soft', 'asked'), [
    (0.0, (True, True, True), (0.012, SLACK)), (pi / 2, (False, True, False), (-0.012, 0.008)),
    (pi, (True, True, True), (-0.012, 0.008)), (0.0, (False, True, False), (0.012, SLACK))])
def test_a_payload_at_the_tip(mounting, soft, asked):
    statics = Statics(replace(paper.build(0.5, mounting_angle=mounting), payload=0.03))
    check(statics, statics.chain.uniform((0.1, 0.1, 0.1)), asked, soft)


@pytest.mark.parametrize('disc', [1, 2, 3])
def test_a_force_on_a_disc(disc):
    statics = Statics(replace(paper.build(0.5), wrenches=(Wrench(disc, (-0.2, 0.0, 0.1)),)))
    check(statics, statics.chain.straight(), (0.015, SLACK), (True, True, True))


@pytest.mark.parametrize(('ratio', 'soft'), [
    (4.0, (False, True, False)), (20.0, (False, False, False))])
def test_stiff_segments_that_give_way_a_little(ratio, soft):
    arm = paper.build()
    statics = Statics(replace(
        arm, segments=tuple(replace(s, jam=Jam(ratio)) for s in arm.segments)))
    state = check(statics, statics.chain.uniform((0.4, -0.2, 0.3)), (0.004, -0.012), soft)
    assert abs(state.bending_angles[0] - 0.4) > 0.002


@pytest.mark.parametrize(('soft', 'pulls', 'gravity'), [
    ((True, True, True), (0.006, -0.004, -0.003), (3.0, -2.0, -4.0)),
    ((True, True, True), (0.004, 0.003, -0.01), (0.0, 0.0, 9.8)),
    ((False, True, False), (-0.002, 0.012, 0.0005), (0.0, 9.8, 0.0))])
def test_an_arm_in_space(soft, pulls, gravity):
    # A ball joint of MuJoCo resists twist as it does bending.
    arm = three_segments(gravity=gravity)
    statics = Statics(replace(arm, segments=tuple(
        replace(s, torsional_stiffness=s.stiffness_x) for s in arm.segments)))
    start = statics.chain.straight() if all(soft) else statics.chain.uniform(
        [(0.2, -0.1), (0.0, 0.0), (-0.1, 0.3)])
    assert not check(statics, start, start.pulls + pulls, soft).jumped
