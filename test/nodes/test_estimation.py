# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Measured poses of the discs correct the shape that is published, and the shapes that are set."""

import time

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from soft_continuum.estimation.unknowns import STRETCH
from soft_continuum.mechanics import Statics, StaticsError
from soft_continuum.ros.conversions import measured_pose_from_ros, poses_from_ros
from soft_continuum.ros.description import load_arm
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Anomaly, JammingValvesState, KinematicsState
from support.descriptions import given, JAMMING, PLANAR
from support.fake_arm import ARM, Cameras, FakeArm, RATE, SeenArm
from support.flat_arm import about_y
from support.ros_rig import DEADLINE, RELIABLE, set_in, spoil

STRAIGHT, BENT = about_y((0.0, 0.0, 0.0)), about_y((0.2, -0.15, 0.25))
AT_ZERO = (0.0, 0.0)  # m
SLACK_PULLS = (-0.02, -0.02)
TOO_SHORT = (0.004, 0.0)


@pytest.fixture
def fake(rig, request):
    """Return kinematics alone with an arm that it can be told about, straight and stiff."""
    path = getattr(request, 'param', PLANAR)
    rig.start('kinematics', **given(path))
    found = SeenArm(rig, load_arm(path))
    found.say([0.0] * len(found.arm.tendons))
    rig.wait_for(lambda: len(found.heard), 'a shape')
    return found


IN_PLANE_AND_SPACE = pytest.mark.parametrize(
    'fake', [PLANAR, JAMMING], indirect=True, ids=['in the plane', 'in space'])


def test_without_measurements_all_is_as_predicted(fake):
    for count in range(len(fake.heard) + 1, len(fake.heard) + 6):
        fake.pull(AT_ZERO)
        fake.rig.wait_for(lambda c=count: len(fake.heard) >= c, 'a shape')
    last = fake.last
    assert last.source == KinematicsState.PREDICTED
    assert not last.parameters
    assert not len(last.angle_stddevs) and not len(last.tip_covariance)
    assert (last.measured.sec, last.measured.nanosec) == (0, 0)
    assert not len(fake.predicted) and not any(map(len, fake.ends))
    assert 'measured' not in fake.rig.statuses['kinematics'].last.message


def test_measured_tensions_correct_the_stiffness_but_measure_no_shape(fake):
    pulls = (-0.02, 0.010)
    fake.say(AT_ZERO, soft=2)
    statics = Statics(ARM)
    state = statics.solve(statics.chain.straight(), pulls, (False, True, False))

    def pulled():
        fake.pull(pulls, tensions=(0.0, 1.2 * state.tensions[1]))
        values = {p.name: p.value for p in fake.last.parameters}
        return values.get('stiffness_factor_2', 1.0) > 1.01

    fake.rig.wait_for(pulled, 'a stiffer segment')
    last = fake.last
    assert last.source == KinematicsState.ESTIMATED
    assert (last.measured.sec, last.measured.nanosec) == (0, 0)
    fake.rig.wait_for(lambda: 'measured tensions' in
                      fake.rig.statuses['kinematics'].last.message, 'its source')


@IN_PLANE_AND_SPACE
def test_measured_poses_correct_the_shape_and_say_how_well_it_is_known(fake):
    # It bent when it was stiffened.
    bending = np.where(fake.arm.bending_axes, [(0.0, 0.0), (0.0, 0.0), (-0.02, 0.03)], 0.0)
    poses, axes = fake.chain.uniform(bending).poses[2::2], fake.arm.pose_axes

    def corrected():
        if np.abs(fake.bending - bending).max() > 0.01 or not all(
                map(len, (fake.predicted, *fake.ends))):
            return False
        ends = [measured_pose_from_ros(one.last, axes, 'base_link')[0] for one in fake.ends]
        return np.abs(np.array(ends) - poses)[:, :3].max() < 1e-3

    fake.show_until(bending, [0.0] * len(fake.arm.tendons), corrected, 'a corrected shape')
    last = fake.last
    assert last.source == KinematicsState.ESTIMATED
    assert last.measured.sec > 0
    assert sorted(p.name for p in last.parameters) == sorted(
        [f'{what}_{n}' for what in ('stiffness_factor', 'stiff_ratio') for n in (1, 2, 3)]
        + [f'offset_{name}' for name in fake.arm.tendon_names] + ['payload'])
    variances = np.reshape(last.tip_covariance, (6, 6)).diagonal()
    assert len(last.angle_stddevs) == 3
    assert all(0.0 < d < 0.1 for d in (*last.angle_stddevs, *np.sqrt(variances[axes])))
    assert not variances[~axes].any()  # a planar arm does not do that
    for recording in fake.ends:
        message = recording.last
        assert message.header.frame_id == 'base_link' and message.header.stamp.sec > 0
        covariance = np.reshape(message.pose.covariance, (6, 6))
        assert np.linalg.eigvalsh(covariance)[0] > 0.0
        assert covariance[0, 0] < 0.01**2
        assert covariance.diagonal()[axes].max() < 0.05**2
    # The prediction goes on: still straight.
    assert poses_from_ros(fake.predicted.last)[:, 0] == pytest.approx(0.0, abs=1e-9)
    fake.rig.wait_for(lambda: 'measured' in fake.rig.statuses['kinematics'].last.message,
                      'a status that says so')


