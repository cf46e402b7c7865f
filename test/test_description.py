# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The description file gives the paper's arm and shapes, or says what is wrong with it."""

from copy import deepcopy
from math import degrees, inf, isinf, nan, pi
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
import yaml

from soft_continuum.mechanics.laws import MomentCurvature
from soft_continuum.nodes.parameter_table import ALL_PARAMETERS, NODE_PARAMETERS
from soft_continuum.parameters.arm import arm_from_parameters, ARM_PARAMETERS
from soft_continuum.parameters.files import load_arm, load_description
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.parameters.shapes import (
    angles_problem,
    PAPER_SHAPES,
    SHAPE_PREFIX,
    shapes_from_parameters,
)
from support.flat_arm import guides_of

DESCRIPTION = Path(__file__).resolve().parents[1] / 'config' / 'manipulator.yaml'
DOCUMENT = yaml.safe_load(DESCRIPTION.read_text(encoding='utf-8'))
DEFAULTS = {p.name: p.default for p in ALL_PARAMETERS}


@pytest.fixture(scope='module')
def arm():
    return load_arm(DESCRIPTION)


@pytest.fixture
def changed(tmp_path):
    """Write the description with other values by dotted name (None: left out); return its path."""

    def write(changes):
        document = deepcopy(DOCUMENT)
        for name, value in changes.items():
            *groups, key = name.split('.')
            tree = document['/**']['ros__parameters']
            for group in groups:
                tree = tree.setdefault(group, {})
            if value is None:
                del tree[key]
            else:
                tree[key] = value
        path = tmp_path / 'changed.yaml'
        path.write_text(yaml.safe_dump(document), encoding='utf-8')
        return path

    return write


def refusal(path, *parts):
    """Return the message that refuses a description; it names the file and has all parts."""
    with pytest.raises(ParameterError) as refused:
        load_description(path)
    message = str(refused.value)
    assert message.startswith(f'{path}: ')
    for part in parts:
        assert part in message
    return message


def shapes_of(path):
    values = load_description(path)
    return shapes_from_parameters(values, arm_from_parameters(values))


# The arm of the paper, with its numbers typed here again.


def test_the_arm_has_the_segments_of_the_paper(arm):
    assert [s.length for s in arm.segments] == [0.070, 0.070, 0.070]
    assert [s.outer_diameter for s in arm.segments] == [0.050, 0.0425, 0.035]
    assert arm.length == pytest.approx(0.330)


def test_the_arm_has_the_discs_of_the_paper(arm):
    assert [d.height for d in arm.discs] == [0.030] * 4


def test_the_arm_has_the_springs_of_the_paper(arm):
    # E I / l in N m/rad, times 13 springs each (eq. 5): the three figures of the paper.
    springs = [13 * s.stiffness_y / s.length for s in arm.segments]
    assert springs == pytest.approx([4.91, 1.69, 0.61], abs=0.01)


def test_the_tendons_run_through_the_outer_loops(arm):
    assert guides_of(arm) == [
        (0.025, 0.025), (0.02125, 0.02125), (0.0175, 0.0175)]


def test_the_arm_has_twelve_bodies_per_segment_and_stands_upright_under_gravity(arm):
    assert arm.bodies_per_segment == 12
    assert arm.mounting_angle == 0.0
    assert arm.gravity == pytest.approx((0.0, 0.0, -9.81), abs=0.01)


def test_the_arm_has_the_estimated_masses_of_the_mechanics_page(arm):
    assert [s.mass for s in arm.segments] == [0.069, 0.050, 0.034]
    assert [d.mass for d in arm.discs[1:]] == [0.060, 0.045, 0.033]


def test_segments_bend_up_to_sixty_degrees(arm):
    assert [degrees(s.bending_angle_limit) for s in arm.segments] == pytest.approx(
        [60.0] * 3, abs=1e-3)


def test_the_shapes_are_those_of_the_paper_with_36_degrees_per_segment():
    shapes = {name: [round(degrees(a), 6) for a in angles]
              for name, angles in shapes_of(DESCRIPTION).items()}
    assert shapes == {
        'c_form': [36.0, 36.0, 36.0],
        'upright_c_form': [-36.0, 36.0, 36.0],
        's_form': [36.0, -36.0, 36.0]}
    assert list(shapes) == ['c_form', 'upright_c_form', 's_form']


