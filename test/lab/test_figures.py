# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of shapes and obstacles can be read and show what they should."""

from math import pi
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.image import imread
import numpy as np
import pytest

from soft_continuum.mechanics import Chain
from soft_continuum.mechanics.drawing import draw_arm
from soft_continuum.mechanics.space.chain import SpaceChain
from soft_continuum.parameters.shapes import PAPER_SHAPES
from soft_continuum.planning.obstacles import (
    Box,
    Capsule,
    Cylinder,
    Mesh,
    Obstacle,
    Sphere,
    turned_by,
)
from soft_continuum.planning.obstacles.drawing import draw_obstacles, faces, outlines
from soft_continuum.ros.description import load_arm
from soft_continuum.ui.cli.demo import shapes_figure

DESCRIPTION = Path(__file__).resolve().parents[2] / 'config' / 'manipulator.yaml'
CHAIN = Chain(load_arm(DESCRIPTION))
SHAPES = {name: (CHAIN.uniform(angles), CHAIN.uniform(angles).bending)
          for name, angles in PAPER_SHAPES.items()}
BENDING = [[0.0, 0.4], [0.3, 0.3], [-0.5, 0.1]]
IN_SPACE = SpaceChain(CHAIN.arm).uniform(BENDING)
PLACE = (0.1, 0.05, 0.2)
ALONG_Y = turned_by(pi / 2, 0.0, 0.0)
ALONG_X = turned_by(0.0, pi / 2, 0.0)
TETRAHEDRON = Mesh(np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]),
                   np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))


@pytest.mark.parametrize('shapes', [
    dict([*SHAPES.items()][:1]), SHAPES, {'bow': (IN_SPACE, np.array(BENDING))}],
    ids=['one', 'three', 'in space'])
def test_a_picture_of_shapes_is_a_readable_png(tmp_path, shapes):
    path = tmp_path / 'shapes.png'
    shapes_figure(path, shapes)
    assert path.read_bytes().startswith(b'\x89PNG\r\n')
    picture = imread(path)
    rows, columns = picture.shape[:2]
    assert rows >= 500 and columns >= 400 * len(shapes)
    ink = picture[:, :, :3].min(axis=2) < 0.9
    for panel in np.array_split(ink, len(shapes), axis=1):  # every panel shows something
        assert 0.01 < panel.mean() < 0.5
    # Nothing is cut off at the edge, such as the legend.
    assert not ink[:, [0, -1]].any() and not ink[[0, -1]].any()


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


def area(outline):
    """Return the area within corners (n, 2)."""
    x, z = outline.T
    return abs(x @ np.roll(z, 1) - z @ np.roll(x, 1)) / 2


@pytest.mark.parametrize(('shape', 'turn', 'wanted'), [
    (Sphere(0.03), ALONG_X, pi * 30**2),
    (Box((0.1, 0.2, 0.3)), ALONG_Y, 100 * 200),
    (Cylinder(0.02, 0.3), ALONG_Y, pi * 20**2),
    (Cylinder(0.02, 0.3), ALONG_X, 40 * 300),
    (Capsule(0.02, 0.3), ALONG_X, 40 * 300 + pi * 20**2)])
def test_an_outline_has_the_area_of_the_shadow(shape, turn, wanted):
    outline, = outlines([Obstacle('it', shape, PLACE, turn)])
    assert area(outline) == pytest.approx(wanted, rel=0.02)
    middle = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
    np.testing.assert_allclose(middle, [100.0, 200.0], atol=0.3)


def test_of_a_mesh_every_triangle_is_drawn():
    triangles = faces([Obstacle('it', TETRAHEDRON, PLACE)])
    assert [face.shape for face in triangles] == [(3, 3)] * 4
    np.testing.assert_allclose(np.vstack(triangles).min(axis=0), [100.0, 50.0, 200.0])


def test_axes_show_obstacles_as_far_as_the_arm_reaches():
    axes = Figure().subplots()
    axes.plot([0.0, 10.0], [0.0, 300.0])
    draw_obstacles(axes, [Obstacle('wall', Box((0.1, 1.0, 9.0)), (0.2, 0.0, 0.0))], reach=0.33)
    (low, high), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert low < 0.0 < 250.0 <= high < 330.0
    assert -400.0 < bottom <= -330.0 and 330.0 <= top < 400.0
