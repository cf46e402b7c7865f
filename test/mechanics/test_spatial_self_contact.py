# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An arm that runs into itself, or is wound up, is reported as such."""

from math import pi

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from soft_continuum.mechanics.arm import Arm, Disc, Segment
from soft_continuum.mechanics.self_contact import exceeds_pi, self_intersections
from soft_continuum.mechanics.space.chain import SpaceChain
from support.spatial_arms import three_segments


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
