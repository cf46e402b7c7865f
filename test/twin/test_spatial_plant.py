# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A plant in space rests where the statics say, and differs from them as a planar one does."""

from dataclasses import replace
from math import nan

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics import pulls_for_bending
from soft_continuum.mechanics.arm import Arm, Disc, Segment, Tendon, Wrench
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.parameters.files import load_arm
from soft_continuum.twin.differences import Obstacle, read_differences, TwinError
from soft_continuum.twin.plant import Plant
from soft_continuum.twin.sensors import Sensors
from soft_continuum.user_files import description_file
from support.plants import ARM, IDEAL, only, run, SOFT, STIFF
from support.spatial_arms import in_space, stretching

JAMMING = load_arm(description_file().with_name('spatial_jamming.yaml'))
SIDEWAYS = (5.0, -7.0, 4.0)  # m/s^2
ZERO = np.zeros(3)


def few(arm=JAMMING, **changes):
    """Return an arm of fewer bodies, with other values: this takes less time."""
    return replace(arm, bodies_per_segment=4, **changes)


def everything():
    """Return an arm that has all that one can have."""
    segments = (Segment(0.07, 0.03, 0.02, 0.015, 0.05),
                Segment(0.08, np.inf, 0.02, mass=0.04),  # a leaf spring
                Segment(0.06, 0.02, 0.04, 0.03, 0.03))
    tendons = (Tendon('helix', 0.3, 0.02, 3, twist=7.0),
               Tendon('cone', 2.0, (0.025, 0.022, 0.022, 0.02, 0.02, 0.015), 3),
               Tendon('short', 4.0, 0.02, 2), Tendon('left', 3.4, 0.02, 1))
    arm = Arm(segments, (Disc(0.02, 0.02),) * 4, tendons, 6, 2, 'second_order', 0.03,
              (Wrench(2, (0.2, -0.3, 0.1), (0.01, 0.0, -0.01)),), SIDEWAYS)
    return stretching(arm, (1e-4, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(('payload', 'pretension'), [(0.0, 0.0), (0.05, 0.5)])
def test_segments_set_in_space_rest_where_the_statics_say(payload, pretension):
    arm = few(gravity=SIDEWAYS, payload=payload)
    found, statics = Plant(arm, IDEAL), SpaceStatics(arm)
    state, pulls, slack = statics.chain.straight(), ZERO, False
    run(found, pulls, pulls, STIFF, 0.2)
    for segment, bending in enumerate([(0.3, 0.35), (-0.4, 0.1), (0.2, -0.3)]):
        goals = [(nan, nan)] * 3
        goals[segment] = bending
        state = pulls_for_bending(statics, state, goals, [s == segment for s in range(3)],
                                  pretension=pretension).state
        goal = np.where(state.tensions > 0.0, state.pulls, state.pulls - 0.003)
        slack = slack or bool(np.any(state.tensions == 0.0))
        run(found, pulls, pulls, only(segment), 0.2)
        pulls = run(found, pulls, goal, only(segment), 2.5)
        assert found.poses[:, :3] == pytest.approx(state.points, abs=5e-5)
        assert found.tensions == pytest.approx(state.tensions, abs=0.02)
        run(found, pulls, pulls, STIFF, 0.3)
    assert slack == (pretension == 0.0)
    assert found.poses == pytest.approx(state.poses, abs=2e-4)
    # There the IMUs feel what holds them against gravity.
    felt = Rotation.from_quat(found.poses[::2, 3:]).inv().apply(SIDEWAYS)
    assert Sensors(found).motions()[:, 3:] == pytest.approx(-felt, abs=0.01)


def test_an_arm_with_everything_rests_where_the_statics_say():
    arm, goal = everything(), np.array([0.004, -0.003, 0.002, -0.02])
    found, statics = Plant(arm, IDEAL), SpaceStatics(arm)
    run(found, np.zeros(4), goal, SOFT, 4.0)
    state = statics.solve(statics.chain.straight(), goal, [True] * 3)
    assert np.count_nonzero(state.tensions) in (2, 3)
    assert np.abs(state.points[-1, :2]).min() > 0.02  # out of every plane
    assert found.poses[:, :3] == pytest.approx(state.points, abs=2e-5)
    assert found.tensions == pytest.approx(state.tensions, abs=1e-3)


def test_a_turned_rig_rests_turned():
    turn, goal, ends = Rotation.from_euler('z', 0.7), np.array([0.006, -0.01, 0.001]), []
    for by in (0.0, 0.7):
        tendons = tuple(replace(t, angle=t.angle + by) for t in JAMMING.tendons)
        gravity = turn.apply(SIDEWAYS) if by else np.array(SIDEWAYS)
        found = Plant(few(tendons=tendons, gravity=tuple(gravity.tolist())), IDEAL)
        run(found, ZERO, goal, only(2), 2.0)
        ends.append(found.poses[:, :3])
    assert np.abs(ends[0][-1, :2]).min() > 0.005
    assert ends[1] == pytest.approx(turn.apply(ends[0]), abs=1e-6)


def test_energy_is_never_created_in_space():
    found = Plant(few(gravity=SIDEWAYS), IDEAL)
    pulls = run(found, ZERO, np.array([0.01, 0.002, -0.02]), only(2), 1.0)
    run(found, pulls, pulls, STIFF, 0.5)
    energies = []
    for _ in range(1000):
        found.step(np.full(3, -0.05), SOFT)
        energies.append(found.energy)
    lost = energies[1] - energies[-1]
    assert lost > 0.05
    # A time step of half the length leaves a third of it.
    assert np.max(energies - np.minimum.accumulate(energies)) < 0.005 * lost


def test_in_a_plane_it_differs_from_the_statics_as_the_planar_plant_does():
    bad = read_differences(description_file().with_name('twin.yaml'), 'bad')
    given = replace(bad, lock_in_shift=0.0, lateral_stiffness_factor=1.0, angle_error=0.0)
    arm = ARM.without_gravity().with_bodies(4)
    both = Plant(arm, given), Plant(in_space(arm), given)
    ideal, apart = Plant(arm, IDEAL), []
    pulls, rests = np.zeros(2), []
    for goal, vacuum, seconds in (((0.0, -0.03), only(0), 1.0), ((0.016, -0.03), only(0), 2.0),
                                  ((0.016, -0.03), STIFF, 0.5), ((-0.03, 0.0), only(2), 1.0),
                                  ((-0.03, 0.02), only(2), 2.0), ((-0.03, 0.014), only(2), 2.0),
                                  ((-0.03, 0.014), STIFF, 0.5), ((-0.05, -0.05), STIFF, 1.0)):
        for one in (*both, ideal):
            run(one, pulls, np.array(goal), vacuum, seconds)
        pulls = np.array(goal)
        rests.append([one.poses for one in both])
        assert rests[-1][1] == pytest.approx(rests[-1][0], abs=2e-3)
        apart.append(np.abs(rests[-1][0] - ideal.poses).max())
        assert both[1].tensions == pytest.approx(both[0].tensions, abs=0.2)
    assert np.median(apart) > 0.02
    assert np.abs(rests[-1][0] - rests[-2][0]).max() > 0.01  # it springs back


def test_what_differs_out_of_the_plane_takes_the_arm_there():
    pull, bent = np.array([0.006, -0.02, -0.02]), {}
    straight = {'gravity': (0.0, 0.0, 0.0)}
    for name, value in (('seed', 1), ('angle_error', 0.05), ('lock_in_shift', 0.02)):
        found = Plant(few(**straight), replace(IDEAL, **{name: value}))
        run(found, ZERO, pull, only(2), 1.5)
        run(found, pull, pull, STIFF, 0.3)
        bent[name] = found.poses[:, :3][-1]
    assert abs(bent['seed'][1]) < 1e-6
    assert abs(bent['angle_error'][1]) > 1e-4 and abs(bent['lock_in_shift'][1]) > 1e-4
    arm = few(tendons=tuple(replace(t, angle=t.angle + 0.5) for t in JAMMING.tendons), **straight)
    for factor, way in ((1.0, 0.5), (1.3, 0.4)):
        found = Plant(arm, replace(IDEAL, lateral_stiffness_factor=factor))
        run(found, ZERO, pull, only(2), 1.5)
        x, y, _ = found.poses[:, :3][-1]
        assert (np.arctan2(y, x) == pytest.approx(way, abs=1e-3)) == (factor == 1.0)
        assert np.arctan2(y, x) <= 0.5 + 1e-3


def test_an_arm_with_friction_inside_is_refused():
    segments = tuple(replace(s, friction=0.01) for s in JAMMING.segments)
    with pytest.raises(TwinError, match='friction of tendons only'):
        Plant(few(segments=segments), IDEAL)


def test_an_obstacle_stops_an_arm_in_space():
    pull = np.array([0.018, -0.03, -0.03])
    for obstacles in ((), (Obstacle(0.055, 0.305, 0.01),)):
        found = Plant(few(gravity=(0.0, 0.0, 0.0)), replace(IDEAL, obstacles=obstacles))
        run(found, ZERO, pull, only(2), 2.0)
        away = np.linalg.norm(found.poses[:, :3][-1, [0, 2]] - [0.055, 0.305])
        assert (away > 0.01) == bool(obstacles)
    with pytest.raises(TwinError, match='obstacle 1 is where the straight arm is'):
        Plant(JAMMING, replace(IDEAL, obstacles=(Obstacle(0.0, 0.2, 0.02),)))
