# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""One description file describes a planar arm, a spatial one and a tendon arm without jamming."""

from argparse import ArgumentTypeError
from dataclasses import replace
from math import inf, nan, pi, radians

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.client.sequence import goal
from soft_continuum.client.state import _model_pose_text, Pose, Reached, reached_text
from soft_continuum.hardware.grbl.motion import Motors
from soft_continuum.lab.analysis.identification import spread_out
from soft_continuum.mechanics import Chain
from soft_continuum.mechanics.arm import ArmError, Tendon
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.plane.statics import PlaneStatics
from soft_continuum.mechanics.rotations import quaternions
from soft_continuum.mechanics.space.chain import SpaceChain
from soft_continuum.nodes.tendon_actuation import TensionPrediction
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import write_parameters
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.parameters.shapes import angles_problem, PAPER_SHAPES, shapes_from_parameters
from soft_continuum.ros.description import load_arm, load_description
from soft_continuum.ui.cli.goals import parse_bendings
from soft_continuum.ui.cli.up import nodes_of
from support.descriptions import JAMMING, PLANAR, TENDON_ARM
from support.spatial_arms import in_space

TWO = {'arm__tendon_names': ('a', 'b')}
THREE = {'arm.tendon_names': ('a', 'b', 'c'), 'arm.tendon_angles': (0.0, 2.0, 4.0)}


def described(**changes):
    """Return the arm with three tendons and other values; __ in a name stands for a dot."""
    return arm_from_parameters(
        THREE | {name.replace('__', '.'): value for name, value in changes.items()})


def refusal(**changes):
    with pytest.raises(ParameterError) as refused:
        described(**changes)
    return str(refused.value)


# What is described.


def test_the_shipped_tendon_arm_has_three_tendons_for_each_segment():
    arm = load_arm(TENDON_ARM)
    assert [tendon.end for tendon in arm.tendons] == [1, 1, 1, 2, 2, 2, 3, 3, 3]
    angles = np.array([tendon.angle for tendon in arm.tendons]).reshape(3, 3)
    assert np.diff(angles, axis=1) == pytest.approx(2.0 * pi / 3.0, abs=1e-5)
    assert angles[:, 0] == pytest.approx(np.radians([0.0, 40.0, 80.0]), abs=1e-5)
    rod = 60e9 * pi / 64 * 0.0007**4
    assert arm.segments[0].stiffness_x == arm.segments[0].stiffness_y == pytest.approx(rod, 1e-2)
    assert arm.segments[0].torsional_stiffness == pytest.approx(rod / 1.33, 1e-2)
    assert arm.gravity == pytest.approx((0.0, 0.0, 9.80665), abs=1e-6)  # hanging
    # Stretch: segments and discs that it passes, and what is between stepper and base.
    assert arm.compliance == pytest.approx((np.repeat([0.095, 0.18, 0.265], 3) + 0.3) / 5000.0)


def test_the_shipped_jamming_arm_is_that_of_the_paper_with_round_springs():
    arm, flat = load_arm(JAMMING), load_arm(PLANAR)
    for round_one, leaf in zip(arm.segments, flat.segments, strict=True):
        assert (round_one.length, round_one.mass) == (leaf.length, leaf.mass)
        assert round_one.stiffness_x == round_one.stiffness_y == pytest.approx(
            leaf.stiffness_y, rel=1e-3)
        assert round_one.torsional_stiffness == inf
        assert round_one.jam.rigid
    assert [(d.height, d.mass) for d in arm.discs] == [(d.height, d.mass) for d in flat.discs]
    assert all(t.offset == (0.025, 0.025, 0.02125, 0.02125, 0.0175, 0.0175) for t in arm.tendons)


def test_what_is_left_out_is_that_of_a_planar_arm_or_the_same_for_all_tendons():
    assert arm_from_parameters({}) == arm_from_parameters({'arm.tendon_names': []})
    arm = described(arm__tendon_twists=(3.0,))
    assert [(t.end, t.twist) for t in arm.tendons] == [(3, 3.0)] * 3  # the last disc
    # A leaf spring bends about one axis.
    arm = described(arm__lateral_bending_stiffnesses=(17.0,), arm__torsional_stiffnesses=(0.1,))
    assert [s.stiffness_x for s in arm.segments] == [17.0] * 3
    assert [s.torsional_stiffness for s in arm.segments] == [0.1] * 3


