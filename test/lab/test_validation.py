# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated specimen shows the paper's pattern, and errors are what they are called."""

from dataclasses import replace

import numpy as np
import pytest

from soft_continuum.lab.analysis.measured_shapes import MeasuredShape, Step
from soft_continuum.lab.analysis.validation import (
    _constant_curvature,
    CORRECTED,
    predict,
    WITH_GRAVITY,
)
from soft_continuum.mechanics import LEFT, RIGHT, SLACK
from support import specimen_data as data

LOW, MIDDLE, HIGH = data.DESCRIBED.segments
SEGMENT_2_MEASURED = replace(
    data.DESCRIBED, segments=(LOW, replace(MIDDLE, stiffness_y=0.0202), HIGH))
BY_MODEL = {(p.shape.name, p.model): p
            for p in predict(data.PAPER_SHAPES, data.DESCRIBED, SEGMENT_2_MEASURED)}


def test_leaf_springs_alone_would_need_the_other_tendon_to_hold_segment_2_back():
    leaf, corrected = BY_MODEL['c_form', WITH_GRAVITY], BY_MODEL['c_form', CORRECTED]
    assert (leaf.slack[1], leaf.needed[1][0]) == (True, LEFT)
    assert (any(corrected.slack), corrected.needed[1][0]) == (False, RIGHT)


def test_errors_are_distances_of_the_points_that_move_and_belong_to_the_segment_below():
    points = BY_MODEL['s_form', WITH_GRAVITY].points
    moved = points[[1, 3, 4]] + [[0.003, 0.0, 0.0], [0.003, np.nan, 0.004], [0.0, 0.0, -0.002]]
    shape = MeasuredShape('s', data.PAPER_SHAPES[2].steps, (1, 3, 4), moved)
    prediction = predict([shape], data.DESCRIBED)[2]
    assert prediction.errors == pytest.approx([0.005, 0.002])
    assert prediction.segments == [0, 1]
    assert prediction.relative_errors == pytest.approx(
        [0.005 / np.linalg.norm(moved[1, ::2]), 0.002 / np.linalg.norm(moved[2])])


def test_the_true_arm_has_no_error_and_needs_the_pulls_that_it_got():
    _, _, prediction = predict(data.PAPER_SHAPES[1:2], data.TRUE)
    assert prediction.errors == pytest.approx(np.zeros(6), abs=1e-9)
    assert [tendon for tendon, _ in prediction.needed] == [LEFT, RIGHT, RIGHT]
    steps = data.PAPER_SHAPES[1].steps
    for (tendon, pull), step in zip(prediction.needed, steps, strict=True):
        assert pull == pytest.approx(step.pulls[tendon], abs=1e-9)


def test_steps_without_an_angle_need_no_pull():
    steps = tuple(Step(s.segment, s.pulls) for s in data.PAPER_SHAPES[0].steps)
    shape = MeasuredShape('c', steps, (7,), data.PAPER_SHAPES[0].positions[7:])
    assert all(p.needed == (None, None, None) for p in predict([shape], data.DESCRIBED))


@pytest.mark.parametrize(('pulls', 'angle'), [
    ((0.0166, SLACK), 36.04), ((SLACK, 0.0166), -36.04), ((SLACK, SLACK), 0.0),
    ((-0.005, -0.005), 0.0), ((0.0166, -0.0143), 36.04), ((0.0166, 0.0), 18.0)])
def test_constant_curvature_bends_no_further_than_the_tendons_ask_for(pulls, angle):
    shape = MeasuredShape('one', (Step(0, pulls),), (7,), np.zeros((1, 3)))
    x, y, z = np.diff(_constant_curvature(shape, data.DESCRIBED).points[-2:], axis=0)[0]
    assert np.degrees(np.arctan2(x, z)) == pytest.approx(angle, abs=0.3)
    assert y == 0.0
