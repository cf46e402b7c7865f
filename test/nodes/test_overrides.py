# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Parameter files are read as rclpy reads them: every claim is made by a node that is started."""

from math import isnan
import re

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import pytest
import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from soft_continuum.parameters.overrides import full_name_of, Overrides
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.description import check_parameter_files, load_description
from support.descriptions import section

NODES = (('tendon_actuation', ''), ('tendon_actuation', 'left'), ('kinematics', 'left'),
         ('kinematics', 'lab/left'))


def of_rclpy(arguments, node, namespace=''):
    """Return what a node is given, with None for a parameter without value; None if refused."""
    context = Context()
    try:
        rclpy.init(args=['node', *arguments], context=context)
    except RCLError:
        return None
    try:
        started = Node(node, namespace=namespace, context=context, enable_rosout=False,
                       start_parameter_services=False)
        with started.handle:
            found = {name: parameter.value for name, parameter
                     in started.handle.get_parameters(Parameter).items()}
        started.destroy_node()
    finally:
        context.shutdown()
    return {name: list(value) if hasattr(value, 'tolist') else value
            for name, value in found.items()}


def of_suite(arguments, node, namespace=''):
    """Return the same as the suite reads it."""
    try:
        overrides = Overrides.of_arguments(arguments)
    except ParameterError:
        return None
    return {name: value for name, (value, _) in overrides.of(
        full_name_of(arguments, node, namespace)).items()}


def same(one, other):
    """Return whether two values are equal, also in type, nan and nan too."""
    if isinstance(one, float) and isinstance(other, float) and isnan(one):
        return isnan(other)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    return type(one) is type(other) and one == other


def assert_same(arguments, node, namespace=''):
    """Claim that the suite reads what a node is given, or refuses it; return that."""
    own, ros = of_suite(arguments, node, namespace), of_rclpy(arguments, node, namespace)
    if own is not None:
        assert ros is not None, own
        assert own.keys() == ros.keys()
        assert all(same(own[name], ros[name]) for name in ros), (own, ros)
    return own


def given_as(*files, more=()):
    """Return ROS arguments with these files."""
    return ['--ros-args', *(word for path in files for word in ('--params-file', str(path))),
            *more]


def write(path, text):
    """Write a file; return its path."""
    path.write_text(text, encoding='utf-8')
    return path