def test_hinges_may_have_any_number_of_tendons(tmp_path):
    pairs = {'arm.tendon_names': ('a', 'b', 'c', 'd', 'e', 'f'),
             'arm.tendon_angles': (0.0, pi) * 3, 'arm.tendon_ends': (1, 1, 2, 2, 3, 3),
             'arm.torsional_stiffnesses': (0.1,), 'arm.guide_offsets': (0.02,),
             'arm.jamming': False}
    hinges = {'arm.lateral_bending_stiffnesses': (inf,)}
    write_parameters(tmp_path / 'arm.yaml', pairs | hinges, [])
    arm = load_arm(tmp_path / 'arm.yaml')
    assert not arm.bending_axes[:, 0].any() and arm.bending_axes[:, 1].all()
    assert nodes_of([tmp_path / 'arm.yaml'])[-1] == 'shape_sequencer'
    again = arm_from_parameters(spread_out(pairs | hinges))  # which identify writes
    assert [s.stiffnesses for s in again.segments] == [s.stiffnesses for s in arm.segments]
    for wrong in (-inf, nan):
        with pytest.raises(ParameterError, match='allowed'):
            arm_from_parameters(pairs | {'arm.lateral_bending_stiffnesses': (wrong,)})


@pytest.mark.parametrize('path, nodes', [

    (PLANAR, ('tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer')),
    (JAMMING, ('tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer')),
    (TENDON_ARM, ('tendon_actuation', 'kinematics', 'shape_sequencer'))],
    ids=lambda p: getattr(p, 'stem', ''))
def test_the_nodes_that_an_arm_needs_are_started(path, nodes):
    assert nodes_of([path]) == nodes


@pytest.mark.parametrize('angles, ends, opposing', [
    ((0.0, 2.0944, 4.1888), (1, 1, 1), [[0, 1, 2]]), ((0.0, 1.0, 2.0), (1, 1, 1), []),
    ((0.5, 0.5 + pi), (2, 2), [[0, 1]]), ((0.0, 2.0, 4.0, 1.0), (1, 1, 1, 3), [[0, 1, 2]]),
    ((-0.1, 0.1, 3.1), (3, 3, 3), [[0, 1, 2]]), ((1.0,), (1,), []),
    ((0.0, 0.5 * pi, pi, 0.1), (2, 2, 2, 1), [[0, 2], [0, 1, 2]])], ids=str)
def test_tendons_oppose_each_other_with_the_backbone_between_them(angles, ends, opposing):
    arm = replace(described(), tendons=tuple(
        Tendon(name, angle, 0.02, end)
        for name, angle, end in zip('abcd', angles, ends, strict=False)))
    assert TensionPrediction(arm).opposing == opposing


# What is refused, and the choices that the message names.


@pytest.mark.parametrize('changes, words', [
    ({'arm__tendon_names': ('a', 'a', 'c')}, 'a name of its own'),
    ({'arm__tendon_names': ('a', 'b 2', 'c')}, 'letters, digits and _'),
    ({'arm__tendon_angles': (0.0, 1.0)}, 'arm.tendon_names has 3, so 3 are needed'),
    ({'arm__tendon_angles': (0.0,)}, 'arm.tendon_names has 3, so 3 are needed'),
    ({'arm__tendon_ends': (1, 2)}, '3 are needed, or one for all'),
    ({'arm__tendon_ends': (1, 2, 4)}, 'allowed: 1 to 3'),
    ({'arm__tendon_ends': (1, 2, 1)}, 'so no tendon passes segment 3; let one end at 3'),
    ({'arm__tendon_ends': (1, 1, 1)}, 'no tendon passes segment 2 and 3; let one end at 3, or'),
    ({'arm__tendon_angles': (1.0, 2.0, 1.0 - 2 * pi)}, 'a and c coincide: both are at'),
    ({'arm__tendon_angles': (1.0, 2.0, 1.0), 'arm__tendon_ends': (3, 2, 0)}, 'end at disc 3; g'),
    ({'arm__tendon_ends': (-1,)}, 'allowed: 0 to'),
    ({'arm__tendon_ends': (1.5,)}, 'a whole number'),
    ({'arm__spacers': 4}, '12 bodies per segment and 4 spacers'),
    ({'arm__torsional_stiffnesses': (0.1, 0.2)}, 'so 3 are needed, or one for all'),
    ({'arm__yield_moments': (0.2,)}, 'a rigid segment does not yield'),
    ({'arm__stiff_curvatures': (0.0, 1.0), 'arm__stiff_moments': (0.0, 1e-4)},
     'arm.stiff_moments, segment 1: row 2 of the stiff law'),
    ({'arm__stiffness_ratios': (0.5,)}, 'stiffness ratio K is 0.5'),
    ({'arm__tendon_names': ('',)}, 'give arm.tendon_names to describe a spatial one'),
], ids=str)
def test_what_is_no_spatial_arm_is_refused(changes, words):
    assert words in refusal(**changes)


