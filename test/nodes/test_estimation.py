# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Measured poses of the discs correct the shape that is published, and the shapes that are set."""

from collections.abc import Callable
import time
from typing import Any

from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from soft_continuum.mechanics import Equilibrium, Statics, StaticsError
from soft_continuum.mechanics.arm import Array
from soft_continuum.parameters.files import load_arm
from soft_continuum.ros.conversions import poses_from_ros
from soft_continuum.ros.ros_time import stamp_of
from soft_continuum.sensing.rigid import planar_pose
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Anomaly, JammingValvesState, KinematicsState
from support.planar import measured_pose_to_ros
from support.ros_rig import LATCHED, Recording, RELIABLE, Rig, STREAM

ARM = load_arm(description_file())
COVARIANCE = np.diag([3e-4, 3e-4, 2e-3])**2
BENT = (0.2, -0.15, 0.25)
SLACK_PULLS = (-0.02, -0.02)  # m
TOO_SHORT = (0.004, 0.0)  # m
RATE = 20.0  # Hz


class FakeArm:
    """Tendons, valves and a camera that say whatever a test wants them to."""

    def __init__(self, rig: Rig, *, moves: bool = True) -> None:
        self.rig = rig
        self.state = rig.record(KinematicsState, 'kinematics/state', RELIABLE)
        self.predicted = rig.record(PoseArray, 'predicted_disc_poses', RELIABLE)
        self.poses = [rig.record(PoseWithCovarianceStamped, f'segment_{n}/pose', RELIABLE)
                      for n in (1, 2, 3)]
        if moves:
            self._tendons = rig.publisher(JointState, 'tendon_states')
            self._valves = rig.publisher(JammingValvesState, 'jamming_valves/state', LATCHED)
        self._discs = [rig.publisher(PoseWithCovarianceStamped, f'disc_{n}/measured_pose', STREAM)
                       for n in (1, 2, 3)]

    def say(self, pulls: tuple[float, float], soft: int = 0) -> None:
        """Say which segment (from 1) is soft, and the pulls (m)."""
        self._valves.publish(JammingValvesState(stiffness=[
            JammingValvesState.NOT_STIFF if n == soft else JammingValvesState.STIFF
            for n in (1, 2, 3)]))
        self.pull(pulls)

    def pull(self, pulls: tuple[float, float], tensions: tuple[float, ...] = ()) -> None:
        """Say the pulls (m), and the tensions (N) if they are measured."""
        self._tendons.publish(JointState(name=['right_tendon', 'left_tendon'],
                                         position=list(pulls), effort=list(tensions)))

    def show(self, points: Array, spoil: Callable[[Any], None] = lambda message: None) -> None:
        """Show every disc at points (2 * discs, 3), all at one time."""
        stamp = stamp_of(self.rig.observer.get_clock().now().nanoseconds * 1e-9)
        for publisher, pose in zip(self._discs, points[2::2], strict=True):
            message = measured_pose_to_ros(pose, COVARIANCE)
            message.header.frame_id, message.header.stamp = 'base_link', stamp
            spoil(message)
            publisher.publish(message)

    def show_until(self, points: Array, pulls: tuple[float, float],
                   condition: Callable[[], Any], what: str,
                   spoil: Callable[[Any], None] = lambda message: None) -> Any:
        """Show the discs again and again until something is so; return that."""
        begun = [0.0]

        def shown() -> Any:
            if time.monotonic() - begun[0] > 1.0 / RATE:
                begun[0] = time.monotonic()
                self.pull(pulls)
                self.show(points, spoil)
            return condition()

        return self.rig.wait_for(shown, what)

    @property
    def angles(self) -> Array:
        """The bending angles that were last published, rad."""
        found: Array = np.reshape(self.state.last.joint_angles, (3, -1)).sum(axis=1)
        return found


@pytest.fixture
def fake(rig: Rig) -> FakeArm:
    """Return kinematics alone with an arm that it can be told about, straight and stiff."""
    rig.start('kinematics')
    found = FakeArm(rig)
    found.say((0.0, 0.0))
    rig.wait_for(lambda: len(found.state), 'a shape')
    return found


def test_without_measurements_all_is_as_predicted(fake: FakeArm) -> None:
    for count in range(len(fake.state) + 1, len(fake.state) + 6):
        fake.pull((0.0, 0.0))
        fake.rig.wait_for(lambda c=count: len(fake.state) >= c, 'a shape')
    last = fake.state.last
    assert last.source == KinematicsState.PREDICTED
    assert not last.parameters
    assert not len(last.angle_deviations) and not len(last.tip_covariance)
    assert (last.measured.sec, last.measured.nanosec) == (0, 0)
    assert not len(fake.predicted) and not any(map(len, fake.poses))
    assert 'measured' not in fake.rig.statuses['kinematics'].last.message


