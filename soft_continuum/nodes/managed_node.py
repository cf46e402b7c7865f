# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The lifecycle of a node that owns a device, its threads, and which readings it publishes."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
import traceback
from typing import Any

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.nodes.suite_node import ERROR, SuiteNode
from soft_continuum.nodes.threads import ControlLoop, on_ros_thread, Worker
from soft_continuum.ros.entries import guarded, repeat
from soft_continuum.ros.ros_time import RosTime

RETRY = 2.0  # s between attempts to connect to a device
CONNECT_TIMEOUT = 20.0  # s in which a device that is asked for has to connect
CLOSE_TIMEOUT = 2.0  # s that a device is given to hold and disconnect
REST_PERIOD = 0.095
"""Period of readings at rest, s: every fifth at 50 Hz, every second one at 20 Hz."""


class DeviceControl(ABC):
    """
    What controls a device, by its controller; reports a snapshot after every change.

    Every method is called on the control thread.  lost: whether a device that was attached failed,
    and has to be connected again; any thread may read it.
    """

    lost = False

    def __init__(self, report: Callable[[Any], None]) -> None:
        """Start without a device; report: called with snapshots."""
        self._report = report
        self._controller: Any = None
        self._active = False
        self._fault = ''  # why there is no device

    def attach(self, device: Any) -> None:
        """Control a connected device from now on."""
        self._controller, self._fault, self.lost = device, '', False

    def detach(self) -> Any:
        """Return the device, if any, and continue without it."""
        device, self._controller = self._controller, None
        self._active = self.lost = False
        self._fault = ''
        self.report()
        return device

    def activate(self) -> None:
        """Start to work."""
        self._active = True
        self.report()

    @abstractmethod
    def deactivate(self) -> None:
        """Hold and stop working."""

    def not_connected(self, error: str) -> None:
        """Note why the device cannot be connected to, or does not reply."""
        self._fault = error
        self.report()

    @abstractmethod
    def failed(self, error: Exception) -> None:
        """Treat an error of this program like a failed device."""

    @abstractmethod
    def cycle(self, late: float) -> None:
        """Read, decide and command; late: s."""

    @abstractmethod
    def snapshot(self) -> Any:
        """Return the state as it is now."""

    def report(self) -> None:
        """Publish a snapshot for the other threads."""
        self._report(self.snapshot())


