# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The plant rests where the statics say, and does what a rig does that the statics do not know."""

from dataclasses import replace
from math import nan, radians

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics import MomentCurvature, pulls_for_bending, set_shape, Statics
from soft_continuum.mechanics.arm import Arm, Disc, mounted, Segment, Tendon, Wrench
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.ros.description import load_arm
from soft_continuum.sim.twin.model_errors import CylinderObstacle, read_model_errors, TwinError
from soft_continuum.sim.twin.plant import Plant, Sensors
from soft_continuum.user_files import description_file
from support.paper_arm import plane_points
from support.plants import ARM as FINE
from support.plants import FREE, only, plant, points_of, run, SOFT, STIFF
from support.spatial_arms import in_space, stretching

ARM = FINE.with_bodies(4)  # this takes less time
JAMMING = load_arm(description_file().with_name('spatial_jamming.yaml'))
SIDEWAYS = (5.0, -7.0, 4.0)  # m/s^2
ZERO = np.zeros(3)


def bent(found, segment, angle):
    """Bend one segment without gravity in the way, and lock it; return the pulls."""
    statics = Statics(found.arm)
    state = statics.bend(statics.chain.straight(), segment, angle)
    goal = np.where(state.tensions > 0.0, state.pulls, state.pulls - 0.003)
    pulls = run(found, np.zeros(2), np.zeros(2), only(segment), 0.5)
    pulls = run(found, pulls, goal, only(segment), 2.0)
    return run(found, pulls, goal, STIFF, 0.5)


def angles(found):
    return found.joint_angles.reshape(3, -1).sum(axis=1)


@pytest.mark.parametrize('mounting', [0.0, 2.0])
def test_the_ideal_plant_rests_where_the_statics_say(mounting):
    arm = replace(ARM, gravity=mounted(mounting))
    found, statics = plant(arm), Statics(arm)
    state, pulls = statics.chain.straight(), np.zeros(2)
    run(found, pulls, pulls, STIFF, 0.5)
    for segment, angle in enumerate((radians(30), radians(-25), radians(20))):
        state = statics.bend(state, segment, angle)
        goal = np.where(state.tensions > 0.0, state.pulls, state.pulls - 0.003)
        run(found, pulls, pulls, only(segment), 0.5)
        pulls = run(found, pulls, goal, only(segment), 3.0)
        assert points_of(found)[:, :2] == pytest.approx(state.points[:, ::2], abs=1e-4)
        assert found.tensions == pytest.approx(state.tensions, abs=0.01)
        run(found, pulls, pulls, STIFF, 0.5)
    assert points_of(found)[:, :2] == pytest.approx(state.points[:, ::2], abs=1e-4)
    assert found.speed < 1e-3


@pytest.mark.parametrize('spatial', [False, True])
def test_energy_is_never_created(spatial):
    if spatial:
        found = plant(few(gravity=SIDEWAYS))
        pulls = run(found, ZERO, np.array([0.01, 0.002, -0.02]), only(2), 1.0)
        run(found, pulls, pulls, STIFF, 0.5)
    else:
        found = plant(replace(ARM, gravity=mounted(1.0)))
        bent(found, 2, radians(40))
    energies = []
    for _ in range(1000):
        found.step(np.full(len(found.arm.tendons), -0.05), SOFT)
        energies.append(found.energy)
    lost = energies[1] - energies[-1]
    assert lost > 0.05
    # A time step of half the length leaves a third of it.
    assert np.max(energies - np.minimum.accumulate(energies)) < 0.005 * lost


@pytest.mark.parametrize('ratio', [5.0, 50.0])
def test_a_stiff_segment_springs_back_by_one_part_in_k(ratio):
    found = plant(ARM.without_gravity(), stiff_ratio=ratio)
    pulls = bent(found, 1, radians(30))
    before = angles(found)[1]
    run(found, pulls, FREE, STIFF, 2.0)
    assert angles(found)[1] == pytest.approx(before * (1.0 - 1.0 / ratio), rel=1e-3)


