# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Coroutines on the thread that spins a node: service calls and waits with deadlines."""

from array import array
from collections import Counter
from collections.abc import Callable, Coroutine, Generator, Sequence
from concurrent.futures import Future
import os
from time import monotonic
from types import coroutine
from typing import Any, TypeVar

from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python

from soft_continuum.client.errors import (
    ClientError,
    NoAnswerError,
    NodesMissingError,
    RefusedError,
)
from soft_continuum.ros.graph import running_nodes
from soft_continuum.ros.names import JAMMING_VALVES, NODES, RECORDER, SHAPE_SEQUENCER

T = TypeVar('T')

ATTEMPTS = 4  # of what may be asked for again
POLL_PERIOD = 0.05  # s between two looks at what gives no notice, such as the ROS graph
HOW_TO_START = 'start them with `./run up` or `ros2 launch soft_continuum bringup.launch.py`'


@coroutine
def _next_step() -> Generator[None, None, None]:
    yield


async def until(condition: Callable[[], T], timeout: float) -> T:
    """Return what ``condition`` gives as soon as that is true, or at last after ``timeout`` s."""
    deadline = monotonic() + timeout
    while not (value := condition()) and monotonic() < deadline:
        await _next_step()
    return value


class Tasks:
    """
    Runs coroutines that wait by ``until``, each step on the thread that spins ``node``.

    rclpy has coroutines of its own, but polls them without a pause.  Callbacks of a future come
    on that thread, too.
    """

    def __init__(self, node: Node, timeout: float, discovery_timeout: float) -> None:
        """``timeout``: s for an answer.  ``discovery_timeout``: s for a node to be found."""
        self.node = node
        self.timeout = timeout
        self.discovery_timeout = discovery_timeout
        self._open = True
        self._clients: dict[str, Any] = {}
        self._callers: Counter[str] = Counter()  # of each of them, that wait
        self._tasks: dict[Coroutine[Any, None, Any], Future[Any]] = {}
        self._timer = node.create_timer(
            POLL_PERIOD, self.step, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._timer.cancel()

    def start(self, work: Coroutine[Any, None, T]) -> Future[T]:
        """Start a coroutine, from any thread; return the future of its outcome."""
        if not self._open:
            work.close()
            raise ClientError('this Arm is closed; make a new one')
        future: Future[T] = Future()
        future.set_running_or_notify_cancel()  # a task that no longer awaits it ends nothing
        self.node.executor.create_task(self._begin, work, future)
        return future

    def _begin(self, work: Coroutine[Any, None, T], future: Future[T]) -> None:
        self._tasks[work] = future
        self._timer.reset()
        self._advance(work)

    async def close(self) -> None:
        """Start no more; let what still waits fail."""
        self._open = False
        for work, future in list(self._tasks.items()):
            if not work.cr_running:  # type: ignore[attr-defined]  # all but this one
                del self._tasks[work]
                work.close()
                future.set_exception(ClientError('this Arm was closed meanwhile'))

    def step(self, *_: object) -> None:
        """Let every coroutine see whether what it waits for has come."""
        for work in list(self._tasks):
            if work in self._tasks:  # an earlier one may have closed it
                self._advance(work)
        if not self._tasks:
            self._timer.cancel()

    def _advance(self, work: Coroutine[Any, None, Any]) -> None:
        try:
            work.send(None)
        except StopIteration as end:
            self._tasks.pop(work).set_result(end.value)
        except BaseException as error:
            self._tasks.pop(work).set_exception(error)

    # Services.

    async def found(self, condition: Callable[[], T], what: str, node: str) -> T:
        """
        Return what ``condition`` gives once it is true.

        Raises NodesMissingError or NoAnswerError, about ``node``, after the discovery timeout.
        """
        value = await until(condition, self.discovery_timeout)
        if not value:
            raise self.not_found(what, [node], self.discovery_timeout)
        return value

    def client(self, kind: Any, name: str) -> Any:
        """Return the client of a service; made before the first call, that waits for nothing."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        return self._clients[name]

    async def call(self, kind: Any, name: str, *, attempts: int = 1, within: float | None = None,
                   **request: Any) -> Any:
        """
        Call a service of one of the nodes; return its response.

        attempts: how often it is asked in all, where that may be: an answer can get lost when a
        node has just been started.  within: s for an answer that takes longer than others.

        Raises NodesMissingError or NoAnswerError.
        """
        client = self.client(kind, name)
        node = next((n for n in (*NODES, RECORDER) if name.startswith(f'{n}/')), NODES[-1])
        timeout = self.timeout if within is None else within
        asked: list[Any] = []
        self._callers[name] += 1
        try:
            await self.found(client.service_is_ready, name, node)
            for _ in range(attempts):
                asked.append(client.call_async(kind.Request(**request)))
                asked[-1].add_done_callback(self.step)
                # The answer to an earlier one counts, too: it may only be late.
                if answered := await until(
                        lambda: [one for one in asked if one.done()], timeout / attempts):
                    return answered[0].result()
        finally:
            self._callers[name] -= 1
            for one in asked:
                client.remove_pending_request(one)
        # What nobody waits for must not be carried out later; what others wait for must be.
        if not self._callers[name] and self._clients.pop(name, None):
            self.node.destroy_client(client)
        raise self.not_found(f'an answer of {name}', [node], timeout)

    async def done(self, future: Any, timeout: float) -> bool:
        """Wait for a future of rclpy; return whether it is done."""
        future.add_done_callback(self.step)
        return await until(future.done, timeout)

    async def parameters(self, node: str, names: Sequence[str]) -> dict[str, Any]:
        """Return parameters of a node by name, without those that have no value."""
        answer = await self.call(GetParameters, f'{node}/get_parameters', attempts=ATTEMPTS,
                                 names=list(names))
        if len(answer.values) < len(names) > 1:  # a node that lacks one gives none
            return {key: value for name in names
                    for key, value in (await self.parameters(node, [name])).items()}
        read = {name: parameter_value_to_python(value)
                for name, value in zip(names, answer.values, strict=False)}
        return {name: value.tolist() if isinstance(value, array) else value
                for name, value in read.items() if value is not None}

    async def set_parameter(self, node: str, name: str, value: Any) -> None:
        """Set a parameter of a node; raises RefusedError with the reason of the node."""
        answer = await self.call(SetParameters, f'{node}/set_parameters', attempts=ATTEMPTS,
                                 parameters=[Parameter(name, value=value).to_parameter_msg()])
        result = answer.results[0] if answer.results else None
        if result is None or not result.successful:
            raise RefusedError(f'{node}: {result.reason if result else "no answer"}')

    def not_found(self, what: str, needed: Sequence[str], timeout: float) -> ClientError:
        """Return the error for something that did not appear within ``timeout`` s."""
        running = running_nodes(self.node, (*NODES, RECORDER))
        if all(running[name] for name in needed):
            return NoAnswerError(f'nothing of {what} within {timeout:g} s, though its node '
                                 'runs; is it active, and the machine not overloaded?')
        missing = [name for name in NODES if not running[name]]
        space = self.node.get_namespace()
        text = (f'{", ".join(missing)} {"does" if len(missing) == 1 else "do"} not run in '
                f'namespace {space}; {HOW_TO_START}')
        if {*missing} <= {JAMMING_VALVES, SHAPE_SEQUENCER}:  # it may be an arm without
            text += ('; an arm without jamming has no jamming_valves, and, where tendons do not '
                     'bend each segment by itself, no shape_sequencer: they are moved by jog and '
                     'trajectories')
        elsewhere = sorted({other for name, other in self.node.get_node_names_and_namespaces()
                            if name in NODES and other != space})
        if elsewhere:
            text += f'; an arm was found in namespace {", ".join(elsewhere)}'
        if os.environ.get('ROS_DOMAIN_ID', '0') != '0':
            text += f'; looked in ROS_DOMAIN_ID {os.environ["ROS_DOMAIN_ID"]}'
        return NodesMissingError(text)
