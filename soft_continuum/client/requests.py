# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Requests to the arm, as coroutines on the node that observes it."""

from collections.abc import Sequence
from functools import cached_property
from math import inf
from typing import Any, TYPE_CHECKING
from uuid import uuid4

from soft_continuum.client.errors import LostError, NoAnswerError, RefusedError, SequenceError
from soft_continuum.client.operations import Operations
from soft_continuum.client.tasks import ATTEMPTS, until
from soft_continuum.ros.names import SHAPE_SEQUENCER
from soft_continuum.ros.ros_time import Age
from soft_continuum.sequencing.progress import AIMS
from soft_continuum.user_files import saved_shapes

if TYPE_CHECKING:  # imports that stop does not need are local
    from soft_continuum.client.sequence import RunningSequence, ShapeLike
    from soft_continuum.client.state import SequenceResult

PLANNING_TIMEOUT = 30.0  # s for the shape_sequencer to plan before it answers
TIP_TIMEOUT = 130.0  # s more for each goal of the tip: more than reach.time_limit
LOST_TIMEOUT = 10.0  # s without messages from the shape_sequencer until a sequence counts as lost
ANSWER_PAUSE = 1.0
"""s to wait for a response once the state of the sequencer shows that it was sent."""
REASON_TIMEOUT = 1.0  # s between the answer to a goal and the reason of its rejection


