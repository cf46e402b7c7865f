# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The server of the action run_shape_sequence: goals are answered and ended from outside."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from math import nan
from typing import Any

from geometry_msgs.msg import PoseWithCovariance
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from unique_identifier_msgs.msg import UUID

from soft_continuum.sequencing.progress import Code, Outcome
from soft_continuum_interfaces.action import RunShapeSequence

RESULT_TIMEOUT = 900  # s for which a client can still ask for a result
GOALS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""Of many goals at once each is answered; rclpy would forget all but ten."""


@dataclass(frozen=True)
class GoalRequest:
    """A goal that waits for its answer; ``answer(True)`` accepts it, ``answer(False)`` rejects."""

    goal_id: UUID
    goal: RunShapeSequence.Goal
    answer: Callable[[bool], None]


@dataclass(frozen=True)
class Reached:
    """Where the arm is in the end, as in the result of RunShapeSequence."""

    bending_angles: Sequence[float] = ()
    angle_stddevs: Sequence[float] = ()
    bending_directions: Sequence[float] = ()
    tip: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    tip_error: float = nan


def error_code(code: Code) -> int:
    """Return the error_code of RunShapeSequence by which a code is known."""
    return int(getattr(RunShapeSequence.Result, code.name))


NOWHERE = Reached()
"""Of a goal that ends before it is known where the arm is."""


class SequenceServer(ActionServer):
    """
    An action server without callbacks that wait.

    rclpy wants the answer to a goal when its callback returns, without the id of the goal, and
    one callback that runs as long as the goal; a coroutine that waits would be polled by its
    executors with a whole core.
    """

    def __init__(self, node: Node, on_request: Callable[[GoalRequest], None],
                 on_accepted: Callable[[Any], None]) -> None:
        """Hand each goal to ``on_request``, and its handle, once accepted, to ``on_accepted``."""
        self._on_request = on_request
        self._answer = GoalResponse.REJECT
        super().__init__(
            node, RunShapeSequence, 'run_shape_sequence', lambda handle: None,
            goal_callback=lambda goal: self._answer, handle_accepted_callback=on_accepted,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
            goal_service_qos_profile=GOALS, result_timeout=RESULT_TIMEOUT)

    async def _execute_goal_request(self, request: Any) -> None:
        """Leave the answer to whoever takes the request."""
        message = request[1]
        try:
            self._on_request(GoalRequest(
                message.goal_id, message.goal, partial(self._send_answer, request)))
        except Exception:
            self._send_answer(request, False)
            raise

    def _send_answer(self, request: Any, accept: bool) -> None:
        self._answer = GoalResponse.ACCEPT if accept else GoalResponse.REJECT
        with suppress(StopIteration):  # it has nothing to wait for
            super()._execute_goal_request(request).send(None)

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Leave the goal executing until ``finish`` is called."""

    def finish(self, handle: Any, outcome: Outcome, reached: Reached = NOWHERE) -> None:
        """End a goal, in the state that its outcome calls for, and send the result."""

        def result(handle: Any) -> RunShapeSequence.Result:
            if outcome.code is Code.SUCCESSFUL:
                handle.succeed()
            elif outcome.code is Code.CANCELED and handle.is_cancel_requested:
                handle.canceled()
            else:
                handle.abort()
            return RunShapeSequence.Result(
                error_code=error_code(outcome.code), error_string=outcome.message,
                shapes_completed=outcome.shapes_completed, corrections=outcome.corrections,
                replans=outcome.replans,
                source=(RunShapeSequence.Result.MEASURED if outcome.measured
                        else RunShapeSequence.Result.PREDICTED), **vars(reached))

        super().notify_execute(handle, result)
