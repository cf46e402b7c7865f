# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Parameter files are read as ROS 2 reads them, and what is wrong is named: file, key, allowed."""

from math import inf, nan
import re

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import pytest
import yaml

from soft_continuum.hardware.drivers import driver_parameters, JAMMING_DRIVERS, TENDON_DRIVERS
from soft_continuum.parameters import files
from soft_continuum.parameters.arm import ARM_PARAMETERS
from soft_continuum.parameters.overrides import full_name, Overrides
from soft_continuum.parameters.parameter import Parameter, ParameterError, RENAMED
from soft_continuum.parameters.shapes import SHAPE_PREFIX
from soft_continuum.ros.description import load_arm, load_description
from soft_continuum.ros.parameter_table import ALL_PARAMETERS, NODE_PARAMETERS
from soft_continuum.ui.cli.reference import (
    COMMAND,
    generated_pages,
    page_with_table,
    parameter_tables,
    table,
)

RATE = Parameter('rate', 50.0, 'how often', 5.0, 500.0, unit='Hz')
COUNT = Parameter('count', 3, 'how many', 1, 10)
ENABLED = Parameter('enabled', True, 'whether it works')
DRIVER = Parameter('driver', 'simulated', 'what drives', choices=('simulated', 'grbl'))
FRAME = Parameter('frame_id', 'base_link', 'which frame')
LENGTHS = Parameter('arm.lengths', (0.07, 0.07), 'how long', 1e-3, 10.0, unit='m')
NAMES = Parameter('names', ('c_form',), 'what there is')
TABLE = (RATE, COUNT, ENABLED, DRIVER, FRAME, LENGTHS, NAMES)


@pytest.fixture
def parameter_file(tmp_path):
    """Write a parameter file, from YAML text or bytes; return its path."""

    def write(content):
        path = tmp_path / 'rig.yaml'
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def section(text, node='/**'):
    """YAML of one node's parameters, each line a key."""
    lines = ''.join(f'    {line}\n' for line in text.splitlines())
    return f'{node}:\n  ros__parameters:\n{lines}'


def given_parameters(path, known, node='', prefixes=()):
    """What a file gives a node, checked by a table."""
    return files.given_parameters(Overrides(path), known, full_name(node), prefixes)


def refusal(path, **options):
    """The message with which a file is refused; it always names the file."""
    with pytest.raises(ParameterError) as refused:
        given_parameters(path, TABLE, **options)
    assert str(refused.value).startswith(str(path))
    return str(refused.value)


# What is read.


def test_only_what_the_file_sets_is_returned_and_the_rest_has_its_default(parameter_file):
    assert given_parameters(parameter_file(section('rate: 10.0')), TABLE) == {'rate': 10.0}
    assert given_parameters(parameter_file('/**:\n  ros__parameters: {}\n'), TABLE) == {}
    values = load_description(parameter_file(section('tendon_rate: 10.0\nuse_sim_time: true')))
    assert values == {p.name: p.default for p in ALL_PARAMETERS} | {
        'tendon_rate': 10.0, 'use_sim_time': True}  # the latter is one of every node of ROS


def test_nested_and_dotted_keys_are_the_same(parameter_file):
    nested = given_parameters(parameter_file(section('arm:\n  lengths: [0.1, 0.2]')), TABLE)
    dotted = given_parameters(parameter_file(section('arm.lengths: [0.1, 0.2]')), TABLE)
    assert nested == dotted
    assert nested['arm.lengths'] == (0.1, 0.2)


def test_every_value_has_the_type_of_its_default(parameter_file):
    path = parameter_file(section(
        'rate: 10\ncount: 4\nenabled: false\ndriver: grbl\nframe_id: world\n'
        'names: [a, b]\narm: {lengths: [1, 2]}'))
    values = given_parameters(path, TABLE)
    assert values == {'rate': 10.0, 'count': 4, 'enabled': False, 'driver': 'grbl',
                      'frame_id': 'world', 'names': ('a', 'b'), 'arm.lengths': (1.0, 2.0)}
    assert isinstance(values['rate'], float)
    assert all(isinstance(length, float) for length in values['arm.lengths'])


@pytest.mark.parametrize('text, value', [
    ('200e0', 200.0), ('2e2', 200.0), ('+2e2', 200.0), ('20e+1', 200.0), ('5e0', 5.0),
    ('200.', 200.0), ('2.0e2', 200.0), ('200', 200.0)])