def test_tendons_without_an_axis_of_the_controller_and_hinges_in_space_are_refused():
    with pytest.raises(ParameterError, match='9 tendons; .* at most 4: give the ports of 3'):
        Motors.of_boards({**load_description(TENDON_ARM), 'grbl.port': '/dev/ttyUSB0',
                          'grbl.steps_per_mm': (200.0,) * 9, 'grbl.signs': (1.0,) * 9})
    with pytest.raises(ArmError, match='this arm is spatial'):
        PlaneStatics(load_arm(TENDON_ARM))


def test_the_shapes_of_the_paper_are_left_out_where_an_arm_in_space_does_not_bend_so():
    arm = described(arm__bending_angle_limits=(0.5,))
    assert shapes_from_parameters({}, arm) == {}
    assert list(shapes_from_parameters({}, described())) == list(PAPER_SHAPES)


# Shapes have directions.


@pytest.mark.parametrize('path', [JAMMING, TENDON_ARM], ids=lambda path: path.stem)
def test_the_shipped_arms_in_space_bend_to_all_sides(path):
    values = load_description(path)
    shapes = shapes_from_parameters(values, load_arm(path))
    assert list(shapes) == ['c_form', 's_form', 'helix']
    assert len({tuple(values[f'shape_directions.{name}']) for name in shapes}) == 3
    helix = np.diff(values['shape_directions.helix'])
    assert np.all((helix > 1.0) & (helix < 2.0))


@pytest.mark.parametrize('given, words', [
    ({'shape_directions.c_form': [0.0, 1.0]}, 'parameter shape_directions.c_form: 2 bending dir'),
    ({'shape_directions.c_form': [0.0, 1.0, nan]}, 'shape_directions.c_form is'),
    ({'shape_directions.c_from': [0.0] * 3}, 'did you mean c_form?')], ids=str)
def test_directions_that_do_not_fit_the_arm_are_refused(given, words):
    with pytest.raises(ParameterError) as refused:
        shapes_from_parameters(given, described())
    assert words in str(refused.value)


def test_a_planar_arm_bends_to_two_sides_only():
    with pytest.raises(ParameterError, match=r'shape_directions.c_form: segment 2 cannot bend in '
                       r'the direction 57.3 degrees: .*; allowed: 0 and 180 degrees'):
        shapes_from_parameters({'shape_directions.c_form': [0.0, 1.0, 0.0]}, load_arm(PLANAR))
    assert angles_problem((0.1,) * 3, load_arm(PLANAR), (0.0, pi, 0.0)) == ''
    assert bending_vectors(load_arm(PLANAR), (0.1,) * 3, (0.0, pi, 0.0)) == pytest.approx(
        np.array([(0.0, 0.1), (0.0, -0.1), (0.0, 0.1)]))


@pytest.mark.parametrize('changes, direction, words', [
    ({'arm__lateral_bending_stiffnesses': (1e3, 0.03, 0.03)}, 1.0, ''),
    ({**TWO, 'arm__tendon_angles': (0.5, 0.5 + pi)}, 1.0,
     'direction 57.3 degrees: the tendons that pass it lie in one plane; allowed: 28.65 and '
     '208.6 degrees'),
    ({**TWO, 'arm__tendon_angles': (0.5, 0.5 + pi)}, 0.5 - pi, ''),
    ({**TWO, 'arm__tendon_angles': (0.5, 0.5 + pi), 'arm__tendon_twists': (10.0,)}, 1.0, '')],
    ids=str)
def test_a_direction_to_which_a_segment_cannot_bend_is_refused(changes, direction, words):
    problem = angles_problem((0.1, 0.1, 0.1), described(**changes), (direction,) * 3)
    assert words in problem and bool(words) == bool(problem)


@pytest.mark.parametrize('direction, allowed', [(0.0, True), (pi, True), (pi / 2, False)])
def test_a_hinge_bends_in_its_plane(direction, allowed):
    arm = in_space(load_arm(PLANAR))
    problem = angles_problem((0.1, 0.0, 0.0), arm, (direction,) * 3)
    assert problem == '' if allowed else 'it is a hinge; allowed: 0 and 180 degrees' in problem
    bent = bending_vectors(arm, (0.1, 0.2, 0.3), (pi,) * 3)
    assert bent == pytest.approx(np.array([[0.0, -0.1], [0.0, -0.2], [0.0, -0.3]]))
    assert not bent[:, 0].any()  # exactly


def test_bendings_have_the_angle_and_direction_they_were_made_of():
    chain = Chain(described())
    angles, directions = np.array([0.3, 0.5, 0.2]), np.array([1.0, -2.0, 3.0])
    state = chain.uniform(bending_vectors(chain.arm, angles, directions))
    assert state.bending_angles == pytest.approx(angles)
    assert state.bending_directions == pytest.approx(directions)
    # The segment leans towards its direction, as seen from the disc below.
    x, y, _ = state.points[3]
    assert np.arctan2(y, x) == pytest.approx(1.0)
    assert not chain.straight().bending_directions.any()
    turned = Rotation.from_quat(state.poses[-1, 3:]).as_matrix()
    assert turned == pytest.approx(state.orientations[-1])
    assert chain.at(state.joint_positions).poses == pytest.approx(state.poses, abs=1e-9)


