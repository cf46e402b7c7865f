# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Rods in space: those of the plane and of tdcr-modeling, and the chain converges to them."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import tdcr
from references import Elastica, solve_rods
from soft_continuum.mechanics import Jam, Statics
from soft_continuum.mechanics.arm import PAPER, SECOND_ORDER, Wrench
from soft_continuum.mechanics.space.statics import SpaceStatics
from support.general_arms import paper_like
from support.spatial_arms import in_space, three_segments

ALL = (True, True, True)
PULLS = np.array([0.008, -0.005, -0.006])


def rods(arm, pulls=PULLS):
    """Return the chain and the rods at the same pulls."""
    statics = SpaceStatics(arm)
    state = statics.solve(statics.chain.straight(), pulls, ALL)
    return state, solve_rods(state, pulls)


def test_in_one_plane_rods_are_those_of_the_plane():
    flat = paper_like(3, bodies=8, gravity=9.80665, mounting_angle=2.0, payload=0.02)
    statics, pulls = Statics(flat), (0.01, -0.02)
    wanted = Elastica(flat).solve(statics.chain.straight(), pulls, ALL)
    _, found = rods(in_space(flat), pulls)
    assert found.points[:, [0, 2]] == pytest.approx(wanted.points[:, :2], abs=1e-8)
    assert found.points[:, 1] == pytest.approx(0.0, abs=1e-12)
    assert found.tensions == pytest.approx(wanted.tensions, rel=1e-6)


@pytest.mark.parametrize(('discretisation', 'spacers', 'orders', 'most'), [
    (PAPER, 0, (0.9, 1.1), 2e-4), (SECOND_ORDER, 0, (1.95, 2.05), 5e-6),
    (PAPER, 1, (0.9, 1.1), 2e-4), (SECOND_ORDER, 1, (1.0, 1.8), 2e-5)])
def test_the_chain_converges_to_rods(discretisation, spacers, orders, most):
    # A guide inside a segment is on a body, which is askew of the rod there: first order.
    # Helical tendons that stretch, a segment that is stiffer about x, weights, and a wrench.
    wrench = Wrench(3, (0.1, -0.2, 0.1), (0.005, 0.003, 0.004))
    arm = three_segments(gravity=(2.0, 1.0, 8.0), discretisation=discretisation, payload=0.02,
                         wrenches=(wrench,), spacers=spacers)
    arm = replace(arm.with_tendons(twist=3.0).with_compliant_tendons(1e-4),
                  segments=(replace(arm.segments[0], stiffness_x=0.06), *arm.segments[1:]))
    chains = [SpaceStatics(replace(arm, bodies_per_segment=bodies)) for bodies in (8, 16, 32)]
    states = [statics.solve(statics.chain.straight(), PULLS, ALL) for statics in chains]
    found = solve_rods(states[-1], PULLS)  # how many bodies the chain has is nothing to them
    off = [np.linalg.norm(state.points - found.points, axis=1).max() for state in states]
    for state in states:
        assert state.tensions[0] == pytest.approx(found.tensions[0], rel=0.02)
    orders_found = np.log2(np.divide(off[:-1], off[1:]))
    assert np.all((orders_found > orders[0]) & (orders_found < orders[1])), off
    assert off[-1] < most


def test_rods_of_stiff_segments_are_refused():
    statics = SpaceStatics(three_segments(jam=Jam(5.0)))
    with pytest.raises(ValueError, match='rods are soft and linear'):
        solve_rods(statics.chain.straight(), np.zeros(3))


# The example arm of tdcr-modeling, whose rod was solved by shooting between its discs.


@pytest.mark.parametrize('load', [0, 1])
def test_a_chain_converges_to_a_cosserat_rod_between_discs(load):
    reference = np.array(tdcr.MODELS[tdcr.ALL_FORCE][load])
    away = [np.linalg.norm(tdcr.state(bodies, tdcr.LOADS[load], True).tip - reference)
            for bodies in (2, 4, 8)]
    assert away[0] > 3.0 * away[1] > 9.0 * away[2]
    assert away[2] < 2e-4


def test_a_spacer_converges_to_a_disc():
    away = [np.linalg.norm(
        tdcr.state(bodies, tdcr.LOADS[1]).tip - tdcr.MODELS[tdcr.ALL_FORCE][1])
            for bodies in (2, 5, 10)]
    assert away[0] > 2.0 * away[1] > 3.0 * away[2]
