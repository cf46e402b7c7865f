# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
MuJoCo, an engine of another make, settles where the statics say.

The same chain is built from hinges with springs, bodies with masses and spatial tendons through
sites at the guides, with a longest length each.  MuJoCo's limits are soft: a tendon that carries
ends up to some tenths of a millimetre longer than its limit.  So our state is computed for the
lengths that MuJoCo's tendons really reached, and only for those that carry there; a tendon that
is slack in MuJoCo is left at its limit.  Both go from the same start; nothing else is shared.
"""

from dataclasses import dataclass, replace
from math import pi

import mujoco
import numpy as np
import pytest

from soft_continuum.mechanics import Jam, LEFT, RIGHT, SLACK, Statics, Wrench
from support import paper_arm as paper

TOLERANCE = 2e-5  # m, on every calculation point
TIME_STEP = 0.002
SOFT_LIMIT = 'solreflimit="0.008 1" solimplimit="0.9 0.9 0.001 0.5 1"'  # stiffer ones chatter


@pytest.fixture(autouse=True)
def log_elsewhere(monkeypatch, tmp_path):
    """Keep the log that MuJoCo writes into the working directory out of the sources."""
    monkeypatch.chdir(tmp_path)


def movable(arm, soft):
    """Return which segments have joints that move: soft ones and elastic jams."""
    return [flag or not segment.jam.rigid
            for flag, segment in zip(soft, arm.segments, strict=True)]


def model_xml(arm, start, soft, limits):
    """
    Return the arm as MJCF; limits are lengths in m or inf.

    Stiff segments are rigid in their shape or, where their jam is elastic, have its springs about
    that shape beside the leaf spring's.
    """
    n = arm.bodies_per_segment
    lines, closing = [], []
    guides = [[], []]

    def site(name, tendon, x, z):
        guides[tendon].append(name)
        return f'<site name="{name}" pos="{x!r} 0 {z!r}"/>'

    first = arm.tendons[0].offset_at(0, 0.0)
    top = arm.discs[0].height
    lines += [site('r0', RIGHT, first, top), site('l0', LEFT, -first, top)]
    moves = movable(arm, soft)
    below, joint = top, 0
    for k, segment in enumerate(arm.segments):
        stiffness = (n + 1) * segment.stiffness_y / segment.length
        for i in range(n + 1):
            disc = i == n
            length = arm.discs[k + 1].height if disc else segment.length / n
            mass = arm.discs[k + 1].mass if disc else segment.mass / n
            angle = float(start[joint])
            turned = f' euler="0 {angle!r} 0"' if not moves[k] else ''
            lines.append(f'<body name="b{joint}" pos="0 0 {below!r}"{turned}>')
            if moves[k]:
                ratio = 1.0 if soft[k] else segment.jam.ratio
                lines.append(
                    f'<joint name="j{joint}" type="hinge" axis="0 1 0" '
                    f'stiffness="{ratio * stiffness!r}" springref="{(1 - 1 / ratio) * angle!r}" '
                    'damping="0.2" armature="1e-5"/>')
            lines.append(f'<inertial pos="0 0 {length / 2!r}" mass="{mass!r}" '
                         'diaginertia="1e-6 1e-6 1e-6"/>')
            if disc:
                upper = arm.tendons[0].offset_at(k, 1.0)
                last = k + 1 == len(arm.segments)
                lines += [site(f'ru{k}', RIGHT, upper, 0.0), site(f'lu{k}', LEFT, -upper, 0.0)]
                if not last:
                    lower = arm.tendons[0].offset_at(k + 1, 0.0)
                    lines += [site(f'rl{k}', RIGHT, lower, length),
                              site(f'll{k}', LEFT, -lower, length)]
                if last and arm.payload:
                    lines.append(
                        f'<body pos="0 0 {length!r}"><inertial pos="0 0 0" '
                        f'mass="{arm.payload!r}" diaginertia="1e-9 1e-9 1e-9"/></body>')
            closing.append('</body>')
            below, joint = length, joint + 1
    tendons = []
    for tendon, name in ((RIGHT, 'right'), (LEFT, 'left')):
        limit = limits[tendon]
        limited = '' if np.isinf(limit) else (
            f' limited="true" range="0 {float(limit)!r}" {SOFT_LIMIT}')
        sites = ''.join(f'<site site="{s}"/>' for s in guides[tendon])
        tendons.append(f'<spatial name="{name}"{limited}>{sites}</spatial>')
    down_x, _, down_z = map(float, arm.gravity)
    return (
        '<mujoco><compiler angle="radian" autolimits="false"/>'
        f'<option timestep="{TIME_STEP}" integrator="implicitfast" '
        f'gravity="{down_x!r} 0 {down_z!r}" '
        'tolerance="1e-14" iterations="200"/>'
        '<worldbody>' + ''.join(lines + closing) + '</worldbody>'
        '<tendon>' + ''.join(tendons) + '</tendon></mujoco>')


@dataclass
class Settled:
    """Where MuJoCo came to rest: joint angles, both pulls in m, tensions in N."""

    joint_angles: np.ndarray
    pulls: np.ndarray
    tensions: np.ndarray


def settle(statics, start, asked, soft, steps=40000):
    """Let MuJoCo move from ``start`` until it rests."""
    arm = statics.chain.arm
    straight = mujoco.MjModel.from_xml_string(
        model_xml(arm, np.zeros(statics.chain.bodies), [True] * len(arm.segments), (np.inf,) * 2))
    data = mujoco.MjData(straight)
    mujoco.mj_forward(straight, data)
    rest = data.ten_length.copy()
    model = mujoco.MjModel.from_xml_string(
        model_xml(arm, start.joint_angles, soft, rest - np.asarray(asked)))
    data = mujoco.MjData(model)
    for wrench in arm.wrenches:  # MuJoCo applies it in the disc's centre of mass
        disc = wrench.disc * statics.chain.joints_per_segment - 1
        data.xfrc_applied[model.body(f'b{disc}').id, :3] = wrench.force
    free = np.repeat(movable(arm, soft), statics.chain.joints_per_segment)
    data.qpos[:] = start.joint_angles[free]
    for _ in range(steps // 100):
        mujoco.mj_step(model, data, 100)
        if np.abs(data.qvel).max() < 1e-7:
            break
    assert np.abs(data.qvel).max() < 1e-6, 'MuJoCo has not come to rest'
    mujoco.mj_forward(model, data)
    angles = start.joint_angles.copy()
    angles[free] = data.qpos
    tensions = np.zeros(2)
    for row in range(data.nefc):
        if data.efc_type[row] == mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON:
            tensions[data.efc_id[row]] = data.efc_force[row]
    return Settled(angles, rest - data.ten_length, tensions)


def check(statics, start, asked, soft):
    """Compare the end state of both and return ours."""
    theirs = settle(statics, start, asked, soft)
    reached = np.where(theirs.tensions > 0.0, theirs.pulls, asked)
    for tendon in (RIGHT, LEFT):
        if theirs.tensions[tendon] > 0.0:  # the limit is soft, but not that soft
            assert abs(reached[tendon] - asked[tendon]) < 1e-3
    ours = statics.solve(start, reached, soft)
    points = ours.points[:, :2]
    other = statics.chain.points(theirs.joint_angles)[:, :2]
    assert np.linalg.norm(points - other, axis=1).max() < TOLERANCE
    assert ours.tensions == pytest.approx(theirs.tensions, abs=1e-3)
    return ours


@pytest.mark.parametrize('mounting', [0.0, pi / 4, pi / 2, -3 * pi / 4, pi])
@pytest.mark.parametrize('segment', [0, 1, 2])
@pytest.mark.parametrize('pull', [-0.006, 0.006, 0.014])
def test_one_soft_segment_and_one_tendon(mounting, segment, pull):
    statics = Statics(paper.build(mounting_angle=mounting))
    state = statics.chain.straight()
    check(statics, state, (pull, SLACK), paper.only(segment))


@pytest.mark.parametrize('form', paper.FORMS)
def test_the_forms_of_the_paper_step_by_step_with_stiff_segments_bent(form):
    statics = Statics(paper.build())
    signs = paper.FORMS[form]
    start = statics.chain.straight()
    for segment, state in enumerate(paper.set_form(statics, signs)):
        tendon = RIGHT if state.tensions[RIGHT] > 0.0 else LEFT
        asked = [SLACK, SLACK]
        asked[tendon] = state.pulls[tendon]
        check(statics, start, asked, paper.only(segment))
        start = state


def test_the_slack_tendon_of_segment_2_in_the_c_form():
    statics = Statics(paper.build())
    first = statics.bend(statics.chain.straight(), 0, paper.ANGLE)
    state = check(statics, first, (first.pulls[RIGHT] + 0.0142, SLACK), paper.only(1))
    assert state.tensions[RIGHT] == 0.0
    assert state.slack[RIGHT] > 0.004


@pytest.mark.parametrize('asked', [
    (0.012, -0.012), (0.006, -0.012), (-0.020, 0.012), (0.030, SLACK), (SLACK, 0.025)])
@pytest.mark.parametrize('mounting', [0.0, pi / 2, pi])
def test_all_segments_soft_and_both_tendons(asked, mounting):
    statics = Statics(paper.build(0.5, mounting_angle=mounting))
    check(statics, statics.chain.straight(), asked, (True, True, True))


def test_both_tendons_taut_against_each_other():
    statics = Statics(paper.build())
    bent = statics.bend(statics.chain.straight(), 0, paper.ANGLE)
    asked = bent.pulls + np.array([1e-4, 1e-4])
    state = check(statics, bent, asked, paper.only(0))
    assert all(state.taut)


def test_guides_at_different_offsets_and_few_bodies():
    arm = paper.build(bodies_per_segment=3, mounting_angle=0.7)
    arm = arm.with_tendons(offset=(0.025, 0.019, 0.022, 0.024, 0.012, 0.018))
    statics = Statics(arm)
    check(statics, statics.chain.straight(), (0.02, SLACK), (True, True, True))
    check(statics, statics.chain.uniform((0.3, 0.0, -0.5)), (SLACK, 0.01), (False, True, False))


def test_an_arm_that_cannot_stand_falls_to_the_same_state():
    statics = Statics(paper.build())
    leaning = statics.chain.uniform((0.05, 0.05, 0.05))
    state = check(statics, leaning, (SLACK, SLACK), (True, True, True))
    assert paper.degrees_of(statics, state)[1] > 40.0


@pytest.mark.parametrize('tip', [-20.0, -5.0, 20.0])
def test_an_arm_that_leans_falls_to_the_same_side(tip):
    statics = Statics(paper.build())
    leaning = statics.chain.uniform(np.radians([0.0, 0.0, tip]))
    check(statics, leaning, (SLACK, SLACK), (True, True, False))


@pytest.mark.parametrize('mounting', [0.0, pi / 2, pi])
@pytest.mark.parametrize('soft', [(True, True, True), (False, True, False)])
@pytest.mark.parametrize('asked', [(0.012, SLACK), (-0.012, 0.008)])
def test_a_payload_at_the_tip(mounting, soft, asked):
    arm = replace(paper.build(0.5, mounting_angle=mounting), payload=0.03)
    statics = Statics(arm)
    check(statics, statics.chain.uniform((0.1, 0.1, 0.1)), asked, soft)


@pytest.mark.parametrize('disc', [1, 2, 3])
def test_a_force_on_a_disc(disc):
    arm = replace(paper.build(0.5), wrenches=(Wrench(disc, (-0.2, 0.0, 0.1)),))
    statics = Statics(arm)
    check(statics, statics.chain.straight(), (0.015, SLACK), (True, True, True))


@pytest.mark.parametrize('ratio', [4.0, 20.0])
@pytest.mark.parametrize('soft', [(False, True, False), (False, False, False)])
def test_stiff_segments_that_give_way_a_little(ratio, soft):
    arm = paper.build()
    arm = replace(arm, segments=tuple(replace(s, jam=Jam(ratio)) for s in arm.segments))
    statics = Statics(arm)
    start = statics.chain.uniform((0.4, -0.2, 0.3))
    state = check(statics, start, (0.004, -0.012), soft)
    assert abs(state.bending_angles[0] - 0.4) > 0.002
