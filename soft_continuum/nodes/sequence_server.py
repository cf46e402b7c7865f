# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The server of the action run_shape_sequence; its owner accepts and ends goals."""

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

from soft_continuum.sequencing import Code, Outcome
from soft_continuum_interfaces.action import RunShapeSequence

RESULT_TIMEOUT = 900  # s for which a client can still ask for a result
GOALS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""Queue length, so that each of many goals is answered; rclpy would keep only ten."""


@dataclass(frozen=True)
class GoalRequest:
    """A pending goal; ``answer(True)`` accepts it, ``answer(False)`` rejects it."""

    goal_id: UUID
    goal: RunShapeSequence.Goal
    answer: Callable[[bool], None]


@dataclass(frozen=True)
class FinalState:
    """Final state of the arm, as in the result of RunShapeSequence."""

    bending_angles: Sequence[float] = ()
    angle_stddevs: Sequence[float] = ()
    bending_directions: Sequence[float] = ()
    tip: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    tip_error: float = nan


def error_code(code: Code) -> int:
    """Return the error_code of RunShapeSequence for a code."""
    return int(getattr(RunShapeSequence.Result, code.name))


NOWHERE = FinalState()
"""Result of a goal that ends before the state of the arm is known."""


class SequenceServer(ActionServer):
    """
    An action server without callbacks that wait.

    rclpy expects the response to a goal when its callback returns, without the id of the goal, and
    one callback that runs as long as the goal; its executors would poll a waiting coroutine, which
    occupies a core.
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
        """Leave the answer to the handler of the request."""
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

    def finish(self, handle: Any, outcome: Outcome, reached: FinalState = NOWHERE) -> None:
        """End a goal in the state of its outcome, and send the result."""

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
