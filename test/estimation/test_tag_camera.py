# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Discs are measured where they are; a picture that tells something else is refused."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from soft_continuum.estimation.sensing.corners import TagDetector
from soft_continuum.estimation.sensing.lens import Lens, LensError
from soft_continuum.estimation.sensing.tag_camera import TagCamera
from soft_continuum.mechanics.arm import PLANAR_AXES
from soft_continuum.mechanics.rotations import rotate
from soft_continuum.parameters.parameter import ParameterError
from support.views import errors, EXACT, views, without_pose

STRAIGHT = views.poses(0.0, 0.0, 0.0)


@pytest.fixture(scope='module')
def ideal():
    """Return a drawn camera, what measures in its pictures, and one of them."""
    drawn = views.camera()
    return drawn, TagCamera(views.layout(), drawn.lens), drawn.picture(STRAIGHT)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize(('preset', 'position', 'angle'), [
    ('ideal', 0.1e-3, np.radians(0.1)), ('typical', 0.15e-3, np.radians(0.15))])
def test_discs_are_measured_to_a_tenth_of_a_millimetre(preset, position, angle):
    random, found = np.random.default_rng(1), []
    drawn = views.camera(preset, **EXACT)
    measuring = TagCamera(views.layout(), drawn.lens)
    for _ in range(5):
        truth = views.random_poses(random)
        sight = measuring.measure(drawn.picture(truth))
        assert list(sight.discs) == [0, 1, 2, 3] and not sight.problems
        found.append(errors(sight, truth))
    found = np.vstack(found)
    assert rms(np.linalg.norm(found[:, :3], axis=1)) < position
    assert rms(found[:, 4]) < angle


def test_no_tag_is_seen_in_clutter(ideal):
    random, detector = np.random.default_rng(3), TagDetector(ideal[0].lens, [0])
    for _ in range(12):
        cells = random.integers(0, 2, (24, 32), dtype=np.uint8) * 255
        clutter = cv2.resize(cells, (320, 240), interpolation=cv2.INTER_NEAREST)
        assert detector.numbers(clutter) == ()


# Bad pictures: each names what to do, and measures nothing that is wrong.

def test_a_fixed_tag_that_is_hidden(ideal):
    covered = ideal[2].copy()
    covered[:400, :400] = 0
    sight = ideal[1].measure(covered)
    assert list(sight.discs) == [0, 1, 2, 3]  # the others do
    assert np.linalg.norm(errors(sight, STRAIGHT)[:, :3], axis=1).max() < 0.3e-3
    covered[:, :400] = 0
    without_pose(ideal[1].measure(covered), '2 of 4', 'needed: 3', 'are they covered')


def test_fixed_tags_of_which_those_in_a_line_are_seen():
    places = (-0.3, -0.02, 0.15, -0.02, 0.3, -0.02, 0.3, 0.4, 0.15, 0.4, -0.3, 0.4)
    tags = views.layout(fixed_positions=places)
    drawn = views.camera(tags=tags)
    measuring, picture = TagCamera(tags, drawn.lens), drawn.picture(STRAIGHT)
    assert len(measuring.measure(picture).discs) == 4
    hidden = drawn.project(tags.fixed[3:, :3]).astype(int)  # the upper row
    for u, v in hidden:
        picture[v - 30:v + 30, u - 30:u + 30] = 90
    without_pose(measuring.measure(picture), 'in a line', 'uncover')


def test_disc_tags_that_were_printed_at_another_scale(ideal):
    sight = TagCamera(views.layout(disc_size=0.0275), ideal[0].lens).measure(ideal[2])
    assert not sight.discs
    assert 'tags.disc_size' in sight.problems[0]


