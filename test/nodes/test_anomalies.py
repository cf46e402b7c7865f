# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""What is said to be wrong with the arm, over DDS."""

import time

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
from sensor_msgs.msg import JointState

from soft_continuum.estimation.unknowns import STRETCH
from soft_continuum.mechanics import Statics
from soft_continuum.parameters.files import load_arm
from soft_continuum.ros.names import MEASURED_POSE
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import Anomaly, JammingValvesState, KinematicsState
from support.planar import measured_pose_to_ros
from support.ros_rig import DEADLINE, LATCHED, RELIABLE, Rig

COVARIANCE = np.diag([8e-4, 8e-4, 1e-2])**2
PERIOD = 0.1  # s
SEGMENT, PULLS = 2, np.array([0.004, -0.006])  # which is soft; of the tendons
SLIPPED = 2.5e-3  # m
SWITCHED = 1.1  # s after which measurements count again


class Camera:
    """Sees an arm that is as described, and whose right tendon may slip."""

    def __init__(self, rig: Rig) -> None:
        arm = load_arm(description_file())
        arm = arm.with_tendons(axial_stiffness=0.5 / STRETCH)
        self._rig, self._statics = rig, Statics(arm)
        self._state = self._statics.chain.straight()
        self.longer = np.zeros(2)
        self._soft = [False] * 3
        self._valves = rig.publisher(JammingValvesState, 'jamming_valves/state', LATCHED)
        self._tendons = rig.publisher(JointState, 'tendon_states')
        self._poses = [rig.publisher(PoseWithCovarianceStamped, MEASURED_POSE.format(n))
                       for n in (1, 2, 3)]

    def soften(self) -> None:
        self._soft = [n == SEGMENT for n in range(3)]
        self.say_valves()

    def say_valves(self) -> None:
        self._valves.publish(JammingValvesState(stiffness=[
            JammingValvesState.NOT_STIFF if soft else JammingValvesState.STIFF
            for soft in self._soft]))

    def show(self, pulls: np.ndarray) -> None:
        """Say what the motors do, and then what is seen."""
        self._state = self._statics.solve(self._state, pulls - self.longer, self._soft)
        stamp = self._rig.observer.get_clock().now().to_msg()
        motors = JointState(name=['right_tendon', 'left_tendon'], position=pulls.tolist())
        motors.header.stamp = stamp
        self._tendons.publish(motors)
        for publisher, pose in zip(self._poses, self._state.points[2::2], strict=True):
            seen = measured_pose_to_ros(pose, COVARIANCE)
            seen.header.stamp, seen.header.frame_id = stamp, 'base_link'
            publisher.publish(seen)
        time.sleep(PERIOD)


def test_a_tendon_that_slipped_is_named(rig: Rig) -> None:
    rig.start('kinematics')
    states = rig.record(KinematicsState, 'kinematics/state', RELIABLE)
    camera = Camera(rig)
    camera.say_valves()
    camera.show(np.zeros(2))
    rig.wait_for(lambda: len(states), 'a shape')
    camera.soften()
    rig.wait_for_status('kinematics', 'soft', str(SEGMENT + 1))
    for part in np.linspace(0.0, 1.0, round(SWITCHED / PERIOD) + 1):
        camera.show(part * PULLS)
    for _ in range(20):
        camera.show(PULLS)
    rig.wait_for(lambda: states.last.source == KinematicsState.ESTIMATED, 'an estimate')
    assert not states.last.anomalies
    camera.longer = np.array([SLIPPED, 0.0])
    deadline = time.monotonic() + DEADLINE
    while not states.last.anomalies and time.monotonic() < deadline:
        camera.show(PULLS)
    anomaly, = states.last.anomalies
    assert anomaly.cause == Anomaly.TENDON_SLIPPED
    assert anomaly.tendon == 'right_tendon'
    assert abs(anomaly.size - SLIPPED) < 0.5 * SLIPPED
    status = rig.statuses['kinematics']
    rig.wait_for(lambda: status.last.level == DiagnosticStatus.ERROR, 'an alarm')
