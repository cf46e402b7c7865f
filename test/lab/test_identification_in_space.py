# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is not known of an arm in space comes from measured points, also of a real one."""

import csv

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.measured import IDENTIFIED, read
from soft_continuum.lab.analysis import validation as validate
from soft_continuum.lab.analysis.delimited import MeasurementError
from soft_continuum.lab.analysis.identification import (
    find_unknowns,
    IdentificationError,
    identify,
    shape_error,
    spread_out,
)
from soft_continuum.lab.analysis.identification import main as identify_main
from soft_continuum.lab.analysis.measured_shapes import MeasuredShape, read_shapes, Step
from soft_continuum.lab.new_arm.description import complete, describe_arm
from soft_continuum.mechanics import SLACK
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import write_parameters
from soft_continuum.ros.description import load_arm, load_description
from soft_continuum.ros.parameter_table import ALL_PARAMETERS

DEFAULTS = {p.name: p.default for p in ALL_PARAMETERS}
JAMMING = {'kind': 'spatial', 'segments': (2.0,), 'mounting_angle': (90.0,),
           'segment_masses': (60.0, 40.0), 'bending_stiffnesses': (0.02, 0.01)}
"""An arm of two jamming segments that points sideways, so that its weight bends it."""


def described(answers):
    """Return the parameters of an arm, with few bodies."""
    return {**DEFAULTS, **describe_arm(complete(answers)).values, 'arm.bodies_per_segment': 6}


# Files.


POINTS = 'shape,point,x [mm],y [mm],z [mm]\nbow,6,20,-10,190\nbow,5,12,-8,160\n'
PULLS = ('shape,segment,tendon_1 [mm],tendon_2 [mm],tendon_3 [mm]\n'
         'bow,1,5,slack,-3\nbow,2,6,0,slack\n')


def given(tmp_path, points=POINTS, pulls=PULLS, **changes):
    """Return the shapes of files with these texts."""
    paths = tmp_path / 'points.csv', tmp_path / 'pulls.csv'
    for path, text in zip(paths, (points, pulls), strict=True):
        path.write_text(text, encoding='utf-8')
    return read_shapes(*paths, arm_from_parameters(described(JAMMING)), **changes)


def test_shapes_in_space_have_a_y_and_their_tendons_by_name(tmp_path):
    shape, = given(tmp_path)
    assert shape.numbers == (5, 4)
    assert shape.positions == pytest.approx(1e-3 * np.array([[20, -10, 190], [12, -8, 160]]))
    assert [step.pulls for step in shape.steps] == [
        pytest.approx((0.005, SLACK, -0.003)), pytest.approx((0.006, 0.0, SLACK))]
    assert [step.soft(2) for step in shape.steps] == [(True, False), (False, True)]


def test_without_jamming_all_segments_are_soft(tmp_path):
    shape, = given(tmp_path, pulls='shape,tendon_3 [cm],tendon_2 [cm],tendon_1 [cm]\n'
                   'bow,1,2,3\n', jamming=False)
    assert shape.steps[0].pulls == pytest.approx((0.03, 0.02, 0.01))
    assert shape.steps[0].soft(2) == (True, True)


@pytest.mark.parametrize(('changes', 'words'), [
    ({'points': POINTS.replace('y [mm]', 'w [mm]')}, 'no column for y'),
    ({'pulls': PULLS.replace('tendon_2', 'left')}, 'no column for tendon_2'),
    ({'points': POINTS.replace('190', '1900')}, r'\(0.02, -0.01, 1.9\) m is further away than'),
    ({'points': POINTS + 'bow,1,0,20,0\n'}, r'must be at \(0, 0, 0\): transform the points'),
    ({'pulls': PULLS.replace('bow,2', 'bow,3')}, 'there is no segment 3')])
def test_what_is_not_measured_of_this_arm_is_named(tmp_path, changes, words):
    with pytest.raises(MeasurementError, match=words):
        given(tmp_path, **changes)


# A made-up arm: what is put in comes out.


def measured(values, noise):
    """Return shapes of an arm, each released at the end, measured with noise (m)."""
    rng, statics = np.random.default_rng(4), SpaceStatics(arm_from_parameters(values))
    shapes = []
    for k, pulls in enumerate([(0.012, SLACK, SLACK), (SLACK, 0.012, SLACK),
                               (SLACK, 0.008, 0.008)]):
        steps = (Step(0, pulls), Step(1, (SLACK,) * 3), Step(0, (SLACK,) * 3))
        state = statics.chain.straight()
        for step in steps:
            state = statics.solve(state, step.pulls, step.soft(2))
        there = state.points[2:] + rng.normal(0.0, noise, (4, 3))
        shapes.append(MeasuredShape(f'shape_{k}', steps, (2, 3, 4, 5), there))
    return shapes


@pytest.fixture(scope='module')
def truth():
    return spread_out({**described({**JAMMING, 'bending_stiffnesses': (0.025, 0.008)}),
                       'arm.discretisation': 'second_order'})