CASES = {
    'a section twice': section('/**', 'a: 1.0', 'b: 1.0') + section('/**', 'a: 2.0', 'c: 3.0'),
    'groups in a section twice':
        section('/**', 'arm:', '  a: 1.0', '  b: 1.0') + section('/**', 'arm:', '  a: 2.0'),
    'a type that changes': section('/**', 'a: 1') + section('/**', 'a: 2.0'),
    'a type that changes in a group':
        section('/**', 'arm: {a: 1}') + section('/**', 'arm: {a: 2.0}'),
    'an empty list after a list': section('/**', 'a: [1.0]') + section('/**', 'a: []'),
    'an empty list': section('/**', 'a: []'),
    'a node, then all': section('tendon_actuation', 'a: 1.0') + section('/**', 'a: 2.0'),
    'all, then a node': section('/**', 'a: 2.0') + section('tendon_actuation', 'a: 1.0'),
    'all, a node, all': section('/**', 'a: 1.0') + section('/tendon_actuation', 'a: 2.0')
        + section('/**', 'a: 3.0'),
    'two arms': section('/left/tendon_actuation', 'a: 1.0')
        + section('/right/tendon_actuation', 'a: 2.0'),
    'any namespace': section('/**/tendon_actuation', 'a: 1.0'),
    'any node of a namespace': section('/left/*', 'a: 1.0'),
    'all below a namespace': section('/left/**', 'a: 1.0') + section('/lab/**', 'b: 1.0'),
    'one part': section('/*', 'a: 1.0') + section('/*/*', 'b: 1.0') + section('/*/left/*', 'c: 1'),
    'namespaces in one another': 'lab:\n  left:\n    kinematics:\n      ros__parameters: {a: 1}\n'
        'left:\n  kinematics: {ros__parameters: {a: 2}}\n  /x: {}\n',
    'namespaces in one another, merged': 'left:\n  kinematics: {ros__parameters: {a: 2, b: 3}}\n'
        'left:\n  kinematics: {ros__parameters: {a: 4}}\n',
    'a name with / in another': 'lab:\n  left/kinematics: {ros__parameters: {a: 1}}\n'
        '  kinematics: {ros__parameters: {b: 1}}\n',
    'a group with a dot in another': section('/**', 'p:', '  a.b: {c: 1}', '  d: 2', 'e: 3'),
    'dots and groups': section('/**', 'arm.a: 1.0', 'arm: {a: 2.0}', 'arm.a.b: 3.0'),
    'a merge key': section('/**', '<<: {a: 1}'),
    'an anchor': section('/**', 'a: &v 1.0'),
    'two documents': section('/**', 'a: 1.0') + '---\n' + section('/**', 'a: 2.0', 'b: 1.0'),
    'numbers': section('/**', *(f'n{k}: {text}' for k, text in enumerate((
        '010', '08', '0x10', '0X1f', '-0x8', '+7', '0b11', '0o17', '1_000', '1:30', '1e3', '1.',
        '.5', '-.5e-2', '1e400', '1e-320', '4.9e-324', '0e-999', '.inf', '-.INF', '+.Inf', '.nan',
        '.NaN', '.Nan', 'nan', 'inf', '-infinity', 'nan(x)', '0x1p3', '0x1.8', '0x.8p1', '0x',
        '9223372036854775807', '9223372036854775808', '-9223372036854775808',
        '0777777777777777777777',
        '01777777777777777777777', '1e', '--1', '1.5.2', '00', '-0', '1 2')))),
    'truth': section('/**', *(f'n{k}: {text}' for k, text in enumerate((
        'y', 'Y', 'n', 'N', 'yes', 'Yes', 'YES', 'yEs', 'on', 'Off', 'OFF', 'true', 'TRUE',
        'false', 'no', 'null', '~', 'None', '!!bool "yes"', '!!bool yes')))),
    'texts': section('/**', 'a: "5.0"', "b: '5'", 'c: !!str 5.0', 'd: !!float 5', 'e: |', '  5.0',
                     'f: |-', '  5.0', 'g: >-', '  a', '  b', 'h: "y"', "i: ''", 'j: "a\\tb"',
                     'k: 2024-01-02', 'l: "\\u00e4 \\U0001f600"', 'm: a b', 'n: !!binary aGk='),
    'lists': section('/**', 'a: [1, 2]', 'b: [1.0, 2e0]', 'c: [y, no]', 'd: [a, "1"]',
                     'e:', '- 1.0', '- 2.0'),
}


@pytest.mark.parametrize('case', CASES)
def test_a_file_is_read_as_a_node_is_given_it(tmp_path, case):
    arguments = given_as(write(tmp_path / 'file.yaml', CASES[case].replace('  /x: {}\n', '')))
    found = [assert_same(arguments, *node) for node in NODES]
    assert any(found), 'no node was given anything'


@pytest.mark.parametrize('text', [
    section('/**', 'a: [1.0, 2]'), section('/**', 'a: [y, 1]'), section('/**', 'a:'),
    section('/**', 'a: &v 1.0', 'b: *v'), section('/**', 'p: {}', 'd: 2'), '/**:\n',
    section('/**', 'a: [[1.0], [2.0]]'), section('left//x', 'a: 1'), section('/left/', 'a: 1'),
    section('lef*', 'a: 1'), section('1left', 'a: 1'), section('le-ft', 'a: 1'), 'a: 1\n',
    section('/**', '"": 1'), section('/**', '? [a]', ': 1'), 'ros__parameters: {a: 1}\n',
    'left: {/x: {ros__parameters: {a: 1}}}\n', '/**: [a]\n'])
def test_what_no_node_starts_with_is_refused_before(tmp_path, text):
    arguments = given_as(write(tmp_path / 'file.yaml', text))
    assert of_rclpy(arguments, 'kinematics') is None
    assert of_suite(arguments, 'kinematics') is None


@pytest.mark.parametrize(('text', 'line'), [
    (section('/**', 'grbl:', '  port: a', 'speed_limit: 0.004', 'grbl:', '  baud: 1'), 6),
    (section('/**', 'speed_limit: 0.004', 'speed_limit: 0.005'), 4),
    (section('/**', 'grbl: {port: a, port: b}'), 3)])
def test_a_key_twice_in_one_mapping_is_refused(tmp_path, text, line):
    path = write(tmp_path / 'file.yaml', text)
    with pytest.raises(ParameterError, match=f'file.yaml, line {line}: key .* stands there twice'):
        load_description(path, node='tendon_actuation')