class Requests(Operations):
    """
    Requests to the four nodes: sequences and manual operations.

    Every coroutine returns when it is done, or raises a ClientError with the reason.  Run them
    with ``start``, on the thread that spins the node.
    """

    async def send(self, shapes: 'Sequence[ShapeLike]', hold: 'float | Sequence[float]',
                   aim: str = AIMS[0]) -> 'RunningSequence':
        """
        Set shapes in sequence, each held for ``hold`` s; return when accepted.

        shapes: names in the library or of saved shapes, or the bending of each segment, base
        first, as for Arm.run.  hold: may also be one for each shape.  aim: controlled quantity,
        'angles' or 'tip'. Raises RefusedError with the reason of the shape_sequencer; ValueError
        for an invalid hold time or aim.
        """
        from soft_continuum.client.sequence import goal, RunningSequence
        message = goal(shapes, hold, aim)
        if saved_shapes().exists():
            await self._look_up_saved(message)
        await self.found(self._action.server_is_ready, 'the action run_shape_sequence',
                         SHAPE_SEQUENCER)
        sequence = RunningSequence()
        handle = await self._handle(message, sequence.on_feedback)
        if not handle.accepted:
            observed = self.observed
            state = await until(lambda: (state := observed.shape_sequencer)
                                and state.rejected_goal_id == handle.goal_id and state,
                                REASON_TIMEOUT)
            raise RefusedError(f'{SHAPE_SEQUENCER}: '
                               f'{state.rejected if state else "the goal was rejected"}')
        sequence.begin(lambda: self.node.executor.create_task(handle.cancel_goal_async),
                       self.start(self._follow(handle)))
        return sequence

    async def _look_up_saved(self, goal: Any) -> None:
        """Replace names of saved shapes in a goal that are not in the library."""
        from soft_continuum.client.own_file import read_saved
        saved = read_saved()
        if any(shape.name in saved.names for shape in goal.shapes):
            library = await self.shapes(await self.description())
            goal.shapes = saved.replaced(goal.shapes, library)

    async def _handle(self, message: Any, on_feedback: Any) -> Any:
        """
        Send a goal; return its handle once it is accepted or rejected.

        If the response is lost, as on a busy machine, the state of the shape_sequencer shows the
        outcome.
        """
        from rclpy.action.client import ClientGoalHandle
        from unique_identifier_msgs.msg import UUID

        from soft_continuum_interfaces.action import RunShapeSequence
        goal_id, known, observed = UUID(uuid=list(uuid4().bytes)), Age(), self.observed
        accepted = False

        def reported() -> bool:
            nonlocal accepted
            state = observed.shape_sequencer
            if known.seconds == inf and state and goal_id in (state.goal_id,
                                                              state.rejected_goal_id):
                accepted = goal_id == state.goal_id
                known.refresh()
            return ANSWER_PAUSE <= known.seconds < inf

        answer = self._action.send_goal_async(message, on_feedback, goal_id)
        answer.add_done_callback(self.step)
        timeout = PLANNING_TIMEOUT + TIP_TIMEOUT * sum(
            bool(shape.tips) for shape in message.shapes)
        await until(lambda: answer.done() or reported(), timeout)
        if answer.done():
            return answer.result()
        if known.seconds < inf:
            return ClientGoalHandle(self._action, goal_id, (
                RunShapeSequence.Impl.SendGoalService.Response(accepted=accepted)))
        answer.add_done_callback(lambda late: late.result().cancel_goal_async())
        raise NoAnswerError(f'no answer from {SHAPE_SEQUENCER} within {timeout:g} s')

    async def _follow(self, handle: Any) -> 'SequenceResult':
        """Return the result of a sequence; raises SequenceError or LostError."""
        from soft_continuum.client.sequence import sequence_result
        result = sequence_result(await self._result(handle))
        if result.outcome != 'SUCCESSFUL':
            raise SequenceError(result)
        return result

    async def _result(self, handle: Any) -> Any:
        """
        Return the result of a goal; raises LostError.

        It arrives when the goal ends, unless it is lost, as on a busy machine: it is requested
        again when the goal has not run for 1 s, then 2 s and so on, ``ATTEMPTS * timeout`` s in
        all.
        """
        observed, accepted, runs, asked = self.observed, Age(), Age(), list[Any]()
        accepted.refresh()
        began = False

        def answers() -> list[Any]:
            return [one for one in asked if one.done()]

        def lost() -> bool:
            return min(accepted.seconds, observed.age(SHAPE_SEQUENCER)) >= LOST_TIMEOUT

        def late() -> bool:  # for ``pause`` s
            nonlocal began
            if (state := observed.shape_sequencer) is not None:
                began = began or state.goal_id == handle.goal_id
                if state.running and (state.goal_id == handle.goal_id or not began):
                    runs.refresh()  # running, or waiting for the previous one to end
            return runs.seconds >= pause

        pause, patience = ANSWER_PAUSE, ATTEMPTS * self.timeout
        while patience > 0.0:
            asked.append(handle.get_result_async())
            asked[-1].add_done_callback(self.step)
            runs.refresh()
            await until(lambda: answers() or lost() or late(), inf)
            if found := answers():
                return found[0].result().result
            if lost():
                raise LostError(
                    f'nothing received from {SHAPE_SEQUENCER} for {LOST_TIMEOUT:g} s; a segment '
                    'of the arm may still be soft: check its state, restart the nodes, stiffen '
                    'all segments')
            patience, pause = patience - pause, min(2.0 * pause, self.timeout)
        raise LostError(f'{SHAPE_SEQUENCER} no longer runs the sequence, but has not reported its '
                        f'result within {ATTEMPTS * self.timeout:g} s; see its state')

    async def cancel_all(self) -> None:
        """Cancel every sequence of any client."""
        from action_msgs.srv import CancelGoal
        await self.call(
            CancelGoal, 'run_shape_sequence/_action/cancel_goal', attempts=ATTEMPTS)

    @cached_property
    def _action(self) -> Any:
        from rclpy.action import ActionClient

        from soft_continuum_interfaces.action import RunShapeSequence
        self.observed  # noqa: B018  (this subscribes to the sequencer)
        return ActionClient(self.node, RunShapeSequence, 'run_shape_sequence')

    def destroy(self) -> None:
        """
        Destroy the action client: before its node, and after its executor was shut down.

        A spinning events executor crashes the process at a message for a destroyed action client
        or server (rclpy 7.1 does not hold the GIL there).
        """
        if '_action' in self.__dict__:
            self._action.destroy()
