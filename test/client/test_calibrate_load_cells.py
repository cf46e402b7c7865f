# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The zero and the scale of load cells are found, whichever way they are mounted."""

from collections.abc import Callable
from itertools import cycle
from pathlib import Path
from typing import Any

import pytest
from sensor_msgs.msg import JointState

from soft_continuum.commissioning import calibrate, calibrate_load_cells
from soft_continuum.parameters.files import load_description
from support.ros_rig import Rig, STREAM

NAMES = ('right_tendon', 'left_tendon')
ZEROS, SCALES = (1000.0, -500.0), (0.01, -0.02)
MASS, WEIGHT = 2.0, 2.0 * 9.80665


@pytest.fixture(scope='module')
def cells(module_rig: Rig) -> dict[str, float]:
    """Publish raw numbers of two cells; return the tensions that they carry, N, to be changed."""
    tensions = dict.fromkeys(NAMES, 0.0)
    publisher = module_rig.observer.create_publisher(JointState, 'load_cells', STREAM)
    noise = cycle((0.5, -0.5))

    def publish() -> None:
        more = next(noise)
        publisher.publish(JointState(name=list(tensions), effort=[
            zero + tension / scale + more
            for zero, scale, tension in zip(ZEROS, SCALES, tensions.values(), strict=False)]))

    module_rig.observer.create_timer(0.01, publish)
    return tensions


@pytest.fixture
def run(cells: dict[str, float], module_domain: int, tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch, capfd: Any) -> Callable[..., tuple[int, str]]:
    """Return a function that calibrates, with what is hung up at each question."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(module_domain))
    monkeypatch.setattr(calibrate_load_cells, 'DURATION', 1.0)

    def call(hung: Callable[[str], str], *options: str, timeout: float = 60.0
             ) -> tuple[int, str]:
        monkeypatch.setattr('builtins.input', lambda question: hung(
            question + capfd.readouterr().out))
        status = calibrate.main(['load_cells', '--namespace', 'arm_under_test', '--timeout',
                                 str(timeout), '--output', str(tmp_path), *options])
        return status, capfd.readouterr().err

    return call


def test_a_known_mass_on_each_tendon_gives_newtons(
        cells: dict[str, float], run: Callable[..., tuple[int, str]], tmp_path: Path) -> None:
    def hung(question: str) -> str:
        for name in NAMES:
            cells[name] = WEIGHT if name in question else 0.0
        return 'yes'

    status, said = run(hung, '--mass', str(MASS))
    assert (status, said) == (0, ''), said
    found = load_description(tmp_path / calibrate_load_cells.FILE, node='tendon_actuation')
    assert found['load_cells.enabled'] is True
    assert found['load_cells.zeros'] == pytest.approx(ZEROS, abs=0.5)
    assert found['load_cells.scales'] == pytest.approx(SCALES, rel=1e-3)


def test_a_mass_that_the_cell_does_not_feel_is_told(
        run: Callable[..., tuple[int, str]], cells: dict[str, float], tmp_path: Path) -> None:
    cells.update(dict.fromkeys(NAMES, 0.0))
    status, said = run(lambda question: 'yes', '--mass', str(MASS))
    assert status == 1
    assert 'right_tendon' in said
    assert 'is it the cell of this tendon' in said
    assert not list(tmp_path.iterdir())


def test_without_a_cell_of_each_tendon_nothing_is_written(
        run: Callable[..., tuple[int, str]], cells: dict[str, float], tmp_path: Path) -> None:
    left = cells.pop('left_tendon')
    try:
        status, said = run(lambda question: 'yes', '--zero-only', '--yes', timeout=2.0)
    finally:
        cells['left_tendon'] = left
    assert status != 0
    assert 'left_tendon on the topic load_cells' in said
    assert 'fewer than 5 readings' in said
    assert not list(tmp_path.iterdir())
