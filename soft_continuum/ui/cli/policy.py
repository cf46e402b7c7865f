# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
``policy``: access permissions over DDS, as a policy file for SROS 2.

It is generated from the tables in ``msg_docs``: only documented interfaces are allowed. The schema
is policy.xsd, version 0.2.0, of ros2/sros2.  See docs/how_to/set_up_the_network.md.
"""

import argparse
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
import re
import shlex
from xml.etree import ElementTree

from soft_continuum.hardware.drivers import chosen_families
from soft_continuum.lab.analysis.verbs import reserve_outputs, run_verb
from soft_continuum.parameters.arguments import Parser
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.overrides import full_name
from soft_continuum.parameters.parameter import ParameterError, Value
from soft_continuum.ros.description import load_rig
from soft_continuum.ros.environment import CLIENT, INPUTS, VIEWER
from soft_continuum.ros.interface_tables import (
    documented_nodes,
    EVERYTHING,
    Interface,
    interfaces,
    is_lifecycle_node,
    OF_EVERY_NODE,
    OF_LIFECYCLE_NODES,
    SERVED,
)
from soft_continuum.ros.names import JAMMING_VALVES, RECORDER, SHARED, TENDON_ACTUATION
from soft_continuum.ros.parameter_table import DESCRIBED
from soft_continuum.text import write_whole

FILE = 'policy.xml'
VERSION = '0.2.0'  # of the schema
QUALIFIERS = {
    ('topic', 'publishes'): 'publish', ('topic', 'subscribes'): 'subscribe',
    ('service', 'serves'): 'reply', ('service', 'calls'): 'request',
    ('action', 'serves'): 'execute', ('action', 'calls'): 'call'}
SET_PARAMETERS = 'rcl_interfaces/srv/SetParameters'
DESCRIBES_TYPES = Interface('service', SERVED, '*/get_type_description',
                            'type_description_interfaces/srv/GetTypeDescription')
DRIVERS = {'tendon_driver': TENDON_ACTUATION, 'jamming_driver': JAMMING_VALVES}
TOPIC = re.compile(r'(~/|/)?[a-z_]\w*(/[a-z_]\w*)*', re.ASCII | re.IGNORECASE)
NAMESPACE = re.compile(r'/?([a-z]\w*(/[a-z]\w*)*)?/?', re.ASCII | re.IGNORECASE)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    return run_verb(Parser(
        'policy', f'Write {FILE} for SROS 2: the topics, services and actions that each node of '
        'an arm and each kind of program may use. Using it needs ROS 2 from apt.',
        '--params-file', '--namespace', '--output', '--force'), _run, argv)


def _run(options: argparse.Namespace) -> None:
    namespace = options.namespace
    text = policy(load_rig(options.params_file, namespace), namespace)
    path, = reserve_outputs(options.output, [FILE], options.force)
    write_whole(path, text)
    print(f'Written: {path}\n  {full_name("NODE", namespace)}: one for each node, which uses it '
          f'automatically\n  {full_name(CLIENT, namespace)}: programs that command: '
          f'soft_continuum, the Python client, the browser\n  {full_name(VIEWER, namespace)}: '
          f'programs that only observe, such as RViz\n  {full_name(INPUTS, namespace)}: drivers '
          'of sensors, an emergency stop\nMake the keys, with ROS 2 from apt:\n  ros2 security '
          'create_keystore keystore\n  ros2 security generate_artifacts -k keystore -p '
          f'{shlex.quote(str(path))}\nNext steps: docs/how_to/set_up_the_network.md.')


def policy(values: Mapping[str, Value], namespace: str = '') -> str:
    """
    Return policy.xml for an arm in a namespace.

    values: its parameters, as load_rig returns them: the numbers of segments and discs, and topic
    names set by parameters. Raises ParameterError for a name that is not valid in ROS.
    """
    if not NAMESPACE.fullmatch(namespace):
        raise ParameterError(f'namespace {namespace!r} is not valid in ROS: use letters, digits, '
                             '_ and /, and begin with a letter')
    root = ElementTree.Element('policy', version=VERSION)
    enclaves = ElementTree.SubElement(root, 'enclaves')
    for name, allowed in profiles(values).items():
        profile = ElementTree.SubElement(ElementTree.SubElement(ElementTree.SubElement(
            enclaves, 'enclave', path=full_name(name, namespace)), 'profiles'),
            'profile', ns=f'/{namespace.strip("/")}', node=name)
        for (kind, role), qualifier in QUALIFIERS.items():
            names = sorted({one.name for one in allowed if (one.kind, one.role) == (kind, role)})
            if names:
                group = ElementTree.SubElement(profile, f'{kind}s', {qualifier: 'ALLOW'})
                for each in names:
                    ElementTree.SubElement(group, kind).text = each
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, "unicode")}\n'


def profiles(values: Mapping[str, Value]) -> dict[str, set[Interface]]:
    """
    Return the permissions of each node and each kind of program, by its name; see policy.

    VIEWER subscribes, as the recorder does.  INPUTS publishes the topics that nodes subscribe to
    and no node publishes: sensors, obstacles, an emergency stop.  CLIENT does both, commands the
    tendons, and calls every service and action.
    """
    listed = {name: {*_numbered(interfaces(name), values)} for name in documented_nodes()}
    for parameter, node in DRIVERS.items():
        listed[node] |= {*_of_driver(values, parameter)}
    found = {name: own | {*OF_EVERY_NODE, *(OF_LIFECYCLE_NODES * is_lifecycle_node(name))}
             for name, own in listed.items()}
    # Nodes of other packages may have any name; those of this one have no parameters.
    program = {one for one in OF_EVERY_NODE if one.kind == 'topic'} | {DESCRIBES_TYPES}
    found[VIEWER] = program | {one for one in listed[RECORDER]
                               if one.role in ('subscribes', 'calls')}
    everything = [(name, _outside(name, one)) for name, own in listed.items() for one in own]
    published = {one.name for _, one in everything if one.role == 'publishes'}
    inputs = {replace(one, role='publishes') for name, one in everything
              if one.role == 'subscribes' and EVERYTHING not in one.name
              and one.name not in published | {*SHARED}}
    found[INPUTS] = program | inputs
    commands = {replace(one, role='calls') for _, one in everything if one.role == SERVED}
    commands |= {Interface('service', 'calls', f'{name}/set_parameters', SET_PARAMETERS)
                 for name in listed}
    commands |= {replace(one, role='publishes') for name, one in everything
                 if one.role == 'subscribes' and one.name.startswith(f'{name}/')
                 and replace(one, role='publishes') not in {
                     _outside(name, own) for own in listed[name]}}
    found[CLIENT] = found[VIEWER] | inputs | commands
    return found


def _outside(node: str, one: Interface) -> Interface:
    """Return the name of an interface for other nodes: without ~."""
    return replace(one, name=re.sub('^~', node, one.name))


def _of_driver(values: Mapping[str, Value], parameter: str) -> Iterator[Interface]:
    """Yield the topics of other nodes that the driver of a parameter uses."""
    for role, topics in zip(('publishes', 'subscribes'),
                            chosen_families(values)[parameter].topics(values), strict=True):
        for name, kind in topics.items():
            if not TOPIC.fullmatch(name):
                raise ParameterError(f'a topic of {parameter} is {name!r}, which is not a valid '
                                     'topic name: use letters, digits, _ and /')
            yield Interface('topic', role, name, kind.replace('/', '/msg/'))


def _numbered(rows: Iterable[Interface], values: Mapping[str, Value]) -> Iterator[Interface]:
    """Yield the rows with the names of segments, discs and nodes."""
    segments = len(arm_from_parameters(dict(values)).segments)
    meant = {'segment_N': [f'segment_{n}' for n in range(1, segments + 1)],
             'disc_N': [f'disc_{n}' for n in range(segments + 1)], 'NODE': DESCRIBED}
    for row in rows:
        part = next((part for part in meant if part in row.name), '')
        for one in meant.get(part, ['']):
            yield replace(row, name=row.name.replace(part, one))