@pytest.mark.parametrize(('text', 'message'), [
    ('%YAML 1.2\n---\n' + section('/**', 'a: 1'), 'line 1, .* YAML 1.1 alone; delete this line'),
    (section('/**', 'grbl: {port: /dev/by-path/pci-0000:00:14.0}'),
     'line 3, .*not read /dev/by-path/pci-0000:00:14.0, with a colon between brackets; quote it'),
    (section('/**', 'a: [http://x:1]'), 'quote it'),
    (section('/**', 'a: {b:{c: 1}}'), 'line 3, .* write a blank behind that of a key'),
    ('%YML 1.1\n---\n' + section('/**', 'a: 1'), 'line 1, .* %YML; delete this line')])
def test_what_not_every_ros_reads_is_refused_with_a_remedy(tmp_path, text, message):
    with pytest.raises(ParameterError, match=message):
        Overrides(write(tmp_path / 'file.yaml', text))
    Overrides(write(tmp_path / 'file.yaml', '%YAML 1.1\n---\n' + section(
        '/**', 'a: x:y', 'b: {c: "x:y", d: [1]}')))


@pytest.mark.parametrize('rule', ['__ns:=/left', 'tendon_actuation:__node:=kinematics'])
def test_a_rule_before_the_ros_arguments_counts(tmp_path, rule):
    file = write(tmp_path / 'file.yaml',
                 section('/left/*', 'a: 1') + section('kinematics', 'a: 2'))
    assert assert_same([rule, *given_as(file)], 'tendon_actuation')


ARGUMENTS = [
    ['-p', 'a:=3.0'], ['-p', 'tendon_actuation:a:=3.0'], ['-p', 'arm.a:=3.0'],
    ['-r', '__ns:=/left'], ['-r', '__ns:=/left', '-r', '__ns:=/right'],
    ['-r', '__node:=kinematics'], ['-r', 'other:__node:=kinematics'],
    ['--remap', 'tendon_actuation:__name:=kinematics'], ['--param', 'a:=[1, 2]', '-p', 'a:=y'],
    ['-p', 'a:="1"', '--', '-p', 'a:=2'], ['-p', 'a:=[]']]


@pytest.mark.parametrize('more', ARGUMENTS, ids=' '.join)
@pytest.mark.parametrize('case', ['a node, then all', 'groups in a section twice',
                                  'any node of a namespace'])
def test_arguments_are_read_in_the_order_of_the_command_line(tmp_path, case, more):
    file = write(tmp_path / 'file.yaml', CASES[case])
    second = write(tmp_path / 'second.yaml', section('kinematics', 'a: 7.0'))
    assert assert_same(given_as(file, second, more=more), 'tendon_actuation') is not None
    assert assert_same([*given_as(more=more), *given_as(file)], 'tendon_actuation') is not None


@settings(max_examples=100)
@given(st.one_of(st.text('a1_.:/*~-', min_size=1, max_size=6), st.lists(st.sampled_from((
    'a', 'b1', '_x', '__', '1', '.', ':', '/', '**', '~', '__ns', 'rostopic', '://', ' ', '-')),
    min_size=1, max_size=5).map(''.join)))
def test_what_an_argument_may_name_is_what_ros_takes(name):
    arguments = given_as(more=['-p', f'{name}:=1'])
    assert (of_suite(arguments, 'kinematics') is None) == (
        of_rclpy(arguments, 'kinematics') is None)


@pytest.mark.parametrize('name', ['a-b', 'a.', '.a', '1a', 'a..b', '/left/kinematics:a', '/**:a',
                                  '__a', 'a___b', 'a__b:c', 'a:b:c', 'a b'])
def test_a_name_that_ros_does_not_take_is_refused_with_the_argument(name):
    with pytest.raises(ParameterError, match=re.escape(f'argument -p {name}:=1: expected ')):
        check_parameter_files(given_as(more=['-p', f'{name}:=1']), [])


# Whatever files and arguments say.

NAMES = st.sampled_from(('/**', '/*', '/left/*', '/left/**', '/**/kinematics', '/*/kinematics',
                         'kinematics', '/kinematics', 'left/kinematics', '/**/left/**', '/**/**'))
KEYS = st.sampled_from(('a', 'b', 'a.b', 'b.a', 'c'))
SCALARS = st.one_of(
    st.sampled_from(('1', '2.0', 'y', 'text', '"3"', '[]', '[1]', '[2.0, 3.0]', '[n]', '[t, u]')),
    st.text('0123456789abefnixpXoyY_+-.', min_size=1, max_size=6))