def test_stiffness_is_found_within_what_is_said_of_it(truth):
    begun = spread_out(described(JAMMING))
    found = identify(begun, find_unknowns(['stiffness_1', 'stiffness_2'], begun),
                     measured(truth, 3e-4))
    assert np.abs(found.values - [0.025, 0.008]).max() < 4.0 * found.stddevs.max()
    assert np.all(found.stddevs < 0.03 * found.values)
    assert found.noise == pytest.approx(3e-4, rel=0.4)
    arm = arm_from_parameters(found.arm)
    assert [s.stiffness_x for s in arm.segments] == pytest.approx(found.values)


@pytest.mark.parametrize(('names', 'words'), [
    (['stiffness_3'], "no unknown 'stiffness_3'; known: stiffness_1, .*angle_2, stiffness, mass"),
    (['stretch'], "no unknown 'stretch'"), (['angle_1'], "no unknown 'angle_1'")])
def test_unknowns_that_this_arm_does_not_have_are_refused(truth, names, words):
    with pytest.raises(IdentificationError, match=words):
        find_unknowns(names, truth)


def test_identify_writes_a_layer_with_which_validate_is_right(tmp_path, capsys, truth):
    files = [str(tmp_path / name) for name in ('points.csv', 'pulls.csv', 'arm.yaml')]
    begun = describe_arm(complete(JAMMING)).values
    write_parameters(tmp_path / 'arm.yaml', {**begun, 'arm.bodies_per_segment': 6}, [])
    shapes = measured(truth, 1e-4)
    with open(files[0], 'w', encoding='utf-8') as points, open(
            files[1], 'w', encoding='utf-8') as pulls:
        points.write('shape,point,x [m],y [m],z [m]\n')
        pulls.write('shape,segment,tendon_1 [m],tendon_2 [m],tendon_3 [m]\n')
        for shape in shapes:
            for number, place in zip(shape.numbers, shape.positions, strict=True):
                points.write(f'{shape.name},{number + 1},{",".join(map(str, place))}\n')
            for step in shape.steps:
                cells = ['slack' if p == SLACK else str(p) for p in step.pulls]
                pulls.write(f'{shape.name},{step.segment + 1},{",".join(cells)}\n')
    words = [*files[:2], '--params-file', files[2], '--output', str(tmp_path)]
    assert identify_main([*words, '--hold-out', 'shape_2']) == 0
    assert '2 shapes, 24 measured coordinates' in capsys.readouterr().out
    layer = tmp_path / 'identify.yaml'
    assert load_description(files[2], layer)['arm.discretisation'] == 'second_order'
    assert [s.stiffness_y for s in load_arm(files[2], layer).segments] == pytest.approx(
        [0.025, 0.008], rel=0.02)
    assert validate.main([*words, '--corrected', str(layer)]) == 0
    assert 'chain, gravity, corrected' in capsys.readouterr().out
    with open(tmp_path / 'validate.csv', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    worst = {model: max(float(row['error [mm]']) for row in rows if row['model'] == model)
             for model in {row['model'] for row in rows}}
    assert worst['chain, gravity, corrected'] < 1.0 < worst['chain, gravity']
    assert {'x [mm]', 'y [mm]', 'z [mm]'} <= rows[0].keys()
    assert (tmp_path / 'validate.png').exists() and (tmp_path / 'identify.png').exists()


# A real one.


def real_shapes(name, numbers):
    """Return poses of FTDCR v4, as if each were set from the straight arm; tips in base_link."""
    recording = read(name)
    origin = np.array([-1.07e-3, 0.51e-3, 0.52e-3])  # m, of the frame, from the benchmark
    upright = [0.0501, 0.0, 0.0]  # rad: against the tilt of the base, with the marker on the axis
    tips = Rotation.from_rotvec(upright).apply(recording.tips - origin)
    return [MeasuredShape(f'{name}_{k}', (Step(None, tuple(recording.pulls[k].tolist())),),
                          (7,), tips[k][None]) for k in numbers]


def test_guides_and_tendons_of_a_real_arm_are_found():
    # Drawn wrongly: guides at 5.5 mm, all tendons 20 degrees and more from where they are.
    begun = spread_out({**described({
        'kind': 'tendons', 'segment_lengths': (59.0, 61.5, 63.0), 'disc_heights': (1.0,),
        'guide_offsets': (5.5,), 'spacers': (2.0,), 'youngs_modulus': (50.0,),
        'segment_masses': (6.0,), 'disc_masses': (1.0,), 'mounting_angle': (0.0,),
        'first_tendon_angles': (-153.0, -170.0, -90.0)}), 'arm.bodies_per_segment': 3})
    unknowns = find_unknowns(['offset', 'angle_1', 'angle_2', 'angle_3'], begun)
    found = identify(begun, unknowns, real_shapes('train', range(60, 1600, 77)))
    # As the benchmark has them, which knows friction, and each pose from the one before.
    offset = 5.5e-3 * found.values[0]
    assert offset == pytest.approx(IDENTIFIED.offset, abs=2.5e-4)
    turns = IDENTIFIED.angle + IDENTIFIED.turn * np.arange(3)
    assert np.angle(np.exp(1j * (found.values[1:] - turns))) == pytest.approx(0.0, abs=0.05)
    others = real_shapes('val', range(10, 440, 50))
    before, after = (np.sqrt(np.mean([float(shape_error(values, shape)[0])**2
                                      for shape in others])) for values in (begun, found.arm))
    assert after < 0.009 < 0.014 < before