def test_the_values_in_the_description_are_the_defaults():
    for name, value in load_description(DESCRIPTION).items():
        default = (PAPER_SHAPES[name.removeprefix(SHAPE_PREFIX)] if name.startswith(SHAPE_PREFIX)
                   else DEFAULTS[name])
        numbers = default != () and not isinstance(np.ravel(default)[0], str)
        assert value == (pytest.approx(default, rel=1e-5) if numbers else default), name


@pytest.mark.parametrize('node', NODE_PARAMETERS)
def test_every_node_finds_all_its_parameters_in_the_description(node):
    values = load_description(DESCRIPTION, node=node)
    for parameter in NODE_PARAMETERS[node]:
        parameter.check(values[parameter.name])


# What a description can say besides.


def test_a_measured_stiffness_takes_the_place_of_the_leaf_spring(changed):
    arm = load_arm(changed({'arm.bending_stiffnesses': [0.0, 0.0202, 0.0]}))
    assert arm.segments[1].stiffness_y == 0.0202
    assert arm.segments[0].stiffness_y == pytest.approx(200e9 * 12.7e-3 * 0.5e-3**3 / 12)


def test_guides_can_be_given_at_each_end_of_each_segment(changed):
    arm = load_arm(changed({'arm.guide_offsets': [0.03, 0.02, 0.0, 0.0, 0.015, 0.01]}))
    assert guides_of(arm) == [
        (0.03, 0.02), (0.02125, 0.02125), (0.015, 0.01)]


def test_measured_tables_take_the_place_of_stiffness_and_ratio(changed):
    arm = load_arm(changed({
        'arm.stiffness_ratios': [10.0],
        'arm.soft_curvatures': [0.0, 0.0, 1.0, 6.0, 0.0],
        'arm.soft_moments': [0.0, 0.0, 0.03, 0.09, 0.0],
        'arm.stiff_curvatures': [0.0, 2.0], 'arm.stiff_moments': [0.0, 1.2]}))
    assert [s.soft_law for s in arm.segments] == [
        None, MomentCurvature((0.0, 1.0, 6.0), (0.0, 0.03, 0.09)), None]
    assert [s.jam.law for s in arm.segments] == [MomentCurvature((0.0, 2.0), (0.0, 1.2))] * 3
    assert {s.jam.ratio for s in arm.segments} == {inf}


@pytest.mark.parametrize(('curvatures', 'moments', 'words'), [
    ([1.0, 2.0], [1.0, 2.0], ['soft_curvatures', 'starting at 0.0']),
    ([0.0, 0.0], [0.0, 0.0], ['soft_curvatures', '3 tables', 'or one for all']),
    ([0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0], ['segment 2', '2 curvatures and 1 moments']),
    ([0.0, 0.0, 2.0, 1.0, 0.0], [0.0, 0.0, 1.0, 2.0, 0.0], ['segment 2', 'must both increase']),
    ([0.0, -1.0], [0.0, -0.1], ['soft_curvatures', '0 to 1e+06']),
    ([0.0, 1.0], [0.0, 3.0], ['stiff_moments, segment 1', 'softer than the soft one']),
])
def test_measured_tables_that_are_no_law_are_refused(changed, curvatures, moments, words):
    with pytest.raises(ParameterError) as refused:
        load_arm(changed({'arm.soft_curvatures': curvatures, 'arm.soft_moments': moments,
                          'arm.stiff_curvatures': [0.0, 2.0], 'arm.stiff_moments': [0.0, 1.2]}))
    assert all(word in str(refused.value) for word in words)


def test_gravity_can_be_left_out(changed):
    assert not any(load_arm(changed({'arm.gravity': 0})).gravity)


def test_an_arm_can_hang(changed):
    assert load_arm(changed({'arm.mounting_angle': pi})).mounting_angle == pi


def of_segments(count):
    """The lists of an arm with some number of equal segments."""
    changes = {}
    for parameter in ARM_PARAMETERS:
        if isinstance(parameter.default, tuple):
            if len(parameter.default) == 1:
                continue  # one value for all
            changes[parameter.name] = [parameter.default[0]] * (count + len(parameter.default) - 3)
    return changes


@pytest.mark.parametrize('count', [1, 2, 5, 12])
def test_the_number_of_segments_is_data(changed, count):
    path = changed(of_segments(count) | {
        'shape_names': ['bow'], 'shapes': {'bow': [0.1] * count}})
    assert len(load_arm(path).segments) == count
    assert shapes_of(path) == {'bow': (0.1,) * count}


