# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""What a launch file checks before it starts anything."""

from collections.abc import Sequence

import pytest

from soft_continuum.cli.up import check_launch, check_twin, chosen_nodes, start_parser
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.user_files import description_file


def test_what_can_be_started_is_not_refused() -> None:
    check_launch('left', [description_file()])


@pytest.mark.parametrize(('namespace', 'files', 'reason'), [
    ('', ['missing.yaml'], 'missing.yaml: cannot be read: No such file'),
    ('', [description_file(), 'missing.yaml'], 'missing.yaml: cannot be read: No such file'),
    ('a-b', [], "namespace 'a-b' is not valid in ROS"),
])
def test_what_cannot_be_started_is_refused_before_anything_starts(
        namespace: str, files: Sequence[str], reason: str) -> None:
    with pytest.raises(ParameterError, match=reason):
        check_launch(namespace, files)


@pytest.mark.parametrize(('options', 'nodes'), [
    ([], {'tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer'}),
    (['--computer', 'rig'], {'tendon_actuation', 'jamming_valves'}),
    (['--computer', 'workstation', '--camera'], {'kinematics', 'shape_sequencer', 'camera'})])
def test_each_of_two_computers_has_its_nodes(options: Sequence[str], nodes: set[str]) -> None:
    assert set(chosen_nodes(start_parser('up', '').parse_args(options))) == nodes


def test_the_boards_of_the_twin_are_not_on_the_workstation() -> None:
    options = start_parser('up', '').parse_args(['--twin', '--computer', 'workstation'])
    with pytest.raises(ParameterError, match='with --computer rig'):
        check_twin(options)
