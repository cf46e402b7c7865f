# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A client of FollowJointTrajectory in a process of its own, which has control_msgs.

It prints a line of JSON for each goal: how it ended and why, and, of the last feedback,
desired, actual and error.
"""

import json
from math import nan
import sys
import time

from builtin_interfaces.msg import Duration, Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
import rclpy
from rclpy.action import ActionClient
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

DEADLINE = 25.0
NAMES = 'right_tendon', 'left_tendon'
LONG = 30  # s, of a motion that is ended before


def goal(*positions, seconds=1, names=NAMES, sec=0, path=0.0, final=0.0):
    """Return a goal that is at some pulls after so many s."""
    trajectory = JointTrajectory(joint_names=list(names))
    trajectory.header.stamp = Time(sec=sec)
    if positions:
        trajectory.points.append(JointTrajectoryPoint(
            positions=list(positions), time_from_start=Duration(sec=seconds)))
    return FollowJointTrajectory.Goal(
        trajectory=trajectory,
        path_tolerance=[JointTolerance(name=NAMES[0], position=path)],
        goal_tolerance=[JointTolerance(name=NAMES[0], position=final)])


def long_goal():
    """Return a goal of more than 64 kB, within the number of points that is allowed."""
    request = goal()
    request.trajectory.points += [JointTrajectoryPoint(
        positions=[0.001, -0.0015], velocities=[0.0, 0.0], accelerations=[0.0, 0.0],
        effort=[0.0, 0.0], time_from_start=Duration(sec=n)) for n in range(1, 901)]
    return request


class Client:
    """Sends goals one after the other."""

    def __init__(self):
        rclpy.init()
        self.node = rclpy.create_node('follower', namespace=sys.argv[1])
        self.action = ActionClient(self.node, FollowJointTrajectory,
                                   'tendon_actuation/follow_joint_trajectory')
        assert self.action.wait_for_server(DEADLINE)
        self.feedback = []

    def wait(self, condition):
        end = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < end
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def send(self, request):
        """Send a goal; return its handle and the future of its result."""
        self.feedback.clear()
        sent = self.action.send_goal_async(
            request, lambda message: self.feedback.append(message.feedback))
        self.wait(sent.done)
        assert sent.result().accepted
        return sent.result(), sent.result().get_result_async()

    def show(self, name, result):
        """Wait for the end of a goal and print it."""
        self.wait(result.done)
        last = self.feedback[-1] if self.feedback else None
        print(json.dumps({
            'name': name, 'status': result.result().status,
            'code': result.result().result.error_code,
            'text': result.result().result.error_string, 'feedback': len(self.feedback),
            **({part: list(getattr(last, part).positions)
                for part in ('desired', 'actual', 'error')} if last else {})}), flush=True)

    def run(self):
        for name, request in (
                ('done', goal(0.0010013, -0.0015)),
                ('joints', goal(0.0, 0.0, names=('right_tendon', 'middle_tendon'))),
                ('tolerance_joint', FollowJointTrajectory.Goal(
                    trajectory=goal(0.0, 0.0).trajectory,
                    path_tolerance=[JointTolerance(name='elbow')])),
                ('empty', goal()),
                ('nan', goal(nan, 0.0)),
                ('far', goal(0.5, -0.5, seconds=100)),
                ('old', goal(0.0, 0.0, sec=1)),
                ('long', long_goal()),
                ('path', goal(0.003, -0.0035, path=1e-9)),
                ('final', goal(0.0005013, -0.001, final=1e-9)),
        ):
            self.show(name, self.send(request)[1])
        handle, result = self.send(goal(0.004, -0.005, seconds=LONG))
        self.wait(lambda: self.feedback)
        handle.cancel_goal_async()
        self.show('canceled', result)
        _, first = self.send(goal(0.004, -0.005, seconds=LONG))
        self.wait(lambda: self.feedback)
        _, second = self.send(goal(0.001, -0.0015, seconds=2))
        self.show('replaced', first)
        self.show('newer', second)
        self.action.destroy()
        self.node.destroy_node()
        rclpy.shutdown()


Client().run()