# What is wrong is named: the file, the key, what was given and what is allowed.

LISTS = [p for p in ARM_PARAMETERS if isinstance(p.default, tuple)  # but tables of any length
         and not p.name.startswith(('arm.soft_', 'arm.stiff_', 'arm.tendon_'))]
LENGTHS = {
    'arm.segment_lengths': [0.070, 0.070, 0.070],
    'arm.outer_diameters': [0.050, 0.0425, 0.035],
    'arm.leaf_thicknesses': [0.00050, 0.00035, 0.00025],
    'arm.leaf_widths': [0.0127, 0.0127, 0.0127],
    'arm.disc_heights': [0.030, 0.030, 0.030, 0.030],
    'arm.guide_offsets': [0.025, 0.025, 0.02125, 0.02125, 0.0175, 0.0175],
}


@pytest.mark.parametrize('factor', [1000.0, 0.001], ids=['in mm', 'in km'])
@pytest.mark.parametrize('name', LENGTHS)
def test_lengths_in_another_unit_are_refused(changed, name, factor):
    refusal(changed({name: [factor * v for v in LENGTHS[name]]}), name, 'allowed: ')


@pytest.mark.parametrize('name', LENGTHS)
def test_one_length_in_another_unit_among_others_is_refused(changed, name):
    *others, last = LENGTHS[name]
    refusal(changed({name: [*others, 1000.0 * last]}), name, 'allowed: ')


@pytest.mark.parametrize(('name', 'value', 'degrees', 'meant'), [
    ('arm.bending_angle_limits', [60.0, 60.0, 60.0], 60, '1.047'),
    ('arm.mounting_angle', 180.0, 180, '3.142'), ('angle_step', 2.0, 2, '0.03491'),
    ('shapes.c_form', [36.0, 36.0, 36.0], 36, '0.6283'),
    ('shapes.c_form', [0.1, -22.5, 0.1], -22.5, '-0.3927')])
def test_angles_in_degrees_are_refused_and_recognised(changed, name, value, degrees, meant):
    refusal(changed({name: value}), f'parameter {name}', 'allowed: ',
            f'; degrees? {degrees} degrees are {meant} rad')


@pytest.mark.parametrize(('name', 'value'), [
    ('shapes.c_form', [1.05, 0.0, 0.0]), ('shapes.c_form', [100.0, 0.0, 0.0]),
    ('arm.mounting_angle', 1e6), ('arm.gravity', 180.0)])
def test_no_degrees_are_suspected_where_they_would_not_be_allowed_either(changed, name, value):
    assert 'degrees?' not in refusal(changed({name: value}))


@pytest.mark.parametrize('name', [*LENGTHS, 'arm.segment_masses', 'arm.disc_masses',
                                  'arm.bending_stiffnesses', 'arm.bending_angle_limits'])
def test_a_negative_value_is_refused(changed, name):
    default = DEFAULTS[name]
    refusal(changed({name: [-abs(default[0] or 0.01), *default[1:]]}), name, 'allowed: ')


@pytest.mark.parametrize('name', ['arm.segment_lengths', 'arm.outer_diameters',
                                  'arm.leaf_thicknesses', 'arm.leaf_widths', 'arm.disc_heights',
                                  'arm.bending_angle_limits'])
def test_a_zero_that_no_arm_can_have_is_refused(changed, name):
    default = DEFAULTS[name]
    refusal(changed({name: [*default[:-1], 0.0]}), name, 'allowed: ')


@pytest.mark.parametrize('name, value', [
    ('arm.bodies_per_segment', 0), ('arm.bodies_per_segment', -1),
    ('arm.bodies_per_segment', 12.5), ('arm.bodies_per_segment', '12'),
    ('arm.youngs_modulus', 0.0), ('arm.youngs_modulus', 200.0), ('arm.youngs_modulus', 'steel'),
    ('arm.gravity', -9.81), ('arm.gravity', nan), ('arm.mounting_angle', inf),
    ('arm.mounting_angle', 180.0), ('tension_limit', 0.0), ('tension_limit', [60.0]),
    ('ambient_pressure', 1013.25), ('ambient_pressure', 1.01325), ('tendon_driver', 'servo'),
    ('jamming_driver', True), ('tendon_rate', 0), ('autostart', 'yes please')])
def test_a_value_out_of_its_range_is_refused(changed, name, value):
    refusal(changed({name: value}), f'parameter {name} is ', 'allowed: ')


