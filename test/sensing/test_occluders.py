# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is hidden from the camera is not measured, the rest is, and nothing false."""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from support.views import errors, views

NEAR = 8.0  # px around a tag in which a bar may disturb it


def outside(bars, points):
    """How far each of these points is out of all bars, px; negative: within one."""
    return np.array([-max(cv2.pointPolygonTest(bar.astype(np.float32), point.tolist(), True)
                          for bar in bars) for point in points])


def test_what_is_hidden_is_not_measured_what_is_cut_right_or_not_at_all_the_rest_is():
    layout, truth = views.layout(), views.poses(0.3, -0.2, 0.4)
    drawn = views.camera(occluders=2)
    measuring = layout.camera(drawn.lens)
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
