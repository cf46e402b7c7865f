# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of any arm in which nothing can be measured are refused, and say what to do."""

import re

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from soft_continuum.estimation.sensing.lens import Lens
from soft_continuum.estimation.sensing.tag_camera import TagCamera
from support.views import covered, errors, space_views, views, without_pose


def measuring(of_arm, lens, **changes):
    """Return what measures in pictures of an arm, with other parameters tags.*."""
    layout = of_arm.layout(**changes)
    return TagCamera(layout, lens, layout.stuck_as(of_arm.VALUES))


@pytest.fixture(scope='module', params=[
    (views, (0.0, 0.0, 0.0)), (space_views, np.zeros((3, 2)))], ids=['in the plane', 'in space'])
def ideal(request):
    """Return the pictures of an arm, lens and picture of the straight arm, camera and discs."""
    of_arm, straight = request.param
    drawn = of_arm.camera()
    discs = of_arm.poses(*straight)
    return of_arm, drawn.lens, drawn.picture(discs), drawn, discs


@pytest.mark.parametrize(('change', 'words'), [
    (np.zeros_like, ('black', 'lens covered')), (lambda p: cv2.flip(p, 1), ('mirrored', 'driver')),
    (lambda p: cv2.resize(p, (640, 480)), ('640 x 480', '1280 x 960'))])
def test_a_picture_in_which_nothing_can_be_measured(ideal, change, words):
    of_arm, lens, picture, *_ = ideal
    without_pose(measuring(of_arm, lens).measure(change(picture)), *words)


@pytest.mark.parametrize(('of_arm', 'rigs', 'least'), [(views, 6, 48), (space_views, 4, 28)])
def test_the_covariance_is_as_large_as_the_errors_are(of_arm, rigs, least):
    random, squares, free = np.random.default_rng(2), [], of_arm.ARM.pose_axes.sum()
    for seed in range(rigs):  # each has other tags, another place and another calibration
        drawn = of_arm.camera('typical', seed=seed)
        measuring = TagCamera(of_arm.layout(), drawn.lens)
        for _ in range(2):
            truth = of_arm.random_poses(random)
            sight = measuring.measure(drawn.picture(truth))
            squares += [error @ np.linalg.solve(disc.covariance, error) for disc, error in zip(
                sight.discs.values(), errors(sight, truth), strict=True)]
    assert len(squares) >= least  # of 8 a rig
    assert 0.5 * free < np.mean(squares) < 1.5 * free  # but those of one rig go together
    assert np.mean(np.array(squares) < chdtri(free, 0.05)) > 0.85


@pytest.mark.parametrize('scale', [0.94, 1.06])
def test_fixed_tags_that_were_printed_at_another_scale(ideal, scale):
    of_arm, lens, picture, *_ = ideal
    sight = measuring(of_arm, lens, fixed_size=0.06 * scale).measure(picture)
    without_pose(sight, 'print at 100 %')
    assert float(re.search('are ([0-9.]+) mm', sight.problems[0])[1]) == pytest.approx(60, abs=0.3)


def test_a_calibration_of_another_camera(ideal):
    of_arm, lens, picture, *_ = ideal
    bent = Lens.of(lens.size, lens.matrix, [-0.6, 0.0, 0.0, 0.0, 0.0])
    sight = measuring(of_arm, bent).measure(picture)
    without_pose(sight, 'tags')
    assert 'do not fit' in sight.problems[0] or '100 %' in sight.problems[0]


def test_tags_on_the_wrong_discs(ideal):
    of_arm, lens, _, _, discs = ideal
    drawn = of_arm.camera()
    drawn._discs[1], drawn._discs[3] = drawn._discs[3], drawn._discs[1]
    sight = measuring(of_arm, lens).measure(drawn.picture(discs))
    assert not {1, 3} & set(sight.discs)
    assert 'right discs' in sight.problems[0]


def test_a_disc_that_is_hidden_is_left_out_and_nothing_else(ideal):
    of_arm, lens, picture, drawn, discs = ideal
    front = discs[2:3, :3] + [0.0, -0.03 if of_arm is space_views else 0.0, 0.015]
    sight = measuring(of_arm, lens).measure(covered(drawn, picture, front, 60))
    assert list(sight.discs) == [0, 1, 3] and not sight.problems


NEAR = 8.0  # px around a tag in which a bar may disturb it


def outside(bars, points):
    """How far each of these points is out of all bars, px; negative: within one."""
    return np.array([-max(cv2.pointPolygonTest(bar.astype(np.float32), point.tolist(), True)
                          for bar in bars) for point in points])


def test_what_is_hidden_is_not_measured_what_is_cut_right_or_not_at_all_the_rest_is():
    layout, truth = views.layout(), views.poses(0.3, -0.2, 0.4)
    drawn = views.camera(occluders=2)
    measuring = TagCamera(layout, drawn.lens)
    places = [Rotation.from_quat(pose[3:]).apply(layout.ring(n)[n].corners) + pose[:3]
              for n, pose in enumerate(truth)]
    tags = [drawn.project(corners) for corners in places]
    fixed = np.vstack([drawn.project(tag.corners) for tag in layout.fixed_tags.values()])
    hidden_ones, cut_ones, before = set(), [], -np.inf
    for time in np.arange(0.0, 600.0, 0.5):
        bars = drawn.occluders.corners(time)
        away = [outside(bars, corners) for corners in tags]
        hidden = {n for n, each in enumerate(away) if each.max() < -2.0}
        cut = [n for n, each in enumerate(away) if -20.0 < each.min() < 2.0 < each.max()]
        if hidden <= hidden_ones and (not cut or time < before + 5.0 or len(cut_ones) > 6):
            continue
        if outside(bars, fixed).min() < NEAR:
            continue  # the frame of all is hidden
        sight = measuring.measure(drawn.picture(truth, time))
        assert not hidden & set(sight.discs)
        assert {n for n, each in enumerate(away) if each.min() > NEAR} <= set(sight.discs)
        off = errors(sight, truth)
        assert np.linalg.norm(off[:, :3], axis=1).max() < 5e-4
        for disc, error in zip(sight.discs.values(), off, strict=True):
            assert error @ np.linalg.solve(disc.covariance, error) < 16.3  # 99.9 %
        hidden_ones, cut_ones, before = hidden_ones | hidden, cut_ones + cut, time
    assert len(hidden_ones) > 1 and len(cut_ones) > 6
