# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Parameter files are read as ROS 2 reads them, and what is wrong is named: file, key, allowed."""

from dataclasses import replace
from math import inf, nan
import re

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import pytest
import yaml

from soft_continuum.parameters.files import load_parameters
from soft_continuum.parameters.nodes import ALL_PARAMETERS, NODE_PARAMETERS
from soft_continuum.parameters.parameter import Parameter, ParameterError
from soft_continuum.parameters.shapes import SHAPE_PREFIX

RATE = Parameter('rate', 50.0, 'how often, Hz', 5.0, 500.0)
COUNT = Parameter('count', 3, 'how many', 1, 10)
ENABLED = Parameter('enabled', True, 'whether it works')
DRIVER = Parameter('driver', 'simulated', 'what drives', choices=('simulated', 'grbl'))
FRAME = Parameter('frame_id', 'base_link', 'which frame')
LENGTHS = Parameter('arm.lengths', (0.07, 0.07), 'how long, m', 1e-3, 10.0)
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


def refusal(path, **options):
    """The message with which a file is refused; it always names the file."""
    with pytest.raises(ParameterError) as refused:
        load_parameters(path, TABLE, **options)
    assert str(refused.value).startswith(str(path))
    return str(refused.value)


# What is read.


def test_what_a_file_leaves_out_has_its_default(parameter_file):
    values = load_parameters(parameter_file(section('rate: 10.0')), TABLE)
    assert values == {p.name: p.default for p in TABLE} | {'rate': 10.0}


def test_nested_and_dotted_keys_are_the_same(parameter_file):
    nested = load_parameters(parameter_file(section('arm:\n  lengths: [0.1, 0.2]')), TABLE)
    dotted = load_parameters(parameter_file(section('arm.lengths: [0.1, 0.2]')), TABLE)
    assert nested == dotted
    assert nested['arm.lengths'] == (0.1, 0.2)


def test_every_value_has_the_type_of_its_default(parameter_file):
    path = parameter_file(section(
        'rate: 10\ncount: 4\nenabled: false\ndriver: grbl\nframe_id: world\n'
        'names: [a, b]\narm: {lengths: [1, 2]}'))
    values = load_parameters(path, TABLE)
    assert values == {'rate': 10.0, 'count': 4, 'enabled': False, 'driver': 'grbl',
                      'frame_id': 'world', 'names': ('a', 'b'), 'arm.lengths': (1.0, 2.0)}
    assert isinstance(values['rate'], float)
    assert all(isinstance(length, float) for length in values['arm.lengths'])


@pytest.mark.parametrize('text, value', [
    ('200e0', 200.0), ('2e2', 200.0), ('+2e2', 200.0), ('20e+1', 200.0), ('5e0', 5.0),
    ('200.', 200.0), ('2.0e2', 200.0), ('200', 200.0)])
def test_a_number_is_written_in_every_way_that_ros_reads(parameter_file, text, value):
    assert load_parameters(parameter_file(section(f'rate: {text}')), TABLE)['rate'] == value


@pytest.mark.parametrize('section_name', ['/**', '/*', 'valves', '/left/valves', 'left/valves'])
def test_a_section_for_all_nodes_or_by_the_name_of_the_node_is_read(
        parameter_file, section_name):
    path = parameter_file(section('rate: 10.0', section_name))
    assert load_parameters(path, TABLE, node='valves')['rate'] == 10.0


def test_a_section_of_another_node_is_left_alone(parameter_file):
    path = parameter_file(section('rate: 10.0', 'valves') + section('unheard_of: 1', 'other'))
    assert load_parameters(path, TABLE, node='valves')['rate'] == 10.0


def test_a_file_none_of_whose_sections_is_for_all_nodes_is_not_read_as_nothing(parameter_file):
    path = parameter_file(section('rate: 10.0', 'my_arm'))
    assert 'my_arm' in refusal(path)


def test_a_later_section_wins(parameter_file):
    path = parameter_file(section('rate: 10.0\ncount: 4') + section('rate: 20.0', 'valves'))
    values = load_parameters(path, TABLE, node='valves')
    assert (values['rate'], values['count']) == (20.0, 4)


def test_a_section_without_parameters_leaves_the_defaults(parameter_file):
    path = parameter_file('/**:\n  ros__parameters: {}\n')
    assert load_parameters(path, TABLE)['rate'] == RATE.default


