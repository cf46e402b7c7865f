# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The zero and the scale of load cells are found, whichever way they are mounted."""

from itertools import cycle

import pytest
from sensor_msgs.msg import JointState

from soft_continuum.commissioning import calibrate, calibrate_load_cells
from soft_continuum.ros.description import load_description
from support.ros_rig import STREAM

NAMES = ('right_tendon', 'left_tendon')
ZEROS, SCALES = (1000.0, -500.0), (0.01, -0.02)
MASS, WEIGHT = 2.0, 2.0 * 9.80665


@pytest.fixture(scope='module')
def cells(module_rig):
    """Publish raw numbers of two cells; return the tensions that they carry, N, to be changed."""
    tensions = dict.fromkeys(NAMES, 0.0)
    publisher = module_rig.observer.create_publisher(JointState, 'load_cells', STREAM)
    noise = cycle((0.5, -0.5))

    def publish():
        more = next(noise)
        publisher.publish(JointState(name=list(tensions), effort=[
            zero + tension / scale + more
            for zero, scale, tension in zip(ZEROS, SCALES, tensions.values(), strict=False)]))

    module_rig.observer.create_timer(0.01, publish)
    return tensions


@pytest.fixture
def run(cells, module_domain, tmp_path, monkeypatch, capfd):
    """Return a function that calibrates, with what is hung up at each question."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(module_domain))
    monkeypatch.setattr(calibrate_load_cells, 'DURATION', 1.0)

    def call(hung, *options, timeout=60.0):
        monkeypatch.setattr('builtins.input', lambda question: hung(
            question + capfd.readouterr().out))
        status = calibrate.main(['load_cells', '--namespace', 'arm_under_test', '--timeout',
                                 str(timeout), '--output', str(tmp_path), *options])
        return status, capfd.readouterr().err

    return call


def test_a_known_mass_on_each_tendon_gives_newtons(cells, run, tmp_path):
    def hung(question):
        for name in NAMES:
            cells[name] = WEIGHT if name in question else 0.0
        return 'yes'

    status, said = run(hung, '--mass', str(MASS))
    assert (status, said) == (0, ''), said
    found = load_description(tmp_path / calibrate_load_cells.FILE, node='tendon_actuation')
    assert found['load_cells.enabled'] is True
    assert found['load_cells.zeros'] == pytest.approx(ZEROS, abs=0.5)
    assert found['load_cells.scales'] == pytest.approx(SCALES, rel=1e-3)


def test_a_mass_that_the_cell_does_not_feel_is_told(run, cells, tmp_path):
    cells.update(dict.fromkeys(NAMES, 0.0))
    status, said = run(lambda question: 'yes', '--mass', str(MASS))
    assert status == 1
    assert 'right_tendon' in said
    assert 'is it the cell of this tendon' in said
    assert not list(tmp_path.iterdir())


def test_without_a_cell_of_each_tendon_nothing_is_written(run, cells, tmp_path):
    left = cells.pop('left_tendon')
    try:
        status, said = run(lambda question: 'yes', '--zero-only', '--yes', timeout=2.0)
    finally:
        cells['left_tendon'] = left
    assert status != 0
    assert 'left_tendon on the topic load_cells' in said
    assert 'fewer than 5 readings' in said
    assert not list(tmp_path.iterdir())