def test_a_jam_that_bears_too_much_gives_way_for_good():
    found = plant(ARM.without_gravity(), stiff_ratio=50.0, yield_moment=0.03, damping_time=0.005)
    pulls = bent(found, 1, radians(30))
    run(found, pulls, FREE, STIFF, 2.0)
    # The leaf spring is left with what the jam bears.
    stiffness = ARM.segments[1].stiffness_y / ARM.segments[1].length
    assert angles(found)[1] == pytest.approx(0.03 / stiffness, rel=1e-3)


def test_friction_makes_the_way_back_another_one():
    reached = []
    for friction in (0.0, 0.3):
        found = plant(ARM.without_gravity(), guide_friction=friction)
        pulls, goal = np.zeros(2), np.array([0.02, -0.06])
        run(found, pulls, pulls, only(2), 0.5)
        for end in (goal, 1.5 * goal, goal):
            pulls = run(found, pulls, end, only(2), 1.5)
            reached.append(found.tensions[0])
    assert reached[0] == pytest.approx(reached[2], rel=1e-2)  # without friction
    assert reached[5] < 0.9 * reached[3]


def test_backlash_is_taken_up_before_a_tendon_follows():
    found = plant(ARM.without_gravity(), backlash=0.001)
    pulls = run(found, np.zeros(2), np.array([0.01, -0.05]), only(2), 2.5)
    before = angles(found)[2]
    pulls = run(found, pulls, pulls - [0.0009, 0.0], only(2), 1.0)
    assert angles(found)[2] == pytest.approx(before, abs=1e-5)
    run(found, pulls, pulls - [0.001, 0.0], only(2), 1.0)
    assert angles(found)[2] < before - 0.02


def test_tendons_that_stretch_do_not_chatter_at_rest():
    found = plant(tendon_compliance=5e-5, stiff_ratio=15.0, zero_offset=4e-4)
    run(found, np.zeros(2), np.zeros(2), STIFF, 1.0)
    tensions = []
    for _ in range(20):
        found.step(np.zeros(2), STIFF)
        tensions.append(found.tensions)
    assert np.mean(tensions, axis=0).min() > 5.0
    assert np.ptp(tensions, axis=0).max() < 0.1


def test_a_tendon_slips_beyond_its_tension_and_stays_longer():
    bent = []
    for tendon, limit in ((0, 1e6), (0, 1.0), (1, 1.0)):
        found = plant(FINE.without_gravity(), slip_tension=limit)
        pull = np.full(2, -0.05)
        pull[tendon] = 0.015
        pulls = run(found, np.zeros(2), pull.copy(), only(2), 4.0)
        most = found.tensions[tendon]
        pull[tendon] = 0.005
        run(found, pulls, pull.copy(), only(2), 2.0)
        bent.append((most, abs(angles(found)[2])))
    (most, held), *of_each = bent
    assert most > 1.5
    for slipped, less in of_each:
        assert slipped == pytest.approx(1.0, abs=0.1)
        assert less < 0.8 * held


def test_a_stiffness_factor_changes_how_soft_segments_share_a_bend():
    shares = []
    for factors in ((1.0, 1.0, 1.0), (1.0, 1.0, 2.0)):
        found = plant(ARM.without_gravity(), stiffness_factors=factors)
        run(found, np.zeros(2), np.array([0.02, -0.05]), np.array([1.0, 0.0, 0.0]), 3.0)
        shares.append(angles(found)[2] / angles(found)[1])
    assert shares[1] == pytest.approx(0.5 * shares[0], rel=0.05)


def test_what_no_twin_can_be_made_of_is_refused():
    with pytest.raises(TwinError, match='2 stiffness factors are given; the arm has 3'):
        plant(stiffness_factors=(1.0, 2.0))
    law = MomentCurvature((0.0, 1.0), (0.0, 0.02))
    arm = replace(ARM, segments=tuple(replace(s, soft_law=law) for s in ARM.segments))
    with pytest.raises(TwinError, match='moment-curvature'):
        plant(arm)


