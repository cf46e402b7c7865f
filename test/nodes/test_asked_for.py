# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A driver that is asked for at the start is the one that the node gets, whatever files say."""

from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from soft_continuum.nodes.up import asked_file, description_file

NAME, KEY = 'tendon_actuation', 'tendon_driver'
SECTIONS = ('/**', NAME, f'/left/{NAME}', '/left/*', '/*')


@pytest.mark.parametrize('namespace', ['', '/left'])
@pytest.mark.parametrize('section', SECTIONS)
def test_what_is_asked_for_wins_over_every_section(
        section: str, namespace: str, tmp_path: Path, domain: int) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(f'"{section}":\n  ros__parameters:\n    {KEY}: dynamixel\n', encoding='utf-8')
    files = [description_file(), file]
    files.append(asked_file(files, {KEY: 'grbl'}))
    context = Context()
    rclpy.init(args=[NAME, '--ros-args',
                     '-r', f'__node:={NAME}', '-r', f'__ns:={namespace or "/"}',
                     *(word for one in files for word in ('--params-file', str(one)))],
               context=context, domain_id=domain)
    node = Node('unnamed', context=context, automatically_declare_parameters_from_overrides=True)
    try:
        assert node.get_parameter(KEY).value == 'grbl'
    finally:
        node.destroy_node()
        context.shutdown()
