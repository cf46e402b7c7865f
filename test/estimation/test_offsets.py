# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a tracker follows is mounted somehow on each disc: a tare of the straight arm tells how."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
import yaml

from soft_continuum.estimation.sensing.imus import imu_rotations
from soft_continuum.estimation.sensing.tag_camera import DiscPose, TagDetections
from soft_continuum.estimation.sensing.tare import (
    offset_of,
    SensorError,
    straight_heights,
    tag_offset,
    turn_of,
    Window,
)
from soft_continuum.estimation.sensing.tracker import Tracker
from soft_continuum.mechanics.rotations import compose, full_poses, planar_pose
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.description import load_arm
from soft_continuum.user_files import description_file
from support.views import space_views, views

VALUES = {'frame_id': 'base_link', 'tracker.frame_id': 'world', 'tracker.offsets': (0.0,)}


def matrix(position, rotation):
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = rotation.as_matrix(), position
    return found


def row(pose):
    return np.array([*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()])


def tracker(base, arm=views.ARM):
    return Tracker.of({**VALUES, 'tracker.base_pose': tuple(row(base))}, arm)


@pytest.mark.parametrize('arm', [views.ARM, space_views.ARM], ids=['in the plane', 'in space'])
@pytest.mark.parametrize('seed', range(8))
def test_after_a_tare_discs_are_measured_wherever_base_and_markers_are(seed, arm):
    rng = np.random.default_rng(seed)
    base = matrix(rng.uniform(-2.0, 2.0, 3), Rotation.random(random_state=seed))
    mounted = matrix(rng.uniform(-0.1, 0.1, 3), Rotation.random(random_state=seed + 100))
    straight = matrix((0.0, 0.0, 0.2), Rotation.identity())
    found = tracker(base, arm)
    noise = [replace_noise(row(base @ straight @ mounted), rng) for _ in range(50)]
    offset = offset_of([found.in_base('world', pose) for pose in noise], 0.2)
    found = replace(found, offsets=(offset,) * 4)
    for angle in (-1.2, 0.0, 2.9):
        disc = matrix((0.1, 0.0, 0.15), Rotation.from_euler('y', angle))
        pose = found.disc(2, found.in_base('world', row(base @ disc @ mounted)))
        assert pose[:3] == pytest.approx([0.1, 0.0, 0.15], abs=3e-4)
        turned = Rotation.from_quat(pose[3:]) * Rotation.from_euler('y', angle).inv()
        assert turned.magnitude() < 1e-3


def replace_noise(pose, rng):
    """Return a pose as a tracker has it: with noise, its quaternion with either sign."""
    pose[:3] += 1e-4 * rng.standard_normal(3)
    pose[3:] *= rng.choice([-1.0, 1.0])
    return pose


@pytest.mark.parametrize(('change', 'named'), [
    ({'frame': 'odom'}, "'odom'; needed: 'base_link', or 'world'"),
    ({'pose': (0, 0, 0, 0, 0, 0, 0)}, 'length 0, not 1; is it lost'),
    ({'pose': (0, 0, 0, 0, 0, 0, 1.5)}, 'length 1.5'),
    ({'pose': (float('nan'), 0, 0, 0, 0, 0, 1)}, 'not finite'),
    ({'pose': (float('inf'), 0, 0, 0, 0, 0, 1)}, 'not finite'),
    ({'pose': (0, 0.2, 0, 0, 0, 0, 1)}, '200 mm out of the plane'),
    ({'pose': (0, 0, 300.0, 0, 0, 0, 1)}, '300 m from the base, .* are positions in m'),
    ({'pose': (0, 0, 0, 0, 0, 1, 0)}, '180 degrees'),
    ({'pose': (0, 0, 0, 0.5, 0.5, 0.5, 0.5)}, '90 degrees')])
def test_what_is_no_pose_of_a_disc_in_the_plane_is_refused(change, named):
    found = tracker(np.eye(4))
    with pytest.raises(SensorError, match=named):
        found.disc(0, found.in_base(change.get('frame', 'world'),
                                    change.get('pose', (0, 0, 0, 0, 0, 0, 1))))


def test_discs_of_an_arm_in_space_may_be_out_of_any_plane():
    found = tracker(np.eye(4), space_views.ARM)
    pose = np.array([0.0, 0.2, 0.1, 0.5, 0.5, 0.5, 0.5])
    assert found.disc(0, found.in_base('world', pose)) == pytest.approx(pose)
    with pytest.raises(SensorError, match='300 m from the base'):
        found.disc(0, found.in_base('world', (0, 0, 300.0, 0, 0, 0, 1)))


def test_without_a_frame_of_the_tracker_the_remedy_is_named():
    found = replace(tracker(np.eye(4)), own_frame='')
    with pytest.raises(SensorError, match=r'tracker\.frame_id and where base_link is'):
        found.in_base('', (0, 0, 0, 0, 0, 0, 1))


def test_what_moves_or_is_far_away_is_no_tare():
    poses = np.zeros((20, 7))
    poses[:, 6] = 1.0
    poses[:, 2] = 0.2
    assert offset_of(list(poses), 0.2) == pytest.approx([0, 0, 0, 0, 0, 0, 1])
    with pytest.raises(SensorError, match='0.50 m from its disc'):
        offset_of(list(poses), 0.7)
    poses[:, 0] = np.linspace(0.0, 0.004, 20)
    with pytest.raises(SensorError, match='it moves by 2.1 mm'):
        offset_of(list(poses), 0.2)
    assert turned_by([0.1] * 10) == pytest.approx([0.0, 0.1, 0.0])
    with pytest.raises(SensorError, match='it moves by 0.0 mm and 0.1'):
        turned_by(np.linspace(0.0, 0.2, 10))
    with pytest.raises(SensorError, match=r'imu\.axes'):
        turned_by([3.14, -3.14] * 10)


