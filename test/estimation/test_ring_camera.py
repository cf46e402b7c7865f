# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Discs in space are measured where they are; a picture that tells something else is refused."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.estimation.sensing.layout import (
    corners_as_numbers,
    corners_at_rest,
    corners_from_numbers,
    FRONT,
)
from soft_continuum.estimation.sensing.lens import Lens
from soft_continuum.estimation.sensing.tag_camera import CORNER_DEVIATION, TagCamera, TagGroup
from soft_continuum.estimation.sensing.tare import SensorError
from soft_continuum.parameters.parameter import ParameterError
from support.views import covered, errors, EXACT, without_pose
from support.views import space_views as views

STRAIGHT = views.poses(*np.zeros((3, 2)))
BENT = views.poses((0.3, 0.2), (-0.2, 0.4), (0.1, -0.5))
LENS = Lens.of((1280, 960), [1030, 0, 640, 0, 1030, 480, 0, 0, 1], [0.0] * 5)
HEAD_ON = 0.0  # rad: a camera there sees one face of each ring from its front
EDGE = np.pi / 6  # and one there two


@pytest.fixture(scope='module')
def ideal():
    """Return a drawn camera, what measures in its pictures, and one of the straight arm."""
    drawn = views.camera()
    return drawn, TagCamera(views.layout(), drawn.lens), drawn.picture(STRAIGHT)


# The fit.

def seen(tags, turn, shift):
    """Return where the corners of tags are seen by LENS, projected by OpenCV, (tags, 4, 2)."""
    vector = Rotation.from_matrix(turn).as_rotvec()
    return np.array([cv2.projectPoints(tag.corners, vector, shift, LENS.matrix, None)[0][:, 0]
                     for tag in tags])


def before_the_camera(direction):
    """Return the pose of a ring at 0.6 m before LENS that is seen from a direction about its z."""
    upright = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    return upright @ Rotation.from_rotvec([0.0, 0.0, -direction]).as_matrix(), np.array(
        [0.05, -0.02, 0.6])


@pytest.mark.parametrize('faces', [(0, 1), (0,), (5, 0, 1)])
def test_the_pose_is_found_from_any_tags_of_a_ring(faces):
    ring = list(views.layout().ring(0).values())
    tags = [ring[k] for k in faces]
    turn, shift = before_the_camera(0.45)
    turn = Rotation.from_rotvec([0.3, -0.2, 0.4]).as_matrix() @ turn
    best = TagGroup(tags, seen(tags, turn, shift), LENS).fits()[0]
    assert best.turn == pytest.approx(turn, abs=1e-6)
    assert best.shift == pytest.approx(shift, abs=1e-7)
    assert best.misfit < 1e-6


def test_the_covariance_is_that_of_noise_and_of_tags_that_are_stuck_off():
    random, ring, off = np.random.default_rng(1), list(views.layout().ring(0).values()), 3e-4
    turn, shift = before_the_camera(EDGE)
    errors, squares = [], []
    for _ in range(100):
        tags, places = ring[:2], []
        for tag in tags:
            twist = Rotation.from_rotvec(random.normal(0.0, off / tag.size, 3))
            moved = (twist.apply(tag.corners - tag.centre) + tag.centre
                     + random.normal(0.0, off, 3)) @ turn.T + shift
            places.append(moved[:, :2] / moved[:, 2:] * 1030.0 + [640.0, 480.0]
                          + random.normal(0.0, CORNER_DEVIATION, (4, 2)))
        fit = TagGroup(tags, places, LENS).fits()[0]
        error = np.concatenate([fit.shift - shift,
                                Rotation.from_matrix(fit.turn @ turn.T).as_rotvec()])
        errors.append(error)
        squares.append(error @ np.linalg.solve(fit.covariance[:6, :6], error))
    assert np.mean(squares) == pytest.approx(6.0, abs=1.2)  # 4 standard errors
    assert np.abs(np.mean(errors, axis=0) / np.std(errors, axis=0)).max() < 0.35


def test_one_tag_has_two_poses_and_two_tags_have_one():
    ring, random = list(views.layout().ring(0).values()), np.random.default_rng(2)
    for direction, faces, clear in ((0.2, (0,), False), (EDGE, (0, 1), True)):
        turn, shift = before_the_camera(direction)
        tags = [ring[k] for k in faces]
        apart = []
        for _ in range(8):
            places = seen(tags, turn, shift) + random.normal(0.0, 0.1, (len(tags), 4, 2))
            fits = TagGroup(tags, places, LENS).fits()
            apart.append(fits[1].misfit - fits[0].misfit if len(fits) > 1 else np.inf)
        assert (min(apart) > 100.0) == clear