def reason(parameter, value):
    """Return why an arm with this value of a parameter is refused."""
    with pytest.raises(ParameterError) as refused:
        arm_from_parameters({parameter.name: value})
    return str(refused.value)


@pytest.mark.parametrize('parameter', LISTS, ids=lambda p: p.name)
def test_a_list_with_something_else_than_a_number_is_refused(parameter):
    for bad in (nan, inf, 'text', True, None, [0.07]):
        message = reason(parameter, [*parameter.default[:-1], bad])
        assert message.startswith(f'parameter {parameter.name} is ')
        assert 'finite numbers' in message


@pytest.mark.parametrize('parameter', LISTS, ids=lambda p: p.name)
def test_a_value_where_a_list_belongs_is_refused(parameter):
    for value in (0.07, 'text', True):
        message = reason(parameter, value)
        assert message.startswith(f'parameter {parameter.name} is ')
        assert 'a list' in message


@pytest.mark.parametrize('parameter', LISTS, ids=lambda p: p.name)
def test_a_list_that_does_not_fit_the_others_is_refused(parameter):
    name, default = parameter.name, parameter.default
    needed = {1: 6 if name == 'arm.guide_offsets' else 3}.get(len(default), len(default))
    for count in (0, needed - 1, needed + 1):
        message = reason(parameter, [default[0]] * count)
        assert 'values; arm.segment_lengths has' in message
        if name != 'arm.segment_lengths':
            assert f'parameter {name} has {count} values' in message
            assert f'so {needed} are needed' in message


def test_an_arm_without_segments_is_refused(changed):
    path = changed({name: values[3:] for name, values in of_segments(3).items()})
    refusal(path, 'segment')


@pytest.mark.parametrize('value', [[], [0.06], [-0.06, 0.0, 0.06]], ids=len)
def test_pull_limits_are_two_numbers(changed, value):
    refusal(changed({'pull_limits': value}), 'pull_limits')


def test_pull_limits_the_wrong_way_round_are_refused(changed):
    refusal(changed({'pull_limits': [0.06, -0.06]}), 'pull_limits')


def test_springs_too_weak_to_be_any_are_refused(changed):
    path = changed({'arm.youngs_modulus': 1e6, 'arm.leaf_thicknesses': [1e-5] * 3})
    refusal(path, 'bending stiffness', 'allowed: ')


@pytest.mark.parametrize('key, meant', [
    ('arm.segment_length', 'arm.segment_lengths'), ('segment_lengths', 'arm.segment_lengths'),
    ('arm.mass', 'arm.'),
    ('tension_limits', 'tension_limit'), ('shape_name', 'shape_names'),
    ('arm.Gravity', 'arm.gravity')])
def test_an_unknown_key_is_refused_with_a_suggestion(changed, key, meant):
    refusal(changed({key: 1.0}), f'unknown parameter {key}; did you mean {meant}')


# Shapes.


def test_a_shape_that_is_listed_but_not_given_is_refused(changed):
    path = changed({'shape_names': ['c_form', 'bow']})
    refusal(path, 'shape_names lists bow', 'shapes.bow')


def test_a_misspelt_shape_is_refused_with_a_suggestion(changed):
    refusal(changed({'shape_names': ['cform', 's_form', 'upright_c_form']}),
            'shape_names lists cform', 'did you mean c_form?')
    refusal(changed({'shapes.s_frm': [0.1, 0.1, 0.1]}), 'shapes.s_frm', 'did you mean s_form?')


def test_a_library_of_which_no_shape_is_given_is_refused(changed):
    path = changed({'shapes': None, 'shape_names': ['bow']})
    refusal(path, str(path), 'shape_names lists bow')


def test_the_shapes_of_the_paper_need_not_be_given(changed):
    path = changed({'shapes': None})
    assert shapes_of(path) == shapes_of(DESCRIPTION)


def test_an_arm_for_which_the_shapes_of_the_paper_are_none_has_no_library(changed):
    path = changed(of_segments(5) | {'shapes': None})
    assert shapes_of(path) == {}


def test_a_shape_that_is_given_but_not_listed_is_refused(changed):
    refusal(changed({'shapes.bow': [0.1, 0.1, 0.1]}), 'shapes.bow', 'shape_names')


@pytest.mark.parametrize('angles', [[0.1], [0.1, 0.1], [0.1] * 4], ids=len)
def test_a_shape_with_the_wrong_number_of_angles_is_refused(changed, angles):
    refusal(changed({'shapes.c_form': angles}), 'shapes.c_form',
            f'{len(angles)} bending angles given, the arm has 3 segments')


