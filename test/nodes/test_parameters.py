# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What parameters a node takes, at its start and later, and how it refuses the others."""

import os
import signal
import sys
import threading

import pytest
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python

from soft_continuum.nodes.runtime import run
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import FRAME_NAME, ParameterError, TOPIC_NAME
from soft_continuum.parameters.shapes import (
    direction_parameter,
    DIRECTION_PREFIX,
    PAPER_SHAPES,
    shape_parameter,
    SHAPE_PREFIX,
    shapes_from_parameters,
    vacuum_parameter,
    VACUUM_PREFIX,
)
from soft_continuum.ros.description import load_description
from soft_continuum.ros.parameter_table import NODE_PARAMETERS
from soft_continuum.ui.cli.main import main
from soft_continuum.user_files import description_file
from support.descriptions import given_in
from support.documented_commands import kept_signal_handlers
from support.ros_rig import ALL
from support.views import space_views

GOOD = description_file().read_text(encoding='utf-8')


@pytest.fixture
def start(domain, monkeypatch, capfd):
    """Return a function that runs a node in this process: exit status and standard error."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))

    def start(node, *arguments):
        # A node that should have refused would run on: ended, it has exit status 0.
        guard = threading.Timer(60.0, os.kill, (os.getpid(), signal.SIGTERM))
        guard.start()
        try:
            status = run(node, [node, '--ros-args', '--log-level', 'fatal', *arguments])
        finally:
            guard.cancel()
        return status, capfd.readouterr().err

    with kept_signal_handlers():
        yield start


@pytest.fixture
def file(tmp_path):
    """Return a function that writes the description with a part replaced: its arguments."""
    def write(old, new):
        assert GOOD.count(old) == 1
        path = tmp_path / 'arm.yaml'
        path.write_text(GOOD.replace(old, new), encoding='utf-8')
        return ['--params-file', str(path)]
    return write


@pytest.mark.parametrize('node', ['kinematics', 'tendon_actuation'])
def test_what_is_no_argument_of_ros_is_refused_and_help_is_given(start, node, capfd):
    with pytest.raises(SystemExit, match='2'):
        start(node, '--', '--params-file', 'rig.yaml')
    assert 'unknown option --params-file' in capfd.readouterr().err
    with pytest.raises(SystemExit, match='0'):
        start(node, '--', '--help')
    assert '--ros-args --params-file FILE' in ' '.join(capfd.readouterr().out.split())


def assert_refused(answer, *reasons):
    """Claim that a node ended with status 2 and one line with all of the reasons."""
    status, text = answer
    assert status == 2, text
    assert len(text.splitlines()) == 1, text
    for reason in reasons:
        assert reason in text


LENGTHS = 'segment_lengths: [0.070, 0.070, 0.070]'
# What no file may say is in test_parameter_files.py and test_description.py.
BAD_DESCRIPTIONS = {
    'lengths in millimetres':
        (LENGTHS, 'segment_lengths: [70.0, 70.0, 70.0]', ['arm.segment_lengths', '0.001 to 10']),
    'unknown key': ('segment_lengths:', 'segment_length:',
                    ['unknown parameter arm.segment_length', 'did you mean arm.segment_lengths']),
    'not YAML': ('arm:\n', 'arm: {\n', ['line', 'not valid YAML']),
    'whole number for a measure': ('gravity: 9.80665', 'gravity: 10', ['arm.gravity', '10.0']),
    'thresholds in the wrong order':
        ('ambient_pressure: 101325.0', 'ambient_pressure: 101325.0\n    release_vacuum: 60.0e+3',
         ['release_vacuum', 'stiff_vacuum']),
    'the same shape twice': ('shape_names: [c_form,', 'shape_names: [c_form, c_form,',
                             ['shape_names', 'c_form']),
}


# Checked by the nodes that have the parameter; all else by every node.
OWNERS = {
    'thresholds in the wrong order': ('jamming_valves',),
    'the same shape twice': ('shape_sequencer',),
}


@pytest.mark.parametrize(('node', 'case'), [
    (node, case) for case in BAD_DESCRIPTIONS
    for node in OWNERS.get(case, ('jamming_valves', 'shape_sequencer'))])
def test_a_bad_description_is_refused_at_the_start_naming_file_and_key(start, file, node, case):
    old, new, reasons = BAD_DESCRIPTIONS[case]
    arguments = file(old, new)
    assert_refused(start(node, *arguments), node, arguments[1], *reasons)


@pytest.mark.parametrize('section', ['/arm/*', '/arm/kinematics', '/**/kinematics'])
def test_what_a_file_says_for_one_node_only_is_checked_as_well(start, tmp_path, section):
    path = tmp_path / 'more.yaml'
    path.write_text(f'{section}:\n  ros__parameters:\n    straight_tolerence: 0.001\n')
    assert_refused(start('kinematics', '-r', '__ns:=/arm', '--params-file', str(path)),
                   'kinematics', str(path), 'straight_tolerence')


@pytest.mark.parametrize(('node', 'value', 'reasons'), [
    ('kinematics', 'straight_tolerance:=1.0', ['straight_tolerance', '0.1']),
    ('kinematics', 'straight_tolerance:=much', ['straight_tolerance', 'much']),
    ('kinematics', 'straight_tolerance:=-0.1', ['straight_tolerance']),
    ('tendon_actuation', 'tendon_driver:=gbrl', ['tendon_driver', 'gbrl', 'simulated']),
    ('tendon_actuation', 'tension_limit:=.nan', ['tension_limit']),
    ('jamming_valves', 'autostart:=2', ['autostart']),
    ('shape_sequencer', 'stale_timeout:=1000.0', ['stale_timeout', '10']),
])
def test_a_bad_value_on_the_command_line_is_refused_with_its_name(start, node, value, reasons):
    assert_refused(
        start(node, '--params-file', str(description_file()), '-p', value), node, *reasons)


@pytest.mark.parametrize(('node', 'parameters', 'named'), [
    ('camera', {'camera.source': '/dev/video9'}, 'camera.calibration is needed'),
    ('camera', {'camera.calibration': '/nowhere.yaml'}, '/nowhere.yaml'),
    ('camera', {'tags.fixed_positions': [0.0] * 8}, 'in a line'),
    ('camera', given_in(space_views.PATH, 'camera') | {'tags.offsets': [0.001] * 12},
     'keep tags.reference_corners'),  # those offsets are of a planar arm
    ('disc_sensors', {'tracker.offsets': [0.0, 1.0]}, 'tracker.offsets has 2'),
    ('disc_sensors', {'tracker.base_pose': [0.0] * 7}, 'of length 1'),
    ('disc_sensors', {'imu.axes': ['+x', '+y', '-z']}, 'right-handed'),
    ('disc_sensors', {'imu.mounting_angles': [0.0, 0.1]}, 'imu.mounting_angles has 2'),
    ('shape_sequencer', {'obstacles.file': '/none.yaml'},
     'parameter obstacles.file: /none.yaml: cannot be')], ids=str)
def test_parameters_that_a_node_cannot_use_are_refused(rig, node, parameters, named):
    with pytest.raises(ParameterError, match=named):
        rig.start(node, ready=False, **parameters)


def test_a_number_out_of_range_is_not_reported_as_a_missing_decimal_point(start):
    status, text = start('jamming_valves', '-p', 'jamming_rate:=1000.0')
    assert status == 2
    assert '100' in text
    assert 'write 5.0 rather than 5' not in text


def test_a_refusal_is_one_line_and_exit_status_2_of_the_executable(processes, tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text(GOOD.replace(LENGTHS, 'segment_lengths: [70.0]'), encoding='utf-8')
    node = processes.node('kinematics', installed=True, files=[path])
    assert node.wait() == 2
    assert len(node.output.splitlines()) == 1, node.output
    assert str(path) in node.output
    assert 'arm.segment_lengths' in node.output


def test_the_four_nodes_refuse_as_one(file, monkeypatch, capfd):
    monkeypatch.setattr(sys, 'argv', ['soft_continuum'])
    with kept_signal_handlers():
        status = main(['up', *file('gravity: 9.80665', 'gravity: heavy')])
    assert_refused((status, capfd.readouterr().err), 'arm.gravity')


# At run time.


@pytest.mark.parametrize(('node', 'cases'), [
    ('tendon_actuation', [
        ('tension_limit', 1e6, '10000'), ('tension_limit', -1.0, '0.1'),
        ('tension_limit', float('nan'), 'nan'), ('tension_limit', 'much', 'DOUBLE'),
        ('tension_limit', 60, 'DOUBLE')]),
    ('shape_sequencer', [
        ('tendon_speed', 0.0, '0.0001'),
        ('antagonist_slack', float('inf'), 'antagonist_slack')])])
def test_a_bad_value_is_refused_at_run_time_with_the_reason(module_rig, node, cases):
    started, = module_rig.start(node)
    for name, value, reason in cases:
        before, = present_values(module_rig, node, [name])
        result = module_rig.set_parameter(node, name, value)
        assert not result.successful, (name, value)
        assert reason in result.reason
        assert present_values(module_rig, node, [name]) == [before]
    module_rig.end(started)


def present_values(rig, node, names):
    """Return the values that a node has."""
    return [parameter_value_to_python(value) for value in rig.call(
        GetParameters, f'{node}/get_parameters', names=list(names)).values]


def changed(parameter):
    """Return an allowed value other than the default."""
    default = parameter.default
    if isinstance(default, tuple):
        step = 1 if 'integer' in parameter.type_name else 1e-4
        return [item if isinstance(item, str) else item + step for item in default] * 2
    if isinstance(default, str):
        return parameter.choices[-1] if parameter.choices else 'other'
    if isinstance(default, bool):
        return not default
    for value in (default * 2, default / 2, default + 1e-4):
        if value != default and parameter.low <= value <= parameter.high:
            return type(default)(value)
    raise AssertionError(parameter)


@pytest.mark.parametrize('node', NODE_PARAMETERS)
def test_the_parameters_of_a_node_are_those_of_its_table(module_rig, node):
    """Names, meaning, bounds, choices, and whether they can be set while the node runs."""
    rig = module_rig
    started, = rig.start(node, ready=node in ALL)
    listed = rig.call(ListParameters, f'{node}/list_parameters').result.names
    # As `ros2 param dump` asks for them: one without a value empties the whole answer.
    values = rig.call(GetParameters, f'{node}/get_parameters', names=listed).values
    assert len(values) == len(listed)
    assert ParameterType.PARAMETER_NOT_SET not in {value.type for value in values}
    own = {name for name in listed if not name.startswith((
        'qos_overrides.', 'use_sim_time', 'start_type_description_service'))}
    table = {p.name: p for p in NODE_PARAMETERS[node]}
    if node == 'shape_sequencer':
        table |= {parameter(name).name: parameter(name) for name in PAPER_SHAPES
                  for parameter in (shape_parameter, direction_parameter, vacuum_parameter)}
    assert own == set(table)
    answer = rig.call(DescribeParameters, f'{node}/describe_parameters', names=list(table))
    results = rig.call(SetParameters, f'{node}/set_parameters', parameters=[
        RosParameter(p.name, value=changed(p)).to_parameter_msg() for p in table.values()]).results
    for parameter, descriptor, result in zip(
            table.values(), answer.descriptors, results, strict=True):
        assert_described(parameter, descriptor)
        assert result.successful != parameter.read_only, (parameter.name, result.reason)
        if parameter.read_only:
            assert 'read-only' in result.reason or 'read only' in result.reason
        else:
            assert started.parameters[parameter.name] == changed(parameter)
    rig.end(started)


def test_a_shape_without_angles_of_its_own_has_an_empty_list_and_that_is_read_again(
        module_rig, tmp_path):
    started, = module_rig.start('shape_sequencer')
    names = [f'{prefix}c_form' for prefix in (SHAPE_PREFIX, DIRECTION_PREFIX, VACUUM_PREFIX)]
    described = shape_parameter('c_form').default
    angles, *others = present_values(module_rig, 'shape_sequencer', names)
    module_rig.end(started)
    assert list(angles) in ([], list(described)) and [list(one) for one in others] == [[], []]
    path = tmp_path / 'dump.yaml'
    path.write_text(''.join(
        ['/**:\n  ros__parameters:\n', *(f'    {name}: []\n' for name in names)]))
    values = load_description(description_file(), path)
    assert shapes_from_parameters(values, arm_from_parameters(values))['c_form'] == described


@pytest.mark.parametrize(('node', 'name', 'good', 'bad'), [
    ('kinematics', 'frame_id', ['base_link', 'left/base_link', 'arm-1.base'],
     ['/base_link', '/base link', 'base link', 'left//base_link', 'left/', '', 'a\tb']),
    ('disc_sensors', 'tracker.frame_id', ['', 'world'], ['/world', 'the world']),
    *(('tendon_actuation', f'ros_tendons.{name}_topic',
       ['/joint_states', 'rig/joint_states', '~/a'],
       ['joint states', '/', '//a', 'a/', '1a', 'a-b', '']) for name in ('state', 'command')),
    *(('jamming_valves', f'ros_jamming.{name}_topics', [['a', '/b/c', '~/d']],
       [['a', 'b c', 'd'], [''], ['a', '/b/', 'c']]) for name in ('pressure', 'command', 'state')),
    *(('jamming_valves', f'ros_jamming.{name}_topic', ['', '/pump'], ['/the pump', 'pump/'])
      for name in ('pump', 'pump_state'))])
def test_a_name_of_a_frame_or_a_topic_is_one_that_ros_takes(node, name, good, bad):
    parameter = next(p for p in NODE_PARAMETERS[node] if p.name == name)
    for value in good:
        assert parameter.check(value) in (value, tuple(value))
    for value in bad:
        with pytest.raises(ParameterError, match=f'^parameter {name} is .*allowed: a '):
            parameter.check(value)


def test_every_parameter_that_is_a_frame_or_a_topic_is_checked_as_one():
    for table in NODE_PARAMETERS.values():
        for parameter in table:
            words = parameter.name.replace('.', '_').split('_')
            expected = (FRAME_NAME if parameter.name.endswith('frame_id') else
                        TOPIC_NAME if words[-1] in ('topic', 'topics') else '')
            assert parameter.form == expected, parameter.name


def assert_described(parameter, descriptor):
    """Claim that a descriptor has all that the table has."""
    assert descriptor.read_only == parameter.read_only
    assert parameter.unit in descriptor.description
    if descriptor.type == ParameterType.PARAMETER_DOUBLE:
        bounds, = descriptor.floating_point_range
        assert (bounds.from_value, bounds.to_value) == (parameter.low, parameter.high)
    elif descriptor.type == ParameterType.PARAMETER_INTEGER:
        bounds, = descriptor.integer_range
        assert (bounds.from_value, bounds.to_value) == (parameter.low, parameter.high)
    elif (descriptor.type == ParameterType.PARAMETER_DOUBLE_ARRAY
          and not parameter.name.startswith((SHAPE_PREFIX, DIRECTION_PREFIX))):
        assert f'{parameter.low:g} to {parameter.high:g}' in descriptor.additional_constraints
    for choice in parameter.choices:
        assert choice in descriptor.additional_constraints
