# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
``policy``: access permissions over DDS, as a policy file for SROS 2.

It is generated from the tables of the pages in ``msg_docs``: only documented interfaces are
allowed.  Interfaces of several nodes are in the tables of the README there, with a column
``nodes``.  The pages are the only source; a test compares them with the running nodes.  The schema
is policy.xsd, version 0.2.0, of ros2/sros2.  See docs/how_to/set_up_the_network.md.
"""

import argparse
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
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
from soft_continuum.ros.names import JAMMING_VALVES, RECORDER, SHARED, TENDON_ACTUATION
from soft_continuum.ros.parameter_table import DESCRIBED
from soft_continuum.text import write_whole
from soft_continuum.user_files import pages

TITLES = {'Topics': 'topic', 'Services': 'service', 'Actions': 'action'}
SERVED = 'serves'  # what a table without directions is about
COMMON_PAGE = 'README'
ALL_NODES = 'all'  # in the column nodes of its tables
EVERYTHING = '*'
"""In place of a topic name: all topics of the namespace."""


@dataclass(frozen=True)
class Interface:
    """
    A name in a row of a table.

    kind: topic, service or action.  role: publishes, subscribes, serves or calls.  name: relative,
    ``~/name`` for private ones, or absolute; segment_N, disc_N and NODE stand for all of them.
    type: as ``std_msgs/msg/Bool``.
    """

    kind: str
    role: str
    name: str
    type: str


def _services(kind: str, *names: str) -> tuple[Interface, ...]:
    return tuple(Interface('service', SERVED, f'~/{name}', f'{kind}/srv/{camel(name)}')
                 for name in names)


def camel(name: str) -> str:
    """Return the name of a type as services are called after it: GetState for get_state."""
    return name.title().replace('_', '')


OF_EVERY_NODE = (
    Interface('topic', 'publishes', '/rosout', 'rcl_interfaces/msg/Log'),
    Interface('topic', 'publishes', '/parameter_events', 'rcl_interfaces/msg/ParameterEvent'),
    *_services('rcl_interfaces', 'describe_parameters', 'get_parameter_types', 'get_parameters',
               'list_parameters', 'set_parameters', 'set_parameters_atomically'),
    *_services('type_description_interfaces', 'get_type_description'),
)
"""Interfaces of every ROS node, which the pages omit."""
OF_LIFECYCLE_NODES = (
    Interface('topic', 'publishes', '~/transition_event', 'lifecycle_msgs/msg/TransitionEvent'),
    *_services('lifecycle_msgs', 'change_state', 'get_state', 'get_available_states',
               'get_available_transitions'),
    Interface('service', SERVED, '~/get_transition_graph',
              'lifecycle_msgs/srv/GetAvailableTransitions'),
)
"""The same of a node whose page has a section Lifecycle."""

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


def documented_nodes() -> tuple[str, ...]:
    """Return the names of the nodes, and of the programs of a user, that have a page."""
    return tuple(sorted(path.stem for path in (pages() / 'msg_docs').glob('*.md')
                        if path.stem not in (COMMON_PAGE, 'parameters')))


@cache
def interfaces(node: str) -> tuple[Interface, ...]:
    """Return the interfaces of a node from its page and the README; raises ValueError."""
    return tuple(found for page in (node, COMMON_PAGE) for title, kind in TITLES.items()
                 for found in _rows(node, page, title, kind))


def is_lifecycle_node(node: str) -> bool:
    """Whether the page of a node has a section about its lifecycle."""
    return '\n## Lifecycle\n' in _page(node)


@cache
def _page(name: str) -> str:
    return (pages() / 'msg_docs' / f'{name}.md').read_text(encoding='utf-8')


def _rows(node: str, page: str, title: str, kind: str) -> Iterator[Interface]:
    """Yield what rows with a type list for that node, in the tables below a heading."""
    section = re.search(rf'^## {title}\s*\n(.*?)(?=^## |\Z)', _page(page),
                        re.MULTILINE | re.DOTALL)
    header: list[str] = []
    for line in section[1].splitlines() if section else ():
        if not line.startswith('|'):
            header = []
            continue
        cells = [cell.strip() for cell in re.split(r'(?<!\\)\|', line.strip().strip('|'))]
        if not header:
            header = [cell.lower() for cell in cells]
        elif not set(''.join(cells)) <= set('-: '):
            if len(cells) != len(header):
                raise ValueError(f'{page}.md: not as many cells as columns: {line}')
            row = dict(zip(header, cells, strict=True))
            names = re.findall('`([^`]+)`', cells[0])
            nodes = row.get('nodes', ALL_NODES)
            if 'type' in row and (nodes == ALL_NODES or node in nodes.split(', ')):
                if not names:
                    raise ValueError(f'{page}.md: no name in backticks in {cells[0]!r}')
                for name in names:
                    yield Interface(kind, row.get('direction', SERVED).strip('`'),
                                    re.sub(rf'^{node}/', '~/', name), row['type'].strip('`'))
