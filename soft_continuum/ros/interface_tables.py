# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Interfaces of each node: the tables of its page in ``msg_docs``.

Interfaces of several nodes are in the tables of the README there, with a column ``nodes``.  The
pages are the only source.  A test compares them with the running nodes; the policies of SROS 2 are
generated from them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
import re

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