def turned_by(angles):
    """Return by what an IMU is turned that is turned by these angles about y, rad."""
    ups = np.column_stack([-np.sin(angles), np.zeros(len(angles)), np.cos(angles)])
    return turn_of(list(ups), np.array([0.0, 0.0, 1.0]))


def test_a_window_has_the_last_second_or_says_that_it_is_not_enough():
    window = Window()
    assert window.recent(0.0) == []
    for k in range(30):
        window.add(0.1 * k, k)
    assert window.recent(2.95) == list(range(20, 30))
    assert window.recent(10.0) == []


def test_a_window_of_a_slow_sensor_has_its_last_five_measurements():
    window = Window()
    for k in range(5):
        with pytest.raises(SensorError, match=f'only {k} measurements') if k else nullcontext():
            assert window.recent(float(k)) == []
        window.add(1.0 * k + 0.9, k)
    assert window.recent(5.8) == [0, 1, 2, 3, 4]
    assert window.recent(7.0) == []  # nothing more came


def test_the_straight_arm_is_as_high_as_its_parts():
    arm = load_arm(description_file())
    assert straight_heights(arm) == pytest.approx([0.0, 0.1, 0.2, 0.3])


@pytest.mark.parametrize('change', [
    {'tracker.offsets': (0.0, 1.0)}, {'tracker.offsets': (0.0,) * 28},
    {'tracker.base_pose': (0.0,) * 7}, {'tracker.base_pose': (1.0,)}])
def test_parameters_that_are_no_poses_are_refused(change):
    values = {**VALUES, 'tracker.base_pose': (0, 0, 0, 0, 0, 0, 1), **change}
    with pytest.raises(ParameterError, match=next(iter(change))):
        Tracker.of(values, views.ARM)


def test_tags_that_are_stuck_off_tell_where_the_disc_is_after_a_tare():
    def turn(angle):  # right and along, as columns of x and z
        return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])

    def seen(pose):  # 2 mm to the right of it, 1 mm low, and turned by 0.05 rad
        return in_space(*(pose[:2] + turn(pose[2]) @ [0.002, -0.001]), pose[2] + 0.05)

    offset = tag_offset([seen(np.array([0.0, 0.2, 0.0]))] * 10, 0.2)
    for pose in ([0.0, 0.2, 0.0], [0.05, 0.15, 1.0], [-0.1, 0.1, -2.0]):
        assert planar_pose(compose(seen(np.array(pose)), offset)) == pytest.approx(pose)


def in_space(*planar):
    """Return the pose (7,) that x, z (m) and angle (rad) are."""
    return full_poses(np.array([planar]))[0]


def sights(poses):
    """Return what a camera saw of disc 1, with these poses (k, 3); of disc 2 once."""
    return [TagDetections({n: DiscPose(in_space(*pose), np.eye(6), in_space(*pose))
                   for n in range(1, 2 + (k == 0))}, (), 0.1, (), {})
            for k, pose in enumerate(poses)]


def test_what_a_tare_answers_is_what_the_parameter_takes():
    """Twelve numbers: x, z and angle of each disc; those of discs that are not seen stay."""
    layout, given = views.layout(), np.round(0.001 * np.arange(12.0), 6)
    before = layout.stuck_as({'tags.offsets': tuple(given)})
    assert before[2] == pytest.approx(in_space(0.006, 0.007, 0.008))
    discs, after, kept = layout.tared(before, sights([[0.001, 0.1, 0.02]] * 5))
    assert discs == [1]
    assert compose(in_space(0.001, 0.1, 0.02), after[1]) == pytest.approx(in_space(0, 0.1, 0))
    again = layout.stuck_as({f'tags.{k}': tuple(v) for k, v in yaml.safe_load(kept).items()})
    for n, (one, other) in enumerate(zip(again, before, strict=True)):
        assert one == pytest.approx(after[1] if n == 1 else other, abs=1e-6)
    with pytest.raises(ParameterError, match=r'tags\.offsets has 11 numbers'):
        layout.stuck_as({'tags.offsets': tuple(range(11))})
    with pytest.raises(SensorError, match='disc 1: it is seen 30.0 mm'):
        layout.tared(before, sights([[0.03, 0.1, 0.0]] * 5))


@pytest.mark.parametrize(('poses', 'named'), [
    ([[0.03, 0.2, 0.0]] * 10, '30.0 mm and 0.0 degrees from'),
    ([[0.0, 0.2, 0.3]] * 10, '17.2 degrees from'),
    ([[0.002 * n, 0.2, 0.0] for n in range(10)], 'it moves by 10.0 mm'),
    ([[0.0, 0.2, 0.01 * n] for n in range(10)], 'it moves by 0.0 mm and 0.050')])
def test_tags_of_an_arm_that_bends_or_moves_are_not_tared(poses, named):
    with pytest.raises(SensorError, match=named):
        tag_offset([in_space(*pose) for pose in poses], 0.2)


@pytest.mark.parametrize('axes', [
    ('+x',), ('+x', '+y', '+x'), ('+x', '+y', '-z'), ('+x', '+y', 'up')])
def test_axes_that_are_none_are_refused(axes):
    with pytest.raises(ParameterError, match='imu.axes'):
        imu_rotations(axes, 4)
