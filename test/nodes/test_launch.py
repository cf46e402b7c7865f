# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What a person asks for at the start is what the nodes run with, by ``ros2 launch`` and by ``up``.

That a node is given what is read here from its command line is claimed in test_overrides.py.
"""

from pathlib import Path

import pytest

from soft_continuum.hardware.drivers import families, JAMMING_DRIVERS, TENDON_DRIVERS
from soft_continuum.parameters.overrides import full_name_of
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.description import check_parameter_files
from soft_continuum.ros.parameter_table import default_frame
from soft_continuum.ui.cli import up
from soft_continuum.ui.cli.up import check_launch, check_twin, chosen_nodes, start_parser
from soft_continuum.user_files import description_file
from support.descriptions import section
from support.launch_stand_in import DeclareLaunchArgument, description, launched

BOARDS = ['grbl.port: /dev/a_port', 'modbus.port: /dev/b_port']
NAMES = ['/**', '/*', '/*/*', '/**/**', '{node}', '/{node}', '/**/{node}', '{space}{node}',
         '{space}*', '{space}**']
"""Names of sections, of which some apply in the namespace and some do not."""


def by_launch(node, files, **asked):
    """Return the arguments of a node that ros2 launch starts."""
    given = dict(zip(('params_file', 'more_params_file'), map(str, files), strict=False))
    found, = (one.command for one in launched(**given, **asked) if one.name == node)
    return found


def by_up(node, files, **asked):
    """Return the arguments of a node that up starts."""
    del node
    options = up.start_parser('up', '').parse_args([
        *(f'--params-file={path}' for path in files),
        *(f'--{name.replace("_", "-")}={value}' for name, value in asked.items())])
    with up.arguments_of(options) as arguments:
        return arguments


def given(node, arguments):
    """Return the full name of a node that is started like this, and its parameters."""
    name = full_name_of(arguments, node)
    found = check_parameter_files(arguments, [node]).of(name)
    return {'name': name} | {key: value for key, (value, _) in found.items()}


@pytest.mark.parametrize('starter', [by_launch, by_up])
@pytest.mark.parametrize('namespace', ['', 'left', 'lab/left'])
@pytest.mark.parametrize('order', [1, -1])
def test_a_driver_that_is_asked_for_wins_over_every_section(tmp_path, starter, namespace, order):
    node, space = 'tendon_actuation', f'/{namespace}/' if namespace else '/'
    forms = [form.format(node=node, space=space) for form in NAMES][::order]
    first, second = tmp_path / 'first.yaml', tmp_path / 'second.yaml'
    first.write_text(section('/**', *BOARDS) + ''.join(
        section(form, 'tendon_driver: simulated', f'tendon_rate: {20 + k}.0')
        for k, form in enumerate(forms)), encoding='utf-8')
    second.write_text(section(f'{space}{node}', 'tendon_driver: simulated', 'speed_limit: 0.02'),
                      encoding='utf-8')
    arguments = starter(node, [first, second], namespace=namespace, tendon_driver='grbl')
    values = given(node, arguments)
    assert values['name'] == f'{space}{node}'
    assert values['tendon_driver'] == 'grbl'
    # All else is as the files say.
    assert (values['grbl.port'], values['speed_limit']) == ('/dev/a_port', 0.02)
    plain = given(node, starter(node, [first, second], namespace=namespace))
    assert plain['tendon_driver'] == 'simulated'
    assert values['tendon_rate'] == plain['tendon_rate'] > 20.0


@pytest.mark.parametrize('starter', [by_launch, by_up])
@pytest.mark.parametrize('form', NAMES)
@pytest.mark.parametrize('namespace', ['', 'left'])
def test_a_driver_that_is_asked_for_wins_over_a_section_of_each_form(
        tmp_path, starter, namespace, form):
    node = 'jamming_valves'
    name = form.format(node=node, space=f'/{namespace}/' if namespace else '/')
    path = tmp_path / 'rig.yaml'
    path.write_text(section(name, 'jamming_driver: simulated') + section('/**', *BOARDS),
                    encoding='utf-8')
    arguments = starter(node, [path], namespace=namespace, jamming_driver='modbus')
    values = given(node, arguments)
    assert (values['jamming_driver'], values['modbus.port'], values['name']) == (
        'modbus', '/dev/b_port', f'{"/left" if namespace else ""}/{node}')


@pytest.mark.parametrize('starter', [by_launch, by_up])
@pytest.mark.parametrize(('node', 'parameter', 'drivers'), [
    ('tendon_actuation', 'tendon_driver', tuple(families(TENDON_DRIVERS))),
    ('jamming_valves', 'jamming_driver', tuple(families(JAMMING_DRIVERS)))])
def test_every_driver_can_be_asked_for(tmp_path, starter, node, parameter, drivers):
    for driver in drivers:
        path = tmp_path / 'rig.yaml'
        path.write_text(section('/**', f'{parameter}: {drivers[0]}'), encoding='utf-8')
        arguments = starter(node, [path], **{parameter: driver})
        values = check_parameter_files(arguments, []).of(f'/{node}')
        assert values[parameter][0] == driver


@pytest.mark.parametrize('starter', [by_launch, by_up])
@pytest.mark.parametrize(('namespace', 'text', 'frame'), [
    ('', section('/**', 'arm: {payload: 0.1}'), 'base_link'),
    ('left', section('/**', 'arm: {payload: 0.1}'), 'left/base_link'),
    ('lab/left', section('kinematics', 'frame_id: other'), 'lab/left/base_link'),
    ('left', section('/**', 'frame_id: world'), 'world'),
    ('left', section('/left/kinematics', 'frame_id: a') + section('/**', 'frame_id: b'), 'b'),
    ('left', section('/**', 'frame_id: b') + section('/left/kinematics', 'frame_id: a'), 'a')])
def test_the_frame_is_that_of_the_files_or_of_the_namespace(
        tmp_path, starter, namespace, text, frame):
    path = tmp_path / 'arm.yaml'
    path.write_text(text, encoding='utf-8')
    arguments = starter('kinematics', [path], namespace=namespace)
    values = given('kinematics', arguments)
    assert values.get('frame_id', default_frame(namespace)) == frame


def test_a_mistake_in_a_section_for_another_namespace_keeps_nothing_from_starting(tmp_path):
    path = tmp_path / 'arms.yaml'
    path.write_text(section('/right/**', 'spede_limit: fast', 'arm: {payload: heavy}')
                    + section('/left/**', 'arm: {payload: 0.2}'), encoding='utf-8')
    arguments = by_launch('kinematics', [path], namespace='left')
    assert given('kinematics', arguments)['arm.payload'] == 0.2
    with pytest.raises(RuntimeError, match='nothing was started: .*spede_limit'):
        by_launch('kinematics', [path], namespace='right')


@pytest.mark.parametrize('computer', ['all', 'workstation'])
@pytest.mark.parametrize(('node', 'line', 'message'), [
    ('teleop', 'teleop.tip_speeed: 0.1', 'teleop.tip_speeed'),
    ('servo', 'payload: 0.1', 'payload'),
    ('servo', 'arm: {payload: heavy}', 'arm.payload'),
    ('shape_sequencer', 'loop.tip_tolerence: 0.1', 'loop.tip_tolerence')])
def test_a_mistake_in_the_section_of_any_node_keeps_all_from_starting(
        tmp_path, node, line, message, computer):
    path = tmp_path / 'more.yaml'
    path.write_text(section(f'/{node}', line), encoding='utf-8')
    with pytest.raises(RuntimeError, match=f'nothing was started: .*{message}'):
        launched(more_params_file=str(path), teleop='true', computer=computer)
    # Where it is not started it is not asked.
    assert len(launched(more_params_file=str(path), teleop='true', computer='rig')) == 2


@pytest.mark.parametrize(('asked', 'nodes'), [
    ({}, {'tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer'}),
    ({'computer': 'rig'}, {'tendon_actuation', 'jamming_valves'}),
    ({'computer': 'workstation', 'teleop': 'true'},
     {'kinematics', 'shape_sequencer', 'servo', 'teleop'}),
    ({'teleop': 'true'}, {'tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer',
                          'servo', 'teleop'})])
def test_the_nodes_are_those_that_are_asked_for(asked, nodes):
    assert {node.name for node in launched(**asked)} == nodes


def test_rviz_shows_the_arm_in_its_frame(monkeypatch, tmp_path):
    with pytest.raises(RuntimeError, match='ros-jazzy-robot-state-publisher'):
        launched(rviz='true')
    monkeypatch.setattr(up, 'get_packages_with_prefixes',
                        lambda: {'robot_state_publisher': '', 'rviz2': ''})
    nodes = {node.executable: node for node in launched(rviz='true', namespace='left')}
    assert nodes['rviz2'].arguments[-2:] == ['-f', 'left/base_link']
    robot, = nodes['robot_state_publisher'].parameters
    assert 'left/base_link' in robot['robot_description']


def test_the_home_may_be_written_as_a_tilde(monkeypatch, tmp_path):
    monkeypatch.setenv('HOME', str(tmp_path))
    (tmp_path / 'arm.yaml').write_text(section('/**', 'arm: {payload: 0.3}'), encoding='utf-8')
    for starter in (by_launch, by_up):
        arguments = starter('kinematics', [Path('~/arm.yaml')])
        assert check_parameter_files(arguments, ['kinematics']).of('/kinematics')[
            'arm.payload'] == (0.3, str(tmp_path / 'arm.yaml'))


def test_every_argument_is_described_and_claimed_here():
    arguments = {a.name: a for a in description() if isinstance(a, DeclareLaunchArgument)}
    assert arguments.keys() == {'namespace', 'params_file', 'more_params_file', 'tendon_driver',
                                'jamming_driver', 'computer', 'rviz', 'teleop'}
    assert all(a.description for a in arguments.values())


# What is checked before anything starts.


def test_what_can_be_started_is_not_refused():
    check_launch('left', [description_file()], ['soft_continuum_interfaces'])


@pytest.mark.parametrize(('namespace', 'files', 'packages', 'reason'), [
    ('', ['missing.yaml'], [], 'missing.yaml: cannot be read: No such file'),
    ('', [description_file(), 'missing.yaml'], [], 'missing.yaml: cannot be read: No such file'),
    ('a-b', [], [], "namespace 'a-b' is not valid in ROS"),
    ('', [], ['no_such_publisher'], 'sudo apt install ros-jazzy-no-such-publisher'),
])
def test_what_cannot_be_started_is_refused_before_anything_starts(
        namespace, files, packages, reason):
    with pytest.raises(ParameterError, match=reason):
        check_launch(namespace, files, packages)


@pytest.mark.parametrize(('options', 'nodes'), [
    ([], {'tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer'}),
    (['--computer', 'rig'], {'tendon_actuation', 'jamming_valves'}),
    (['--computer', 'workstation', '--camera'], {'kinematics', 'shape_sequencer', 'camera'})])
def test_each_of_two_computers_has_its_nodes(options, nodes):
    assert set(chosen_nodes(start_parser('up', '').parse_args(options))) == nodes


def test_the_boards_of_the_twin_are_not_on_the_workstation():
    options = start_parser('up', '').parse_args(['--twin', '--computer', 'workstation'])
    with pytest.raises(ParameterError, match='with --computer rig'):
        check_twin(options)
