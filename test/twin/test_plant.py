# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The plant rests where the statics say, and does what a rig does that the statics do not know."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from soft_continuum.mechanics import MomentCurvature, set_shape, Statics
from soft_continuum.mechanics.arm import mounted
from soft_continuum.twin.differences import TwinError
from support.plants import ARM, FREE, only, plant, points_of, run, SOFT, STIFF


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
        assert points_of(found)[:, :2] == pytest.approx(state.points[:, :2], abs=1e-4)
        assert found.tensions == pytest.approx(state.tensions, abs=0.01)
        run(found, pulls, pulls, STIFF, 0.5)
    assert points_of(found)[:, :2] == pytest.approx(state.points[:, :2], abs=1e-4)
    assert found.speed < 1e-3


def test_energy_is_never_created():
    arm = replace(ARM, gravity=mounted(1.0))
    found = plant(arm)
    bent(found, 2, radians(40))
    energies = []
    for _ in range(1000):
        found.step(FREE, SOFT)
        energies.append(found.energy)
    assert max(np.diff(energies[1:])) < 1e-4 * energies[1]  # of the integration
    assert energies[-1] < energies[1] - 1e-3


@pytest.mark.parametrize('ratio', [5.0, 50.0])
def test_a_stiff_segment_springs_back_by_one_part_in_k(ratio):
    found = plant(ARM.without_gravity(), stiff_ratio=ratio)
    pulls = bent(found, 1, radians(30))
    before = angles(found)[1]
    run(found, pulls, FREE, STIFF, 2.0)
    assert angles(found)[1] == pytest.approx(before * (1.0 - 1.0 / ratio), rel=1e-3)


def test_a_jam_that_bears_too_much_gives_way_for_good():
    found = plant(ARM.without_gravity(), stiff_ratio=50.0, yield_moment=0.03,
                  damping_time=0.005)
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


@pytest.mark.parametrize('tendon', [0, 1])
def test_a_tendon_slips_beyond_its_tension_and_stays_longer(tendon):
    pull = np.full(2, -0.05)
    bent = []
    for limit in (1e6, 1.0):
        found = plant(ARM.without_gravity(), slip_tension=limit)
        pull[tendon] = 0.015
        pulls = run(found, np.zeros(2), pull.copy(), only(2), 4.0)
        most = found.tensions[tendon]
        pull[tendon] = 0.005
        run(found, pulls, pull.copy(), only(2), 2.0)
        bent.append((most, abs(angles(found)[2])))
    (most, held), (slipped, less) = bent
    assert most > 1.5
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
    assert points_of(found) == pytest.approx(state.points, abs=1e-12)
