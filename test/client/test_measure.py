# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes are measured by whatever publishes disc_N/measured_pose, and written for identify."""

from math import nan
from types import SimpleNamespace

from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.client import ClientError
from soft_continuum.client.measured import mean_of
from soft_continuum.lab.analysis.measured_shapes import read_shapes
from soft_continuum.mechanics.arm import PLANAR_AXES, SPATIAL_AXES
from soft_continuum.mechanics.rotations import in_plane, planar_pose
from soft_continuum.ros.conversions import poses_from_ros, tracked_pose_to_ros
from soft_continuum.ros.description import load_arm
from soft_continuum.sequencing import Phase, Progress
from soft_continuum.ui.browser.html import positions_html
from soft_continuum.ui.cli import measure
from soft_continuum.user_files import description_file
from support.descriptions import given
from support.ros_rig import spoil, STREAM

OFFSET = np.array([0.001, 0.0, -0.002])  # m: by which the tracker is off
IN_SPACE = np.array([0.001, 0.003, -0.002])
DEVIATION = 0.0005
TENDON_ARM = description_file().with_name('tendon_arm.yaml')


class Tracker:
    """Measures every disc where kinematics says it is, off by something known."""

    def __init__(self, rig, offset=OFFSET):
        self.spoil = None  # None: it sees nothing
        self._rig, self._offset = rig, np.concatenate([offset, np.zeros(4)])
        self._publishers = [rig.observer.create_publisher(
            PoseWithCovarianceStamped, f'disc_{n}/measured_pose', STREAM) for n in range(4)]
        rig.observer.create_subscription(PoseArray, 'disc_poses', self._on_discs, STREAM)

    def _on_discs(self, message):
        spoil, poses = self.spoil, poses_from_ros(message)[::2]
        if spoil is None:
            return
        # More often than the poses come, of which few may come in the time of a measurement.
        for publisher, pose in 4 * list(zip(self._publishers, poses, strict=False)):
            measured = tracked_pose_to_ros(pose + self._offset, DEVIATION**2 * np.eye(6))
            measured.header.frame_id = 'base_link'
            measured.header.stamp = self._rig.observer.get_clock().now().to_msg()
            spoil(measured)
            publisher.publish(measured)


@pytest.fixture(scope='module')
def tracker_of_module(arm_of_module):
    return Tracker(arm_of_module)


@pytest.fixture
def tracker(arm, tracker_of_module):
    tracker_of_module.spoil = lambda message: None
    yield tracker_of_module
    tracker_of_module.spoil = None


@pytest.fixture
def client(arm, connect):
    """Return a client that knows nothing of what was measured in other tests."""
    return connect()


def test_discs_are_measured_where_the_tracker_sees_them(client, tracker, arm):
    discs = client.measure(0.5)
    assert sorted(discs) == [0, 1, 2, 3]
    poses = client.state.disc_poses
    assert poses is not None
    for n, disc in discs.items():
        pose = poses[2 * n]
        assert planar_pose(disc.pose) == pytest.approx(
            [pose.x + OFFSET[0], pose.z + OFFSET[2], pose.angle], abs=1e-6)
        assert disc.stddev == pytest.approx(DEVIATION * PLANAR_AXES)
        assert disc.samples >= 3


def test_what_a_planar_arm_cannot_do_need_not_be_measured(client, tracker):
    tracker.spoil = spoil(pose__pose__position__y=nan, pose__covariance__7=nan)
    for disc in client.measure(0.5).values():
        assert disc.has_position
        assert (disc.pose[1], disc.stddev[1]) == (0.0, 0.0)


@pytest.mark.parametrize(('fields', 'named'), [
    ({'header__frame_id': 'world'}, "'world'; needed: 'base_link'"),
    ({'pose__pose__orientation__z': 0.7}, 'not about y'),
    ({'pose__pose__position__x': nan}, 'finite'),
    ({'pose__covariance__0': -1.0}, 'not positive definite')])
def test_measurements_that_are_none_are_refused_by_their_reason(client, tracker, fields, named):
    tracker.spoil = spoil(**fields)
    with pytest.raises(ClientError, match=named):
        client.measure(0.5)


_angle_only = spoil(pose__pose__position__x=0.0, pose__pose__position__z=0.0,
                    pose__covariance__0=1e6, pose__covariance__14=1e6)  # not measured


