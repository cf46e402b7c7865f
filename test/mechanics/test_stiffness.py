# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Bending stiffness: the paper's equations 1 to 8 and the figures printed beside them."""

import pytest

from soft_continuum.mechanics import stiffness
from support import paper_arm as paper


@pytest.mark.parametrize(
    ('thickness', 'printed'), [(0.50e-3, 4.91), (0.35e-3, 1.69), (0.25e-3, 0.61)])
def test_thirteen_springs_have_the_stiffness_that_the_paper_prints(thickness, printed):
    inertia = stiffness.second_moment_of_area(paper.LEAF_WIDTH, thickness)
    each = stiffness.joint_stiffness(paper.YOUNGS_MODULUS * inertia, 0.07, 12)
    assert round(each, 2) == printed


def test_springs_in_series_are_as_stiff_as_the_leaf_spring():
    whole = stiffness.rotational_stiffness(0.0202, 0.07)
    for bodies in (1, 2, 12, 100):
        each = stiffness.joint_stiffness(0.0202, 0.07, bodies)
        assert each / (bodies + 1) == pytest.approx(whole, rel=1e-14)


def test_the_measured_stiffness_of_the_paper_follows_from_a_lever_arm_of_25_mm():
    bending_stiffness = stiffness.bending_stiffness_from_slope(72.0, 0.07, 0.025)
    assert round(bending_stiffness, 4) == 0.0202
    assert round(stiffness.joint_stiffness(0.0202, 0.07, 12), 2) == 3.75


def test_the_lever_arm_of_30_mm_in_the_text_gives_another_stiffness():
    bending_stiffness = stiffness.bending_stiffness_from_slope(72.0, 0.07, 0.030)
    assert round(bending_stiffness, 5) == 0.02335
    assert bending_stiffness / 0.0202 > 1.15


def test_the_leaf_spring_alone_is_55_percent_off_the_measurement():
    assert round(100 * (3.75 - 1.69) / 3.75) == 55


def test_the_slope_is_that_of_a_cantilever_with_a_rigid_end():
    # Deflection of the point of load by two integrations of M / EI along the spring (eq. 6).
    force, length, lever, bending_stiffness, cells = 1.0, 0.07, 0.025, 0.0202, 20000
    slope = deflection = 0.0
    for i in range(cells):
        z = (i + 0.5) * length / cells
        curvature = force * (length + lever - z) / bending_stiffness
        deflection += (slope + 0.5 * curvature * length / cells) * length / cells
        slope += curvature * length / cells
    at_load = deflection + slope * lever
    # eq. 8 as printed leaves the product of lever arm and length whole: it is a cantilever's.
    recovered = stiffness.bending_stiffness_from_slope(force / at_load, length, lever)
    assert recovered == pytest.approx(bending_stiffness, rel=1e-6)
