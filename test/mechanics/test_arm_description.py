# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An arm that cannot exist is refused, with what is allowed; above all one in wrong units."""

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from soft_continuum.mechanics import (
    ArmError,
    Disc,
    Segment,
    Tendon,
    Wrench,
)
from soft_continuum.mechanics.plane.chain import PlaneChain
from soft_continuum.parameters.arm import arm_from_parameters
from support import paper_arm as paper

GOOD = {'length': 0.07, 'stiffness_x': 0.03, 'stiffness_y': 0.0265, 'mass': 0.069,
        'bending_angle_limit': 1.5, 'outer_diameter': 0.05}
TENDON = {'name': 'right', 'angle': 0.0, 'offset': (0.025, 0.02), 'end': 1}


@pytest.mark.parametrize(('field', 'value'), [
    (field, value) for field in GOOD for value in (nan, inf, -inf, -0.01)
    if (field.startswith('stiffness'), value) != (True, inf)
] + [('length', 0.0), ('stiffness_x', 0.0), ('stiffness_y', 0.0), ('bending_angle_limit', 0.0),
     ('outer_diameter', 0.0)])
def test_a_segment_with_an_impossible_number_is_refused(field, value):
    with pytest.raises(ArmError, match='allowed'):
        Segment(**{**GOOD, field: value})


@pytest.mark.parametrize('offsets', [
    (nan, 0.02), (0.02, nan), (1e-5, 0.02), (-0.02, 0.02), (0.02, inf)])
def test_an_impossible_guide_offset_is_refused(offsets):
    with pytest.raises(ArmError, match='allowed'):
        Tendon(**{**TENDON, 'offset': offsets})


@pytest.mark.parametrize('offsets', [(), (0.02, 0.02, 0.02)])
def test_a_segment_has_a_guide_at_each_of_its_two_ends(offsets):
    with pytest.raises(ArmError, match='needed: one, or 2'):
        Tendon(**{**TENDON, 'offset': offsets})


@pytest.mark.parametrize(('height', 'mass'), [
    (nan, 0.06), (1e-9, 0.06), (-0.03, 0.06), (inf, 0.06), (0.03, nan), (0.03, -0.06),
    (0.03, inf)])
def test_an_impossible_disc_is_refused(height, mass):
    with pytest.raises(ArmError, match='allowed'):
        Disc(height, mass)


@pytest.mark.parametrize(('field', 'value'), [
    ('bodies_per_segment', 0), ('bodies_per_segment', -1), ('bodies_per_segment', 10**6),
    ('mounting_angle', nan), ('mounting_angle', inf), ('mounting_angle', 90.0),
    ('gravity', nan), ('gravity', -9.81), ('gravity', 9806.65)])
def test_an_impossible_arm_is_refused(field, value):
    with pytest.raises(ArmError, match='allowed'):
        paper.build(**{field: value})


@pytest.mark.parametrize('bodies', [12.0, 12.5, nan])
def test_the_number_of_bodies_is_a_whole_number(bodies):
    with pytest.raises(ArmError):
        PlaneChain(paper.build(bodies_per_segment=bodies))


def test_an_arm_without_segments_or_with_missing_discs_is_refused():
    arm = paper.build()
    for segments, discs in (((), arm.discs[:1]), (arm.segments, arm.discs[1:]),
                            (arm.segments[:1], arm.discs)):
        with pytest.raises(ArmError):
            replace(arm, segments=segments, discs=discs)


# The paper's own arm with one value in the wrong unit: mm, g, N mm^2 or degrees.

@pytest.mark.parametrize('segment', [0, 1, 2])
@pytest.mark.parametrize(('field', 'factor'), [
    ('length', 1e3), ('length', 1e-3), ('outer_diameter', 1e3), ('outer_diameter', 1e-3),
    ('mass', 1e3), ('stiffness_y', 1e6),
    ('bending_angle_limit', 57.3)])
def test_a_segment_in_the_wrong_unit_is_refused(segment, field, factor):
    arm = paper.build()
    wrong = factor * getattr(arm.segments[segment], field)
    with pytest.raises(ArmError):
        replace(arm, segments=tuple(
            replace(s, **{field: wrong}) if i == segment else s
            for i, s in enumerate(arm.segments)))


@pytest.mark.parametrize('factor', [1e3, 1e-3])
def test_guides_in_the_wrong_unit_are_refused(factor):
    arm = paper.build()
    with pytest.raises(ArmError):
        arm.with_tendons(offset=tuple(factor * offset for offset in arm.tendons[0].offset))


@pytest.mark.parametrize(('field', 'factor'), [('height', 1e3), ('height', 1e-3), ('mass', 1e3)])
def test_a_disc_in_the_wrong_unit_is_refused(field, factor):
    arm = paper.build()
    with pytest.raises(ArmError):
        wrong = replace(arm.discs[1], **{field: getattr(arm.discs[1], field) * factor})
        replace(arm, discs=(arm.discs[0], wrong, *arm.discs[2:]))


