# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tendons, valves and cameras that say whatever a test wants them to, for kinematics alone."""

from collections.abc import Callable, Sequence
import time
from typing import Any

from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
import numpy as np
from sensor_msgs.msg import JointState

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Chain
from soft_continuum.ros.conversions import equilibrium_from_ros, tracked_pose_to_ros
from soft_continuum.ros.description import load_arm
from soft_continuum.ros.names import MEASURED_POSE
from soft_continuum.ros.ros_time import stamp_of
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import JammingValvesState, KinematicsState, TendonActuationState
from support.ros_rig import LATCHED, RELIABLE, Rig, STREAM

ARM = load_arm(description_file())
RATE = 20.0  # Hz, at which discs are shown
DEVIATIONS = (3e-4, 3e-4, 3e-4, 2e-3, 2e-3, 2e-3)  # m, rad: of a camera
UNKNOWN = 1e3  # m, rad: of what a planar arm cannot do, and nobody measures

Spoil = Callable[[Any], None]


def unspoilt(message: Any) -> None:
    """Leave a message as it is."""


class FakeArm:
    """Tendons and valves."""

    def __init__(self, rig: Rig, arm: Arm = ARM) -> None:
        self.rig, self.arm = rig, arm
        self._tendons = rig.publisher(JointState, 'tendon_states')
        self._valves = rig.publisher(JammingValvesState, 'jamming_valves/state', LATCHED)

    def say(self, pulls: Sequence[float] | None = None, soft: int = 0, at: float = 0.0) -> None:
        """Say which segment (from 1) is soft since a time (s), and after that the pulls (m)."""
        self._valves.publish(JammingValvesState(stamp=stamp_of(at), stiffness=[
            JammingValvesState.NOT_STIFF if n == soft else JammingValvesState.STIFF
            for n in range(1, len(self.arm.segments) + 1)]))
        if pulls is not None:
            self.pull(pulls)

    def pull(self, pulls: Sequence[float], names: Sequence[str] | None = None, at: float = 0.0,
             tensions: Sequence[float] = ()) -> None:
        """Say the pulls (m) at a time (s), and the tensions (N) if they are measured."""
        message = JointState(name=list(self.arm.tendon_names if names is None else names),
                             position=list(pulls), effort=list(tensions))
        message.header.stamp = stamp_of(at)
        self._tendons.publish(message)

    def state(self, **values: bool) -> None:
        """Say how the device of the tendons is."""
        self.rig.publisher(TendonActuationState, 'tendon_actuation/state', LATCHED).publish(
            TendonActuationState(**values))


class Cameras:
    """What sees every disc of an arm but its base."""

    def __init__(self, rig: Rig, arm: Arm, stddevs: Sequence[float] = DEVIATIONS) -> None:
        self._clock = rig.observer.get_clock()
        self._covariance = np.diag(np.where(arm.pose_axes, stddevs, UNKNOWN))**2
        self._discs = [rig.publisher(PoseWithCovarianceStamped, MEASURED_POSE.format(n), STREAM)
                       for n in range(1, len(arm.discs))]

    def show(self, poses: Any, spoil: Spoil = unspoilt) -> None:
        """Show every disc of an arm with these poses (2 * discs, 7), all at one time."""
        stamp = self._clock.now().to_msg()
        for publisher, pose in zip(self._discs, poses[2::2], strict=True):
            message = tracked_pose_to_ros(pose, self._covariance)
            message.header.frame_id, message.header.stamp = 'base_link', stamp
            spoil(message)
            publisher.publish(message)


class SeenArm(FakeArm):
    """An arm that cameras see, and what kinematics makes of it."""

    def __init__(self, rig: Rig, arm: Arm = ARM) -> None:
        super().__init__(rig, arm)
        self.chain, self._cameras = Chain(self.arm), Cameras(rig, self.arm)
        self.heard = rig.record(KinematicsState, 'kinematics/state', RELIABLE)
        self.predicted = rig.record(PoseArray, 'predicted_disc_poses', RELIABLE)
        self.ends = [rig.record(PoseWithCovarianceStamped, f'segment_{n}/pose', RELIABLE)
                     for n in range(1, len(self.arm.segments) + 1)]

    @property
    def last(self) -> Any:
        """The last KinematicsState."""
        return self.heard.last

    @property
    def bending(self) -> Any:
        """The bending that was last published, (segments, 2) rad."""
        return self.bending_of(self.last)

    def bending_of(self, state: KinematicsState) -> Any:
        """Return the bending of a KinematicsState, (segments, 2) rad."""
        return equilibrium_from_ros(state, self.chain).bending

    def show_until(self, bending: Any, pulls: Sequence[float], condition: Callable[[], Any],
                   what: str, spoil: Spoil = unspoilt) -> Any:
        """Show an arm that bends (segments, 2) rad evenly, until something is so; return that."""
        poses, begun = self.chain.uniform(bending).poses, [0.0]

        def shown() -> Any:
            if time.monotonic() - begun[0] > 1.0 / RATE:
                begun[0] = time.monotonic()
                self.pull(pulls)
                self._cameras.show(poses, spoil)
            return condition()

        return self.rig.wait_for(shown, what)
