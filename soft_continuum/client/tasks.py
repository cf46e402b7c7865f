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
from soft_continuum.ros.names import (
    JAMMING_VALVES,
    NODES,
    RECORDER,
    running_nodes,
    SHAPE_SEQUENCER,
)

T = TypeVar('T')

ATTEMPTS = 4  # of repeatable requests
POLL_PERIOD = 0.05  # polling period, s, of conditions without events, such as the ROS graph
HOW_TO_START = 'start them with `./run up` or `ros2 launch soft_continuum bringup.launch.py`'


@coroutine
def _next_step() -> Generator[None, None, None]:
    yield


async def until(condition: Callable[[], T], timeout: float) -> T:
    """Return the value of ``condition`` once it is true, or at the latest after ``timeout`` s."""
    deadline = monotonic() + timeout
    while not (value := condition()) and monotonic() < deadline:
        await _next_step()
    return value


class Tasks:
    """
    Runs coroutines that wait with ``until``, each step on the thread that spins ``node``.

    rclpy has its own coroutines, but polls them without a pause.  Callbacks of futures are also
    called on that thread.
    """

    def __init__(self, node: Node, timeout: float, discovery_timeout: float) -> None:
        """``timeout``: s for a response. ``discovery_timeout``: s for discovery of a node."""
        self.node = node
        self.timeout = timeout
        self.discovery_timeout = discovery_timeout
        self._open = True
        self._clients: dict[str, Any] = {}
        self._callers: Counter[str] = Counter()  # waiting coroutines of each
        self._tasks: dict[Coroutine[Any, None, Any], Future[Any]] = {}
        self._timer = node.create_timer(
            POLL_PERIOD, self.step, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._timer.cancel()

    def start(self, work: Coroutine[Any, None, T]) -> Future[T]:
        """Start a coroutine, from any thread; return the future of its outcome."""
        if not self._open:
            work.close()
            raise ClientError('this Arm is closed; create a new one')
        future: Future[T] = Future()
        future.set_running_or_notify_cancel()  # an abandoned await does not cancel the work
        self.node.executor.create_task(self._begin, work, future)
        return future

    def _begin(self, work: Coroutine[Any, None, T], future: Future[T]) -> None:
        self._tasks[work] = future
        self._timer.reset()
        self._advance(work)

    async def close(self) -> None:
        """Accept no more coroutines; fail those that still wait."""
        self._open = False
        for work, future in list(self._tasks.items()):
            if not work.cr_running:  # type: ignore[attr-defined]  # all but this one
                del self._tasks[work]
                work.close()
                future.set_exception(ClientError('this Arm was closed meanwhile'))

    def step(self, *_: object) -> None:
        """Let every coroutine check the condition it waits for."""
        for work in list(self._tasks):
            if work in self._tasks:  # a previous one may have closed it
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
        Return the value of ``condition`` once it is true.

        Raises NodesMissingError or NoAnswerError, about ``node``, after the discovery timeout.
        """
        value = await until(condition, self.discovery_timeout)
        if not value:
            raise self.not_found(what, [node], self.discovery_timeout)
        return value

    def client(self, kind: Any, name: str) -> Any:
        """Return the client of a service; creating it before the first call saves a wait."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        return self._clients[name]

    async def call(self, kind: Any, name: str, *, attempts: int = 1, within: float | None = None,
                   **request: Any) -> Any:
        """
        Call a service of one of the nodes; return its response.

        attempts: total number of calls, for repeatable requests: a response can get lost when a
        node has just started.  within: s for a response that takes longer than others.

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
                # A late response to an earlier call counts, too.
                if answered := await until(
                        lambda: [one for one in asked if one.done()], timeout / attempts):
                    return answered[0].result()
        finally:
            self._callers[name] -= 1
            for one in asked:
                client.remove_pending_request(one)
        # Abandoned requests must not be carried out later; those that others await must be.
        if not self._callers[name] and self._clients.pop(name, None):
            self.node.destroy_client(client)
        raise self.not_found(f'an answer from {name}', [node], timeout)

    async def done(self, future: Any, timeout: float) -> bool:
        """Wait for a future of rclpy; return whether it is done."""
        future.add_done_callback(self.step)
        return await until(future.done, timeout)

    async def parameters(self, node: str, names: Sequence[str]) -> dict[str, Any]:
        """Return parameters of a node by name, without those not set."""
        answer = await self.call(GetParameters, f'{node}/get_parameters', attempts=ATTEMPTS,
                                 names=list(names))
        if len(answer.values) < len(names) > 1:  # a node that lacks one returns none
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
        """Return the error for something not found within ``timeout`` s."""
        running = running_nodes(self.node, (*NODES, RECORDER))
        if all(running[name] for name in needed):
            return NoAnswerError(f'{what} is missing after {timeout:g} s, although its node runs; '
                                 'is it active, and the computer not overloaded?')
        missing = [name for name in NODES if not running[name]]
        space = self.node.get_namespace()
        text = (f'{", ".join(missing)} {"does" if len(missing) == 1 else "do"} not run in '
                f'namespace {space}; {HOW_TO_START}')
        if {*missing} <= {JAMMING_VALVES, SHAPE_SEQUENCER}:  # the arm may be without jamming
            text += ('; an arm without jamming has no jamming_valves and, unless its tendons bend '
                     'each segment independently, no shape_sequencer: move it by jog and '
                     'trajectories')
        elsewhere = sorted({other for name, other in self.node.get_node_names_and_namespaces()
                            if name in NODES and other != space})
        if elsewhere:
            text += f'; an arm was found in namespace {", ".join(elsewhere)}'
        if os.environ.get('ROS_DOMAIN_ID', '0') != '0':
            text += f'; looked in ROS_DOMAIN_ID {os.environ["ROS_DOMAIN_ID"]}'
        return NodesMissingError(text)