def test_a_disc_of_which_only_the_angle_is_measured_has_no_position(client, tracker, arm):
    tracker.spoil = _angle_only
    discs = client.measure(0.5)
    for disc in discs.values():
        assert not disc.has_position
        assert np.isnan(disc.pose[[0, 2]]).all()
        assert planar_pose(disc.pose)[2] == pytest.approx(0.0, abs=1e-2)
    arm.wait_for(lambda: client.state.measured_discs and all(client.state.measured_discs),
                 'angles of all discs')
    state = client.state
    assert all(disc is not None and np.isnan(disc.x) and np.isfinite(disc.angle)
               for disc in state.measured_discs)
    assert str(state).count('position not measured') == 4
    assert 'nan' not in str(state) + positions_html(state, 'xz')


def test_an_angle_beside_a_pose_takes_no_position_away(client, tracker, arm):
    count = iter(range(10**6))
    tracker.spoil = lambda message: None if next(count) // 4 % 4 else _angle_only(message)
    for disc in client.measure(1.5).values():
        assert disc.has_position
        assert disc.stddev[[0, 2]] == pytest.approx(DEVIATION, rel=1e-3)
    assert all(disc is not None and np.isfinite(disc.x) for disc in client.state.measured_discs)


def test_several_sensors_are_weighted_by_their_variances():
    unknown = 1e6
    samples = [(np.array([0.010, 0.0, 0.02]), np.diag([1e-6, 1e-6, 1e-4])),
               (np.array([0.013, 0.0, 0.05]), np.diag([2e-6, 1e-6, 4e-4])),
               (np.array([9.0, 9.0, 0.05]), np.diag([unknown, unknown, 4e-4]))] * 4
    disc = mean_of([in_plane(*sample) for sample in samples], PLANAR_AXES)
    assert planar_pose(disc.pose) == pytest.approx([0.011, 0.0, 0.03])
    assert disc.stddev[0] >= 1e-3
    assert disc.stddev[4] == pytest.approx(np.sqrt(2e-4))  # how much they scatter
    assert disc.samples == 12


def test_without_a_sensor_nothing_moves_and_the_remedy_is_said(call, arm, tmp_path):
    status, _, error = call('measure', 's_form', '--output', str(tmp_path))
    assert status == 1
    assert 'does the node camera or disc_sensors run' in error
    arm.assert_rests(5)
    assert not list(tmp_path.iterdir())


def test_a_shape_of_which_only_the_base_disc_is_seen_is_not_written(
        call, arm, tracker, monkeypatch, tmp_path):
    monkeypatch.setattr(tracker, '_publishers', tracker._publishers[:1])
    status, _, error = call('measure', 's_form', '--output', str(tmp_path), '--duration', '1.5')
    assert status == 1
    assert 'only the base disc is measured' in error
    arm.assert_rests(5)
    assert not list(tmp_path.iterdir())


def test_measured_shapes_are_read_by_identify_as_they_were(call, arm, tracker, tmp_path):
    status, _, error = call('measure', 's_form', '--output', str(tmp_path), '--duration', '1.5')
    assert status == 0, error
    description = load_arm(description_file())
    shape, = read_shapes(tmp_path / 'points.csv', tmp_path / 'pulls.csv', description)
    assert shape.name == 's_form'
    assert [step.segment for step in shape.steps] == [0, 1, 2]
    poses = poses_from_ros(arm.disc_poses.last)
    assert shape.positions[::2, ::2] == pytest.approx((poses[::2, :3] + OFFSET)[:, ::2], abs=1e-4)
    assert shape.steps[-1].pulls == pytest.approx(arm.pulls, abs=1e-4)
    assert 'SIMULATED' not in (tmp_path / 'points.csv').read_text(encoding='utf-8')


def test_status_says_what_is_seen_and_how_far_from_the_model(call, tracker):
    status, output, _ = call('status')
    assert status == 0
    assert output.count('seen at') == 4
    assert f'{1e3 * np.linalg.norm(OFFSET):.1f} mm from the model' in output


# In space.