def test_a_prediction_that_fails_is_not_shown_until_it_is_found_again(fake):
    statuses = fake.rig.statuses['kinematics']
    markers = fake.rig.record(MarkerArray, 'shape_markers', RELIABLE)

    def ghost():
        return len(markers) > 0 and 'prediction' in {m.ns for m in markers.last.markers}

    fake.show_until(STRAIGHT, AT_ZERO, lambda: len(fake.predicted) and ghost(), 'a prediction')
    # Shorter by more than straight_tolerance: only the jams of the estimate give.
    fake.show_until(STRAIGHT, TOO_SHORT, lambda: 'finds no shape' in statuses.last.message
                    and not ghost(), 'a status that says so')
    assert 'do not fit' in {v.key: v.value for v in statuses.last.values}['prediction']
    states, shown = len(fake.heard), len(fake.predicted)
    fake.show_until(STRAIGHT, TOO_SHORT, lambda: len(fake.heard) > states + 5, 'the estimate')
    assert len(fake.predicted) == shown
    fake.show_until(STRAIGHT, AT_ZERO, lambda: len(fake.predicted) > shown and ghost(),
                    'a prediction again')
    fake.rig.wait_for(lambda: 'no shape' not in statuses.last.message, 'a status without it')


def later(seconds):
    """Return what moves the stamp of a message by a time."""
    return lambda message: set_in(message, header__stamp__sec=message.header.stamp.sec + seconds)


# No two of one reason in turn: what is the same is said once.
UNUSABLE = {
    spoil(header__frame_id='camera'): "'camera'",
    spoil(pose__covariance__0=-1.0): 'positive definite',
    spoil(pose__pose__position__x=float('nan')): 'finite',
    spoil(pose__covariance__2=1e-3, pose__covariance__12=1e-3): 'positive definite',
    later(10): 'future', later(-3600): 'old'}
IN_SPACE = {spoil(pose__pose__orientation__w=2.0): 'quaternion'}  # of others only an angle is read


@IN_PLANE_AND_SPACE
def test_measurements_that_cannot_be_used_are_refused_with_the_reason(fake):
    statuses = fake.rig.statuses['kinematics']
    in_space = IN_SPACE if fake.arm.pose_axes.all() else {}
    for change, reason in (UNUSABLE | in_space).items():
        before = len(statuses)

        def said(before=before, reason=reason):
            return any(reason in text for message in list(statuses)[before:]
                       for text in (message.message, *(v.value for v in message.values)))

        fake.show_until(about_y((0.02, 0.0, 0.03)), [0.0] * len(fake.arm.tendons), said,
                        f'a refusal with {reason}', change)
    assert np.all(fake.bending == 0.0)
    assert fake.last.source == KinematicsState.PREDICTED


def test_restarted_on_a_bent_arm_it_finds_the_shape_by_measurements(rig):
    rig.start('kinematics')
    fake = SeenArm(rig)
    fake.say(SLACK_PULLS)
    rig.wait_for(lambda: 'unknown' in rig.statuses['kinematics'].last.message, 'doubt')
    assert 'sensors' in rig.statuses['kinematics'].last.message
    assert not len(fake.heard)
    fake.show_until(BENT, SLACK_PULLS, lambda: len(fake.heard) and
                    np.abs(fake.bending - BENT).max() < 0.03, 'the shape')
    # The first shape that was ever published was near it already.
    assert fake.bending_of(list(fake.heard)[0]) == pytest.approx(BENT, abs=0.1)


