# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A client says what the arm must not touch, and sees what the sequencer plans with."""

import json
from pathlib import Path

import numpy as np
import pytest

from soft_continuum.client import ClientError, RefusedError
from soft_continuum.planning.obstacles import (
    Box,
    Capsule,
    Cylinder,
    Mesh,
    Obstacle,
    Sphere,
    turned_by,
)
from soft_continuum.planning.obstacles.files import load_obstacles

EXAMPLE = Path(__file__).resolve().parents[2] / 'config' / 'obstacles_example.yaml'
TETRAHEDRON = Mesh(np.array([[0.2, 0, 0], [0.3, 0, 0], [0.2, 0.1, 0], [0.2, 0, 0.1]]),
                   np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
SHELF = Obstacle('shelf', Box((0.1, 0.2, 0.01)), (0.2, 0.0, 0.2), turned_by(0.0, 0.3, 0.0))
PIPE = Obstacle('pipe', Capsule(0.01, 0.3), (-0.2, 0.0, 0.2))


@pytest.fixture(scope='module')
def arm(module_rig):
    """Return a sequencer alone."""
    module_rig.start('shape_sequencer')
    return module_rig


@pytest.fixture
def client(arm, connect):
    client = connect()
    client.obstacles.clear()
    return client


def test_obstacles_are_known_as_they_were_added_until_they_are_removed(client):
    assert client.obstacles.known == ()
    client.obstacles.add(SHELF, PIPE, Obstacle('part', TETRAHEDRON))
    shelf, pipe, part = client.obstacles.known
    assert (shelf, pipe) == (SHELF, PIPE)
    assert (part.name, abs(part.shape.volume)) == ('part', pytest.approx(0.001 / 6))
    moved = Obstacle('shelf', Cylinder(0.02, 0.2), (0.3, 0.0, 0.2))
    client.obstacles.add(moved)
    assert {one.name: one for one in client.obstacles.known}['shelf'] == moved
    client.obstacles.remove('pipe', 'part')
    assert client.obstacles.known == (moved,)
    client.obstacles.add(PIPE, replace=True)
    assert client.obstacles.known == (PIPE,)


def test_a_file_is_loaded_by_the_client(client):
    loaded = client.obstacles.load(EXAMPLE)
    assert loaded == load_obstacles(EXAMPLE) == client.obstacles.known


def test_what_the_sequencer_refuses_is_refused_with_its_reason(client):
    client.obstacles.add(SHELF)
    for _ in range(2):  # the second time, its reason is the same
        with pytest.raises(RefusedError, match='obstacle ball is in the base disc'):
            client.obstacles.add(PIPE, Obstacle('ball', Sphere(0.1)))
    assert client.obstacles.known == (SHELF,)


def test_what_cannot_be_is_an_error_before_anything_is_sent(client, tmp_path):
    with pytest.raises(ClientError, match=r'none.yaml: cannot be read'):
        client.obstacles.load(tmp_path / 'none.yaml')
    with pytest.raises(ClientError, match='there is no obstacle ball; known: none'):
        client.obstacles.remove('ball')


def test_the_command_line_adds_lists_and_removes(client, call, tmp_path):
    status, output, errors = call('obstacles', str(EXAMPLE), '--clear', '--unit', 'mm')
    assert (status, errors) == (0, '')
    lines = output.splitlines()
    assert [line.split()[0] for line in lines[1:]] == ['table', 'shelf', 'post', 'pipe', 'lamp']
    assert lines[2].split() == ['shelf', 'box', '120', '200', '10', '230', '0', '190']
    status, output, _ = call('obstacles', '--remove', 'table', '--json')
    names = [one['name'] for one in json.loads(output)['obstacles']]
    assert (status, names) == (0, ['shelf', 'post', 'pipe', 'lamp'])
    assert call('obstacles', '--clear')[1] == 'no obstacles\n'
    (tmp_path / 'bad.yaml').write_text('obstacles: [{name: a, shape: ball}]')
    status, _, errors = call('obstacles', str(tmp_path / 'bad.yaml'))
    assert status == 1
    assert "shape is 'ball'; allowed: sphere, box" in errors