def test_a_wrong_focal_length_is_corrected_by_fixed_tags_at_different_depths():
    turn, shift = before_the_camera(FRONT)
    shift = shift + [0.0, 0.15, 0.2]
    tags = [tag for tag in views.layout(fixed_stddev=1e-5).fixed_tags.values()
            if ((tag.centre @ turn.T + shift)[2] > 0.5)]
    places = (seen(tags, turn, shift) - LENS.matrix[:2, 2]) * 1.004 + LENS.matrix[:2, 2]
    fit = TagGroup(tags, places, LENS, focal_stddev=0.01).fits()[0]
    assert fit.focal == pytest.approx(1.004, abs=5e-4)
    assert fit.shift == pytest.approx(shift, abs=5e-4)


# Pictures.

@pytest.mark.parametrize(('preset', 'across', 'along', 'turn'), [
    ('ideal', 0.15e-3, 0.4e-3, 3e-3), ('typical', 0.8e-3, 1.0e-3, 5e-3)])
def test_discs_are_measured_where_they_are(preset, across, along, turn):
    random, found = np.random.default_rng(1), []
    drawn = views.camera(preset, **EXACT, calibration_error=0.0)
    measuring = TagCamera(views.layout(), drawn.lens)
    for _ in range(3):
        truth = views.random_poses(random)
        sight = measuring.measure(drawn.picture(truth))
        assert len(sight.discs) >= 3
        found.append(errors(sight, truth))
    found = np.sqrt(np.median(np.square(np.vstack(found)), axis=0))
    assert (found[[0, 2]] < across).all()
    assert found[1] < along  # y, along which it looks
    assert (found[3:] < turn).all()


def test_a_second_camera_sees_what_the_first_is_not_sure_of(ideal):
    aside = views.camera(direction=FRONT - np.pi / 3)
    along = []
    for drawn in (ideal[0], aside):
        sight = TagCamera(views.layout(), drawn.lens).measure(drawn.picture(BENT))
        along.append(sight.discs[2])
    x, y = np.sqrt(np.diag(along[0].covariance)[:2])
    assert y > 1.5 * x  # along its view
    both = np.linalg.inv(sum(np.linalg.inv(one.covariance) for one in along))
    assert np.sqrt(both[1, 1]) < 0.7 * y


def test_what_is_nearer_hides_what_is_behind_it(ideal):
    behind = STRAIGHT.copy()
    behind[3, :3] = STRAIGHT[1, :3] + [0.0, 0.1, 0.0]  # disc 3 behind disc 1, as it is seen
    numbers = ideal[1].measure(ideal[0].picture(behind)).numbers
    assert {10, 11} <= set(numbers)
    assert not {22, 23} & set(numbers)
    assert not {6, 7, 8, 9} & set(numbers)  # the back of the ring of disc 1


# Bad pictures: each names what to do, and measures nothing that is wrong.

def test_fixed_tags_that_are_hidden(ideal):
    places = views.layout().fixed[:, :3]
    few = covered(ideal[0], ideal[2], places[[0, 1, 4, 5, 6, 7]])
    without_pose(ideal[1].measure(few), '2 of 8', 'needed: 3', 'are they covered')


def test_fixed_tags_that_are_elsewhere(ideal):
    tags = views.layout()
    exchanged = tags.fixed.copy()
    exchanged[[0, 1]] = exchanged[[1, 0]]
    wrong = TagCamera(views.layout(fixed_poses=tuple(exchanged.ravel())), ideal[0].lens)
    sight = wrong.measure(ideal[2])
    without_pose(sight, 'do not fit', 'tags.fixed_poses')


def test_rings_that_were_printed_at_another_scale(ideal):
    wrong = TagCamera(views.layout(disc_size=0.025), ideal[0].lens)
    without_pose(wrong.measure(ideal[2]), 'tags of disc 0 are 24.0 mm', 'print at 100 %')


def test_a_ring_with_one_wrong_tag(ideal):
    drawn = views.camera()
    first, second = drawn._discs[1][4], drawn._discs[1][5]
    drawn._discs[1][4:6] = (type(first)(first.corners, 0.0, second.modules),
                            type(first)(second.corners, 0.0, first.modules))
    sight = ideal[1].measure(drawn.picture(STRAIGHT))
    assert list(sight.discs) == [0, 2, 3]
    assert 'disc 1 do not fit' in sight.problems[0]


