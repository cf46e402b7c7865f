# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Measured shapes: files are read as they were meant, and models have the paper's errors."""

from dataclasses import replace

import numpy as np
import pytest

from soft_continuum.lab.analysis.delimited import MeasurementError
from soft_continuum.lab.analysis.measured_shapes import (
    MeasuredShape,
    read_shapes,
    simulate_steps,
    sliding,
    Step,
)
from soft_continuum.lab.analysis.validation import (
    _constant_curvature,
    CORRECTED,
    predict,
    WITH_GRAVITY,
)
from soft_continuum.mechanics import LEFT, RIGHT, SLACK, Statics, StaticsError
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.ros.description import load_description
from support import specimen_data as data

POINTS = """shape;point;x [mm];z [mm]
bow;1;0;0
bow;2;0;30
bow;7;12,5;280
bow;8;15;309,5
"""
PULLS = """shape;segment;angle [deg];right [mm];left [mm];payload [g]
bow;1;36;16,5;slack;20
bow;3;-18;10;Slack;20
"""


def read(tmp_path, points=POINTS, pulls=PULLS, arm=data.DESCRIBED):
    paths = tmp_path / 'points.csv', tmp_path / 'pulls.csv'
    for path, text in zip(paths, (points, pulls), strict=True):
        path.write_text(text, encoding='utf-8')
    return read_shapes(*paths, arm)


def test_shapes_are_read_in_si_units(tmp_path):
    shape, = read(tmp_path)
    assert shape.name == 'bow'
    assert shape.numbers == (0, 1, 6, 7)
    assert shape.positions[2:] == pytest.approx(
        np.array([[0.0125, np.nan, 0.28], [0.015, np.nan, 0.3095]]), nan_ok=True)
    assert shape.payload == pytest.approx(0.02)
    first, second = shape.steps
    assert (first.segment, second.segment) == (0, 2)
    assert first.pulls == (pytest.approx(0.0165), SLACK)
    assert second.angle == pytest.approx(np.radians(-18.0))


def test_angle_and_payload_may_be_left_out(tmp_path):
    shape, = read(tmp_path, pulls='shape,segment,right [m],left [m]\nbow,1,slack,0.01\n')
    assert np.isnan(shape.steps[0].angle)
    assert shape.payload == 0.0


def test_a_shape_may_have_any_name(tmp_path):
    shape, = read(tmp_path, 'SIMULATED, not measured\nshape,point,x [mm],z [mm]\n'
                  '"bow, ""left""",7,12.5,280\n',
                  'shape,segment,right [mm],left [mm]\n"bow, ""left""",1,16.5,slack\n')
    assert shape.name == 'bow, "left"'


def test_points_of_another_arm_are_refused(tmp_path):
    values = load_description()
    names = ('arm.segment_lengths', 'arm.outer_diameters', 'arm.leaf_thicknesses',
             'arm.leaf_widths', 'arm.segment_masses', 'arm.bending_angle_limits',
             'arm.disc_heights', 'arm.disc_masses')
    four = arm_from_parameters({'shape_names': ()} | {n: (*values[n], values[n][-1])
                                                      for n in names})
    with pytest.raises(MeasurementError, match=r'no shape has a point above 8, of disc 4; this '
                       r'arm has 5 discs: .*--params-file'):
        read(tmp_path, arm=four)
    for changed, message in (
            ({'arm.disc_heights': (0.03, 0.03, 0.03, 0.05)}, 'points 7 and 8 are 29.61 mm apart, '
             'but disc 4 of this arm is 50 mm long'),
            ({'arm.segment_lengths': (0.07, 0.07, 0.12)}, '6 and 7 are 70 .* segment 3'),
            ({'arm.segment_lengths': (0.07, 0.07, 0.05)}, '6 and 7 are 70 .* segment 3')):
        points = POINTS.replace('bow;7', 'bow;6;12,5;210\nbow;7')
        with pytest.raises(MeasurementError, match=message):
            read(tmp_path, points, arm=arm_from_parameters(values | changed))


@pytest.mark.parametrize(('old', 'new', 'message'), [
    ('bow;8;15', 'bow;9;15', r'points\.csv, line 5: there is no point 9; this arm has 1 to 8'),
    ('bow;8;15', 'bow;7;15', r'points\.csv, line 5: point 7 of shape .bow. is given twice'),
    ('bow;8;15', 'bow;7.5;15', r'points\.csv, line'),
    ('bow;8;15', 'bow;8;1500', r'points\.csv, line 5: .* is further away than the arm is long'),
    ('bow;2;0;30', 'bow;2;0;60', r'points\.csv, line 3: point 2 of the base disc .* transform'),
    ('bow;7;12,5;280\nbow;8;15;309,5\n', '', r'points\.csv: shape .bow. has points of the base'),
    ('x [mm]', 'x', r"points\.csv, line 1: column 'x' has no unit"),
    (';x [mm]', '', r'points\.csv, line 1: no column for x'),
    ('bow;3;-18', 'bow;4;-18', r'pulls\.csv, line 3: there is no segment 4; this arm has 1 to 3'),
    ('16,5', '16500', r'pulls\.csv, line 2: a pull of 16.5 m is more than the arm is long'),
    ('slack;20', 'loose;20', r"pulls\.csv, line 2: left \[mm\] is 'loose', not a finite number"),
    ('Slack;20', 'Slack;30', r'pulls\.csv, line 3: the payload of shape .bow. changes'),
    ('bow;1;36;16,5;slack;20\nbow;3', 'bend;3', r'pulls\.csv: has no rows for shape .bow. of '
     r'.*points\.csv; it has bend'),
])
def test_bad_points_and_pulls_are_refused(tmp_path, old, new, message):
    assert (old in POINTS) != (old in PULLS)
    with pytest.raises(MeasurementError, match=message):
        read(tmp_path, POINTS.replace(old, new), PULLS.replace(old, new))


def test_pulls_of_shapes_without_points_do_no_harm(tmp_path):
    assert len(read(tmp_path, pulls=PULLS.replace('bow;3', 'arc;3'))[0].steps) == 1


def test_a_tendon_slides_to_the_base_where_it_is_pulled_and_back_where_it_is_let_out():
    straight = Statics(data.DESCRIBED).chain.straight()
    assert sliding(straight, Step(0, (0.01, -0.01))) == (1, -1)
    assert sliding(straight, Step(0, (SLACK, 0.01))) == (0, 1)


def test_steps_that_cannot_be_walked_are_named():
    with pytest.raises(StaticsError, match=r'shape bow, step 2 \(segment 1 soft\)'):
        simulate_steps(
            Statics(data.DESCRIBED), [Step(0, (0.01, SLACK)), Step(0, (0.2, SLACK))], 'bow')


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
