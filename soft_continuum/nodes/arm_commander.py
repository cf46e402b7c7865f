# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The requests that nodes send to tendon_actuation and jamming_valves."""

from collections.abc import Sequence
from typing import Any
from uuid import uuid4

from builtin_interfaces.msg import Time
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.ros.conversions import trajectory_to_ros
from soft_continuum.ros.entries import COMMAND
from soft_continuum.ros.motion_tracker import MotionTracker
from soft_continuum.ros.names import JAMMING_VALVES, TENDON_ACTUATION
from soft_continuum.ros.ros_time import RosTime
from soft_continuum.sequencing import Code
from soft_continuum.sequencing.runner import Failure
from soft_continuum_interfaces.msg import MotionRequest, TendonActuationState, TendonTrajectory
from soft_continuum_interfaces.srv import SetVacuum

SET_STIFF, SET_VACUUM = 'set_stiff', 'set_vacuum'
SERVICES = {SET_STIFF: SetBool, SET_VACUUM: SetVacuum}
"""Services of jamming_valves for each segment: name and type."""
CODES = {
    MotionRequest.STOPPED: Code.STOPPED,
    MotionRequest.TENSION: Code.MODEL_FAILURE,
    MotionRequest.LATE: Code.TIMEOUT,
    MotionRequest.CLOCK: Code.CLOCK_JUMPED,
}
"""Codes by which refused or ended motions end a sequence; other reasons: HARDWARE_FAULT."""

ENDS = {MotionRequest.REFUSED: 'refused', MotionRequest.ENDED: 'ended'}


class MotionCommander:
    """
    Sends motions to tendon_actuation, and keeps why one failed.

    motion_failure: of the present motion.
    """

    def __init__(self, node: Node, arm: Arm) -> None:
        """Create the publisher for ``node``, whose name begins the ids of its motions."""
        self.motion_failure: Failure | None = None
        self._tendons: Sequence[str] = arm.tendon_names
        self._name = node.get_name()
        self._process = uuid4().hex[:8]
        self._run = 0
        self._motion: MotionTracker | None = None  # the present one
        self._start, self._stamp = 0.0, Time()  # of the pieces that were sent last
        self._ros_time = RosTime(node.get_clock())
        self._trajectory = node.create_publisher(
            TendonTrajectory, f'{TENDON_ACTUATION}/tendon_trajectory', COMMAND)

    def begin(self) -> None:
        """Begin a run: failures of earlier requests no longer count."""
        self._run += 1
        self._motion = self.motion_failure = None

    def follow(self, motion: int, start: float, times: Array, pulls: Array) -> None:
        """Send the next piece of a motion; all pieces of one motion have the same id."""
        motion_id = f'{self._name}/{self._process}/{self._run}.{motion}'
        if self._motion is None or motion_id != self._motion.id:
            self._motion, self.motion_failure = MotionTracker(motion_id), None
            self._start = 0.0
        if start != self._start:  # parts of one path share their stamp
            self._start, self._stamp = start, self._ros_time.stamp(start)
        trajectory = trajectory_to_ros(times, pulls, self._tendons)
        trajectory.header.stamp = self._stamp
        self._trajectory.publish(TendonTrajectory(id=motion_id, trajectory=trajectory))

    def hold(self) -> None:
        """Request that the tendons brake and hold: a trajectory without points."""
        self._trajectory.publish(
            TendonTrajectory(trajectory=JointTrajectory(joint_names=list(self._tendons))))

    def on_tendon_state(self, state: TendonActuationState) -> None:
        """Note what happened to the present motion."""
        if self._motion is None or self.motion_failure is not None:
            return
        outcome = self._motion.outcome(state)
        if outcome is not None and outcome.status in ENDS:
            self.motion_failure = Failure(
                CODES.get(outcome.reason, Code.HARDWARE_FAULT),
                f'the tendon motion was {ENDS[outcome.status]}: {outcome.message}')


class ArmCommander(MotionCommander):
    """
    The ArmPort of a Runner, over ROS; keeps why requests failed.

    switch_failure: why jamming_valves did not switch.
    """

    def __init__(self, node: Node, arm: Arm, jamming: bool = True) -> None:
        """Create the publisher and, with ``jamming``, the clients."""
        super().__init__(node, arm)
        self.switch_failure = ''
        self._node = node
        self._clients = {(name, segment): self._client(name, segment) for name in SERVICES
                         for segment in range(len(arm.segments)) if jamming}
        self._answers: dict[tuple[str, int], Future] = {}  # of the last request to each

    def _client(self, name: str, segment: int) -> Client:
        return self._node.create_client(
            SERVICES[name], f'{JAMMING_VALVES}/segment_{segment + 1}/{name}')

    def begin(self) -> None:
        """Begin a run: failures of earlier requests no longer count."""
        super().begin()
        self.switch_failure = ''

    def end(self) -> None:
        """End a run: unanswered requests are not carried out later."""
        for service, answer in self._answers.items():
            if not answer.done():  # the network may be cut, and would bring it when it is back
                self._node.destroy_client(self._clients[service])
                self._clients[service] = self._client(*service)
        self._answers.clear()

    def hold(self) -> None:
        """Request that the tendons brake and hold; ending the motion this way is no failure."""
        super().hold()
        self._motion = self.motion_failure = None

    def set_stiff(self, segment: int, stiff: bool) -> None:
        """Request that jamming_valves evacuates or vents a segment (0-based)."""
        self._request((SET_STIFF, segment), SetBool.Request(data=stiff))

    def set_vacuum(self, segment: int, vacuum: float) -> None:
        """Request that jamming_valves sets the vacuum of a segment (0-based), Pa."""
        self._request((SET_VACUUM, segment), SetVacuum.Request(vacuum=vacuum))

    def _request(self, service: tuple[str, int], request: Any) -> None:
        run = self._run

        def on_response(future: Future) -> None:
            response = future.result()
            if run == self._run and response is not None and not response.success:
                self.switch_failure = f'{JAMMING_VALVES}: {response.message}'

        answer = self._clients[service].call_async(request)
        self._answers[service] = answer
        answer.add_done_callback(on_response)