def test_a_number_that_is_seen_twice(ideal):
    twice = ideal[2].copy()
    tag = views.layout().ring(1)[10]
    u, v = ideal[0].project(tag.centre[None] + STRAIGHT[1, :3])[0].astype(int)
    twice[400:470, 1150:1220] = ideal[2][v - 35:v + 35, u - 35:u + 35]
    sight = ideal[1].measure(twice)
    assert list(sight.discs) == [0, 1, 2, 3]  # the other tag of disc 1 is seen from its side
    assert 'number 10' in sight.problems[0]
    assert np.abs(errors(sight, STRAIGHT)[1, :3]).max() < 2e-3


def test_of_a_disc_of_which_one_tag_is_seen_from_its_front_nothing_is_measured():
    tags = views.layout(fixed_poses=tuple(v for y in (-0.2, 0.2) for z in (0.0, 0.3)
                                          for v in (-0.3, y, z, 0.0)))
    drawn = views.camera(tags=tags, direction=HEAD_ON)
    measuring, picture = TagCamera(tags, drawn.lens), drawn.picture(STRAIGHT)
    assert 2 in measuring.measure(picture).discs
    ring = tags.ring(2)
    aside = np.array([STRAIGHT[2, :3] + ring[k].centre for k in (13, 17)])  # at its sides
    sight = measuring.measure(covered(drawn, picture, aside, 10))
    assert {12, 13, 17} & set(sight.numbers) == {12}
    assert 2 not in sight.discs
    assert any('only tag 12 of disc 2' in problem for problem in sight.problems)


# Layouts and the straight arm.

@pytest.mark.parametrize(('changes', 'named'), [
    ({'fixed_poses': (0.0,) * 8}, 'at least 3'), ({'fixed_poses': (0.0,) * 13}, '13 numbers'),
    ({'fixed_poses': (-0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0)}, 'in a line'),
    ({'disc_size': 0.02}, 'at least 23.1 mm'), ({'faces': 4}, 'radius of 25 mm')])
def test_rings_that_cannot_be_are_refused(changes, named):
    with pytest.raises(ParameterError, match=named):
        views.layout(**changes)


def tared(drawn, pictures=2):
    """Return what measures, after it has seen the straight arm."""
    before = TagCamera(views.layout(), drawn.lens)
    seen = [before.measure(drawn.picture(STRAIGHT)).corners for _ in range(pictures)]
    return TagCamera(views.layout(), drawn.lens,
                     corners_from_numbers(corners_as_numbers(corners_at_rest(seen))))


def test_a_tare_corrects_the_camera_and_how_tags_are_stuck():
    """Bent arms are seen better too: what is wrong along the view is not taken for a ring."""
    random, before, after = np.random.default_rng(3), [], []
    for seed in range(2):
        drawn = views.camera('severe', seed=seed)
        cameras = TagCamera(views.layout(), drawn.lens), tared(drawn)
        for _ in range(2):
            truth = views.random_poses(random)
            picture = drawn.picture(truth)
            for camera, found in zip(cameras, (before, after), strict=True):
                found.append(errors(camera.measure(picture), truth))
    shift, turn = (np.median(np.linalg.norm(np.vstack(after)[:, part], axis=1)) / np.median(
        np.linalg.norm(np.vstack(before)[:, part], axis=1)) for part in (slice(3), slice(3, 6)))
    assert shift < 0.5 and turn < 0.4


def test_an_arm_that_bends_or_moves_is_not_tared(ideal):
    drawn, camera, _ = ideal
    bent = views.poses((0.1, 0.0), (0.0, 0.0), (0.0, 0.0))
    straight, leans = (camera.measure(drawn.picture(one)).corners for one in (STRAIGHT, bent))
    with pytest.raises(SensorError, match='is the arm straight, does tags.fixed_poses fit'):
        TagCamera(views.layout(), drawn.lens, leans)
    with pytest.raises(SensorError, match='wait until the arm rests'):
        corners_at_rest([straight] * 3 + [leans] * 3)
    with pytest.raises(SensorError, match='no tags are seen'):
        TagCamera(views.layout(), drawn.lens, {3: straight[4]})
    with pytest.raises(ParameterError, match='tags.reference_corners has 8 numbers'):
        corners_from_numbers((1.0,) * 8)
    assert corners_from_numbers((0.0,)) == {}