TREES = st.recursive(SCALARS, lambda inner: st.dictionaries(KEYS, inner, min_size=1, max_size=3),
                     max_leaves=5)
SECTIONS = st.tuples(NAMES, st.dictionaries(KEYS, TREES, max_size=4))


def in_flow(tree):
    """Return a tree in the flow style of YAML."""
    if isinstance(tree, str):
        return tree
    return '{' + ', '.join(f'{key}: {in_flow(inner)}' for key, inner in tree.items()) + '}'


@settings(max_examples=30, suppress_health_check=[
    HealthCheck.too_slow, HealthCheck.function_scoped_fixture])
@given(st.lists(st.lists(SECTIONS, min_size=1, max_size=4), min_size=1, max_size=2),
       st.lists(st.sampled_from(('a:=5', 'a.b:=6.0', 'kinematics:a:=7', 'b:=[x]')), max_size=2),
       st.sampled_from(('', '/left')))
def test_whatever_files_and_arguments_say_is_read_as_a_node_is_given_it(
        tmp_path, files, arguments, namespace):
    paths = [write(tmp_path / f'{k}.yaml', ''.join(
        f'{name}: {{ros__parameters: {in_flow(tree)}}}\n' for name, tree in sections))
        for k, sections in enumerate(files)]
    assert_same(given_as(*paths, more=[word for text in arguments for word in ('-p', text)]),
                'kinematics', namespace)


# What the suite makes of it.


def test_the_arm_in_the_first_of_two_sections_is_that_of_nodes_and_library(tmp_path):
    path = write(tmp_path / 'arm.yaml', section(
        '/**', 'arm:', '  segment_lengths: [0.100, 0.100, 0.100]', 'speed_limit: 0.01')
        + section('/**', 'tension_limit: 40.0'))
    for node in ('', 'kinematics'):
        values = load_description(path, node=node)
        assert values['arm.segment_lengths'] == (0.1, 0.1, 0.1)
        assert (values['speed_limit'], values['tension_limit']) == (0.01, 40.0)


def test_each_of_two_arms_in_one_file_is_that_of_its_namespace(tmp_path):
    path = write(tmp_path / 'arms.yaml', section('/left/**', 'arm: {payload: 0.1}')
                 + section('/right/**', 'arm: {payload: 0.2}'))
    for node in ('', 'kinematics'):
        assert load_description(path, node=node, namespace='left')['arm.payload'] == 0.1
        assert load_description(path, node=node, namespace='/right/')['arm.payload'] == 0.2
    with pytest.raises(ParameterError, match=r'only for /left/\*\*, /right/\*\*'):
        load_description(path)


def test_a_mistake_in_the_first_of_two_sections_is_seen_before_the_start(tmp_path):
    path = write(tmp_path / 'file.yaml', section('/**', 'spede_limit: 0.01')
                 + section('/**', 'tension_limit: 40.0'))
    with pytest.raises(ParameterError, match='spede_limit; did you mean speed_limit'):
        check_parameter_files(given_as(path), ['tendon_actuation'])


@pytest.mark.parametrize(('node', 'arguments'), [
    ('kinematics', []), ('kinematics', ['-r', '__ns:=/left']),
    ('other', ['-r', '__ns:=/left', '-r', '__node:=other'])])
def test_no_node_starts_with_an_arm_of_its_own(tmp_path, node, arguments):
    """Library, commands and other nodes would have another one."""
    path = write(tmp_path / 'file.yaml', section(f'/**/{node}', 'arm: {payload: 0.2}'))
    with pytest.raises(ParameterError, match='sets arm.payload for .* alone'):
        check_parameter_files(given_as(path, more=arguments), ['kinematics'])
    everywhere = write(tmp_path / 'all.yaml', section('/**', 'arm: {payload: 0.2}'))
    check_parameter_files(given_as(everywhere, path, more=arguments), ['kinematics'])


def test_a_node_takes_the_arm_that_a_launch_file_gives_it(tmp_path):
    """launch_ros writes parameters of a launch file below the full name of the node."""
    path = write(tmp_path / 'file.yaml', section('/left/kinematics', 'arm: {payload: 0.2}'))
    check_parameter_files(given_as(path, more=['-r', '__ns:=/left']), ['kinematics'])
    both = write(tmp_path / 'both.yaml', path.read_text() + section('/**', 'frame_id: base'))
    with pytest.raises(ParameterError, match='sets arm.payload for kinematics alone'):
        load_description(both, namespace='left')
