# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The file of model errors of a twin is read, or refused with what is allowed."""

import pytest
import yaml

from soft_continuum.sim.twin.model_errors import (
    CylinderObstacle,
    RANGES,
    read_model_errors,
    TwinError,
)
from soft_continuum.ui.cli import twin
from soft_continuum.user_files import description_file

FILE = description_file().with_name('twin.yaml')


def changed(tmp_path, **values):
    """A file with one preset, of which some values are others."""
    presets = yaml.safe_load(FILE.read_text(encoding='utf-8'))
    path = tmp_path / 'my_twin.yaml'
    mine = presets['typical'] | values
    path.write_text(yaml.safe_dump({'mine': {k: v for k, v in mine.items() if v is not None}}))
    return path


@pytest.mark.parametrize('preset', twin.PRESETS)
def test_every_preset_of_the_file_can_be_read(preset):
    found = read_model_errors(FILE, preset)
    assert all(name in FILE.read_text(encoding='utf-8') for name in RANGES)
    assert found.stiffness_factors


@pytest.mark.parametrize(('values', 'words'), [
    ({'stiff_ratio': 0.5}, 'stiff_ratio is 0.5; allowed: 1.1 to 100000'),
    ({'stiff_ratio': '50'}, 'stiff_ratio'), ({'seed': 1.5}, 'seed is 1.5'),
    ({'mass_factor': True}, 'mass_factor is True'),
    ({'backlash': float('nan')}, 'backlash'),
    ({'stiffness_factors': [1.0, -1.0]}, 'stiffness_factors is -1.0'),
    ({'stiffness_factors': []}, 'stiffness_factors'),
    ({'occluders': 1.0}, 'occluders is 1.0'), ({'obstacles': 3}, 'such as [{x: 0.08'),
    ({'obstacles': None}, 'nothing else'), ({'obstacles': [{'x': 0.1, 'z': 0.1}]}, 'in m, of 100'),
    ({'obstacles': [{'x': 0.1, 'z': 0.1, 'radius': 0.0}]}, 'radius of obstacle 1 is 0.0'),
    ({'obstacles': [{'x': '0', 'z': 0.1, 'radius': 0.1}]}, "x of obstacle 1 is '0'"),
    ({'obstacles': [{'x': n, 'z': 0, 'radius': 1} for n in range(101)]}, 'of 100 at most'),
    ({'seed': None}, 'must hold these and nothing else'), ({'sed': 1}, 'nothing else')])
def test_a_value_that_is_not_allowed_is_named(tmp_path, capsys, values, words):
    path = changed(tmp_path, **values)
    with pytest.raises(TwinError, match='my_twin.yaml'):
        read_model_errors(path, 'mine')
    assert twin.main(['--file', str(path), '--preset', 'mine']) == 2
    error = capsys.readouterr().err
    assert words in error
    assert len(error.splitlines()) == 1


@pytest.mark.parametrize(('text', 'words'), [
    ('', 'names to presets'), ('a: [', 'my_twin.yaml'), ('a: {}', 'has no preset typical')])
def test_a_file_of_something_else_is_refused(tmp_path, capsys, text, words):
    path = tmp_path / 'my_twin.yaml'
    path.write_text(text)
    assert twin.main(['--file', str(path)]) == 2
    assert words in capsys.readouterr().err


def test_obstacles_are_read(tmp_path):
    listed = [{'x': 0.1, 'z': 0.2, 'radius': 0.03}, {'x': -1, 'z': 0, 'radius': 1}]
    found = read_model_errors(changed(tmp_path, obstacles=listed), 'mine').obstacles
    assert found == (CylinderObstacle(0.1, 0.2, 0.03), CylinderObstacle(-1, 0, 1))


def test_a_file_that_is_not_there_is_named(tmp_path, capsys):
    assert twin.main(['--file', str(tmp_path / 'none.yaml')]) == 1
    assert 'none.yaml' in capsys.readouterr().err