class ManagedNode(SuiteNode, LifecycleNode):
    """
    A lifecycle node that owns a device, on three threads.

    - The ROS thread runs every callback.  It only waits in a requested transition `configure`,
    whose response in ROS 2 must follow the connection.
    - ``loop`` runs a DeviceControl; nothing else uses the device.
    - ``connecting`` opens and closes devices, which takes up to seconds.

    With ``autostart`` the node becomes active automatically once its device is connected.  It
    reconnects to a lost device.
    """

    loop: ControlLoop
    _control: DeviceControl

    def __init__(self, name: str, hardware_id: str, **options: Any) -> None:
        """Connect to nothing yet; arguments: of SuiteNode."""
        super().__init__(name, hardware_id, **options)
        self.ros_time = RosTime(self.get_clock())
        self.active = False
        self.connecting = Worker('connecting', self._on_thread_failure)
        self._opened: Any = None  # a device that is connected and not attached yet
        self._quitting = False
        self._attempt = False  # to connect is under way
        self._was_configured = False  # then autostart has done its work
        self._retry = repeat(self, RETRY, self._connect)
        self._answer_invalid_transitions()

    def start_control(self, rate: float) -> None:
        """Start the loop of ``_control``; rate: Hz."""
        self.loop = ControlLoop(f'{self.get_name()}_control', 1.0 / rate, self._control.cycle,
                                self._on_control_failure)

    # What a subclass does, besides.

    @abstractmethod
    def open_device(self) -> Any:
        """Connect and move nothing, on the thread for it; raises HardwareError or ValueError."""

    @abstractmethod
    def _publish(self, snapshot: Any) -> None:
        """Publish a snapshot of ``_control``, on the thread of ROS."""

    # Connecting.

    def start(self) -> None:
        """Connect and become active if ``autostart`` is set."""
        self._connect()

    def _wants_device(self) -> bool:
        return bool((self.parameters['autostart'] and self._state == 'unconfigured'
                     and not self._was_configured) or self._control.lost)

    def _connect(self) -> None:
        if not self._attempt and self._wants_device():
            self._attempt = True
            self.connecting.submit(self._open)

    def _open(self) -> None:
        try:
            self._opened, error = self.open_device(), ''
        except (HardwareError, ValueError) as problem:
            error = str(problem)
        self.on_ros_thread(self._after_attempt, error)

    def _after_attempt(self, error: str) -> None:
        self._attempt = False
        self._retry.reset()  # the attempt itself may have taken longer
        if error:
            self.loop.post(self._control.not_connected, error)
        elif self._opened is None:
            return  # the node was configured meanwhile
        elif not self._wants_device():
            self._release(self._take())
        elif self._state == 'unconfigured':
            if self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
                self.trigger_activate()
        else:
            self.loop.call(self._control.attach, self._take())

    def _take(self) -> Any:
        device, self._opened = self._opened, None
        return device

    def _release(self, device: Any) -> None:
        if device is not None:
            self.connecting.submit(device.close)

    def _on_thread_failure(self, error: Exception) -> None:
        self.get_logger().error(''.join(traceback.format_exception(error)))

    def _on_control_failure(self, error: Exception) -> None:
        self._on_thread_failure(error)
        self._control.failed(error)

    def on_ros_thread(self, function: Callable[..., None], *arguments: Any) -> bool:
        """Call ``function`` on the ROS thread; return False after its end."""
        # An executor would keep the task, and this node with it.
        return not self._quitting and on_ros_thread(self, function, *arguments)

    # The lifecycle.

    @property
    def _state(self) -> str:
        return str(self._state_machine.current_state[1])

    def _answer_invalid_transitions(self) -> None:
        service = self._service_change_state
        answer = service.callback

        def change_state(request: Any, response: Any) -> Any:
            try:
                return answer(request, response)
            except Exception as error:  # rclpy raises for a transition that is not valid now
                self.get_logger().warning(
                    f'transition refused in state {self._state}: {error}')
                response.success = False
                return response

        service.callback = change_state

    def _configure(self) -> None:
        if self._opened is None:
            try:
                self.connecting.call(CONNECT_TIMEOUT, self._open_now)
            except TimeoutError:  # what it finds later is there for the next attempt
                raise HardwareError(f'{self.hardware_id} has not connected within '
                                    f'{CONNECT_TIMEOUT:g} s; check its cables and its power, then '
                                    'configure again') from None
        self.loop.call(self._control.attach, self._take())
        self._was_configured = True

    def _open_now(self) -> None:
        if self._opened is None:  # else an attempt that was under way found it
            self._opened = self.open_device()

    def _activate(self) -> None:
        self.loop.call(self._control.activate)
        self.active = True

    def _deactivate(self) -> None:
        self.active = False
        self.loop.call(self._control.deactivate)

    def _clean_up(self) -> None:
        self.active = False
        self._release(self.loop.call(self._control.detach))

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Connect."""
        return self._guarded(self._configure, super().on_configure, state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start."""
        return self._guarded(self._activate, super().on_activate, state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop."""
        return self._guarded(self._deactivate, super().on_deactivate, state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Disconnect."""
        return self._guarded(self._clean_up, super().on_cleanup, state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and disconnect, from any state."""
        self._guarded(self._deactivate, super().on_shutdown, state)
        return self._guarded(self._clean_up, super().on_shutdown, state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Disconnect and go back to unconfigured, to be configured again."""
        self._guarded(self._clean_up, super().on_error, state)
        return TransitionCallbackReturn.SUCCESS

    def _guarded(self, work: Callable[[], None], parent: Any, state: LifecycleState
                 ) -> TransitionCallbackReturn:
        # rclpy swallows what a transition callback raises, so it is caught and reported here.
        try:
            work()
        except (HardwareError, ValueError) as error:
            self.status.set(ERROR, str(error))
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            self.get_logger().error(traceback.format_exc())
            self.status.set(ERROR, f'{type(error).__name__}: {error}')
            return TransitionCallbackReturn.ERROR
        parent(state)
        return TransitionCallbackReturn.SUCCESS

    def quit(self) -> None:
        """Hold and disconnect before the process ends."""
        self._quitting = True
        guarded(self, self._deactivate)()
        guarded(self, self._clean_up)()
        if self._opened is not None:
            self._release(self._take())
        self.connecting.close(CLOSE_TIMEOUT)
        self.loop.close()
        self._publish(self._control.snapshot())


class RestingStream:
    """
    Chooses the readings of a device that are published: all in motion, ten a second at rest.

    Converting and sending a reading costs far more than making it.
    """

    def __init__(self, resolution: float) -> None:
        """Start with a reading that is due; resolution: smallest change that counts as motion."""
        self._resolution = resolution
        self._published: tuple[Any, Sequence[float], float] | None = None

    def due(self, now: float, state: Any, values: Sequence[float]) -> bool:
        """Return whether a reading goes out at ``now``, s: it changed, or 0.1 s passed."""
        if self._published is not None:
            last_state, last_values, last = self._published
            if now - last < REST_PERIOD and state == last_state and all(
                    abs(value - before) <= self._resolution
                    for value, before in zip(values, last_values, strict=True)):
                return False
        self._published = state, values, now
        return True