class Plant:
    """An arm whose tendons are not as long as the motors think; what it does is shown."""

    OFFSETS = np.array([5e-4, -1.2e-3])  # m

    def __init__(self, rig):
        self._statics, self._shown = Statics(ARM), 0.0
        self.state = self._statics.chain.straight()
        self._rig, self._cameras = rig, Cameras(rig, ARM)
        rig.observer.create_subscription(JointState, 'tendon_states', self._on_tendons, RELIABLE)

    def _on_tendons(self, message):
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
            self._cameras.show(self.state.poses)


def test_with_sensors_a_result_is_measured_and_segments_are_corrected(rig):
    rig.start_arm(loop__settling_time=0.2, loop__measuring_time=0.3, loop__sensor_timeout=30.0)
    plant = Plant(rig)
    state = rig.record(KinematicsState, 'kinematics/state', RELIABLE)
    rig.wait_for(lambda: state.last and state.last.source == KinematicsState.ESTIMATED,
                 'an estimate')
    goal = rig.goal_when_heard((0.0, 0.0, 0.4))
    result = goal.assert_ended('SUCCEEDED')
    assert result.source == RunShapeSequence.Result.MEASURED
    assert 1 <= result.corrections <= 3 * 2
    assert list(result.bending_angles) == pytest.approx(
        plant.state.bending_angles.tolist(), abs=0.03)
    assert plant.state.bending_angles == pytest.approx([0.0, 0.0, 0.4], abs=0.03)
    assert all(d > 0.0 for d in result.angle_stddevs) and result.tip.covariance.any()
    assert 'measuring' in {phase for _, _, phase in goal.phases}
    assert any(np.isfinite(f.error) for _, f in goal.feedback)
    rig.assert_only_one_was_soft()
    rig.assert_never_moved_all_stiff()
    rig.assert_stiff_since(goal)


PERIOD = 0.1  # s
SEGMENT, PULLS = 3, np.array([0.004, -0.006])  # which is soft, from 1; of the tendons
SLIPPED = 2.5e-3  # m
SWITCHED = 1.1  # s after which measurements count again
SEEN = (8e-4, 8e-4, 8e-4, 1e-2, 1e-2, 1e-2)  # m, rad


class Slipping(FakeArm):
    """An arm that is as described, and whose right tendon may slip, and what cameras see of it."""

    def __init__(self, rig):
        super().__init__(rig)
        self._statics = Statics(ARM.with_tendons(axial_stiffness=0.5 / STRETCH))
        self._state, self._cameras = self._statics.chain.straight(), Cameras(rig, ARM, SEEN)
        self.longer = np.zeros(2)

    def show(self, pulls, soft=True):
        """Say what the motors do, and then what is seen."""
        self._state = self._statics.solve(
            self._state, pulls - self.longer, [soft and n == SEGMENT for n in (1, 2, 3)])
        self.pull(pulls.tolist(), at=self.rig.observer.get_clock().now().nanoseconds * 1e-9)
        self._cameras.show(self._state.poses)
        time.sleep(PERIOD)


def test_a_tendon_that_slipped_is_named(rig):
    rig.start('kinematics')
    states = rig.record(KinematicsState, 'kinematics/state', RELIABLE)
    markers = rig.record(MarkerArray, 'shape_markers', RELIABLE)
    arm = Slipping(rig)
    arm.say()
    arm.show(np.zeros(2), soft=False)
    rig.wait_for(lambda: len(states), 'a shape')
    arm.say(soft=SEGMENT)
    rig.wait_for_status('kinematics', 'soft', str(SEGMENT))
    for part in np.linspace(0.0, 1.0, round(SWITCHED / PERIOD) + 1):
        arm.show(part * PULLS)
    for _ in range(20):
        arm.show(PULLS)
    rig.wait_for(lambda: states.last.source == KinematicsState.ESTIMATED, 'an estimate')
    assert not states.last.anomalies
    arm.longer = np.array([SLIPPED, 0.0])
    deadline = time.monotonic() + DEADLINE
    while not states.last.anomalies and time.monotonic() < deadline:
        arm.show(PULLS)
    anomaly, = states.last.anomalies
    assert anomaly.cause == Anomaly.TENDON_SLIPPED
    assert anomaly.tendon == 'right_tendon'
    assert abs(anomaly.size - SLIPPED) < 0.5 * SLIPPED
    status = rig.statuses['kinematics']
    rig.wait_for(lambda: status.last.level == DiagnosticStatus.ERROR
                 and 'right_tendon' in status.last.message, 'an alarm')
    rig.wait_for(lambda: arm.show(PULLS) or any(
        'right_tendon' in marker.text for marker in markers.last.markers), 'an alarm in RViz')
