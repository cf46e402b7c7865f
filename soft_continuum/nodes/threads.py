# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The threads of a node: control, long tasks, loading of the model, and ROS."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from importlib import import_module
from queue import Empty, Full, Queue, SimpleQueue
import sys
import threading
from time import monotonic
import traceback
from typing import Any, TYPE_CHECKING

from rclpy.node import Node

from soft_continuum.hardware.real_time import ask_for_real_time
from soft_continuum.ros.entries import guarded

if TYPE_CHECKING:  # nodes without a model do not load the mechanics
    from soft_continuum.mechanics.arm import Arm

CALL_TIMEOUT = 3.0
"""Time (s) that a caller waits for a thread; drivers must be much faster."""
SWITCH_INTERVAL = 0.001
"""Switch interval of Python threads, s: the longest delay of control by another thread."""


def on_ros_thread(node: Node, function: Callable[..., None], *arguments: Any) -> bool:
    """
    Call ``function`` on the executor of ``node``, from any thread; return False without one.

    Its exceptions are caught: a task that raises would end the process in rclpy's EventsExecutor.
    """
    executor = node.executor
    if executor is None:
        return False
    executor.create_task(guarded(node, function), *arguments)
    return True


class Newest:
    """
    Passes values from any thread to ``function``, which ``post`` calls on another thread.

    If values arrive faster than they are processed, only the newest is kept.
    """

    def __init__(self, post: Callable[..., bool], function: Callable[[Any], None]) -> None:
        """Start without a value; post: returns whether its argument will be called."""
        self._post, self._function = post, function
        self._lock = threading.Lock()
        self._value: Any = None

    def put(self, value: Any) -> None:
        """Have ``value``, which is not None, processed soon."""
        with self._lock:
            waits, self._value = self._value is not None, value
            if not waits and not self._post(self._take):
                self._value = None

    def _take(self) -> None:
        with self._lock:
            value, self._value = self._value, None
        self._function(value)


class _Request:
    """
    Something that another thread is to do, and its result.

    ``failed`` is called with its exception, unless a caller waits for the result.
    """

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...],
                 failed: Callable[[Exception], None] | None = None) -> None:
        self._function, self._arguments, self._failed = function, arguments, failed
        self.future: Future[Any] = Future()

    def result(self, timeout: float, thread: str) -> Any:
        """Return its result, or raise its exception; TimeoutError about ``thread``."""
        try:
            return self.future.result(timeout)
        except TimeoutError:
            if self.future.done():  # its own
                raise
            raise TimeoutError(
                f'the thread {thread} has not finished '
                f'{getattr(self._function, "__name__", "it")} within {timeout:g} s') from None

    def run(self) -> None:
        """Do it."""
        try:
            self.future.set_result(self._function(*self._arguments))
        except Exception as error:
            self.future.set_exception(error)
            if self._failed is not None:
                _tell(self._failed, error)


def _tell(failed: Callable[[Exception], None], error: Exception) -> None:
    try:
        failed(error)
    except Exception:  # the thread has to go on, to hold if nothing else
        traceback.print_exc()


class ControlLoop:
    """
    A thread that controls one device: nothing else uses the device while the loop runs.

    It calls ``cycle`` at a steady rate, on absolute deadlines, with its delay (s).  Missed
    deadlines are skipped.  Between two cycles it executes requests of other threads: ``call``
    waits for the result, ``post`` does not.  ``failed`` is called, on the same thread, with
    exceptions of ``cycle`` or of a posted function.
    """

    def __init__(self, name: str, period: float, cycle: Callable[[float], None],
                 failed: Callable[[Exception], None]) -> None:
        """Start at once; period: s."""
        self._period, self._cycle, self._failed = period, cycle, failed
        self._requests: SimpleQueue[_Request] = SimpleQueue()
        self._ending = False
        sys.setswitchinterval(SWITCH_INTERVAL)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """
        Call ``function`` on the thread of the loop; return its result or raise its exception.

        Raises TimeoutError after CALL_TIMEOUT; the function may still be called then.
        """
        request = _Request(function, arguments)
        self._requests.put(request)
        return request.result(CALL_TIMEOUT, self._thread.name)

    def post(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Let the loop call ``function`` as soon as it can."""
        self._requests.put(_Request(function, arguments, self._failed))

    def close(self) -> None:
        """End the thread after all earlier requests."""
        self.post(setattr, self, '_ending', True)
        self._thread.join(CALL_TIMEOUT)

    def _run(self) -> None:
        ask_for_real_time()
        last = monotonic()
        deadline = last + self._period
        while not self._ending:
            with suppress(Empty):
                self._requests.get(timeout=max(0.0, deadline - monotonic())).run()
            now = monotonic()
            if now >= deadline and not self._ending:
                late, last = now - last - self._period, now
                try:
                    self._cycle(late)
                except Exception as error:
                    _tell(self._failed, error)
                deadline += self._period * (1 + (monotonic() - deadline) // self._period)


class Worker:
    """
    A thread for long tasks: one after another, with a limited queue.

    ``failed`` is called, on the same thread, with exceptions of submitted functions.
    """

    def __init__(self, name: str, failed: Callable[[Exception], None], limit: int = 8) -> None:
        """Start at once; ``limit``: how many may wait."""
        self._failed = failed
        self._work: Queue[_Request | None] = Queue(limit)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def submit(self, function: Callable[..., Any], *arguments: Any) -> bool:
        """Queue ``function``; return False if the queue is full."""
        try:
            self._work.put_nowait(_Request(function, arguments, self._failed))
        except Full:
            return False
        return True

    def call(self, timeout: float, function: Callable[..., Any], *arguments: Any) -> Any:
        """
        Return the result of ``function``, or raise its exception.

        Raises TimeoutError after ``timeout`` s; the function may still be called then.
        """
        request = _Request(function, arguments)
        with suppress(Full):  # else nothing that waits before it has ended for long
            self._work.put(request, timeout=timeout)
        return request.result(timeout, self._thread.name)

    def close(self, timeout: float) -> None:
        """End the thread after all earlier requests; wait ``timeout`` s at most."""
        with suppress(Full):
            self._work.put(None, timeout=timeout)
        self._thread.join(timeout)

    def _run(self) -> None:
        while (work := self._work.get()) is not None:
            work.run()


def loading() -> str:
    """Return the status text while the model loads."""
    from soft_continuum.mechanics._kernel import must_build
    return ('compiling the model, only on first use; it takes up to a minute' if must_build() else
            'loading the model')


def load_model(node: Any, arm: 'Arm', loaded: Callable[[], None] | None = None,
               later: Sequence[str] = ()) -> None:
    """
    Load the compiled model on a thread of its own; compiling takes tens of seconds.

    arm: the described one.  ``loaded`` is called on the thread of ROS.  later: modules to import
    afterwards, so that their first use does not wait.  The thread does not prevent a process from
    ending.
    """
    def load() -> None:
        try:
            from soft_continuum.mechanics._kernel import warm_up
            from soft_continuum.mechanics.statics import Statics
            warm_up()
            for module in Statics(arm).late_imports:  # else the first motion waits for them
                import_module(module)
        except Exception as error:  # of numba, a compiler, a disk
            on_ros_thread(node, node.status.alarm, 'model', 'the model cannot be loaded: '
                          f'{type(error).__name__}: {error}; see soft_continuum doctor')
            return
        if loaded is not None:
            on_ros_thread(node, loaded)
        for module in later:
            import_module(module)

    threading.Thread(target=load, name='model', daemon=True).start()