def test_a_number_that_is_seen_twice(ideal):
    twice = ideal[2].copy()
    (row, column), size = np.argwhere(np.ones(1)).repeat(2, axis=1)[0] + (600, 100), 60
    middle = ideal[0].project(STRAIGHT[1:2, :3] + [0.0, 0.0, 0.015])[0].astype(int)
    twice[row:row + size, column:column + size] = ideal[2][
        middle[1] - size // 2:middle[1] + size // 2, middle[0] - size // 2:middle[0] + size // 2]
    sight = ideal[1].measure(twice)
    assert list(sight.discs) == [0, 2, 3]
    assert 'number 1' in sight.problems[0]


# Corners that are given, without a picture.

def corners_of(tags, truth, turn=0.0, distance=0.85, noise=0.0, seed=0):
    """Return the corners of all tags from a distance, m, turned about the vertical, rad."""
    random, c, s = np.random.default_rng(seed), np.cos(turn), np.sin(turn)
    to_camera = np.array([[c, s, 0.0], [0.0, 0.0, -1.0], [-s, c, 0.0]])
    every = {n: tag.corners for n, tag in tags.fixed_tags.items()}
    for disc, pose in enumerate(truth):
        every |= {n: pose[:3] + np.array([rotate(pose[3:], p) for p in tag.corners])
                  for n, tag in tags.ring(disc).items()}
    places = {n: (p - [0.0, 0.0, 0.15]) @ to_camera.T + [0.0, 0.0, distance]
              for n, p in every.items()}
    return {n: p[:, :2] / p[:, 2:] * 900.0 + [640.0, 480.0] + random.normal(0.0, noise, (4, 2))
            for n, p in places.items()}


def measured(corners, monkeypatch, tags=None):
    """Return what a planar camera measures when it detects these corners."""
    lens = Lens.of((1280, 960), [900, 0, 640, 0, 900, 480, 0, 0, 1], [0.0] * 5)
    camera = TagCamera(tags or views.layout(), lens)
    monkeypatch.setattr(TagDetector, 'detect', lambda *_: list(corners.items()))
    return camera.measure(np.full((960, 1280), 90, np.uint8))


def within_the_plane(sight, truth):
    """Return the mean square of errors over their stated deviations, and their RMS, m and rad."""
    axes = np.ix_(PLANAR_AXES, PLANAR_AXES)
    found = errors(sight, truth)[:, PLANAR_AXES]
    return [e @ np.linalg.solve(disc.covariance[axes], e)
            for e, disc in zip(found, sight.discs.values(), strict=True)], found


@pytest.mark.parametrize('noise', [0.3, 1.0])
def test_noise_loses_no_disc_and_is_stated(noise, monkeypatch):
    random, tags, squares, found = np.random.default_rng(1), views.layout(), [], []
    for seed in range(20):
        truth = views.random_poses(random)
        sight = measured(corners_of(tags, truth, noise=noise, seed=seed), monkeypatch)
        assert list(sight.discs) == [0, 1, 2, 3] and not sight.problems
        assert sight.stddev == pytest.approx(noise, rel=0.5)
        each, off = within_the_plane(sight, truth)
        squares += each
        found.append(off)
    assert 0.3 < np.mean(squares) < 3.0  # three where stated deviations are those of errors
    assert rms(np.linalg.norm(np.vstack(found)[:, :2], axis=1)) < noise * 1.6e-3


def test_two_pictures_of_one_pose_differ_less_than_their_errors(monkeypatch):
    pairs = [[measured(corners_of(views.layout(), STRAIGHT, noise=0.1, seed=2 * k + i),
                       monkeypatch).discs[3].pose[:3] for i in range(2)] for k in range(20)]
    assert rms(np.linalg.norm(np.diff(pairs, axis=1), axis=2)) < 0.25e-3


def test_small_frontal_tags_are_stated_as_exact_as_they_are(monkeypatch):
    sight = measured(corners_of(views.layout(), STRAIGHT, distance=2.0, noise=0.1), monkeypatch)
    for disc in sight.discs.values():
        assert np.sqrt(disc.covariance[4, 4]) < np.radians(1.2)


def test_a_tag_whose_first_pose_is_not_a_number_is_measured_by_the_second(monkeypatch):
    solve = cv2.solvePnPGeneric

    def spoilt(*given, **named):
        count, vectors, shifts, off = solve(*given, **named)
        return count, (vectors[0] * np.nan, vectors[0]), (shifts[0], shifts[0]), off
    monkeypatch.setattr(cv2, 'solvePnPGeneric', spoilt)
    sight = measured(corners_of(views.layout(), STRAIGHT), monkeypatch)
    assert list(sight.discs) == [0, 1, 2, 3]
    assert np.abs(errors(sight, STRAIGHT)).max() < 1e-6


@pytest.mark.parametrize('turn', [-0.6, 0.35, 0.6])
def test_a_tag_aside_before_an_oblique_camera_costs_only_discs_beside_it(turn, monkeypatch):
    aside = STRAIGHT.copy()
    aside[0, 0] += 0.05
    sight = measured(corners_of(views.layout(), aside, turn=turn, noise=0.1), monkeypatch)
    assert list(sight.discs) == [2, 3]
    assert len(sight.problems) == 1 and 'discs 0 and 1 are seen' in sight.problems[0]
    assert np.linalg.norm(errors(sight, STRAIGHT)[:, :3], axis=1).max() < 1e-3


# Layouts and calibrations.

@pytest.mark.parametrize(('positions', 'named'), [
    ((0.0, 0.0, 0.1, 0.1), 'at least 3'), ((0.0,) * 9, '9 numbers'),
    ((-0.3, 0.0, -0.1, 0.0, 0.1, 0.0, 0.3, 0.001), 'in a line'),
    ((-0.3, 0.0, 0.0, 0.02, 0.3, 0.0), 'in a line')])
def test_fixed_tags_that_do_not_carry_a_plane_are_refused(positions, named):
    with pytest.raises(ParameterError, match=named):
        views.layout(fixed_positions=positions)


def test_a_calibration_is_read_as_it_was_written(ideal, tmp_path):
    lens = replace(ideal[0].lens, distortion=np.array([0.1, -0.2, 0.003, -0.004, 0.5]))
    path = tmp_path / 'camera.yaml'
    path.write_text(lens.text('webcam'), encoding='utf-8')
    again = Lens.read(path)
    assert again.size == lens.size
    assert np.array_equal(again.matrix, lens.matrix)
    assert np.array_equal(again.distortion, lens.distortion)


@pytest.mark.parametrize('text', [
    '%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n'
    '   rows: 3\n   cols: 3\n   dt: d\n   data: [6e+02, 0., 310., 0., 610., 250., 0., 0., 1.]\n'
    'distortion_coefficients: !!opencv-matrix\n   data: [ 0.1 ]\n',
    'header: {frame_id: cam}\nheight: 480\nwidth: 640\ndistortion_model: plumb_bob\nd:\n- 0.1\n'
    'k: [600.0, 0.0, 310.0, 0.0, 610.0, 250.0, 0.0, 0.0, 1.0]\n---\n'])
def test_a_calibration_of_opencv_or_of_a_message_is_read(tmp_path, text):
    path = tmp_path / 'camera.yaml'
    path.write_text(text, encoding='utf-8')
    lens = Lens.read(path)
    assert lens.size == (640, 480) and lens.distortion.tolist() == [0.1, 0.0, 0.0, 0.0, 0.0]
    assert lens.matrix.tolist() == [[600.0, 0.0, 310.0], [0.0, 610.0, 250.0], [0.0, 0.0, 1.0]]


K = (600.0, 0.0, 320.0, 0.0, 600.0, 240.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize(('size', 'matrix', 'message'), [
    ((640, 480), np.reshape(K, (3, 3)).T, 'expected fx 0 cx, 0 fy cy, 0 0 1, row by row'),
    ((640, 480), [*K[:8], 2.0], 'expected fx 0 cx'), ((640, 480), [*K[:8], 0.0], 'expected fx'),
    ((640, 480), [K[0], 5.0, *K[2:]], 'expected fx 0 cx'),
    ((640, 480), [*K[:2], 700.0, *K[3:]], r'in the picture of 640 x 480 px'),
    ((640, 480), [*K[:2], 0.0, *K[3:5], 0.0, *K[6:]], 'in the picture'),
    ((640, 480), [0.9, 0.0, 0.5, 0.0, 1.2, 0.5, 0.0, 0.0, 1.0], 'in px'),
    ((640, 480), ['3_20', *K[1:]], 'the camera matrix must be numbers; given'),
    ((0, 0), K, 'the size of the picture is .0, 0.'), ((640.7, 480), K, 'whole numbers above 0'),
    ((640, -480), K, 'whole'), (('640', 480), K, 'whole'), ((True, 480), K, 'whole')])
def test_what_is_no_camera_matrix_is_refused(size, matrix, message):
    Lens.of((640, 480), K, [])
    with pytest.raises(LensError, match=message):
        Lens.of(size, matrix, [])


@pytest.mark.parametrize('text', ['', '3', 'image_width: wide', '[1, 2]',
                                  'image_width: 640\nimage_height: 480'])
def test_a_file_that_is_no_calibration_is_refused(tmp_path, text):
    path = tmp_path / 'camera.yaml'
    path.write_text(text, encoding='utf-8')
    with pytest.raises(LensError, match='not a camera calibration'):
        Lens.read(path)


@pytest.mark.parametrize(('distortion', 'model', 'same'), [
    ([], 'plumb_bob', 5), ([], '', 5), ([], 'none', 5), ([], 'rational_polynomial', 5),
    ([0.0] * 8, 'plumb_bob', 5), ([0.0] * 14, 'rational_polynomial', 5), ([0.0] * 4, 'None', 5),
    ([-0.2, 0.1], 'plumb_bob', 5), ([-0.2, 0.1, 1e-3, 2e-3], 'plumb_bob', 5),
    ([-0.2, 0.1, 1e-3, 2e-3, 0.01, 0.0, 0.0, 0.0], 'plumb_bob', 5),
    ([-0.2, 0.1, 1e-3, 2e-3, 0.01, 0.02, 0.01, 3e-3, *[0.0] * 6], 'rational_polynomial', 8)])
def test_coefficients_that_are_left_out_are_zeros(distortion, model, same):
    matrix = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
    lens = Lens.of((640, 480), matrix, distortion, model)
    points = np.array([[100.0, 80.0], [500.0, 400.0]])
    whole = np.array([*distortion, *[0.0] * 14])[:14]  # as OpenCV has them at most
    assert lens.undistorted(points) == pytest.approx(
        Lens((640, 480), matrix, whole).undistorted(points), abs=1e-6)
    assert lens.distortion.size == same
    assert f'cols: {same}' in lens.text('any')


@pytest.mark.parametrize(('matrix', 'distortion', 'model'), [
    (np.zeros(9), np.zeros(5), 'plumb_bob'), (K, np.zeros(5), 'equidistant'),
    (K, np.ones(6), 'plumb_bob'), (K, [np.nan] * 5, 'plumb_bob'),
    (K, np.ones(9), 'rational_polynomial'), (K, [0.1], 'none'),
    (np.full(9, np.inf), np.zeros(5), 'plumb_bob'), ([1.0], np.zeros(5), '')])
def test_an_uncalibrated_camera_is_refused(matrix, distortion, model):
    with pytest.raises(LensError, match='soft_continuum calibrate camera'):
        Lens.of((640, 480), matrix, distortion, model)