def test_in_space_positions_and_orientations_are_averaged():
    turn, more = Rotation.from_rotvec([0.3, 2.0, -1.0]), np.array([0.02, -0.01, 0.03])
    place, unknown = np.array([0.01, 0.02, 0.1]), np.diag([1e-6] * 3 + [1e6] * 3)
    tracker = np.concatenate([place + 0.002, [0.0, 0.0, 0.0, 1.0]]), unknown  # no orientation
    samples = [tracker]
    for sign in (1.0, -1.0, 0.0):  # about base_link, as covariances are
        turned = (Rotation.from_rotvec(sign * more) * turn).as_quat()
        samples += [tracker, (np.concatenate([place, turned if sign > 0.0 else -turned]),
                              np.diag([1e-6] * 3 + [1e-4] * 3))]
    disc = mean_of(samples, SPATIAL_AXES)
    assert disc.samples == len(samples) == 7
    assert disc.pose[:3] == pytest.approx(place + 0.002 * 4 / 7)
    assert (Rotation.from_quat(disc.pose[3:]) * turn.inv()).magnitude() < 1e-6
    assert disc.stddev[3:] == pytest.approx(
        np.maximum(0.01, np.abs(more) * np.sqrt(2 / 3)))  # how much they scatter
    up = turn.apply([0.0, 0.0, 0.03])
    assert np.diff(disc.points(0.03), axis=0)[0] == pytest.approx(up, abs=1e-8)
    # A tracker that measures positions only tells where the bottom is.
    bottom, top = mean_of([tracker] * 3, SPATIAL_AXES).points(0.03)
    assert bottom == pytest.approx(place + 0.002)
    assert np.isnan(top).all()


def test_shapes_in_space_are_read_by_identify_as_they_were(rig, settling, call, tmp_path):
    rig.start('kinematics', 'tendon_actuation', 'shape_sequencer',
              **given(TENDON_ARM, tendon_rate=10.0, angle_step=0.2, estimation__enabled=False))
    Tracker(rig, IN_SPACE).spoil = lambda message: None
    status, _, error = call('measure', 'c_form', '--output', str(tmp_path), '--duration', '0.5')
    assert status == 0, error
    arm = load_arm(TENDON_ARM)
    shape, = read_shapes(tmp_path / 'points.csv', tmp_path / 'pulls.csv', arm, jamming=False)
    poses = poses_from_ros(rig.disc_poses.last)
    assert shape.numbers == tuple(range(8))
    assert shape.positions == pytest.approx(poses[:, :3] + IN_SPACE, abs=1e-4)
    step, = shape.steps
    assert step.segment is None
    pulls = dict(zip(rig.tendons.last.name, rig.tendons.last.position, strict=True))
    assert step.pulls == pytest.approx([pulls[name] for name in arm.tendon_names], abs=1e-4)
    assert max(step.pulls) > 0.01


class Corrected:
    """An arm of which a sequence sets segment 1 twice, as the closed loop does."""

    description = load_arm(description_file())

    def __init__(self):
        self.pulls, self.progress = (0.0, 0.0), None

    @property
    def state(self):
        return SimpleNamespace(pulls=self.pulls)

    def run(self, *_):
        """Straighten it."""

    def start(self, *_, **__):
        return self

    def updates(self):
        for step, (segment, phase) in enumerate([
                (1, Phase.MOVING), (1, Phase.STIFFENING), (2, Phase.STIFFENING),
                (1, Phase.SOFTENING), (1, Phase.MOVING), (1, Phase.STIFFENING),
                (0, Phase.HOLDING)]):
            self.pulls = (1e-3 * step, -1e-3 * step)
            for fraction in (0.0, 0.5):
                self.progress = Progress(0, 'c_form', segment, phase, fraction)
                yield self.progress

    def measure(self, _):
        return {1: SimpleNamespace(has_position=True)}

    def result(self):
        """Return: it ended well."""


def test_segments_that_are_set_again_are_written_again(monkeypatch):
    """Only the first pulls of each segment used to be kept, which the closed loop then changed."""
    monkeypatch.setattr(measure, 'SETTLING', 0.0)
    steps, discs = measure._set_and_measure(Corrected(), 'c_form', 0.0, jamming=True)
    assert steps == [(1, (1e-3, -1e-3)), (2, (2e-3, -2e-3)), (1, (5e-3, -5e-3))]
    assert set(discs) == {1}
