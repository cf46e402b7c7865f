# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The action ~/follow_joint_trajectory of tendon_actuation, where control_msgs is installed.

A goal is validated like a trajectory on ~/joint_trajectory.  Every goal is accepted, and aborted
at once if the trajectory is refused: ROS 2 cannot give a reason for a rejected goal.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isnan
from typing import Any
from uuid import uuid4

from control_msgs.action import FollowJointTrajectory
import numpy as np
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectoryPoint

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.protocols import TendonReading
from soft_continuum.mechanics.arm import Array
from soft_continuum.nodes.tendon_control import MAX_POINTS, Report
from soft_continuum.ros.conversions import seconds, trajectory_from_ros
from soft_continuum.ros.entries import guarded
from soft_continuum.ros.motion_tracker import MotionTracker
from soft_continuum.ros.ros_time import duration_to_ros, RosTime
from soft_continuum.text import plain
from soft_continuum_interfaces.msg import MotionRequest, TendonTrajectory

Result = FollowJointTrajectory.Result
MAX_GOALS = 8  # at once: one is followed, the others are judged
JUDGING_TIMEOUT = 10.0  # s
STARTING = {MotionRequest.LATE, MotionRequest.CLOCK}
"""Reasons for refusing a goal with a header.stamp as too old."""


class GoalError(ValueError):
    """A goal that is refused before validation; code: of Result."""

    def __init__(self, code: int, message: str) -> None:
        """Refuse with a code, for programs, and a message, for a person."""
        super().__init__(message)
        self.code = code


@dataclass
class Tolerances:
    """Largest errors of position (m) and speed (m/s), (tendons,); inf for none."""

    positions: Array
    speeds: Array

    def problem(self, positions: Array, speeds: Array, tendons: tuple[str, ...]) -> str:
        """Return which error is too large; empty for none."""
        for what, unit, errors, allowed in (
                ('position', 'm', positions, self.positions),
                ('speed', 'm/s', speeds, self.speeds)):
            over = np.abs(errors) - allowed
            if over.max() > 0.0:
                n = int(over.argmax())
                return (f'the {what} of {tendons[n]} is {errors[n]:.4g} {unit} off; tolerance: '
                        f'{allowed[n]:.4g} {unit}')
        return ''


@dataclass
class _Goal:
    """A goal that was accepted as such; since: when it came, s (steady)."""

    handle: Any
    motion: MotionTracker
    times: Array
    pulls: Array
    path: Tolerances
    final: Tolerances
    late: float  # s after its end by which it has to be reached; inf for any time
    since: float
    stamped: bool
    first: Array | None = None  # (tendons,) m, the pulls when tendon_actuation had accepted it

    def desired(self, time: float) -> tuple[Array, Array]:
        """Return pulls (m) and speeds (m/s) at a time from the start, s."""
        assert self.first is not None
        times, pulls = self.times, self.pulls
        if times[0] > 0.0:
            times, pulls = np.append(0.0, times), np.vstack([self.first, pulls])
        wanted = np.array([np.interp(time, times, column) for column in pulls.T])
        at = int(np.searchsorted(times, time, side='right'))
        if not 0 < at < len(times):
            return wanted, np.zeros(len(wanted))
        return wanted, (pulls[at] - pulls[at - 1]) / (times[at] - times[at - 1])