# Both kinds of arms say the same of a planar one.


def test_a_planar_arm_is_drawn_where_the_spatial_one_is():
    flat, angles = load_arm(PLANAR), np.array([0.4, -0.3, 0.7])
    one = Chain(flat).uniform(angles)
    other = SpaceChain(flat).uniform(np.column_stack([np.zeros(3), angles]))
    assert one.poses == pytest.approx(other.poses, abs=1e-12)
    assert one.backbone == pytest.approx(other.backbone, abs=1e-12)
    for guides, there in zip(one.tendon_points, other.tendon_points, strict=True):
        assert guides[1:-1] == pytest.approx(there, abs=1e-12)  # in the discs at both ends, too
    assert np.abs(one.bending_angles) == pytest.approx(other.bending_angles)
    assert other.joint_positions.reshape(-1, 3)[:, 1] == pytest.approx(one.joint_positions)


@pytest.mark.parametrize('path', [PLANAR, JAMMING, TENDON_ARM], ids=lambda p: p.stem)
def test_a_state_is_made_again_of_its_coordinates(path):
    chain = Chain(load_arm(path))
    numbers = np.random.default_rng(3).uniform(-0.1, 0.1, (2, chain.coordinate_count))
    state = chain.state_of(numbers[0], numbers[1], (True, False, True))
    again = chain.state_of(state.coordinates, state.held_coordinates, state.stiff)
    assert state.coordinates == pytest.approx(numbers[0])
    assert again.held_coordinates == pytest.approx(numbers[1])
    assert again.poses == pytest.approx(state.poses, abs=1e-12)
    assert again.stiff == (True, False, True)


@pytest.mark.parametrize('turn', [(0.0, 0.0, 0.0), (3.1, 0.2, 0.0), (0.0, 0.0, 3.14159),
                                  (0.1, 3.0, 0.5), (-2.0, 2.0, 0.3)])
def test_orientations_of_every_size_are_quaternions(turn):
    wanted = Rotation.from_rotvec(turn).as_quat(canonical=True)
    assert quaternions(Rotation.from_rotvec(turn).as_matrix()[None])[0] == pytest.approx(wanted)


# What people say, and are told.


@pytest.mark.parametrize('shape, angles, directions', [
    ((0.1, 0.2), [0.1, 0.2], []), (np.array([0.1, 0.2]), [0.1, 0.2], []),
    ([(0.1, 1.0), 0.2], [0.1, 0.2], [1.0, 0.0]), ([(0.1, 0.0), (0.2, -2.0)], [0.1, 0.2],
                                                  [0.0, -2.0])], ids=str)
def test_a_segment_bends_by_an_angle_or_by_angle_and_direction(shape, angles, directions):
    message = goal([shape], 0.0).shapes[0]
    assert list(message.bending_angles) == angles
    assert list(message.bending_directions) == directions


@pytest.mark.parametrize('bend', [(0.1, 1.0, 2.0), None, ()], ids=str)
def test_what_is_no_bending_is_refused(bend):
    with pytest.raises(ValueError, match='its bending angle, or its angle and direction'):
        goal([[0.1, bend]], 0.0)


def test_degrees_on_the_command_line_have_directions_behind_an_at():
    assert parse_bendings('10,20@120,-30@-60') == (
        radians(10.0), (radians(20.0), radians(120.0)), (radians(-30.0), radians(-60.0)))
    for text in '10@', '@20', '10@20@30', '10@nan', '10;20':
        with pytest.raises(ArgumentTypeError, match='such as 10@0,20@120,30@-60'):
            parse_bendings(text)


def test_what_was_reached_and_a_pose_out_of_the_plane_are_told_in_space():
    reached = Reached(False, (0.5, 0.25), (0.0,) * 6, (), (), nan, 0, (1.0, -2.0))
    assert reached_text(reached) == (
        'predicted: nothing was measured; angles +28.6@57.3 +14.3@-114.6 deg')
    turned = Rotation.from_rotvec([-pi / 6, 0.0, 0.0]).as_quat()
    assert _model_pose_text(Pose((0.01, 0.02, 0.3), tuple(turned))) == (
        'x   +10.0 mm, y   +20.0 mm, z  +300.0 mm,   30.0 deg from the z axis')
    assert _model_pose_text(Pose((0.01, 0.0, 0.3), (0.0, 0.0, 0.0, 1.0))) == (
        'x   +10.0 mm, z  +300.0 mm,   +0.0 deg')
