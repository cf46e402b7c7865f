# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An independent parser makes the same arm of the URDF as the rigid chain is."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from soft_continuum.mechanics import Chain, Disc, Segment
from soft_continuum.mechanics.arm import mounted, STANDARD_GRAVITY
from soft_continuum.mechanics.rotations import full_poses
from soft_continuum.ros.description import load_arm
from soft_continuum.ros.urdf import arm_urdf, joint_names
from soft_continuum.user_files import description_file
from support.descriptions import check_urdf, JAMMING, parsed, PLANAR, TENDON_ARM
from support.flat_arm import flat_arm, of_segments

PAPER = load_arm(description_file())
SHORT = flat_arm([Segment.leaf_spring(0.1, 0.02, 0.1)], [(0.02, 0.015)],
                 [Disc(0.02), Disc(0.03, 0.2)], bodies_per_segment=1)
LONG = of_segments(PAPER, [0, 1, 2, 0, 1, 2], bodies_per_segment=5, payload=0.3)
ARMS = pytest.mark.parametrize('arm', [PAPER, SHORT, LONG], ids=['paper', 'short', 'long'])


def names(model, kind, count):
    return [mujoco.mj_id2name(model, kind, i) for i in range(count)]


@ARMS
def test_the_joints_of_joint_states_give_the_poses(arm):
    model, chain = parsed(arm_urdf(arm)), Chain(arm)
    assert names(model, mujoco.mjtObj.mjOBJ_JOINT, model.njnt) == joint_names(chain)
    assert np.all(model.jnt_axis == [0.0, 1.0, 0.0])
    for seed in range(3):
        angles = np.random.default_rng(seed).uniform(-0.08, 0.08, chain.bodies)
        check_urdf(arm_urdf(arm), dict(zip(joint_names(chain), angles, strict=True)),
                   full_poses(chain.plane_points(angles)))


@pytest.mark.parametrize('path', [PLANAR, JAMMING, TENDON_ARM], ids=lambda p: p.stem)
def test_an_arm_of_any_kind_has_the_poses_of_its_urdf(path):
    # Also where a bend about one axis goes on about the other: then discs turn about z.
    chain = Chain(load_arm(path))
    turns = np.random.default_rng(1).uniform(-0.2, 0.2, chain.coordinate_count)
    state = chain.state_of(turns, turns, (False,) * 3)
    check_urdf(arm_urdf(chain.arm), dict(zip(
        joint_names(chain), state.joint_positions, strict=True)), state.poses)
    assert chain.at(state.joint_positions).poses == pytest.approx(state.poses, abs=1e-9)


@ARMS
def test_the_weight_on_every_joint_is_that_of_the_chain(arm):
    # Gravity alone, straight and on its side: the moments of the masses above each joint.
    chain = Chain(replace(arm, gravity=mounted(np.pi / 2)))
    model = parsed(arm_urdf(arm))
    model.opt.gravity[:] = STANDARD_GRAVITY, 0.0, 0.0
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    moments = np.cumsum(chain.load_coefficients[::-1, 0])[::-1]
    assert data.qfrc_bias == pytest.approx(moments, rel=1e-9, abs=1e-12)


def test_the_frames_of_two_arms_share_one_tree():
    left, right = (parsed(arm_urdf(PAPER, f'{side}/base_link')) for side in ('left', 'right'))
    body = mujoco.mjtObj.mjOBJ_BODY
    frames = [names(model, body, model.nbody)[1:] for model in (left, right)]
    assert set(frames[0]).isdisjoint(frames[1])
    assert all(frame.startswith('left/') for frame in frames[0])
    joint = mujoco.mjtObj.mjOBJ_JOINT
    assert names(left, joint, left.njnt) == joint_names(Chain(PAPER))


def test_a_joint_may_bend_no_further_than_its_segment():
    arm = replace(PAPER, segments=tuple(
        replace(s, bending_angle_limit=0.7) for s in PAPER.segments))
    assert parsed(arm_urdf(arm)).jnt_range == pytest.approx(
        np.tile([-0.7, 0.7], (Chain(arm).bodies, 1)))