def test_shifts_are_those_of_the_seed():
    def shape(seed):
        found = plant(lock_in_shift=0.02, seed=seed)
        run(found, np.zeros(2), np.zeros(2), STIFF, 0.5)
        return angles(found)

    assert shape(1) == pytest.approx(shape(1), abs=0.0)
    assert np.abs(shape(1) - shape(2)).max() > 1e-4
    assert np.abs(shape(1)).max() <= 0.02


def test_the_description_of_the_shape_is_that_of_the_chain():
    found = plant()
    state = set_shape(Statics(ARM.without_gravity()), [0.0, 0.0, 0.0])
    assert points_of(found) == pytest.approx(plane_points(state), abs=1e-12)


# In space.


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
    found, statics = plant(arm), SpaceStatics(arm)
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
    found, statics = plant(arm), SpaceStatics(arm)
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
        found = plant(few(tendons=tendons, gravity=tuple(gravity.tolist())))
        run(found, ZERO, goal, only(2), 2.0)
        ends.append(found.poses[:, :3])
    assert np.abs(ends[0][-1, :2]).min() > 0.005
    assert ends[1] == pytest.approx(turn.apply(ends[0]), abs=1e-6)


def test_in_a_plane_it_differs_from_the_statics_as_the_planar_plant_does():
    severe = read_model_errors(description_file().with_name('twin.yaml'), 'severe')
    given = replace(severe, lock_in_shift=0.0, lateral_stiffness_factor=1.0, angle_error=0.0)
    arm = ARM.without_gravity()
    both = Plant(arm, given), Plant(in_space(arm), given)
    ideal, apart = plant(arm), []
    pulls, rests = np.zeros(2), []
    for goal, vacuum, seconds in (((0.0, -0.03), only(0), 0.6), ((0.016, -0.03), only(0), 1.2),
                                  ((0.016, -0.03), STIFF, 0.4), ((-0.03, 0.0), only(2), 0.6),
                                  ((-0.03, 0.02), only(2), 1.2), ((-0.03, 0.014), only(2), 1.2),
                                  ((-0.03, 0.014), STIFF, 0.4), ((-0.05, -0.05), STIFF, 0.8)):
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
        found = plant(few(**straight), **{name: value})
        run(found, ZERO, pull, only(2), 1.5)
        run(found, pull, pull, STIFF, 0.3)
        bent[name] = found.poses[:, :3][-1]
    assert abs(bent['seed'][1]) < 1e-6
    assert abs(bent['angle_error'][1]) > 1e-4 and abs(bent['lock_in_shift'][1]) > 1e-4
    arm = few(tendons=tuple(replace(t, angle=t.angle + 0.5) for t in JAMMING.tendons), **straight)
    for factor, way in ((1.0, 0.5), (1.3, 0.4)):
        found = plant(arm, lateral_stiffness_factor=factor)
        run(found, ZERO, pull, only(2), 1.5)
        x, y, _ = found.poses[:, :3][-1]
        assert (np.arctan2(y, x) == pytest.approx(way, abs=1e-3)) == (factor == 1.0)
        assert np.arctan2(y, x) <= 0.5 + 1e-3


def test_an_arm_with_friction_inside_is_refused():
    segments = tuple(replace(s, friction=0.01) for s in JAMMING.segments)
    with pytest.raises(TwinError, match='only friction of tendons'):
        plant(few(segments=segments))


def test_an_obstacle_stops_an_arm_in_space():
    pull = np.array([0.018, -0.03, -0.03])
    for obstacles in ((), (CylinderObstacle(0.055, 0.305, 0.01),)):
        found = plant(few(gravity=(0.0, 0.0, 0.0)), obstacles=obstacles)
        run(found, ZERO, pull, only(2), 2.0)
        away = np.linalg.norm(found.poses[:, :3][-1, [0, 2]] - [0.055, 0.305])
        assert (away > 0.01) == bool(obstacles)
    with pytest.raises(TwinError, match='obstacle 1 overlaps the straight arm'):
        plant(JAMMING, obstacles=(CylinderObstacle(0.0, 0.2, 0.02),))