def test_a_number_is_written_in_every_way_that_ros_reads(parameter_file, text, value):
    assert given_parameters(parameter_file(section(f'rate: {text}')), TABLE)['rate'] == value


@pytest.mark.parametrize(('section_name', 'applies'), [
    ('/**', True), ('/*', True), ('valves', True), ('/valves', True), ('/**/valves', True),
    ('/left/valves', False), ('left/valves', False), ('/*/valves', False)])
def test_a_section_for_all_nodes_or_by_the_name_of_the_node_is_read(
        parameter_file, section_name, applies):
    path = parameter_file(section('rate: 10.0', section_name))
    assert ('rate' in given_parameters(path, TABLE, node='valves')) == applies


def test_a_file_none_of_whose_sections_is_for_all_nodes_is_not_read_as_nothing(parameter_file):
    path = parameter_file(section('tendon_rate: 10.0', 'my_arm'))
    with pytest.raises(ParameterError, match='has no section for all nodes .*my_arm'):
        load_description(path)


@pytest.mark.parametrize(('own', 'namespace', 'section_name'), [
    ('kinematics', '', '/**'), ('/**/tendon_actuation', '/left', '/left/**'),
    ('/left/kinematics', 'left', '/left/**')])
def test_an_arm_that_single_nodes_would_read_otherwise_is_refused(
        parameter_file, own, namespace, section_name):
    path = parameter_file(section('arm.segment_lengths: [0.08, 0.08, 0.08]')
                          + section('autostart: true\narm.segment_lengths: [0.1, 0.1, 0.1]', own))
    with pytest.raises(ParameterError, match=re.escape(f'section {own} sets arm.segment_lengths '
                                                       'for ')) as error:
        load_arm(path, namespace=namespace)
    assert str(error.value).startswith(str(path))
    assert str(error.value).endswith(f'write it below {section_name}')


def test_a_later_section_wins_and_that_of_another_node_is_left_alone(parameter_file):
    path = parameter_file(section('rate: 10.0\ncount: 4') + section('rate: 20.0', 'valves')
                          + section('unheard_of: 1', 'other'))
    values = given_parameters(path, TABLE, node='valves')
    assert (values['rate'], values['count']) == (20.0, 4)


def test_names_below_an_unchecked_prefix_are_returned_as_they_are(parameter_file):
    path = parameter_file(section('shapes: {bow: [0.1, 0.2]}'))
    assert given_parameters(path, TABLE, prefixes=['shapes.'])['shapes.bow'] == [0.1, 0.2]


# Files that are refused.


def test_what_is_no_file_is_named(tmp_path):
    assert 'No such file' in refusal(tmp_path / 'absent.yaml')
    assert 'directory' in refusal(tmp_path)
    refusal('nul\0byte.yaml')


def nested(bracket, depth):
    opening = bracket[0] if bracket == '[]' else '{a: '
    return opening * depth + '1' + bracket[1] * depth


@pytest.mark.parametrize(('content', 'words'), [
    (b'/**: {ros__parameters: {frame_id: "\xe4rm"}}', 'UTF-8'),
    *((text, f'rig.yaml, line {line}, column ') for text, line in (  # malformed
        ('/**:\n  ros__parameters:\n    rate: [1.0\n', 4),
        ('/**:\n  ros__parameters:\n    rate: 1.0\n   count: 2\n', 4),
        ('/**:\n\tros__parameters:\n', 2),
        ('/**: {ros__parameters: {rate: "1}}\n', 2),
        ('a: b: c', 1),
        ('*undefined', 1))),
    # Values that YAML itself cannot make.
    *((section(f'rate: {value}'), '') for value in (
        '2024-13-45', '0x_', '0b_', '!!int ""', '!!int text', '!!float text', '!!bool text',
        '!!timestamp text', '!!python/object:os.system {}', '!!binary a', '9' * 5000, '2:99:-',
        '<<', '"\\x00"', '\x07', '\ufffe')),
    # What contains itself, or is nested too deeply.
    *((f'/**: {{ros__parameters: {text}}}', '') for text in (
        '&a {rate: *a}', '&a {b: *a}', '&a [*a]',
        *(f'{{rate: {nested(bracket, depth)}}}' for bracket in ('[]', '{}')
          for depth in (50, 500)))),
    *((text, 'starts with a node name, or /**') for text in (
        '', '# nothing\n', '1', 'text', '[1, 2]', '---\n...\n', 'null')),
    *((text, f'key {text.split(":")[0]}: .*ros__parameters') for text in (
        '/**:', '/**: 1', '/**: {}', '/**: [ros__parameters]', '/**: {parameters: {rate: 10.0}}',
        'rate: 10.0')),
    *((f'/**: {{ros__parameters: {value}}}', 'key ros__parameters: ')
      for value in ('1', 'text', '[1.0]', '')),
    (section('arm:\n  lengths:'), 'key arm.lengths has no value'),
    *((section(f'{key}: 1'), f'unknown parameter {key}; did you mean {meant}?')
      for key, meant in (('rat', 'rate'), ('arm.length', 'arm.lengths'), ('Enabled', 'enabled'),
                         ('drivers', 'driver'))),
    (section('rate: 1.0'), 'parameter rate is 1.0; allowed: 5 to 500 (how often [Hz])')])
