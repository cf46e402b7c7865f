# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Files of points and pulls are read as they were meant, or refused with file and line."""

import numpy as np
import pytest

from soft_continuum.lab.analysis.delimited import MeasurementError
from soft_continuum.lab.analysis.measured_shapes import read_shapes, simulate_steps, sliding, Step
from soft_continuum.mechanics import SLACK, Statics, StaticsError
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