def test_names_below_a_free_prefix_are_handed_on(parameter_file):
    path = parameter_file(section('shapes: {bow: [0.1, 0.2]}'))
    assert load_parameters(path, TABLE, prefixes=['shapes.'])['shapes.bow'] == [0.1, 0.2]


# Files that are refused.


def test_a_missing_file_is_named(tmp_path):
    assert 'No such file' in refusal(tmp_path / 'absent.yaml')


def test_a_directory_is_no_file(tmp_path):
    assert 'directory' in refusal(tmp_path)


def test_a_path_that_no_file_can_have_is_refused():
    refusal('nul\0byte.yaml')


def test_a_file_that_is_not_utf_8_is_refused(parameter_file):
    assert 'UTF-8' in refusal(parameter_file(b'/**: {ros__parameters: {frame_id: "\xe4rm"}}'))


@pytest.mark.parametrize('text, line', [
    ('/**:\n  ros__parameters:\n    rate: [1.0\n', 4),
    ('/**:\n  ros__parameters:\n    rate: 1.0\n   count: 2\n', 4),
    ('/**:\n\tros__parameters:\n', 2),
    ('/**: {ros__parameters: {rate: "1}}\n', 2),
    ('a: b: c', 1),
    ('*undefined', 1)])
def test_malformed_yaml_is_refused_with_its_line(parameter_file, text, line):
    path = parameter_file(text)
    assert f'{path}, line {line}, column ' in refusal(path)


@pytest.mark.parametrize('value', [
    '2024-13-45', '0x_', '0b_', '!!int ""', '!!int text', '!!float text', '!!bool text',
    '!!timestamp text', '!!python/object:os.system {}', '!!binary a', '9' * 5000, '2:99:-', '<<',
    '"\\x00"', '\x07', '\ufffe'])
def test_values_that_yaml_itself_cannot_make_are_refused(parameter_file, value):
    refusal(parameter_file(section(f'rate: {value}')))


@pytest.mark.parametrize('text', ['&a {rate: *a}', '&a {b: *a}', '&a [*a]'])
def test_a_file_that_contains_itself_is_refused(parameter_file, text):
    refusal(parameter_file(f'/**: {{ros__parameters: {text}}}'))


@pytest.mark.parametrize('depth', [50, 500])
@pytest.mark.parametrize('bracket', ['[]', '{}'])
def test_a_file_nested_too_deeply_is_refused(parameter_file, bracket, depth):
    opening = bracket[0] if bracket == '[]' else '{a: '
    nested = opening * depth + '1' + bracket[1] * depth
    refusal(parameter_file(f'/**: {{ros__parameters: {{rate: {nested}}}}}'))


@pytest.mark.parametrize('text', ['', '# nothing\n', '1', 'text', '[1, 2]', '---\n...\n', 'null'])
def test_a_file_that_does_not_start_with_a_node_is_refused(parameter_file, text):
    assert 'starts with a node name, or /**' in refusal(parameter_file(text))


@pytest.mark.parametrize('text', ['/**:', '/**: 1', '/**: {}', '/**: [ros__parameters]',
                                  '/**: {parameters: {rate: 10.0}}', 'rate: 10.0'])
def test_a_section_without_ros__parameters_is_refused_naming_it(parameter_file, text):
    message = refusal(parameter_file(text))
    assert f'key {text.split(":")[0]}: ' in message and 'ros__parameters' in message


@pytest.mark.parametrize('value', ['1', 'text', '[1.0]', ''])
def test_ros__parameters_without_keys_is_refused(parameter_file, value):
    message = refusal(parameter_file(f'/**: {{ros__parameters: {value}}}'))
    assert 'key ros__parameters: ' in message


def test_a_key_without_a_value_is_refused_naming_it(parameter_file):
    message = refusal(parameter_file(section('arm:\n  lengths:')))
    assert 'key arm.lengths has no value' in message


# Keys and values that are refused.


@pytest.mark.parametrize('key, meant', [
    ('rat', 'rate'), ('arm.length', 'arm.lengths'), ('Enabled', 'enabled'), ('drivers', 'driver')])
def test_an_unknown_key_is_refused_with_a_suggestion(parameter_file, key, meant):
    message = refusal(parameter_file(section(f'{key}: 1')))
    assert f'unknown parameter {key}; did you mean {meant}?' in message