def test_a_file_that_cannot_be_read_as_parameters_is_refused_saying_why(
        parameter_file, content, words):
    said = refusal(parameter_file(content))
    assert all(part in said for part in words.split('.*'))


# Keys and values that are refused.


def renamed():
    """Names of parameters of version 0.1, and those that they have now."""
    yield from ((old, new) for old, new in RENAMED.items() if '-' not in new)  # a verb has one
    yield from ((p.name.removesuffix('stddev') + 'deviation', p.name)
                for p in ALL_PARAMETERS if p.name.endswith('stddev'))


@pytest.mark.parametrize('old, new', list(renamed()))
def test_a_name_of_version_0_1_is_refused_with_the_new_one(parameter_file, old, new):
    group, _, key = old.rpartition('.')
    nested = f'{group}:\n  {key}: 1' if group else f'{key}: 1'
    for overrides in (Overrides(parameter_file(section(f'{old}: 1'))),
                      Overrides(parameter_file(section(nested))),
                      Overrides.of_arguments(['--ros-args', '-p', f'{old}:=1'])):
        with pytest.raises(ParameterError) as refused:
            files.given_parameters(overrides, ALL_PARAMETERS, full_name('camera'))
        assert str(refused.value).endswith(f'unknown parameter {old}; it is named {new} now')


def test_an_unknown_key_that_is_like_no_other_is_refused_with_those_of_its_group(parameter_file):
    message = refusal(parameter_file(section('xyzzy: 1')))
    groups = {group + '.*' if dot else p.name
              for p in TABLE for group, dot, _ in [p.name.partition('.')]}
    assert message.endswith(f'unknown parameter xyzzy; known: {", ".join(sorted(groups))}')
    message = refusal(parameter_file(section('arm.xyzzy: 1')))
    assert message.endswith('unknown parameter arm.xyzzy; known: ' + ', '.join(
        sorted(p.name for p in TABLE if p.name.startswith('arm.'))))


WRONG = [
    (RATE, 'fast', 'finite numbers'), (RATE, True, 'finite numbers'), (RATE, nan, 'finite'),
    (RATE, inf, 'finite numbers'), (RATE, -inf, 'finite'), (RATE, [10.0], 'finite'),
    (RATE, 4.9, '5 to 500'), (RATE, 501, '5 to 500'), (RATE, -50.0, '5 to 500'),
    (RATE, 10**400, ''), (RATE, -10**400, ''),
    (COUNT, 2.0, 'a whole number'), (COUNT, True, 'a whole number'), (COUNT, '2', 'a whole'),
    (COUNT, 0, '1 to 10'), (COUNT, 11, '1 to 10'), (COUNT, 10**400, ''), (COUNT, nan, 'a whole'),
    (ENABLED, 1, 'true or false'), (ENABLED, 'true', 'true or false'), (ENABLED, [], 'true or'),
    (DRIVER, 'servo', 'simulated or grbl'), (DRIVER, '', 'simulated or grbl'),
    (DRIVER, 1, 'simulated or grbl'), (FRAME, 1, 'text'), (FRAME, ['base_link'], 'text'),
    (LENGTHS, 0.07, 'a list'), (LENGTHS, '0.07', 'a list'), (LENGTHS, False, 'a list'),
    (LENGTHS, [0.07, 'x'], 'finite numbers'), (LENGTHS, [0.07, nan], 'finite numbers'),
    (LENGTHS, [0.07, True], 'finite numbers'), (LENGTHS, [0.07, [0.07]], 'finite numbers'),
    (LENGTHS, [0.07, None], 'finite'), (LENGTHS, [70.0, 70.0], '0.001 to 10'),
    (LENGTHS, [-0.07, 0.07], '0.001 to 10'), (LENGTHS, [0.0, 0.07], '0.001 to 10'),
    (LENGTHS, b'\x01\x02', 'a list'),
    (NAMES, 'c_form', 'a list'), (NAMES, 3, 'a list'), (NAMES, [1, 2], ''), (NAMES, [None], ''),
    (NAMES, [['c_form']], ''), (NAMES, [True], ''),
]


