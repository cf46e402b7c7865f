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
from soft_continuum.parameters.arm import arm_from_parameters, ARM_PARAMETERS
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.parameters.shapes import (
    angles_problem,
    PAPER_SHAPES,
    SHAPE_PREFIX,
    shapes_from_parameters,
)
from soft_continuum.ros.description import load_arm, load_description
from soft_continuum.ros.parameter_table import ALL_PARAMETERS, NODE_PARAMETERS
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


def test_the_arm_is_that_of_the_paper(arm):
    assert [s.length for s in arm.segments] == [0.070, 0.070, 0.070]
    assert [s.outer_diameter for s in arm.segments] == [0.050, 0.0425, 0.035]
    assert [d.height for d in arm.discs] == [0.030] * 4
    assert arm.length == pytest.approx(0.330)
    # E I / l in N m/rad, times 13 springs each (eq. 5): the three figures of the paper.
    springs = [13 * s.stiffness_y / s.length for s in arm.segments]
    assert springs == pytest.approx([4.91, 1.69, 0.61], abs=0.01)
    # The tendons run through the outer loops.
    assert guides_of(arm) == [(0.025, 0.025), (0.02125, 0.02125), (0.0175, 0.0175)]
    assert arm.bodies_per_segment == 12
    assert arm.mounting_angle == 0.0  # upright
    assert arm.gravity == pytest.approx((0.0, 0.0, -9.81), abs=0.01)
    assert [degrees(s.bending_angle_limit) for s in arm.segments] == pytest.approx(
        [60.0] * 3, abs=1e-3)
    # As docs/explanation/mechanics.md estimates them.
    assert [s.mass for s in arm.segments] == [0.069, 0.050, 0.034]
    assert [d.mass for d in arm.discs[1:]] == [0.060, 0.045, 0.033]


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
    assert guides_of(arm) == [(0.03, 0.02), (0.02125, 0.02125), (0.015, 0.01)]


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


def test_gravity_can_be_left_out_and_an_arm_can_hang(changed):
    assert not any(load_arm(changed({'arm.gravity': 0})).gravity)
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
    path = changed(of_segments(count) | {'shape_names': ['bow'], 'shapes': {'bow': [0.1] * count}})
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


MAY_BE_ZERO = ('arm.segment_masses', 'arm.disc_masses', 'arm.bending_stiffnesses')
NO_ZERO = ('arm.segment_lengths', 'arm.outer_diameters', 'arm.leaf_thicknesses',
           'arm.leaf_widths', 'arm.disc_heights', 'arm.bending_angle_limits')


def wrong_lists():
    """Yield lists with another unit, for all or for one, a negative value, or a zero."""
    for name, (*others, last) in LENGTHS.items():
        for factor in (1000.0, 0.001):  # in mm, in km
            yield name, [factor * value for value in (*others, last)]
        yield name, [*others, 1000.0 * last]
    for name in (*LENGTHS, *MAY_BE_ZERO, 'arm.bending_angle_limits'):
        first, *others = DEFAULTS[name]
        yield name, [-abs(first or 0.01), *others]
    for name in NO_ZERO:
        yield name, [*DEFAULTS[name][:-1], 0.0]


@pytest.mark.parametrize(('name', 'value', 'degrees'), [
    *((name, value, '') for name, value in wrong_lists()),
    *((name, value, f'; degrees? {given} degrees are {meant} rad')
      for name, value, given, meant in (
          ('arm.bending_angle_limits', [60.0, 60.0, 60.0], 60, '1.047'),
          ('arm.mounting_angle', 180.0, 180, '3.142'), ('angle_step', 2.0, 2, '0.03491'),
          ('shapes.c_form', [36.0, 36.0, 36.0], 36, '0.6283'),
          ('shapes.c_form', [0.1, -22.5, 0.1], -22.5, '-0.3927'))),
    # Of these, the same number in degrees would not be allowed either.
    *((name, value, None) for name, value in (
        ('shapes.c_form', [1.05, 0.0, 0.0]), ('shapes.c_form', [100.0, 0.0, 0.0]),
        ('arm.mounting_angle', 1e6), ('arm.gravity', 180.0))),
    *((name, value, '') for name, value in (
        ('arm.bodies_per_segment', 0), ('arm.bodies_per_segment', -1),
        ('arm.bodies_per_segment', 12.5), ('arm.bodies_per_segment', '12'),
        ('arm.youngs_modulus', 0.0), ('arm.youngs_modulus', 200.0),
        ('arm.youngs_modulus', 'steel'), ('arm.gravity', -9.81), ('arm.gravity', nan),
        ('arm.mounting_angle', inf), ('tension_limit', 0.0), ('tension_limit', [60.0]),
        ('ambient_pressure', 1013.25), ('ambient_pressure', 1.01325), ('tendon_driver', 'servo'),
        ('jamming_driver', True), ('tendon_rate', 0), ('autostart', 'yes please'),
        # Shapes that are no lists of numbers.
        *(('shapes.c_form', value) for value in (
            'text', 0.1, True, [0.1, 'x', 0.1], [nan, 0.1, 0.1]))))])
