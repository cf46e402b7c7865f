# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The policy of SROS 2 is a file that sros2 takes, and of each who takes part it knows the place.

test_interfaces.py compares it with what each node does.
"""

from fnmatch import fnmatchcase
from functools import partial
from xml.etree import ElementTree

import pytest

from soft_continuum.client import Arm
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.description import load_rig
from soft_continuum.ros.environment import CLIENT, INPUTS, VIEWER, with_enclave
from soft_continuum.ros.names import RECORDER
from soft_continuum.ui.cli.main import main
from soft_continuum.ui.cli.policy import documented_nodes, policy
from soft_continuum.user_files import description_file
from support.policies import allowed, used
from support.ros_rig import ALL, DEADLINE

# Element, attributes and children, as policy.xsd of ros2/sros2 (0.2.0) has them.
SCHEMA = {
    'policy': ({'version'}, set(), ('enclaves',)),
    'enclaves': (set(), set(), ('enclave',)),
    'enclave': ({'path'}, set(), ('profiles',)),
    'profiles': (set(), {'type'}, ('profile',)),
    'profile': ({'ns', 'node'}, set(), ('topics', 'services', 'actions')),
    'topics': (set(), {'publish', 'subscribe'}, ('topic',)),
    'services': (set(), {'reply', 'request'}, ('service',)),
    'actions': (set(), {'call', 'execute'}, ('action',)),
    'topic': (set(), set(), ()), 'service': (set(), set(), ()), 'action': (set(), set(), ()),
}


def test_a_recorder_may_read_all_and_say_nothing_of_it(shared_arm):
    values = load_rig([description_file()])
    text = policy(values, shared_arm.namespace)
    shared_arm.start(RECORDER, ready=False)
    may = allowed(text, f'{shared_arm.namespace}/{RECORDER}')
    for node in (*ALL, RECORDER):  # what all of them publish
        for name in used(shared_arm, node)['publish'] - {'/parameter_events'}:
            assert any(fnmatchcase(name, one) for one in may['subscribe']), name
    shared_arm.until(lambda: used(shared_arm, RECORDER)['publish'] == may['publish'], DEADLINE)
    assert used(shared_arm, RECORDER)['publish'] == may['publish']


def within(now, may):
    """Whether everything that is used is allowed; * stands for any text, as in DDS Security."""
    return all(any(fnmatchcase(name, one) for one in may[how])
               for how, names in now.items() for name in names)


def test_who_commands_may_do_all_that_a_client_does_and_who_looks_may_not(shared_arm, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(shared_arm.domain))
    text = policy(load_rig([description_file()]), shared_arm.namespace)
    commands, looks, feeds = (allowed(text, f'{shared_arm.namespace}/{name}')
                              for name in (CLIENT, VIEWER, INPUTS))
    with Arm(shared_arm.namespace, timeout=DEADLINE) as arm:
        node = arm._requests.node.get_name()
        assert arm.state and arm.description and arm.shapes
        shared_arm.until(lambda: len(used(shared_arm, node)['request']) >= 2, DEADLINE)
        assert within(used(shared_arm, node), looks), 'to look takes no more than that'
        arm.stop()
        arm.resume()
        arm.soften(1)
        arm.jog(left_tendon=-0.0001)
        arm.stiffen()
        arm.run('c_form')
        arm.obstacles.clear()
        wanted = {'tendon_actuation/tendon_trajectory', 'obstacles'}
        shared_arm.until(lambda: wanted <= {
            name.removeprefix(f'{shared_arm.namespace}/')
            for name in used(shared_arm, node)['publish']}, DEADLINE)
        assert within(used(shared_arm, node), commands)
        assert not within(used(shared_arm, node), looks)
    for name in ('/tendon_actuation/state', '/kinematics/heartbeat', '/tendon_states'):
        for may in (commands, feeds, looks):
            assert shared_arm.namespace + name not in may['publish'], 'nobody else is that node'
    assert not feeds['request'] and not looks['publish'] - {'/rosout', '/parameter_events'}
    assert not any('set' in name or 'stop' in name for name in looks['request'])


def test_each_process_takes_the_enclave_of_its_profile(rig, processes):
    processes.node('kinematics', namespace=rig.namespace)

    def enclaves():
        return {name: path for name, _, path
                in rig.observer.get_node_names_and_namespaces_with_enclaves()}

    rig.until(lambda: 'kinematics' in enclaves(), DEADLINE)
    assert enclaves()['kinematics'] == f'{rig.namespace}/kinematics'
    given = ['camera', '--ros-args', '-r', '__ns:=/left', '-r', '__node:=camera_2']
    assert with_enclave(given, 'camera')[-2:] == ['--enclave', '/left/camera_2']
    assert with_enclave([*given, '--enclave', '/own'], 'camera')[-1] == '/own'
    assert with_enclave([], 'client', 'left')[-1] == '/left/client'


@pytest.mark.parametrize('namespace', ['', 'left', '/lab/left'])
def test_the_policy_keeps_to_the_schema_of_sros2(namespace):
    root = ElementTree.fromstring(policy(load_rig([]), namespace))
    assert root.tag == 'policy' and root.get('version') == '0.2.0'
    for element in root.iter():
        needed, optional, children = SCHEMA[element.tag]
        assert needed <= {*element.attrib} <= needed | optional
        assert {child.tag for child in element} <= {*children}
        assert bool(len(element)) == bool(children), 'no list may be empty'
        assert bool((element.text or '').strip()) != bool(children)
        if element.tag in ('topics', 'services', 'actions'):
            assert {*element.attrib.values()} == {'ALLOW'}
    paths = [element.get('path', '') for element in root.iter('enclave')]
    names = {*documented_nodes(), CLIENT, VIEWER, INPUTS}
    assert {path.rpartition('/')[2] for path in paths} == names and len(paths) == len(names)
    assert {path.rpartition('/')[0].strip('/') for path in paths} == {namespace.strip('/')}


def test_an_arm_has_as_many_discs_as_it_is_described_with(tmp_path):
    spatial = description_file('tendon_arm')
    text = policy(load_rig([spatial]))
    count = len(load_rig([spatial])['arm.segment_lengths'])
    found = {name for name in allowed(text, '/camera')['publish'] if 'measured_pose' in name}
    assert found == {f'/disc_{n}/measured_pose' for n in range(count + 1)}


RIG = """\
/**:
  ros__parameters:
    tendon_driver: ros_topics
    ros_tendons: {state_topic: motors/states, command_topic: %s}
"""


def test_topics_that_parameters_name_are_allowed_to_the_node_that_has_the_driver(tmp_path):
    rig = tmp_path / 'my_rig.yaml'
    rig.write_text(RIG % '/motors/commands', encoding='utf-8')
    text = policy(load_rig([description_file(), rig]), 'left')
    may, feeds = (allowed(text, f'/left/{name}') for name in ('tendon_actuation', INPUTS))
    assert '/motors/commands' in may['publish'] and '/left/motors/states' in may['subscribe']
    assert '/left/motors/states' in feeds['publish'], 'who drives the motors'
    assert '/motors/commands' not in feeds['publish']
    without = allowed(policy(load_rig([description_file()]), 'left'), '/left/tendon_actuation')
    assert not any('motors' in name for names in without.values() for name in names)
    rig.write_text(RIG % '"commands</topic><topic>*"', encoding='utf-8')
    with pytest.raises(ParameterError, match='ros_tendons.command_topic'):
        policy(load_rig([description_file(), rig]), 'left')


@pytest.mark.parametrize('namespace', ['a b', '1', 'left//arm', 'läft', 'a"/><enclave path="/'])
def test_a_namespace_that_ros_does_not_take_is_refused(namespace):
    with pytest.raises(ParameterError, match='namespace'):
        policy(load_rig([]), namespace)


def test_the_command_writes_the_file_once(tmp_path, capsys):
    write = partial(main, ['policy', '--namespace', 'left', '--output', str(tmp_path / 'new')])
    assert write() == 0
    assert '/left/client' in capsys.readouterr().out
    text = (tmp_path / 'new' / 'policy.xml').read_text(encoding='utf-8')
    assert text == policy(load_rig([]), 'left')
    assert write() == 2
    assert '--force' in capsys.readouterr().err