def test_measured_tensions_correct_the_stiffness_but_measure_no_shape(fake: FakeArm) -> None:
    pulls = (-0.02, 0.010)
    fake.say((0.0, 0.0), soft=2)
    statics = Statics(ARM)
    state = statics.solve(statics.chain.straight(), pulls, (False, True, False))

    def pulled() -> Any:
        fake.pull(pulls, (0.0, 1.2 * state.tensions[1]))
        values = {p.name: p.value for p in fake.state.last.parameters}
        return values.get('stiffness_factor_2', 1.0) > 1.01

    fake.rig.wait_for(pulled, 'a stiffer segment')
    last = fake.state.last
    assert last.source == KinematicsState.ESTIMATED
    assert (last.measured.sec, last.measured.nanosec) == (0, 0)
    fake.rig.wait_for(lambda: 'measured tensions' in
                      fake.rig.statuses['kinematics'].last.message, 'its source')


def test_measured_poses_correct_the_shape_and_say_how_well_it_is_known(fake: FakeArm) -> None:
    points = Statics(ARM).chain.uniform((0.0, 0.0, 0.03)).points  # it bent when it was stiffened
    fake.show_until(points, (0.0, 0.0), lambda: fake.angles[2] > 0.02 and len(fake.predicted),
                    'a corrected shape')
    last = fake.state.last
    assert last.source == KinematicsState.ESTIMATED
    assert last.measured.sec > 0
    assert sorted(p.name for p in last.parameters) == sorted(
        [f'{what}_{n}' for what in ('stiffness_factor', 'stiff_ratio') for n in (1, 2, 3)]
        + ['offset_right_tendon', 'offset_left_tendon', 'payload'])
    variances = np.reshape(last.tip_covariance, (6, 6)).diagonal()
    assert all(0.0 < d < 0.1 for d in (*last.angle_deviations, *np.sqrt(variances[::2])))
    assert not variances[1::2].any()  # a planar arm does not do that
    fake.rig.wait_for(lambda: all(map(len, fake.poses)), 'poses with covariance')
    for recording in fake.poses:
        message = recording.last
        assert message.header.frame_id == 'base_link' and message.header.stamp.sec > 0
        covariance = np.reshape(message.pose.covariance, (6, 6))
        assert np.linalg.eigvalsh(covariance)[0] > 0.0
        assert covariance[0, 0] < 0.01**2
    # The prediction goes on: still straight.
    assert planar_pose(poses_from_ros(fake.predicted.last))[:, 0] == pytest.approx(0.0, abs=1e-9)
    fake.rig.wait_for(lambda: 'measured' in fake.rig.statuses['kinematics'].last.message,
                      'a status that says so')


def test_a_prediction_that_fails_is_not_shown_until_it_is_found_again(fake: FakeArm) -> None:
    points, statuses = Statics(ARM).chain.straight().points, fake.rig.statuses['kinematics']
    markers = fake.rig.record(MarkerArray, 'shape_markers', RELIABLE)

    def ghost() -> bool:
        return len(markers) > 0 and 'prediction' in {m.ns for m in markers.last.markers}

    fake.show_until(points, (0.0, 0.0), lambda: len(fake.predicted) and ghost(), 'a prediction')
    # Shorter by more than straight_tolerance: only the jams of the estimate give.
    fake.show_until(points, TOO_SHORT, lambda: 'finds no shape' in statuses.last.message
                    and not ghost(), 'a status that says so')
    assert 'do not fit' in {v.key: v.value for v in statuses.last.values}['prediction']
    states, shown = len(fake.state), len(fake.predicted)
    fake.show_until(points, TOO_SHORT, lambda: len(fake.state) > states + 5, 'the estimate')
    assert len(fake.predicted) == shown
    fake.show_until(points, (0.0, 0.0), lambda: len(fake.predicted) > shown and ghost(),
                    'a prediction again')
    fake.rig.wait_for(lambda: 'no shape' not in statuses.last.message, 'a status without it')


def _frame(message: Any) -> None:
    message.header.frame_id = 'camera'


def _nan(message: Any) -> None:
    message.pose.pose.position.x = float('nan')


def _indefinite(message: Any) -> None:
    message.pose.covariance[0] = -1.0


def _future(message: Any) -> None:
    message.header.stamp.sec += 10


def _old(message: Any) -> None:
    message.header.stamp.sec -= 3600


def test_measurements_that_cannot_be_used_are_refused_with_the_reason(fake: FakeArm) -> None:
    statuses = fake.rig.statuses['kinematics']
    points = Statics(ARM).chain.uniform((0.02, 0.0, 0.03)).points
    for spoil, reason in ((_frame, "'camera'"), (_nan, 'finite'),
                          (_indefinite, 'positive definite'), (_future, 'future'),
                          (_old, 'old')):
        before = len(statuses)

        def said(before: int = before, reason: str = reason) -> bool:
            return any(reason in text for message in list(statuses)[before:]
                       for text in (message.message, *(v.value for v in message.values)))

        fake.show_until(points, (0.0, 0.0), said, f'a refusal with {reason}', spoil)
    assert np.all(fake.angles == 0.0)


