# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The service that plans shapes without motion."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from math import isfinite
from time import monotonic

from rclpy.node import Node

from soft_continuum.nodes.entries import serve_later
from soft_continuum.nodes.planning import Planning
from soft_continuum.nodes.threads import on_ros_thread
from soft_continuum.ros.plans import plans_to_ros
from soft_continuum.sequencing.plans import PlanError, Reach, Shape
from soft_continuum_interfaces.msg import Shape as ShapeMessage
from soft_continuum_interfaces.srv import PlanShapes

MAX_TIME_LIMIT = 600.0  # s

Answer = Callable[[PlanShapes.Response], None]


class PlanService:
    """Handles one request at a time: a newer one, or a goal of the action, aborts it."""

    def __init__(self, node: Node, planning: Planning, busy: Callable[[], str],
                 shapes_of: Callable[[Sequence[ShapeMessage]], list[Shape]]) -> None:
        """
        Create the service.

        busy: why nothing can be planned now, empty when it can.  shapes_of: reads a request,
        raises PlanError.
        """
        self._node, self._planning, self._busy, self._shapes_of = node, planning, busy, shapes_of
        serve_later(node, PlanShapes, '~/plan_shapes', self._on_request)

    def _on_request(self, request: PlanShapes.Request, answer: Answer) -> None:
        limit = request.time_limit
        problem = self._busy()
        if not (isfinite(limit) and 0.0 <= limit <= MAX_TIME_LIMIT):
            problem = (f'time_limit is {limit:g} s; allowed: 0 (use reach.time_limit) to '
                       f'{MAX_TIME_LIMIT:g} s')
        try:
            shapes = self._shapes_of(request.shapes)
        except PlanError as error:
            problem = str(error)
        if problem:
            answer(PlanShapes.Response(message=problem))
            return
        begin = monotonic()
        plan = self._planning.explain(shapes, limit, request.states)
        plan.add_done_callback(lambda _: on_ros_thread(
            self._node, self._reply, plan, shapes, begin, answer))

    def _reply(self, plan: 'Future[list[Reach]]', shapes: Sequence[Shape], begin: float,
               answer: Answer) -> None:
        error = plan.exception()
        if error is None:
            response = plans_to_ros(plan.result(), shapes)
        else:
            name = '' if isinstance(error, PlanError) else f'{type(error).__name__}: '
            response = PlanShapes.Response(message=f'{name}{error}')
        response.planning_time = monotonic() - begin
        answer(response)
