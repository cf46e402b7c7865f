# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures show obstacles where they are, as they are seen along y."""

from math import pi

from matplotlib.figure import Figure
import numpy as np
import pytest

from soft_continuum.analysis.obstacle_figures import draw_obstacles, faces, outlines
from soft_continuum.obstacles import Box, Capsule, Cylinder, Mesh, Obstacle, Sphere, turned_by

PLACE = (0.1, 0.05, 0.2)
ALONG_Y = turned_by(pi / 2, 0.0, 0.0)
ALONG_X = turned_by(0.0, pi / 2, 0.0)
TETRAHEDRON = Mesh(np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]),
                   np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))


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
