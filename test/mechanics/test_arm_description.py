# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An arm that cannot exist is refused, with what is allowed; above all one in wrong units."""

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from soft_continuum.mechanics import ArmError, Disc, Segment, Tendon, Wrench
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


def arm(**changes):
    """Return the paper's arm with other fields."""
    return replace(paper.build(), **changes)


@pytest.mark.parametrize(('make', 'words'), [
    *((lambda value=value: Disc(*value), 'allowed') for value in (
        (nan, 0.06), (1e-9, 0.06), (-0.03, 0.06), (inf, 0.06), (0.03, nan), (0.03, -0.06),
        (0.03, inf))),
    *((lambda value=value: Tendon(**{**TENDON, 'offset': value}), 'allowed') for value in (
        (nan, 0.02), (0.02, nan), (1e-5, 0.02), (-0.02, 0.02), (0.02, inf))),
    *((lambda value=value: Tendon(**{**TENDON, 'offset': value}), 'needed: one, or 2')
      for value in ((), (0.02, 0.02, 0.02))),
    (lambda: Tendon('t', 0.0, 0.025, 0), 'ends at disc 0; the base is 0'),
    (lambda: Tendon('t', nan, 0.025, 1), 'angle of t is nan'),
    *((lambda value=value: paper.build(bodies_per_segment=value), 'bodies|whole') for value in (
        0, -1, 10**6, 12.0, 12.5, nan, True)),
    *((lambda value=value: paper.build(mounting_angle=value), 'rad') for value in (
        nan, inf, 30.0, 45.0, 90.0, 180.0)),
    *((lambda value=value: paper.build(gravity=value), 'allowed') for value in (
        nan, -9.81, 9806.65)),
    (lambda: arm(gravity=(0.0, 9.8)), 'gravity is .*give x, y and z'),
    (lambda: arm(segments=(), discs=paper.build().discs[:1]), '.'),
    (lambda: arm(discs=paper.build().discs[1:]), '.'),
    (lambda: arm(segments=paper.build().segments[:1]), '.'),
    (lambda: arm(tendons=paper.build().tendons[:1] * 2), 'each its own name'),
    (lambda: arm(tendons=(Tendon('t', 0.0, 0.025, 4),)), 'the last one is 3'),
    (lambda: arm(tendons=None), 'tendons are None; give a tuple'),
    (lambda: arm(spacers=4), 'a multiple of spacers'),
    (lambda: arm(discretisation='third_order'), 'paper, second_order'),
    *((lambda disc=disc: arm(wrenches=(Wrench(disc),)), f'no disc {disc}.*0 to 3')
      for disc in (-1, 4, 1.5)),
    *((lambda force=force: paper.build().with_force(1, force), 'force is nan')
      for force in np.where(np.eye(3), nan, 0.0)),
    (lambda: Segment(0.07, inf, inf), 'bend about at least one axis'),
    (lambda: Segment(70.0, 0.1, 0.1), 'segment length is 70'),
    (lambda: Segment(0.07, 0.1, 0.1, soft_law=0.1), 'soft law is 0.1; give a Moment'),
    (lambda: Segment(0.07, 0.1, 0.1, jam=5.0), 'give a')])
def test_what_is_no_arm_is_refused(make, words):
    with pytest.raises(ArmError, match=words):
        make()


def test_a_whole_number_of_numpy_is_a_whole_number_of_bodies():
    assert paper.build().with_bodies(np.int64(5)).bodies_per_segment == 5


@pytest.mark.parametrize(('part', 'field', 'factor'), [
    *(('segments', *wrong) for wrong in (
        ('length', 1e3), ('length', 1e-3), ('outer_diameter', 1e3), ('outer_diameter', 1e-3),
        ('mass', 1e3), ('stiffness_y', 1e6), ('bending_angle_limit', 57.3))),
    *(('discs', *wrong) for wrong in (('height', 1e3), ('height', 1e-3), ('mass', 1e3))),
    ('tendons', 'offset', 1e3), ('tendons', 'offset', 1e-3)])
def test_a_value_of_the_papers_arm_in_a_wrong_unit_is_refused(part, field, factor):
    """In mm, g, N mm^2 or degrees."""
    for which, one in enumerate(getattr(paper.build(), part)):
        wrong = (factor * np.array(getattr(one, field))).tolist()
        wrong = tuple(wrong) if isinstance(wrong, list) else wrong
        with pytest.raises(ArmError):
            arm(**{part: tuple(replace(other, **{field: wrong}) if k == which else other
                               for k, other in enumerate(getattr(paper.build(), part)))})


# The frame

def test_the_straight_arm_is_330_mm_long_with_its_calculation_points_on_the_discs():
    arm = paper.build()
    assert arm.length == pytest.approx(0.330)
    chain = PlaneChain(arm)
    points = chain.plane_points(chain.straight().joint_angles)
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
    points = state.points[:, ::2]
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
    with pytest.raises(ArmError, match='this arm is spatial'):
        PlaneChain(other)


def test_only_a_planar_arm_bends_beyond_half_a_turn():
    arm = paper.build()
    wide = replace(arm, segments=tuple(replace(s, bending_angle_limit=4.0) for s in arm.segments))
    right, left = arm.tendons
    with pytest.raises(ArmError, match='bending angle limit'):
        replace(wide, tendons=(right, replace(left, twist=0.1)))
