# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Reachable tips are those of the shapes they belong to."""

from dataclasses import replace

import numpy as np
import pytest

from soft_continuum.analysis.workspace import furthest_apart, reach
from soft_continuum.mechanics import Statics
from soft_continuum.mechanics.spatial import set_shape
from support import specimen_data as data

WEIGHTLESS = data.DESCRIBED.without_gravity()


def test_every_tip_is_that_of_its_angles_in_its_order():
    found = reach(data.DESCRIBED, (2, 0, 1), 3)
    statics = Statics(data.DESCRIBED)
    assert len(found.tips) == found.asked == 27
    for k in (0, 7, 26):
        state = set_shape(statics, found.bending[k], order=(2, 0, 1))
        assert statics.chain.points(state.joint_angles)[-1, :2] == pytest.approx(
            found.tips[k], abs=1e-9)


def test_the_order_matters_under_gravity_only():
    base_first, tip_first = (0, 1, 2), (2, 1, 0)
    assert furthest_apart(reach(WEIGHTLESS, base_first, 3), reach(WEIGHTLESS, tip_first, 3)) < 1e-9
    assert furthest_apart(reach(data.DESCRIBED, base_first, 3),
                          reach(data.DESCRIBED, tip_first, 3)) > 1e-3


def test_tips_lie_on_both_sides_alike():
    tips = reach(data.DESCRIBED, (0, 1, 2), 3).tips
    mirrored = tips * [-1.0, 1.0]
    for tip in mirrored:
        assert np.linalg.norm(tips - tip, axis=1).min() < 1e-9


def test_shapes_that_no_tendon_holds_are_left_out():
    heavy = replace(data.DESCRIBED, payload=5.0)
    found = reach(heavy, (0, 1, 2), 3)
    assert len(found.tips) == len(found.bending) < found.asked


def test_tips_on_a_line_span_no_area():
    found = reach(WEIGHTLESS, (0, 1, 2), 2)
    one = replace(found, tips=np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]))
    assert one.hull == 0.0
    assert found.hull > 0.01
