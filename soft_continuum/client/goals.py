# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a client sends, as messages."""

from collections.abc import Sequence
from math import isfinite
from typing import Any

from builtin_interfaces.msg import Duration
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Shape

LONGEST = 86400.0  # s


def goal(shapes: Sequence[str | Sequence[float]], hold: float) -> RunShapeSequence.Goal:
    """
    Return the goal for names or bending angles (rad), each held for ``hold`` s.

    Raises ValueError for a hold time that is no time; shapes are for the shape_sequencer to judge.
    """
    if not 0.0 <= hold <= LONGEST:
        raise ValueError(f'hold is {hold} s; allowed: 0 to {LONGEST:g} s')
    time = _duration(hold)
    messages = []
    for shape in shapes:
        if isinstance(shape, str):
            messages.append(Shape(name=shape, hold_time=time))
        else:
            messages.append(Shape(bending_angles=[float(a) for a in shape], hold_time=time))
    return RunShapeSequence.Goal(shapes=messages)


def jog_trajectory(pulls: tuple[float, float] | None, duration: float, stamp: Any
                   ) -> JointTrajectory:
    """Return a motion from ``stamp`` on to the pulls (m) of both tendons; None: hold."""
    message = JointTrajectory(joint_names=['right_tendon', 'left_tendon'])
    if pulls is not None:
        message.header.stamp = stamp
        message.points.append(JointTrajectoryPoint(
            positions=list(pulls), time_from_start=_duration(duration)))
    return message


def _duration(seconds: float) -> Duration:
    assert isfinite(seconds)
    return Duration(sec=int(seconds), nanosec=min(999_999_999, int(seconds % 1.0 * 1e9)))