def test_an_unknown_key_that_is_like_no_other_is_refused_with_all_there_are(parameter_file):
    message = refusal(parameter_file(section('xyzzy: 1')))
    assert re.search(r'unknown parameter xyzzy[.;:]', message)
    assert all(p.name in message for p in TABLE)


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


def test_a_wrong_value_in_a_file_is_refused_naming_the_file(parameter_file):
    message = refusal(parameter_file(section('rate: 1.0')))
    assert 'parameter rate is 1.0; allowed: 5 to 500 (how often, Hz)' in message


# Every parameter there is.


@pytest.mark.parametrize('parameter', ALL_PARAMETERS, ids=lambda p: p.name)
def test_a_default_is_allowed(parameter):
    assert parameter.check(parameter.default) == parameter.default


@pytest.mark.parametrize('parameter', ALL_PARAMETERS, ids=lambda p: p.name)
def test_a_parameter_is_described_and_a_number_has_bounds(parameter):
    assert parameter.description
    default = parameter.default
    first = default[0] if isinstance(default, tuple) else default
    if isinstance(first, int | float) and not isinstance(first, bool):
        assert -inf < parameter.low < parameter.high < inf


def test_a_parameter_means_the_same_in_every_node():
    for table in NODE_PARAMETERS.values():
        assert len({p.name for p in table}) == len(table)
        assert all(p in ALL_PARAMETERS for p in table)


LENGTH_UNITS = re.compile(r', (m|m/s|m/s\^2)\b')
LENGTHS_OF_ALL = [p for p in ALL_PARAMETERS if LENGTH_UNITS.search(p.description)]


def in_millimetres(parameter):
    """The default as someone writes it who thinks in mm; None when it is zero."""
    if isinstance(parameter.default, tuple):
        scaled = tuple(1e3 * v for v in parameter.default)
        return scaled if any(scaled) else None
    return 1e3 * parameter.default or None


def test_all_lengths_and_speeds_are_known_by_their_units():
    assert len(LENGTHS_OF_ALL) >= 14


@pytest.mark.parametrize(
    'parameter', [p for p in LENGTHS_OF_ALL if in_millimetres(p)], ids=lambda p: p.name)
def test_a_default_given_in_millimetres_is_refused(parameter):
    with pytest.raises(ParameterError, match=f'^parameter {parameter.name} is .*allowed: '):
        parameter.check(in_millimetres(parameter))


# Whatever stands in a file.

TABLE_OF_ALL = [replace(p) for p in ALL_PARAMETERS]
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
fuzz = settings(deadline=None, derandomize=True, max_examples=60,
                suppress_health_check=[HealthCheck.function_scoped_fixture])


def try_to_load(path):
    """Only a ParameterError that names the file may come out."""
    try:
        load_parameters(path, TABLE_OF_ALL, prefixes=[SHAPE_PREFIX])
    except ParameterError as error:
        assert str(error).startswith(str(path))


@fuzz
@given(st.text(alphabet=CHARACTERS + '\ud800', max_size=60))
def test_any_text_is_read_or_refused(parameter_file, text):
    try_to_load(parameter_file(text.encode('utf-8', 'surrogatepass')))


@fuzz
@given(st.text(alphabet='/*:{}[]&!|>-?,#\'" \n\tab01._ex%@`', max_size=60))
def test_anything_that_looks_like_yaml_is_read_or_refused(parameter_file, text):
    try_to_load(parameter_file(text))


@fuzz
@given(st.text(alphabet='0123456789abcdefxXob_.:-+eE~<=!*&TZ ', max_size=14))
def test_any_scalar_is_read_or_refused(parameter_file, text):
    try_to_load(parameter_file(section(f'rate: {text}')))


@fuzz
@given(st.binary(max_size=100))
def test_any_bytes_are_read_or_refused(parameter_file, data):
    try_to_load(parameter_file(data))


@fuzz
@given(st.dictionaries(names, trees, max_size=5))
def test_any_tree_of_values_is_read_or_refused(parameter_file, tree):
    text = yaml.safe_dump({'/**': {'ros__parameters': tree}}, allow_unicode=True)
    try_to_load(parameter_file(text.encode('utf-8', 'surrogatepass')))
