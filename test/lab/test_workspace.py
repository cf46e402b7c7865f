# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Reachable tips are those of the shapes they belong to, of planar and of spatial arms."""

from dataclasses import replace
from pathlib import Path
import re

from matplotlib.image import imread
import numpy as np
import pytest

from soft_continuum.lab.analysis import workspace
from soft_continuum.lab.analysis.workspace import (
    furthest_apart,
    sample_workspace,
    SampledWorkspace,
)
from soft_continuum.lab.new_arm.description import complete, describe_arm
from soft_continuum.mechanics import set_shape
from soft_continuum.mechanics.arm import Tendon
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.mechanics.statics import Statics
from soft_continuum.parameters.files import parameters_text
from support import specimen_data as data
from support.two_rods import ARM

WEIGHTLESS = data.DESCRIBED.without_gravity()
TENDON_ARM = str(Path(__file__).parents[2] / 'config' / 'tendon_arm.yaml')


@pytest.fixture(scope='module')
def sets():
    """Return the reach of the arm when its segments are jammed, and when all bend at once."""
    return sample_workspace(ARM, (1, 0), 2, 3), sample_workspace(ARM, (0, 1), 2, 3, jamming=False)


@pytest.mark.parametrize(('arm', 'order', 'angles', 'jamming', 'count'), [
    (data.DESCRIBED, (2, 0, 1), 3, True, 27), (ARM, (1, 0), 2, True, 16),
    (ARM, (0, 1), 2, False, 16)], ids=['planar', 'spatial', 'spatial, at once'])
def test_every_tip_is_that_of_its_bending_in_its_order(arm, order, angles, jamming, count):
    found = sample_workspace(arm, order, angles, 3, jamming)
    assert found.tips.shape == (count, len(arm.axes)) and found.asked == count
    for k in (1, 7, count - 1):
        state = set_shape(Statics(arm), found.bending[k], order=order, jamming=jamming)
        assert state.poses[-1, :3][arm.pose_axes[:3]] == pytest.approx(found.tips[k], abs=1e-6)


def test_the_order_matters_under_gravity_only():
    base_first, tip_first = (0, 1, 2), (2, 1, 0)
    assert furthest_apart(sample_workspace(WEIGHTLESS, base_first, 3),
                          sample_workspace(WEIGHTLESS, tip_first, 3)) < 1e-9
    assert furthest_apart(sample_workspace(data.DESCRIBED, base_first, 3),
                          sample_workspace(data.DESCRIBED, tip_first, 3)) > 1e-3


def test_tips_lie_on_both_sides_alike_and_on_a_line_they_span_no_area():
    found = sample_workspace(data.DESCRIBED, (0, 1, 2), 3)
    for tip in found.tips * [-1.0, 1.0]:
        assert np.linalg.norm(found.tips - tip, axis=1).min() < 1e-9
    assert found.hull > 0.01
    assert replace(found, tips=np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])).hull == 0.0


def test_shapes_that_no_tendon_holds_are_left_out():
    heavy = replace(data.DESCRIBED, payload=5.0)
    found = sample_workspace(heavy, (0, 1, 2), 3)
    assert len(found.tips) == len(found.bending) < found.asked


def test_in_space_tips_fill_a_volume_and_a_jammed_segment_keeps_the_sag_it_had(sets):
    assert furthest_apart(*sets) > 1e-3
    assert sets[0].hull > 1e-4
    flat = sets[0].tips * [1.0, 0.0, 1.0]
    assert SampledWorkspace((0, 1), flat, sets[0].bending, 16).hull == 0.0


def test_a_segment_is_set_towards_a_tendon_whose_angle_is_rounded():
    # As descriptions have it: then the next tendon would carry less than nothing.
    statics = SpaceStatics(replace(ARM, tendons=tuple(
        Tendon(f't{i}', 2.094395 * i, 0.01, 2) for i in range(3))))
    towards = 1.2 * np.array([-np.sin(2 * np.pi / 3), np.cos(2 * np.pi / 3)])
    state = set_shape(statics, [towards, towards])
    assert state.bending == pytest.approx(np.array([towards, towards]), abs=1e-5)
    assert state.tensions[[0, 2]] == pytest.approx(0.0, abs=1e-5)


def test_the_workspace_of_an_arm_in_space_is_a_table_and_a_figure(capsys, tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text(parameters_text(describe_arm(complete(
        {'kind': 'tendons', 'segments': (1.0,)})).values, []), encoding='utf-8')
    assert workspace.main(['--params-file', str(path), '--output', str(tmp_path)]) == 0
    output, progress = capsys.readouterr()
    assert '2 times 31 shapes' in progress
    assert 'y from mm' in output and 'hull cm^3' in output
    assert re.search(r'^gravity +31 +31 ', output, re.MULTILINE)
    colours = imread(tmp_path / 'workspace.png')[:, :, :3]
    assert np.ptp(colours, axis=2).max() < 0.01 and (colours.min(axis=2) < 0.9).mean() > 0.005


@pytest.mark.parametrize(('words', 'reason'), [
    (('--directions', '6'), 'a planar arm bends only in its plane; leave out --directions'),
    (('--directions', '2'), "'2' given; allowed: a whole number from 3 to 72"),
    (('--params-file', TENDON_ARM, '--per-segment', '11'),
     '31 bendings in each of 3 segments are 29791 shapes; --per-segment 4 is the most')])
def test_what_would_take_too_long_or_has_no_meaning_is_refused(capsys, words, reason):
    with pytest.raises(SystemExit) as ended:
        raise SystemExit(workspace.main([*words]))
    assert ended.value.code == 2
    assert reason in capsys.readouterr().err
