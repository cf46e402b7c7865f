# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of shapes can be read and show what they should."""

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.image import imread
import numpy as np
import pytest

from soft_continuum.analysis.figures import draw_arm, shapes_figure
from soft_continuum.mechanics import Chain
from soft_continuum.mechanics.space.chain import SpaceChain
from soft_continuum.parameters.files import load_arm
from soft_continuum.parameters.shapes import PAPER_SHAPES

DESCRIPTION = Path(__file__).resolve().parents[2] / 'config' / 'manipulator.yaml'
CHAIN = Chain(load_arm(DESCRIPTION))
SHAPES = {name: (CHAIN.uniform(angles), CHAIN.uniform(angles).bending)
          for name, angles in PAPER_SHAPES.items()}
BENDING = [[0.0, 0.4], [0.3, 0.3], [-0.5, 0.1]]
IN_SPACE = SpaceChain(CHAIN.arm).uniform(BENDING)


def first(count):
    return dict(list(SHAPES.items())[:count])


def dark(picture):
    """Where a picture (rows, columns, channels) is neither white nor transparent."""
    return picture[:, :, :3].min(axis=2) < 0.9


@pytest.mark.parametrize('count', [1, 2, 3])
def test_a_picture_of_shapes_is_a_readable_png(tmp_path, count):
    path = tmp_path / 'shapes.png'
    shapes_figure(path, first(count))
    assert path.read_bytes().startswith(b'\x89PNG\r\n')
    picture = imread(path)
    rows, columns = picture.shape[:2]
    assert rows >= 500 and columns >= 400 * count
    ink = dark(picture)
    for panel in np.array_split(ink, count, axis=1):  # every panel shows something
        assert 0.01 < panel.mean() < 0.5
    # Nothing is cut off at the edge, such as the legend.
    assert not ink[:, 0].any() and not ink[:, -1].any()
    assert not ink[0].any() and not ink[-1].any()


@pytest.mark.parametrize('name', [r'$\broken$', 'C-form \u00fc, 50 % $'])
def test_a_shape_may_have_any_name(tmp_path, name):
    path = tmp_path / 'shapes.pdf'
    shapes_figure(str(path), {name: SHAPES['c_form']})
    assert path.read_bytes().startswith(b'%PDF')


@pytest.mark.parametrize('state', [SHAPES['c_form'][0], IN_SPACE], ids=['planar', 'in space'])
def test_the_arm_is_drawn_in_millimetres_where_the_chain_is(state):
    axes = Figure().subplots()
    draw_arm(axes, state)
    drawn = {line.get_label(): line.get_xydata() for line in axes.get_lines()}
    assert drawn['rigid chain, calculation points'] == pytest.approx(1e3 * state.poses[:, [0, 2]])
    guides = [1e3 * tendon[:, [0, 2]] for tendon in state.tendon_points]
    assert drawn['right tendon'] == pytest.approx(guides[0])
    assert drawn['left tendon'] == pytest.approx(guides[1])
    assert axes.get_aspect() == 1.0


def test_a_straight_arm_stands_from_the_origin_to_its_length():
    axes = Figure().subplots()
    draw_arm(axes, CHAIN.straight())
    points = {line.get_label(): line.get_xydata() for line in axes.get_lines()}[
        'rigid chain, calculation points']
    assert points[0] == pytest.approx((0.0, 0.0))
    assert points[-1] == pytest.approx((0.0, 330.0))


def test_a_picture_of_shapes_in_space_is_a_readable_png(tmp_path):
    path = tmp_path / 'in_space.png'
    shapes_figure(path, {'bow': (IN_SPACE, np.array(BENDING))})
    assert imread(path).std() > 0.05  # something is drawn
