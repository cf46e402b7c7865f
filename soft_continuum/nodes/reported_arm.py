# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What other nodes report of the arm, and the interlocks that follow from it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Bool

from soft_continuum.hardware.tendon_controller import Reason
from soft_continuum.mechanics.chain import Array, RigidChain
from soft_continuum.ros.age import Age
from soft_continuum.ros.qos import LATCHED, SENSOR

STRAIGHT = 0.02  # rad: largest bending angle of a segment that counts as straight


@dataclass(frozen=True)
class Interlock:
    """Why the tendons must not move; reason: as in MotionRequest."""

    reason: Reason
    message: str


class ReportedArm:
    """
    Stiffness and shape of the arm as jamming_valves and kinematics report them.

    The thread of ROS writes, any thread reads: every value is replaced as a whole.
    """

    def __init__(self, node: Node, chain: RigidChain, timeout: Callable[[], float]) -> None:
        """Subscribe for ``node``; timeout: age in s at which what was reported is stale."""
        self._chain, self._timeout = chain, timeout
        self.stiff: tuple[bool | None, ...] = (None,) * chain.segments
        self._jamming_age = Age()
        self._joint_angles: Array | None = None
        self._shape_age = Age()
        node.create_subscription(JointState, 'joint_states', self._on_shape, SENSOR)
        for i in range(chain.segments):
            node.create_subscription(
                Bool, f'segment_{i + 1}/stiff',
                lambda message, i=i: self._on_stiff(i, message.data), LATCHED)
        node.create_subscription(
            FluidPressure, 'segment_1/pressure', lambda _: self._jamming_age.refresh(), SENSOR)

    def _on_stiff(self, segment: int, stiff: bool) -> None:
        self.stiff = (*self.stiff[:segment], stiff, *self.stiff[segment + 1:])
        self._jamming_age.refresh()

    def _on_shape(self, message: JointState) -> None:
        if (len(message.position) == self._chain.joints
                and np.all(np.isfinite(message.position))):
            self._joint_angles = np.array(message.position)
            self._shape_age.refresh()

    @property
    def joint_angles(self) -> Array | None:
        """Joint angles of the present shape (joints,) in rad, None when it is not known."""
        return self._joint_angles if self._shape_age.seconds <= self._timeout() else None

    @property
    def _stiffness_known(self) -> bool:
        return None not in self.stiff and self._jamming_age.seconds <= self._timeout()

    def motion_interlock(self) -> Interlock | None:
        """Return why the arm must not be moved at all now, None when it may be."""
        if not self._stiffness_known:
            return Interlock(
                Reason.STIFFNESS_UNKNOWN,
                'it is not known which segments are soft: nothing received from jamming_valves '
                f'for {self._timeout():g} s')
        if all(self.stiff):
            return Interlock(
                Reason.ALL_STIFF, 'every segment is stiff; soften one first '
                '(jamming_valves/segment_N/set_stiff)')
        if self.joint_angles is None:
            return Interlock(
                Reason.SHAPE_UNKNOWN,
                'the shape of the arm is not known, so no tension can be predicted: no '
                f'joint_states from kinematics for {self._timeout():g} s')
        return None

    def homing_interlock(self) -> Interlock | None:
        """Return why tendons must not be paid out to their switches now, None when they may."""
        if not self._stiffness_known:
            return Interlock(
                Reason.STIFFNESS_UNKNOWN, 'it is not known whether the arm is stiff: '
                f'nothing received from jamming_valves for {self._timeout():g} s')
        if not all(self.stiff):
            return Interlock(
                Reason.STIFFNESS_CHANGED,
                'homing pays out the tendons: stiffen every segment')
        angles = self.joint_angles
        if angles is not None:
            bent = np.abs(self._chain.bending_angles(angles)).max()
            if bent > STRAIGHT:
                return Interlock(
                    Reason.HOMING,
                    'homing ends where the straight arm has its tendons just taut, but a '
                    f'segment is bent by {bent:.3f} rad: straighten the arm, and call '
                    'kinematics/reset if kinematics is wrong')
        return None
