# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A sequence of shapes while it runs."""

from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from time import monotonic
from typing import Any

from soft_continuum.client.connection import Connection
from soft_continuum.client.errors import LostError, NoAnswerError, SequenceError
from soft_continuum.client.state import SequenceResult
from soft_continuum_interfaces.action import RunShapeSequence

SILENCE = 10.0  # s without a word of the shape_sequencer until it counts as lost
OUTCOMES = {getattr(RunShapeSequence.Result, name): name for name in (
    'SUCCESSFUL', 'PREEMPTED', 'CANCELED', 'STOPPED', 'TIMEOUT', 'HARDWARE_FAULT',
    'MODEL_FAILURE')}


@dataclass(frozen=True)
class Progress:
    """
    How far a sequence is.

    shape_index: from 0.  segment: from 1, 0 for the whole arm.  phase: 'preparing', 'softening',
    'moving', 'stiffening' or 'holding'.  fraction: 0 to 1, of the whole sequence.
    """

    shape_index: int
    shape: str
    segment: int
    phase: str
    fraction: float


class RunningSequence:
    """
    A sequence that was sent; made by ``Arm.start``.

    Wait with ``result()``, or with ``await`` in asyncio.
    """

    def __init__(self, connection: Connection, age: Callable[[], float | None]) -> None:
        """``age`` tells the s since the shape_sequencer was heard."""
        self.accepted: bool | None = None
        self._connection = connection
        self._age = age
        self._heard = monotonic()
        self._progress: Progress | None = None
        self._handle: Any = None
        self._cancel_wanted = False
        self._end: Future[SequenceResult] = Future()
        self._end.set_running_or_notify_cancel()  # a task that no longer awaits ends no goal

    # For the user.

    @property
    def progress(self) -> Progress | None:
        """How far it is; None before the first word."""
        return self._progress

    @property
    def done(self) -> bool:
        """Whether it has ended, in whatever way."""
        return self._end.done()

    def updates(self) -> Iterator[Progress]:
        """Yield how far it is whenever that changes, until it has ended."""
        before: Progress | None = None

        def news() -> bool:
            return self.done or self._progress != before

        while True:
            self._connection.wait_for(news, SILENCE)
            done, now = self.done, self._progress
            if now is not None and now != before:
                before = now
                yield now
            if done:
                return

    def result(self, timeout: float | None = None) -> SequenceResult:
        """
        Wait for the end, at most ``timeout`` s; return how it ended.

        Raises SequenceError if not every shape was reached and held, NoAnswerError when it still
        runs after ``timeout``, LostError when the shape_sequencer has fallen silent.
        """
        try:
            return self._end.result(timeout)
        except TimeoutError:
            raise NoAnswerError(f'the sequence still runs after {timeout:g} s; '
                                'wait longer or cancel() it') from None

    def __await__(self) -> Generator[Any, None, SequenceResult]:
        """Wait as ``result()`` does, without blocking the event loop."""
        import asyncio  # 0.04 s that a stop must not wait for
        return asyncio.wrap_future(self._end).__await__()

    def cancel(self) -> None:
        """
        Ask for the end: the tendons come to rest, the soft segment is stiffened.

        Returns at once; ``result()`` then raises SequenceError with outcome CANCELED.
        """
        self._connection.do(self._cancel)

    # On the thread of the connection.

    def send(self, action: Any, goal: RunShapeSequence.Goal) -> None:
        """Send the goal."""
        self._connection.every_second.append(self._watch)
        action.send_goal_async(goal, feedback_callback=self._on_feedback).add_done_callback(
            self._on_answer)

    def _cancel(self) -> None:
        self._cancel_wanted = True
        if self._handle is not None and not self.done:
            self._handle.cancel_goal_async()

    def _on_answer(self, future: Any) -> None:
        handle = future.result()
        self.accepted = handle.accepted
        if handle.accepted:
            self._handle = handle
            handle.get_result_async().add_done_callback(self._on_result)
            if self._cancel_wanted:
                self._cancel()
        else:
            self._finish()
        self._connection.changed()

    def _on_feedback(self, message: Any) -> None:
        said = message.feedback
        self._heard = monotonic()
        self._progress = Progress(said.shape_index, said.shape, said.segment, said.phase,
                                  float(said.progress))
        self._connection.changed()

    def _on_result(self, future: Any) -> None:
        said = future.result().result
        result = SequenceResult(OUTCOMES.get(said.error_code, str(said.error_code)),
                                said.error_string, said.shapes_completed)
        if said.error_code == RunShapeSequence.Result.SUCCESSFUL:
            self._finish(lambda: self._end.set_result(result))
        else:
            self._finish(lambda: self._end.set_exception(SequenceError(result)))

    def _watch(self) -> None:
        """Give up when nothing has been heard for long, on whatever topic."""
        if self._handle is None:  # it may still plan
            return
        age = self._age()
        if monotonic() - self._heard >= SILENCE and (age is None or age >= SILENCE):
            self._finish(lambda: self._end.set_exception(LostError(
                f'nothing heard of shape_sequencer for {SILENCE:g} s; the arm may be left with a '
                'soft segment: see its state, start the nodes again, stiffen all segments')))

    def _finish(self, say: Callable[[], None] = lambda: None) -> None:
        if self._watch in self._connection.every_second:
            self._connection.every_second.remove(self._watch)
        if not self.done:
            say()
        self._connection.changed()