def short(value):
    """The name of a case."""
    return value.name if isinstance(value, Parameter) else repr(value)[:20]


@pytest.mark.parametrize('parameter, value, allowed', WRONG, ids=short)
def test_a_wrong_value_is_refused_with_its_name_and_what_is_allowed(parameter, value, allowed):
    with pytest.raises(ParameterError) as refused:
        parameter.check(value)
    message = str(refused.value)
    assert message.startswith(f'parameter {parameter.name} is ')
    assert f'allowed: {allowed}' in message
    assert parameter.description in message


@pytest.mark.parametrize('parameter, value', [
    (RATE, 5.0), (RATE, 500), (COUNT, 1), (COUNT, 10), (LENGTHS, [1e-3, 10.0]), (LENGTHS, ())])
def test_bounds_are_allowed_values(parameter, value):
    assert parameter.check(value) is not None


@pytest.mark.parametrize('line, message', [
    ('use_sim_time_: true', 'unknown parameter use_sim_time_; did you mean use_sim_time?'),
    ('use_sim_time: 1', 'parameter use_sim_time is 1; allowed: true or false'),
    ('use_sim_time: "true"', "parameter use_sim_time is 'true'; allowed: true or false"),
    ('start_type_description_service: 0', 'is 0; allowed: true or false')])
def test_parameters_that_every_node_of_ros_has_are_checked(parameter_file, line, message):
    with pytest.raises(ParameterError, match=re.escape(message)):
        load_description(parameter_file(section(line)))


# Every parameter of the suite.


def test_every_default_is_allowed_and_every_number_has_bounds():
    for parameter in ALL_PARAMETERS:
        assert parameter.check(parameter.default) == parameter.default
        assert parameter.meaning
        if parameter.type_name.startswith(('double', 'integer')):
            assert -inf < parameter.low < parameter.high < inf, parameter.name


def test_a_parameter_means_the_same_in_every_node():
    for parameters in NODE_PARAMETERS.values():
        assert len({p.name for p in parameters}) == len(parameters)
        assert set(parameters) <= set(ALL_PARAMETERS)


def test_a_unit_stands_in_its_own_field_and_not_in_the_meaning():
    of_drivers = {*driver_parameters(TENDON_DRIVERS), *driver_parameters(JAMMING_DRIVERS)}
    for parameter in set(ALL_PARAMETERS) - of_drivers:
        assert not re.search(r', (m|rad|kg|N|N m|Pa|s|Hz|(m|Pa)/s.*)([;:]|$)', parameter.meaning)
        assert parameter.unit == '' or parameter.description.endswith(f' [{parameter.unit}]')


def in_millimetres(parameter):
    """Return the default in mm instead of m."""
    if isinstance(parameter.default, tuple):
        return tuple(1e3 * v for v in parameter.default)
    return 1e3 * parameter.default


LENGTHS_AND_SPEEDS = [p for p in ALL_PARAMETERS if p.unit in ('m', 'm/s', 'm/s^2')
                      and in_millimetres(p) not in ((0.0,), 0.0)]


@pytest.mark.parametrize('parameter', LENGTHS_AND_SPEEDS, ids=lambda p: p.name)
def test_a_default_given_in_millimetres_is_refused(parameter):
    with pytest.raises(ParameterError, match=f'^parameter {parameter.name} is .*allowed: '):
        parameter.check(in_millimetres(parameter))


def test_the_documented_tables_are_those_of_the_code():
    for page, content in generated_pages():
        text = page.read_text(encoding='utf-8')
        assert text == page_with_table(text, content), (
            f'{page.name} is out of date: ./run exec {COMMAND}')


