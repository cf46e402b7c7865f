# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a launch file checks before it starts anything."""

import pytest

from soft_continuum.cli.up import check_launch, check_twin, chosen_nodes, start_parser
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.user_files import description_file


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