def test_a_value_out_of_its_range_is_refused(changed, name, value, degrees):
    message = refusal(changed({name: value}), f'parameter {name}', 'allowed: ', degrees or '')
    assert degrees is not None or 'degrees?' not in message


def reason(parameter, value):
    """Return why an arm with this value of a parameter is refused."""
    with pytest.raises(ParameterError) as refused:
        arm_from_parameters({parameter.name: value})
    return str(refused.value)


@pytest.mark.parametrize('parameter', LISTS, ids=lambda p: p.name)
def test_a_list_with_something_else_than_a_number_is_refused(parameter):
    for bad in (nan, *[inf] * (not parameter.infinite), 'text', True, None, [0.07]):
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


@pytest.mark.parametrize(('changes', 'parts'), [
    ({name: values[3:] for name, values in of_segments(3).items()},
     ['parameter arm.', 'is []; ROS takes an empty list for no value']),
    *(({'pull_limits': value}, ['pull_limits'])
      for value in ([], [0.06], [-0.06, 0.0, 0.06], [0.06, -0.06])),
    # Springs too weak to be any.
    ({'arm.youngs_modulus': 1e6, 'arm.leaf_thicknesses': [1e-5] * 3},
     ['bending stiffness', 'allowed: ']),
    *(({key: 1.0}, [f'unknown parameter {key}; did you mean {meant}']) for key, meant in (
        ('arm.segment_length', 'arm.segment_lengths'), ('segment_lengths', 'arm.segment_lengths'),
        ('arm.mass', 'arm.'), ('tension_limits', 'tension_limit'), ('shape_name', 'shape_names'),
        ('arm.Gravity', 'arm.gravity'))),
    # Shapes that are listed and not given, misspelt, given and not listed, or of another arm.
    ({'shape_names': ['c_form', 'bow']}, ['shape_names lists bow', 'shapes.bow']),
    ({'shapes': None, 'shape_names': ['bow']}, ['shape_names lists bow']),
    ({'shape_names': ['cform', 's_form', 'upright_c_form']},
     ['shape_names lists cform', 'did you mean c_form?']),
    ({'shapes.s_frm': [0.1, 0.1, 0.1]}, ['shapes.s_frm', 'did you mean s_form?']),
    ({'shapes.bow': [0.1, 0.1, 0.1]}, ['shapes.bow', 'shape_names']),
    *(({'shapes.c_form': [0.1] * count},
       ['shapes.c_form', f'{count} bending angles given, the arm has 3 segments'])
      for count in (1, 2, 4)),
    *(({'shapes.c_form': [angle if s == segment else 0.1 for s in (1, 2, 3)]},
       ['shapes.c_form', f'segment {segment} is {angle:g}', 'allowed: -1.047 to 1.047 rad'])
      for segment in (1, 2, 3) for angle in (1.05, -1.05, 100.0))])
def test_what_does_not_fit_is_refused_by_its_name(changed, changes, parts):
    refusal(changed(changes), *parts)


# Shapes.


def test_the_shapes_of_the_paper_need_not_be_given(changed):
    assert shapes_of(changed({'shapes': None})) == shapes_of(DESCRIPTION)
    # Of an arm for which they are none there is no library.
    assert shapes_of(changed(of_segments(5) | {'shapes': None})) == {}


def test_angles_up_to_the_limit_are_allowed_and_what_is_no_number_is_a_problem(arm):
    limits = tuple(arm.bending_angle_limits)
    assert angles_problem(limits, arm) == ''
    assert angles_problem(tuple(-a for a in limits), arm) == ''
    for angle in (nan, inf, -inf):
        assert 'segment 2' in angles_problem((0.0, angle, 0.0), arm)


def test_only_the_shapes_that_are_listed_are_in_the_library(changed):
    path = changed({'shape_names': ['s_form'], 'shapes.c_form': None,
                    'shapes.upright_c_form': None})
    assert list(shapes_of(path)) == ['s_form']


# The file itself.


@pytest.mark.parametrize('load', [load_description, load_arm])
def test_a_file_that_is_missing_or_wrong_is_named_by_every_way_in(changed, load, tmp_path):
    with pytest.raises(ParameterError, match='absent.yaml: cannot be read: No such file'):
        load(tmp_path / 'absent.yaml')
    path = changed({'arm.segment_lengths': [70, 70, 70]})
    with pytest.raises(ParameterError) as refused:
        load(path)
    assert str(refused.value).startswith(f'{path}: parameter arm.segment_lengths is ')


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
