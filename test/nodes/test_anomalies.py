# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""What is said to be wrong with the arm, over DDS."""

import time

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np

from soft_continuum.estimation.unknowns import STRETCH
from soft_continuum.mechanics import Statics
from soft_continuum_interfaces.msg import Anomaly, KinematicsState
from support.fake_arm import ARM, Cameras, FakeArm
from support.ros_rig import DEADLINE, RELIABLE, Rig

DEVIATIONS = (8e-4, 8e-4, 8e-4, 1e-2, 1e-2, 1e-2)  # m, rad
PERIOD = 0.1  # s
SEGMENT, PULLS = 3, np.array([0.004, -0.006])  # which is soft, from 1; of the tendons
SLIPPED = 2.5e-3  # m
SWITCHED = 1.1  # s after which measurements count again


class Slipping(FakeArm):
    """An arm that is as described, and whose right tendon may slip, and what cameras see of it."""

    def __init__(self, rig: Rig) -> None:
        super().__init__(rig)
        self._statics = Statics(ARM.with_tendons(axial_stiffness=0.5 / STRETCH))
        self._state, self._cameras = self._statics.chain.straight(), Cameras(rig, ARM, DEVIATIONS)
        self.longer = np.zeros(2)

    def show(self, pulls: np.ndarray, soft: bool = True) -> None:
        """Say what the motors do, and then what is seen."""
        self._state = self._statics.solve(
            self._state, pulls - self.longer, [soft and n == SEGMENT for n in (1, 2, 3)])
        self.pull(pulls.tolist(), at=self.rig.observer.get_clock().now().nanoseconds * 1e-9)
        self._cameras.show(self._state.poses)
        time.sleep(PERIOD)


def test_a_tendon_that_slipped_is_named(rig: Rig) -> None:
    rig.start('kinematics')
    states = rig.record(KinematicsState, 'kinematics/state', RELIABLE)
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
    rig.wait_for(lambda: status.last.level == DiagnosticStatus.ERROR, 'an alarm')