def test_restarted_on_a_bent_arm_it_finds_the_shape_by_measurements(rig: Rig) -> None:
    rig.start('kinematics')
    fake = FakeArm(rig)
    fake.say(SLACK_PULLS)
    rig.wait_for(lambda: 'unknown' in rig.statuses['kinematics'].last.message, 'doubt')
    assert 'sensors' in rig.statuses['kinematics'].last.message
    assert not len(fake.state)
    points = Statics(ARM).chain.uniform(BENT).points
    fake.show_until(points, SLACK_PULLS, lambda: len(fake.state) and
                    np.abs(fake.angles - BENT).max() < 0.03, 'the shape')
    # The first shape that was ever published was near it already.
    first = np.reshape(list(fake.state)[0].joint_angles, (3, -1)).sum(axis=1)
    assert first == pytest.approx(BENT, abs=0.1)


def test_another_shape_than_the_one_that_was_followed_is_an_anomaly(fake: FakeArm) -> None:
    straight = Statics(ARM).chain.straight().points
    fake.show_until(straight, (0.0, 0.0),
                    lambda: fake.state.last.source == KinematicsState.ESTIMATED, 'an estimate')
    assert not fake.state.last.anomalies
    markers = fake.rig.record(MarkerArray, 'shape_markers', RELIABLE)
    bent = Statics(ARM).chain.uniform(BENT).points
    found = fake.show_until(bent, (0.0, 0.0), lambda: fake.state.last.anomalies, 'an anomaly')
    assert found[0].cause == Anomaly.UNKNOWN
    fake.rig.wait_for(
        lambda: 'no known cause' in fake.rig.statuses['kinematics'].last.message, 'an error')
    fake.show_until(bent, (0.0, 0.0), lambda: len(markers) and any(
        'no known cause' in marker.text for marker in markers.last.markers), 'an alarm in RViz')


def test_an_aim_that_does_not_exist_is_rejected(rig: Rig) -> None:
    rig.start('shape_sequencer')
    goal = rig.goal('c_form', aim=7)
    assert not goal.accepted
    reason = rig.rejection(goal)
    assert '7' in reason and 'angles' in reason and 'tip' in reason


class Plant:
    """An arm whose tendons are not as long as the motors think; what it does is shown."""

    OFFSETS = np.array([5e-4, -1.2e-3])  # m

    def __init__(self, rig: Rig) -> None:
        self._statics, self._shown = Statics(ARM), 0.0
        self.state: Equilibrium = self._statics.chain.straight()
        self._rig, self._arm = rig, FakeArm(rig, moves=False)
        rig.observer.create_subscription(JointState, 'tendon_states', self._on_tendons, RELIABLE)

    def _on_tendons(self, message: JointState) -> None:
        stiffness = self._rig.states['jamming_valves'].last.stiffness
        soft = [s == JammingValvesState.NOT_STIFF for s in stiffness]
        if any(soft):
            try:
                self.state = self._statics.solve(
                    self.state, np.array(message.position) + self.OFFSETS, soft)
            except StaticsError:
                return
        if time.monotonic() - self._shown > 1.0 / RATE:
            self._shown = time.monotonic()
            self._arm.show(self.state.points)


QUICK_LOOP = {'loop__settling_time': 0.2, 'loop__measuring_time': 0.3,
              'loop__sensor_timeout': 30.0}


def test_without_sensors_a_result_is_a_prediction_with_them_it_is_measured(rig: Rig) -> None:
    rig.start_arm(**QUICK_LOOP)
    status, result = rig.goal((0.0, 0.0, 0.3)).result()
    assert (status, result.source) == ('SUCCEEDED', RunShapeSequence.Result.PREDICTED)
    assert result.corrections == 0
    assert list(result.bending_angles) == pytest.approx([0.0, 0.0, 0.3], abs=2e-3)
    assert not len(result.angle_deviations) and not result.tip.covariance.any()
    assert 0.2 < result.tip.pose.position.z < 0.35


def test_with_sensors_a_result_is_measured_and_segments_are_corrected(rig: Rig) -> None:
    rig.start_arm(**QUICK_LOOP)
    plant = Plant(rig)
    state: Recording = rig.record(KinematicsState, 'kinematics/state', RELIABLE)
    rig.wait_for(lambda: state.last and state.last.source == KinematicsState.ESTIMATED,
                 'an estimate')
    goal = rig.goal_when_heard((0.0, 0.0, 0.4))
    status, result = goal.result()
    assert (status, result.error_string) == ('SUCCEEDED', '')
    assert result.source == RunShapeSequence.Result.MEASURED
    assert 1 <= result.corrections <= 3 * 2
    assert list(result.bending_angles) == pytest.approx(
        plant.state.bending_angles.tolist(), abs=0.03)
    assert plant.state.bending_angles == pytest.approx([0.0, 0.0, 0.4], abs=0.03)
    assert all(d > 0.0 for d in result.angle_deviations) and result.tip.covariance.any()
    assert 'measuring' in {phase for _, _, phase in goal.phases}
    assert any(np.isfinite(f.error) for _, f in goal.feedback)
    rig.assert_only_one_was_soft()
    rig.assert_never_moved_all_stiff()
    rig.assert_stiff_since(goal)