def test_every_parameter_is_documented_and_those_of_the_arm_once():
    documented = dict(parameter_tables())
    assert documented.keys() == {'parameters.md', *(f'{node}.md' for node in NODE_PARAMETERS)}
    names = [p.name for parameters in documented.values() for p in parameters]
    assert {p.name for p in ALL_PARAMETERS} == set(names) - {
        'shapes.<name>', 'shape_directions.<name>', 'shape_vacuums.<name>'}
    assert all(names.count(p.name) == 1 for p in ARM_PARAMETERS)


@pytest.mark.parametrize(('parameter', 'row'), [
    (RATE, '| `rate` | double `50.0` Hz | 5 to 500 | how often |'),
    (COUNT, '| `count` | integer `3` | 1 to 10 | how many |'),
    (ENABLED, '| `enabled` | bool `true` |  | whether it works |'),
    (DRIVER, '| `driver` | string `simulated` | simulated or grbl | what drives |'),
    (LENGTHS, '| `arm.lengths` | double array `[0.07, 0.07]` m | each 0.001 to 10 | how long |'),
    (Parameter('port', '', 'a|b <c>', read_only=False),
     "| `port` * | string `''` | text | a\\|b \\<c> |"),
    (Parameter('shapes.bow', (), 'angles', unit='rad'),
     '| `shapes.bow` | double array rad |  | angles |')], ids=short)
def test_a_row_of_a_table_has_all_that_is_known_of_a_parameter(parameter, row):
    assert table([parameter]).splitlines()[-1] == row


@pytest.mark.parametrize(('text', 'value'), [
    ('1e-3', 1e-3), ('010', 8), ('0x1F', 31), ('-.5', -0.5), ('.inf', inf), ('1_000', '1_000'),
    ('1:30', '1:30'), ('0b11', '0b11'), ('2026-01-02', '2026-01-02'), ("'1'", '1'), ('yes', True),
    ('~', None)])
def test_other_files_have_the_numbers_that_rcl_reads(parameter_file, text, value):
    read = files.read_yaml(parameter_file(f'y: {text}'))
    assert read == {'y': value} and type(read['y']) is type(value)


def test_a_key_that_any_file_has_twice_is_refused(parameter_file):
    with pytest.raises(ParameterError, match='line 3, column 4.*key size stands there twice'):
        files.read_yaml(parameter_file('boxes:\n - size: 1\n   size: 2\n   "x": 1\n'))


# Whatever a file contains.

names = st.sampled_from([p.name for p in ALL_PARAMETERS] + ['arm', 'shapes.bow', 'x', ''])
# Letters, digits, signs of YAML, and characters that break lines, decoders or terminals.
CHARACTERS = 'abeExX019 _.-+:,#&*!|>%@`\'"?/[]{}\n\t\r\x00\x07\x85\xe4\u20ac\u2028\ufeff\U0001f600'
texts = st.text(alphabet=CHARACTERS, max_size=8)
scalars = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), texts,
    st.binary(max_size=4), st.dates(), st.integers(10**300, 10**320))
trees = st.recursive(
    scalars, lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(names, inner, max_size=4)), max_leaves=8)
fuzz = settings(max_examples=100, suppress_health_check=[
    HealthCheck.too_slow, HealthCheck.function_scoped_fixture])


def try_to_load(path):
    """Only a ParameterError that names the file may come out."""
    try:
        given_parameters(path, ALL_PARAMETERS, prefixes=[SHAPE_PREFIX])
    except ParameterError as error:
        assert str(error).startswith(str(path))


@fuzz
@given(st.one_of(
    st.text(alphabet=CHARACTERS + '\ud800', max_size=60),
    st.text(alphabet='/*:{}[]&!|>-?,#\'" \n\tab01._ex%@`', max_size=60),  # much like YAML
    st.text(alphabet='0123456789abcdefxXob_.:-+eE~<=!*&TZ ', max_size=14).map(
        lambda text: section(f'rate: {text}')),
    st.binary(max_size=100)))
def test_any_text_scalar_or_bytes_are_read_or_refused(parameter_file, content):
    try_to_load(parameter_file(
        content if isinstance(content, bytes) else content.encode('utf-8', 'surrogatepass')))


@settings(fuzz, max_examples=40)
@given(st.dictionaries(names, trees, max_size=5))
def test_any_tree_of_values_is_read_or_refused(parameter_file, tree):
    text = yaml.safe_dump({'/**': {'ros__parameters': tree}}, allow_unicode=True)
    try_to_load(parameter_file(text.encode('utf-8', 'surrogatepass')))