def test_a_mounting_angle_in_degrees_is_refused():
    for degrees in (30.0, 45.0, 90.0, 180.0):
        with pytest.raises(ArmError, match='rad'):
            paper.build(mounting_angle=degrees)


# The frame

def test_the_straight_arm_is_330_mm_long_with_its_calculation_points_on_the_discs():
    arm = paper.build()
    assert arm.length == pytest.approx(0.330)
    chain = PlaneChain(arm)
    points = chain.points(chain.straight().joint_angles)
    assert points[:, 1] == pytest.approx([0.0, 0.03, 0.1, 0.13, 0.2, 0.23, 0.3, 0.33])
    assert np.all(points[:, [0, 2]] == 0.0)
    assert chain.bodies == 39


def test_a_positive_angle_carries_the_tip_to_positive_x_and_shortens_the_right_tendon():
    chain = PlaneChain(paper.build())
    state = chain.uniform((0.3, 0.0, 0.0))
    assert state.points[-1, 0] > 0.0
    right, left = state.pulls
    assert right > 0.0 > left
    guides = chain.guide_points(chain.straight().joint_angles)
    assert np.all(guides[0, :, 0] > 0.0)
    assert np.all(guides[1, :, 0] < 0.0)


def test_guides_sit_on_the_discs_at_half_the_outer_diameter():
    chain = PlaneChain(paper.build())
    state = chain.uniform((0.5, -0.4, 0.3))
    guides = chain.guide_points(state.joint_angles)
    points = state.points[:, :2]
    offsets = [0.025, 0.025, 0.025, 0.02125, 0.02125, 0.0175, 0.0175, 0.0175]
    for side in guides:
        assert np.linalg.norm(side - points, axis=1) == pytest.approx(offsets)


@pytest.mark.parametrize(
    'angles', [np.zeros(38), np.zeros(40), np.full(39, nan), np.zeros((3, 13))])
def test_joint_angles_of_the_wrong_size_or_nan_are_refused(angles):
    with pytest.raises(ValueError, match='39'):
        PlaneChain(paper.build()).state(angles)


@pytest.mark.parametrize('angles', [(0.1, 0.2), (0.1,) * 4, (0.1, nan, 0.1)])
def test_bending_angles_of_the_wrong_size_or_nan_are_refused(angles):
    with pytest.raises(ValueError):
        PlaneChain(paper.build()).uniform(angles)


def test_a_whole_number_of_numpy_is_a_whole_number_of_bodies():
    assert paper.build().with_bodies(np.int64(5)).bodies_per_segment == 5


@pytest.mark.parametrize('disc', [-1, 4, 1.5])
def test_a_force_on_a_disc_that_is_not_there_is_refused(disc):
    with pytest.raises(ArmError, match='0 to 3'):
        replace(paper.build(), wrenches=(Wrench(disc, (0.0, 0.0, 1.0)),))


@pytest.mark.parametrize('field', ['jam', 'soft_law'])
def test_a_number_is_not_a_stiffness_law(field):
    with pytest.raises(ArmError, match='give a'):
        Segment(**{**GOOD, field: 5.0})


# What an arm is by its tendons and segments

def test_an_arm_without_gravity_is_mounted_as_before():
    arm = paper.build(mounting_angle=0.5)
    assert arm.mounting_angle == pytest.approx(0.5)
    assert arm.without_gravity().mounting_angle == pytest.approx(0.5)
    described = {'arm.mounting_angle': 2.0, 'arm.gravity': 0.0}
    assert arm_from_parameters(described).mounting_angle == 2.0


@pytest.mark.parametrize('changed', [
    {'angle': 0.1}, {'end': 1, 'offset': 0.02}, {'twist': 1.0}, {'friction': 0.1},
    {'offset': 0.01}, {'offset': 0.0}])
def test_a_tendon_that_is_not_like_the_other_makes_an_arm_a_spatial_one(changed):
    arm = paper.build()
    right, left = arm.tendons
    assert arm.planar and arm.tendon_labels == ('right', 'left')
    other = replace(arm, tendons=(replace(right, **changed), left))
    assert not other.planar and other.tendon_labels == other.tendon_names
    with pytest.raises(ArmError, match='a spatial one'):
        PlaneChain(other)


def test_only_a_planar_arm_bends_beyond_half_a_turn():
    arm = paper.build()
    wide = replace(arm, segments=tuple(replace(s, bending_angle_limit=4.0) for s in arm.segments))
    right, left = arm.tendons
    with pytest.raises(ArmError, match='bending angle limit'):
        replace(wide, tendons=(right, replace(left, twist=0.1)))
