# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The pages of msg_docs list the topics, services and actions of the nodes: no more, no less."""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
import re

import pytest
from rclpy.action import get_action_server_names_and_types_by_node
from ros_rig import ALL, DEADLINE, Rig

from soft_continuum.ros.names import CAMERA, DISC_SENSORS, RECORDER, SERVO, TELEOP

PAGES = Path(__file__).resolve().parents[2] / 'msg_docs'
OF_EVERY_NODE = {
    '/rosout', '/parameter_events', '/clock', '~/describe_parameters', '~/get_parameter_types',
    '~/get_parameters', '~/list_parameters', '~/set_parameters', '~/set_parameters_atomically',
    '~/get_type_description',
}
LIFECYCLE = {
    '~/transition_event', '~/change_state', '~/get_state', '~/get_available_states',
    '~/get_available_transitions', '~/get_transition_graph',
}
Row = dict[str, str]


def section(node: str, title: str) -> list[Row]:
    """Return the rows of the tables below a heading of a page, by lower-case column name."""
    text = (PAGES / f'{node}.md').read_text(encoding='utf-8')
    found = re.search(rf'^## {title}\s*\n(.*?)(?=^## |\Z)', text, re.MULTILINE | re.DOTALL)
    rows, header = [], []
    for line in found[1].splitlines() if found else ():
        if not line.startswith('|'):
            header = []
            continue
        cells = [cell.strip() for cell in re.split(r'(?<!\\)\|', line.strip().strip('|'))]
        if not header:
            header = [cell.lower() for cell in cells]
        elif not set(''.join(cells)) <= set('-: '):
            assert len(cells) == len(header), f'{node}.md: {line}'
            rows.append(dict(zip(header, cells, strict=True)))
    return rows


def name_of(node: str, row: Row) -> str:
    """Return the name in the first column of a row, private names as ~/name."""
    first = next(iter(row.values()))
    found = re.search('`([^`]+)`', first)
    assert found, f'{node}.md: no name in backticks in {first!r}'
    return re.sub(rf'^{node}/', '~/', found[1])


def documented(node: str, title: str, direction: str = '') -> dict[str, str]:
    """Return type by name, of the rows with a direction if one is asked for."""
    return {
        name_of(node, row): row['type'].strip('`') for row in section(node, title)
        if not direction or row.get('direction', direction).strip('`').startswith(direction)}


def in_graph(rig: Rig, node: str, found: Iterable[tuple[str, list[str]]]) -> dict[str, str]:
    """Return type by name as the pages write it."""
    names = {}
    for name, types in found:
        short = name.removeprefix(f'{rig.namespace}/')
        short = re.sub(rf'^{node}/', '~/', short)
        short = re.sub(r'(segment|disc)_\d+', r'\1_N', short)
        if '/_' not in short and short not in OF_EVERY_NODE:
            names[short] = re.sub('/(msg|srv|action)/', '/', types[0])
    return names


def assert_same(node: str, kind: str, on_page: dict[str, str],
                in_graph: Callable[[], dict[str, str]], rig: Rig) -> None:
    """Claim that page and graph agree; what every lifecycle node has may be left out."""
    on_page = {name: re.sub('/(msg|srv|action)/', '/', of) for name, of in on_page.items()}

    def found() -> dict[str, str]:
        return {name: of for name, of in in_graph().items()
                if name in on_page or name not in LIFECYCLE}

    rig.until(lambda: on_page == found(), DEADLINE)
    assert on_page == found(), f'msg_docs/{node}.md, {kind}: the page has the first, the graph'


@pytest.mark.parametrize('node', [*ALL, DISC_SENSORS, RECORDER, SERVO, TELEOP])
def test_the_page_of_a_node_lists_its_topics_services_and_actions(rig: Rig, node: str) -> None:
    if node == TELEOP:
        rig.start_arm()  # it asks for the number of segments
    rig.start(node, ready=node in ALL, load_cells__used=True)
    observer, space = rig.observer, rig.namespace
    for kind, on_page, found in (
            ('publishes topics', documented(node, 'Topics', 'publishes'),
             observer.get_publisher_names_and_types_by_node),
            ('subscribes topics', documented(node, 'Topics', 'subscribes'),
             observer.get_subscriber_names_and_types_by_node),
            ('serves services', documented(node, 'Services', 'serves'),
             observer.get_service_names_and_types_by_node),
            ('serves actions', documented(node, 'Actions', 'serves'),
             partial(get_action_server_names_and_types_by_node, observer))):
        assert_same(node, kind, on_page, lambda of=found: in_graph(rig, node, of(node, space)),
                    rig)


def test_there_is_a_page_for_every_node_and_no_other_node() -> None:
    pages = {path.stem for path in PAGES.glob('*.md')} - {'README', 'parameters'}
    assert pages == {*ALL, CAMERA, DISC_SENSORS, RECORDER, SERVO, TELEOP}