class FollowServer(ActionServer):
    """
    Follows goals, one at a time; on the thread of ROS.

    take: passes a serialised TendonTrajectory and its id on for validation.  hold: makes the
    tendons brake and hold.  give_up: withdraws the trajectory of an id.
    """

    def __init__(self, node: Node, tendons: tuple[str, ...], take: Callable[[bytes, str], None],
                 hold: Callable[[], None], give_up: Callable[[str], None]) -> None:
        """Serve the action."""
        self._tendons, self._take, self._hold, self._give_up = tendons, take, hold, give_up
        self._time = RosTime(node.get_clock())
        self._goals: dict[str, _Goal] = {}  # by the id of the trajectory
        super().__init__(
            node, FollowJointTrajectory, '~/follow_joint_trajectory', lambda handle: None,
            goal_callback=lambda _: (GoalResponse.ACCEPT if len(self._goals) < MAX_GOALS
                                     else GoalResponse.REJECT),
            handle_accepted_callback=guarded(node, self._on_accepted),
            cancel_callback=guarded(node, self._on_cancel))

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Leave the goal executing until it ends."""

    def _end(self, handle: Any, code: int, message: str, canceled: bool = False) -> None:
        def result(handle: Any) -> Any:
            if canceled:
                handle.canceled()
            elif code == Result.SUCCESSFUL:
                handle.succeed()
            else:
                handle.abort()
            return Result(error_code=code, error_string=message)

        super().notify_execute(handle, result)

    # Goals.

    def _on_accepted(self, handle: Any) -> None:
        request = handle.request
        handle.execute()  # from which it can be ended
        try:
            goal = self._goal(handle, request)
        except GoalError as error:
            self._end(handle, error.code, str(error))
            return
        name = goal.motion.id
        self._goals[name] = goal
        self._take(serialize_message(
            TendonTrajectory(id=name, trajectory=request.trajectory)), name)

    def _goal(self, handle: Any, request: Any) -> _Goal:
        """Return a goal as numbers; raises GoalError."""
        trajectory, now = request.trajectory, STEADY()
        if (request.multi_dof_trajectory.points or request.component_path_tolerance
                or request.component_goal_tolerance):
            raise GoalError(Result.INVALID_GOAL, 'multi-DOF trajectories are not supported; '
                                                 'tendons have one degree of freedom')
        named = {*trajectory.joint_names} | {
            one.name for one in (*request.path_tolerance, *request.goal_tolerance)}
        if sorted(trajectory.joint_names) != sorted(self._tendons) or named - {*self._tendons}:
            raise GoalError(Result.INVALID_JOINTS, f'joint names {plain(str(sorted(named)))}; '
                            f'needed: {list(self._tendons)}')
        if len(trajectory.points) > MAX_POINTS:
            raise GoalError(Result.INVALID_GOAL, f'{len(trajectory.points)} points; allowed: '
                            f'{MAX_POINTS}; send the trajectory in parts')
        if not trajectory.points:
            raise GoalError(Result.INVALID_GOAL, 'a trajectory without points; to hold, cancel')
        try:
            times, pulls = trajectory_from_ros(trajectory, self._tendons)
        except ValueError as error:
            raise GoalError(Result.INVALID_GOAL, str(error)) from None
        start = self._time.steady(trajectory.header.stamp)
        if start is not None and start + times[-1] < now:
            raise GoalError(
                Result.OLD_HEADER_TIMESTAMP, f'the trajectory ended {now - start - times[-1]:.3f} '
                's ago; check header.stamp (zero: start now) and the clocks')
        late = seconds(request.goal_time_tolerance)
        return _Goal(handle, MotionTracker(f'follow_joint_trajectory/{uuid4().hex}'), times, pulls,
                     self._tolerances(request.path_tolerance),
                     self._tolerances(request.goal_tolerance), late if late > 0.0 else inf, now,
                     start is not None)

    def _tolerances(self, given: Any) -> Tolerances:
        """Return tolerances; 0 or less stands for none.  Raises GoalError."""
        found = Tolerances(np.full(len(self._tendons), inf), np.full(len(self._tendons), inf))
        for one in given:
            if one.acceleration > 0.0:
                raise GoalError(Result.INVALID_GOAL, f'a tolerance of the acceleration of '
                                f'{plain(one.name)}: accelerations are not measured')
            n = self._tendons.index(one.name)
            if any(map(isnan, (one.position, one.velocity, one.acceleration))):
                raise GoalError(Result.INVALID_GOAL, f'a tolerance of {plain(one.name)} is nan')
            for values, value in ((found.positions, one.position), (found.speeds, one.velocity)):
                values[n] = value if value > 0.0 else inf
        return found

    def _on_cancel(self, handle: Any) -> CancelResponse:
        if any(goal.handle is handle for goal in self._goals.values()):
            self._hold()
        return CancelResponse.ACCEPT

    # What happens to them.

    def report(self, report: Report) -> None:
        """Process a report of tendon_actuation: after every cycle and every change."""
        for name, goal in list(self._goals.items()):
            outcome = goal.motion.outcome(report.state)
            if outcome is None:
                if not goal.motion.followed and STEADY() - goal.since > JUDGING_TIMEOUT:
                    self._give_up(name)  # it may still be judged
                    self._finish(name, Result.INVALID_GOAL,
                                 'the trajectory was not validated in time')
            elif outcome.status == MotionRequest.REFUSED:
                self._give_up(name)  # a part of it may have been accepted
                old = goal.stamped and outcome.reason in STARTING
                self._finish(name, Result.OLD_HEADER_TIMESTAMP if old else Result.INVALID_GOAL,
                             outcome.message)
            elif outcome.status == MotionRequest.ENDED:
                self._finish(name, Result.PATH_TOLERANCE_VIOLATED, outcome.message)
            elif report.reading is not None:
                self._follow(name, goal, report, report.reading,
                             outcome.status == MotionRequest.DONE)

    def _follow(self, name: str, goal: _Goal, report: Report, reading: TendonReading, done: bool
                ) -> None:
        pulls, speeds = np.array(reading.pulls), np.array(reading.speeds)
        if goal.first is None:
            goal.first = pulls
        time = report.time - report.start
        wanted, moves = goal.desired(goal.times[-1] if done else time)
        self._send_feedback(goal, time, (wanted, moves), (pulls, speeds))
        tolerances = goal.final if done else goal.path
        problem = tolerances.problem(pulls - wanted, speeds - moves, self._tendons)
        if done:
            self._finish(name, Result.GOAL_TOLERANCE_VIOLATED if problem else Result.SUCCESSFUL,
                         problem)
        elif problem and time <= goal.times[-1]:
            self._hold()
            self._finish(name, Result.PATH_TOLERANCE_VIOLATED, problem)
        elif time > goal.times[-1] + goal.late:
            self._hold()
            self._finish(name, Result.GOAL_TOLERANCE_VIOLATED,
                         f'the tendons do not rest {goal.late:.3g} s after the end '
                         '(goal_time_tolerance)')

    def _finish(self, name: str, code: int, message: str) -> None:
        goal = self._goals.pop(name)
        self._end(goal.handle, code, message, goal.handle.is_cancel_requested)

    def _send_feedback(self, goal: _Goal, time: float, wanted: tuple[Array, Array],
                       actual: tuple[Array, Array]) -> None:
        if not goal.handle.is_active:
            return
        stamp = duration_to_ros(max(0.0, time))
        (a, b), (c, d) = wanted, actual
        goal.handle.publish_feedback(FollowJointTrajectory.Feedback(
            header=Header(stamp=self._time.stamp(STEADY())), joint_names=list(self._tendons),
            **{name: JointTrajectoryPoint(positions=x.tolist(), velocities=v.tolist(),
                                          time_from_start=stamp)
               for name, x, v in (('desired', a, b), ('actual', c, d),
                                  ('error', a - c, b - d))}))
