# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Workspace and convergence of arms that bend in every direction."""

from dataclasses import replace
from pathlib import Path
import re

from matplotlib.image import imread
import numpy as np
import pytest

from soft_continuum.analysis.convergence import converge
from soft_continuum.analysis.workspace import furthest_apart, Reach, reach
from soft_continuum.cli import converge as cli_converge
from soft_continuum.cli import workspace
from soft_continuum.mechanics.arm import Disc
from soft_continuum.mechanics.spatial import (
    pulls_for_bending,
    set_shape,
    spatial,
    SpatialArm,
    SpatialSegment,
    SpatialStatics,
    SpatialTendon,
)
from soft_continuum.new_arm.description import complete, describe
from soft_continuum.parameters.files import load_arm, parameters_text

RODS = (SpatialSegment(0.08, 0.003, 0.003, 0.002, 0.01, bending_angle_limit=1.2),) * 2
TENDONS = tuple(SpatialTendon(f'{end}_{i}', 2.094395 * i + 0.5 * end, 0.01, end, compliance=1e-4)
                for end in (1, 2) for i in range(3))
TENDON_ARM = str(Path(__file__).parents[2] / 'config' / 'tendon_arm.yaml')
ARM = SpatialArm(RODS, (Disc(0.005, 0.01),) * 3, TENDONS, 4, 3)
"""Two rods with three tendons each, upright."""


@pytest.fixture(scope='module')
def sets():
    """Return the reach of the arm when its segments are jammed, and when all bend at once."""
    return reach(ARM, (1, 0), 2, 3), reach(ARM, (0, 1), 2, 3, jamming=False)


def test_every_tip_in_space_is_that_of_its_bending(sets):
    one_by_one, at_once = sets
    statics = SpatialStatics(ARM)
    assert one_by_one.tips.shape == at_once.tips.shape == (16, 3)
    for k in (1, 6, 15):
        bending = one_by_one.bending[k]
        assert set_shape(statics, bending, order=(1, 0)).tip == pytest.approx(
            one_by_one.tips[k], abs=1e-6)
        bending = at_once.bending[k]
        fit = pulls_for_bending(statics, statics.chain.straight(), bending, (True, True))
        assert fit.state.tip == pytest.approx(at_once.tips[k], abs=1e-6)


def test_a_jammed_segment_keeps_the_sag_it_had(sets):
    assert furthest_apart(*sets) > 1e-3


def test_an_arm_in_space_fills_a_volume_and_one_in_a_plane_does_not(sets):
    assert sets[0].hull > 1e-4
    flat = sets[0].tips * [1.0, 0.0, 1.0]
    assert Reach((0, 1), flat, sets[0].bending, 16).hull == 0.0


def test_a_segment_is_set_towards_a_tendon_whose_angle_is_rounded():
    # As descriptions have it: then the next tendon would carry less than nothing.
    statics = SpatialStatics(replace(ARM, tendons=tuple(
        SpatialTendon(f't{i}', 2.094395 * i, 0.01, 2) for i in range(3))))
    towards = 1.2 * np.array([-np.sin(2 * np.pi / 3), np.cos(2 * np.pi / 3)])
    state = set_shape(statics, [towards, towards])
    assert state.bending == pytest.approx(np.array([towards, towards]), abs=1e-5)
    assert state.tensions[[0, 2]] == pytest.approx(0.0, abs=1e-5)


@pytest.fixture
def description(tmp_path):
    """Return a file that describes an arm of one segment, without jamming."""
    path = tmp_path / 'arm.yaml'
    path.write_text(parameters_text(describe(complete(
        {'kind': 'tendons', 'segments': (1.0,)})).values, []), encoding='utf-8')
    return path


def test_the_workspace_of_an_arm_in_space_is_a_table_and_a_figure(capsys, tmp_path, description):
    assert workspace.main(['--params-file', str(description), '--output', str(tmp_path)]) == 0
    output, progress = capsys.readouterr()
    assert '2 times 31 shapes' in progress
    assert 'y from mm' in output and 'hull cm^3' in output
    assert re.search(r'^gravity +31 +31 ', output, re.MULTILINE)
    colours = imread(tmp_path / 'workspace.png')[:, :, :3]
    assert np.ptp(colours, axis=2).max() < 0.01 and (colours.min(axis=2) < 0.9).mean() > 0.005


@pytest.mark.parametrize(('words', 'reason'), [
    (('--directions', '6'), 'a planar arm bends in its plane; leave out --directions'),
    (('--directions', '2'), "'2' given; allowed: a whole number from 3 to 72"),
    (('--params-file', TENDON_ARM, '--per-segment', '11'),
     '31 bendings in each of 3 segments are 29791 shapes; --per-segment 4 is the most')])
def test_what_would_take_too_long_or_has_no_meaning_is_refused(capsys, words, reason):
    with pytest.raises(SystemExit) as ended:
        raise SystemExit(workspace.main([*words]))
    assert ended.value.code == 2
    assert reason in capsys.readouterr().err


# Convergence.


def test_a_planar_arm_converges_in_space_as_it_does_in_the_plane():
    flat = load_arm().without_gravity()
    angles = np.radians([36.0, 20.0, 36.0])
    one, other = converge(flat, angles, 1e-3, 5), converge(spatial(flat), angles, 1e-3, 5)
    assert other.bodies.tolist() == one.bodies.tolist() == [2, 3, 4, 5]
    assert other.angles == pytest.approx(one.angles, rel=1e-6)
    assert other.error == pytest.approx(one.error, rel=1e-4)


def test_with_spacers_the_bodies_are_multiples_of_their_spans():
    found = converge(ARM.without_gravity(), (0.6, 0.6), 0.01, 16, jamming=False)
    assert found.bodies.tolist() == [4, 8, 12, 16]
    assert found.angles[0] == pytest.approx([0.6, 0.6], abs=1e-5)  # as the arm is described
    assert np.all(np.diff(found.error, axis=0) < 0.0)
    assert found.converged == 8


def test_too_few_bodies_to_compare_are_refused(capsys):
    assert cli_converge.main(['--params-file', TENDON_ARM, '--most', '19']) == 2
    assert 'multiples of 10, so up to 19 bodies' in capsys.readouterr().err
