# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arm of the model is drawn over the picture where a camera would see it."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.estimation.sensing.tag_camera import overlay, OVERLAY_SIZE, TagCamera
from support.views import EXACT, space_views, views

ANGLES = (0.3, -0.2, 0.4)


def points(*bending_angles):
    """Return the poses of bottom and top of each disc."""
    return views.CHAIN.uniform(bending_angles).poses


def drawn(*arguments):
    """Return the overlay as colours, red first."""
    data = np.frombuffer(overlay(*arguments), dtype=np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1].astype(int)
    assert max(picture.shape) == OVERLAY_SIZE
    return picture


def magenta(picture):
    """Return the pixels (k, 2) of the model, column first."""
    red, green, blue = np.moveaxis(picture, 2, 0)
    return np.argwhere((red - green > 90) & (blue - green > 60))[:, ::-1]


def teal(picture):
    """Return the pixels (k, 2) of tags, column first."""
    red, green, blue = np.moveaxis(picture, 2, 0)
    return np.argwhere((green - red > 60) & (blue - red > 60))[:, ::-1]


@pytest.fixture(scope='module')
def ideal():
    """Return a camera that is as it is said to be, its tags, and a picture of the bent arm."""
    camera = views.camera()
    return camera, TagCamera(camera._layout, camera.lens), camera.picture(views.poses(*ANGLES))


@pytest.mark.parametrize('preset', ['ideal', 'severe'])
def test_the_model_is_where_the_camera_sees_it(preset):
    camera = views.camera(preset, **EXACT, calibration_error=0.0)
    tags = TagCamera(camera._layout, camera.lens)
    picture = camera.picture(views.poses(0.0, 0.0, 0.0))
    model = points(*ANGLES)
    pixels = magenta(drawn(picture, tags, tags.measure(picture), model))
    scale = OVERLAY_SIZE / picture.shape[1]
    # The twin's own projection, which shares nothing with the one that is drawn with.
    corners = camera.project(model[:, :3]) * scale
    for corner in corners:
        assert np.linalg.norm(pixels - corner, axis=1).min() < 2.5
    # And nowhere but along the arm.
    low, high = corners.min(axis=0) - 15.0, corners.max(axis=0) + 15.0
    assert ((pixels > low) & (pixels < high)).all()


def test_the_model_of_an_arm_in_space_is_where_the_camera_sees_it():
    camera = space_views.camera('typical', **EXACT, calibration_error=0.0)
    tags = TagCamera(space_views.layout(), camera.lens)
    poses = space_views.CHAIN.uniform([(0.3, 0.2), (-0.2, 0.4), (0.1, -0.5)]).poses
    picture = camera.picture(space_views.poses(*np.zeros((3, 2))))
    pixels = magenta(drawn(picture, tags, tags.measure(picture), poses))
    outer, turns = tags.layout.radius / np.cos(np.pi / 6), np.pi / 6 + np.arange(6) * np.pi / 3
    rim = outer * np.column_stack([np.cos(turns), np.sin(turns), np.zeros(6)])
    for pose in poses:
        corners = camera.project(Rotation.from_quat(pose[3:]).apply(rim) + pose[:3])
        for corner in corners * OVERLAY_SIZE / picture.shape[1]:
            assert np.linalg.norm(pixels - corner, axis=1).min() < 2.5


def test_without_a_plane_or_a_model_only_the_tags_are_drawn(ideal):
    _, tags, picture = ideal
    covered = picture.copy()
    covered[:, :picture.shape[1] // 3] = 100  # two of the four fixed tags
    few = tags.measure(covered)
    assert few.view is None
    for shown in (drawn(covered, tags, few, points(*ANGLES)),
                  drawn(picture, tags, tags.measure(picture), None)):
        assert len(magenta(shown)) == 0
        assert len(teal(shown)) > 50
    assert len(teal(drawn(picture))) == 0


@pytest.mark.parametrize('bad', [np.nan, 1e300, -1e9])
def test_a_model_that_is_no_arm_draws_nothing_and_fails_nothing(ideal, bad):
    _, tags, picture = ideal
    shown = drawn(picture, tags, tags.measure(picture), np.full((8, 7), bad))
    assert len(magenta(shown)) == 0


@pytest.mark.parametrize('shape', [(1, 3000), (20000, 1), (1, 1), (300, 100)])
def test_a_picture_of_any_form_is_drawn_small(shape):
    assert drawn(np.full(shape, 100, dtype=np.uint8)).min() > 90
