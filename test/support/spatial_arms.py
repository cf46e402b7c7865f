# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Spatial arms for tests: one of three segments and tendons, and random ones."""

from dataclasses import replace
from math import pi

import numpy as np
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics import Jam
from soft_continuum.mechanics.arm import Arm, Disc, Segment, Tendon, Wrench
from soft_continuum.mechanics.space.statics import SpaceStatics


def in_space(arm):
    """Return a planar arm as one that the statics in space solve: a tendon a whole turn on."""
    right, left = arm.tendons
    return replace(arm, tendons=(replace(right, angle=2.0 * pi), left))


def stretching(arm, compliances):
    """Return an arm whose tendons stretch by given amounts (tendons,), m/N; 0: they do not."""
    return replace(arm, tendons=tuple(
        replace(tendon, axial_stiffness=float(rope) / compliance) if compliance else tendon
        for tendon, rope, compliance in zip(arm.tendons, arm.ropes, compliances, strict=True)))


def three_segments(turn=0.0, jam=None, tendons=3, **changes):
    """Return three segments with tendons evenly around them, the first turned about z."""
    segments = tuple(Segment(0.07, k, k, 0.03, 0.05, jam or Jam())
                     for k in (0.03, 0.02, 0.015))
    routed = tuple(Tendon(f't{i}', turn + 2.0 * pi * i / tendons, 0.025, 3)
                   for i in range(tendons))
    return replace(Arm(segments, (Disc(0.02, 0.02),) * 4, routed, 4), **changes)


def random_arm(seed, tendons=4, jam=None):
    """Return an arm with everything: hinges, helical tendons, stretch, spacers, loads."""
    draw = np.random.default_rng(seed)
    count = int(draw.integers(1, 4))
    segments = tuple(Segment(
        draw.uniform(0.05, 0.1), k := draw.uniform(0.02, 0.06), k * draw.uniform(0.5, 2.0),
        k * draw.uniform(0.5, 1.0), draw.uniform(0.0, 0.05), jam or Jam(draw.uniform(2.0, 9.0)))
        for _ in range(count))
    routed, stretch = zip(*((Tendon(
        f't{i}', 2.0 * pi * i / tendons + draw.uniform(-0.3, 0.3), draw.uniform(0.015, 0.025),
        count, draw.uniform(-8.0, 8.0)), draw.choice([0.0, 1e-4])) for i in range(tendons)),
        strict=True)
    wrench = Wrench(count, tuple(draw.uniform(-0.2, 0.2, 3)), tuple(draw.uniform(-0.01, 0.01, 3)))
    return stretching(Arm(
        segments, (Disc(0.02, 0.02),) * (count + 1), routed, 6, int(draw.choice([0, 2])),
        str(draw.choice(['paper', 'second_order'])), 0.01, (wrench,),
        tuple(draw.uniform(-6.0, 6.0, 3))), stretch)


def near_its_limit(seed):
    """
    Return a round arm, pulls that its tendons hardly allow, or not, and what of it is soft.

    Round: of every segment both bending stiffnesses are equal, so no direction is special.
    """
    draw = np.random.default_rng(seed)
    count, tendons = int(draw.integers(1, 4)), int(draw.integers(2, 6))
    stiffness = draw.uniform(0.01, 0.05, count)
    segments = tuple(Segment(
        draw.uniform(0.05, 0.1), k, k, k * draw.uniform(0.5, 1.0), draw.uniform(0.0, 0.05))
        for k in stiffness)
    routed, stretch = zip(*((Tendon(
        f't{i}', 2.0 * pi * i / tendons + draw.uniform(-0.3, 0.3), draw.uniform(0.015, 0.025),
        int(draw.integers(1, count + 1)) if i else count,
        draw.choice([0.0, draw.uniform(-8.0, 8.0)])), draw.choice([0.0, 1e-4]))
        for i in range(tendons)), strict=True)
    wrench = Wrench(count, tuple(draw.uniform(-0.2, 0.2, 3)), tuple(draw.uniform(-0.01, 0.01, 3)))
    gravity = draw.uniform(-9.0, 9.0, 3) * (
        (1.0, 1.0, 1.0) if draw.uniform() < 0.7 else (0.0, 0.0, 1.0))
    arm = stretching(Arm(
        segments, (Disc(0.02, 0.02),) * (count + 1), routed, 4, int(draw.choice([0, 1])),
        str(draw.choice(['paper', 'second_order'])), float(draw.choice([0.0, 0.02, 0.2])),
        (wrench,) if draw.uniform() < 0.5 else (), tuple(gravity)), stretch)
    pulls = draw.uniform(-0.01, 0.03, tendons) * draw.uniform(0.3, 1.5)
    soft = draw.uniform(size=count) < 0.8
    soft[0] |= not soft.any()
    return arm, pulls, soft.tolist()


def turned(arm, angle):
    """Return a round arm with all tendons and loads turned about z, rad."""
    turn = Rotation.from_euler('z', angle).apply
    return replace(
        arm, tendons=tuple(replace(t, angle=t.angle + angle) for t in arm.tendons),
        wrenches=tuple(replace(w, force=tuple(turn(w.force)), moment=tuple(turn(w.moment)))
                       for w in arm.wrenches), gravity=tuple(turn(arm.gravity)))


def mirrored(arm):
    """Return an arm with all tendons and loads mirrored, y to -y."""
    def across(v):
        return v[0], -v[1], v[2]

    return replace(
        arm, tendons=tuple(replace(t, angle=-t.angle, twist=-t.twist) for t in arm.tendons),
        wrenches=tuple(replace(w, force=across(w.force),
                               moment=(-w.moment[0], w.moment[1], -w.moment[2]))
                       for w in arm.wrenches), gravity=across(arm.gravity))


def random_state(seed, **changes):
    """Return the statics of a random arm, a state, and whether each segment is soft there."""
    arm, draw = random_arm(seed, **changes), np.random.default_rng(1000 + seed)
    statics, segments = SpaceStatics(arm), len(arm.segments)
    start = statics.solve(statics.chain.straight(), draw.uniform(-0.004, 0.004, len(arm.tendons)),
                          [True] * segments)
    soft = draw.uniform(size=segments) < 0.6
    soft[0] |= not soft.any()
    state = statics.solve(start, start.pulls + draw.uniform(-0.002, 0.004, len(arm.tendons)), soft)
    return statics, state, soft.tolist()


def turns(before, after):
    """Return the rotation vectors (..., 3) in base_link that turn rotations to others."""
    return np.array([Rotation.from_matrix(b @ a.T).as_rotvec()
                     for a, b in zip(before, after, strict=True)])