@pytest.mark.parametrize('segment', [1, 2, 3])
@pytest.mark.parametrize('angle', [1.05, -1.05, 100.0])
def test_a_shape_beyond_the_limits_is_refused_naming_the_segment(changed, segment, angle):
    angles = [0.1, 0.1, 0.1]
    angles[segment - 1] = angle
    refusal(changed({'shapes.c_form': angles}), 'shapes.c_form', f'segment {segment} is {angle:g}',
            'allowed: -1.047 to 1.047 rad')


@pytest.mark.parametrize('value', ['text', 0.1, True, [0.1, 'x', 0.1], [nan, 0.1, 0.1]], ids=repr)
def test_a_shape_that_is_not_a_list_of_numbers_is_refused(changed, value):
    refusal(changed({'shapes.c_form': value}), 'shapes.c_form', 'allowed: ')


def test_angles_at_the_limit_are_allowed(arm):
    limits = tuple(arm.bending_angle_limits)
    assert angles_problem(limits, arm) == ''
    assert angles_problem(tuple(-a for a in limits), arm) == ''


@pytest.mark.parametrize('angle', [nan, inf, -inf])
def test_angles_that_are_no_numbers_are_a_problem(arm, angle):
    assert 'segment 2' in angles_problem((0.0, angle, 0.0), arm)


def test_only_the_shapes_that_are_listed_are_in_the_library(changed):
    path = changed({'shape_names': ['s_form'], 'shapes.c_form': None,
                    'shapes.upright_c_form': None})
    assert list(shapes_of(path)) == ['s_form']


# The file itself.


@pytest.mark.parametrize('load', [load_description, load_arm])
def test_a_file_that_is_not_there_is_named(tmp_path, load):
    path = tmp_path / 'absent.yaml'
    with pytest.raises(ParameterError, match='absent.yaml: cannot be read: No such file'):
        load(path)


@pytest.mark.parametrize('load', [load_description, load_arm])
def test_a_bad_value_is_refused_naming_the_file_by_every_way_in(changed, load):
    path = changed({'arm.segment_lengths': [70, 70, 70]})
    with pytest.raises(ParameterError) as refused:
        load(path)
    assert str(refused.value).startswith(f'{path}: parameter arm.segment_lengths is ')


def test_malformed_yaml_is_refused_with_its_line(tmp_path):
    path = tmp_path / 'broken.yaml'
    text = DESCRIPTION.read_text(encoding='utf-8')
    line = text[:text.index('outer_diameters')].count('\n') + 1
    path.write_text(text.replace('0.0425, 0.035]', '0.0425, 0.035'), encoding='utf-8')
    with pytest.raises(ParameterError) as refused:
        load_description(path)
    found = int(str(refused.value).split(', line ')[1].split(',')[0])
    assert found in (line, line + 1)


# Whatever the values are.

numbers = st.one_of(st.floats(), st.sampled_from([0.0, 1e-3, 0.07, 1.0, 10.0, 70.0, 1e9]))
arm_values = st.fixed_dictionaries({}, optional={
    p.name: (st.lists(numbers, max_size=7) if isinstance(p.default, tuple)
             else st.integers(-1, 2000) if isinstance(p.default, int)
             else st.sampled_from([*p.choices, '']) if isinstance(p.default, str) else numbers)
    for p in ARM_PARAMETERS})


@settings(max_examples=60)
@given(arm_values)
def test_any_values_give_an_arm_or_are_refused(values):
    try:
        arm = arm_from_parameters(values)
    except ParameterError as error:
        assert str(error)
        return
    for segment in arm.segments:
        assert 1e-3 <= segment.length <= 10.0
        assert segment.stiffness_y > 0.0 and not isinf(segment.stiffness_y)


@settings(max_examples=50)
@given(st.lists(st.floats(), max_size=5))
def test_any_angles_are_a_shape_or_are_refused(angles):
    arm = arm_from_parameters({})
    try:
        shapes = shapes_from_parameters(
            {'shape_names': ('any',), f'{SHAPE_PREFIX}any': angles}, arm)
    except ParameterError as error:
        assert f'{SHAPE_PREFIX}any' in str(error)
        return
    assert all(abs(a) <= s.bending_angle_limit
               for a, s in zip(shapes['any'], arm.segments, strict=True))
