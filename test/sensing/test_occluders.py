# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is hidden from the camera is not measured, the rest is, and nothing false."""

import cv2
import numpy as np

from soft_continuum.mechanics.orientations import full_poses
from soft_continuum.sensing.tag_camera import TagCamera
from support import views
from support.planar import IN_PLANE

NEAR = 8.0  # px around a tag in which a bar may disturb it


def outside(bars, points):
    """How far each of these points is out of all bars, px; negative: within one."""
    return np.array([-max(cv2.pointPolygonTest(bar.astype(np.float32), point.tolist(), True)
                          for bar in bars) for point in points])


def test_a_disc_behind_an_occluder_is_not_measured_the_others_are_and_nothing_false():
    layout, truth = views.layout(), views.discs(0.3, -0.2, 0.4)
    drawn = views.camera(occluders=2)
    measuring = TagCamera(layout, drawn.lens)
    tags = [drawn.project(layout.disc_corners(n, pose), layout.depth)
            for n, pose in enumerate(truth)]
    fixed = [drawn.project(layout.fixed_corners(n), 0.0) for n in layout.fixed_numbers]
    looked_at, hidden_ones = 0, set()
    for time in range(0, 600, 2):
        bars = drawn.occluders.corners(time)
        if min(outside(bars, corners).min() for corners in fixed) < NEAR:
            continue  # the frame of all is hidden
        hidden = {n for n, corners in enumerate(tags) if outside(bars, corners).max() < -2.0}
        if not hidden or hidden <= hidden_ones:
            continue
        hidden_ones |= hidden
        free = {n for n, corners in enumerate(tags) if outside(bars, corners).min() > NEAR}
        sight = measuring.measure(drawn.picture(full_poses(truth), time))
        looked_at += 1
        assert not hidden & set(sight.discs)
        assert free <= set(sight.discs)
        assert np.linalg.norm(views.errors(sight, truth)[:, :2], axis=1).max() < 5e-4
    assert looked_at > 1


def test_a_tag_that_a_bar_cuts_is_measured_right_or_not_at_all():
    truth = views.discs(0.0, 0.0, 0.0)
    drawn = views.camera(occluders=1, seed=3)
    measuring, times, seen = TagCamera(views.layout(), drawn.lens), [], []
    layout = views.layout()
    tags = [drawn.project(layout.disc_corners(n, pose), layout.depth)
            for n, pose in enumerate(truth)]
    for time in np.arange(0.0, 600.0, 0.5):
        bars = drawn.occluders.corners(time)
        cut = [n for n, corners in enumerate(tags)
               if -20.0 < outside(bars, corners).min() < 2.0 < outside(bars, corners).max()]
        if cut and (not times or time - times[-1] > 5.0) and len(times) < 10:
            times.append(time)
            sight = measuring.measure(drawn.picture(full_poses(truth), time))
            seen.append(len(sight.discs))
            for disc, error in zip(sight.discs.values(), views.errors(sight, truth), strict=True):
                assert error @ np.linalg.solve(disc.covariance[IN_PLANE], error) < 16.3  # 99.9 %
    assert len(times) == 10 and max(seen) >= 3
