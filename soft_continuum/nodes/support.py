# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""What every node does alike: parameters, status, diagnostics and the lifecycle."""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
import time
import traceback
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from std_msgs.msg import Bool

from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.mechanics._compile import is_compiled
from soft_continuum.mechanics.statics import warm_up
from soft_continuum.parameters.parameter import Parameter, ParameterError
from soft_continuum.ros.qos import LATCHED, SENSOR, STREAM

SLACK_ALLOWANCE = 1e-4
"""m of pull that rope and guides absorb; the model's inextensible tendons would buckle the arm."""

LOG_PERIOD = 1.0  # s between two lines of the same severity
RETRY = 2.0  # s between attempts to connect to a device

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class NodeParameters(Mapping[str, Any]):
    """The declared parameters of a node: a mapping from name to checked value."""

    def __init__(self, node: Node, table: Sequence[Parameter]) -> None:
        """Declare every parameter of ``table``; raises ParameterError for a bad value."""
        self._node = node
        self._table = {p.name: p for p in table}
        self._values: dict[str, Any] = {}
        for parameter in table:
            self._declare(parameter)
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._after_set)

    def declare_angles(self, name: str) -> None:
        """Declare one more parameter, a list of bending angles that must be given."""
        parameter = Parameter(name, (0.0,), 'bending angles of a shape, rad, base first')
        try:
            value = self._node.declare_parameter(
                name, RosParameter.Type.DOUBLE_ARRAY, _descriptor(parameter)).value
        except InvalidParameterTypeException as error:
            raise ParameterError(f'parameter {name}: {error}') from None
        if value is not None:
            self._values[name] = parameter.check(value)

    def _declare(self, parameter: Parameter) -> None:
        default: Any = parameter.default
        default = list(default) if isinstance(default, tuple) else default
        try:
            value = self._node.declare_parameter(
                parameter.name, default, _descriptor(parameter)).value
        except InvalidParameterTypeException as error:
            decimal = isinstance(parameter.default, float) or isinstance(default, list)
            hint = ' (write 5.0 rather than 5)' if decimal and 'INTEGER' in str(error) else ''
            raise ParameterError(
                f'parameter {parameter.name}: {error}{hint}; {_allowed(parameter)}') from None
        except InvalidParameterValueException as error:
            raise ParameterError(
                f'parameter {parameter.name}: {error}; {_allowed(parameter)}') from None
        self._values[parameter.name] = parameter.check(value)

    def _on_set(self, changes: list[RosParameter]) -> SetParametersResult:
        for change in changes:
            parameter = self._table.get(change.name)
            if parameter is not None:
                try:
                    parameter.check(change.value)
                except ParameterError as error:
                    return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _after_set(self, changes: list[RosParameter]) -> None:
        for change in changes:
            if change.name in self._table:
                self._values[change.name] = self._table[change.name].check(change.value)

    def __getitem__(self, name: str) -> Any:
        """Return the present value of a parameter."""
        return self._values[name]

    def __iter__(self) -> Any:
        """Iterate over the names."""
        return iter(self._values)

    def __len__(self) -> int:
        """Return how many parameters there are."""
        return len(self._values)


def _allowed(parameter: Parameter) -> str:
    if parameter.choices:
        return 'allowed: ' + ', '.join(parameter.choices)
    return parameter.description


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=parameter.description, read_only=parameter.read_only)
    if parameter.choices:
        descriptor.additional_constraints = _allowed(parameter)
    default = parameter.default
    bounded = parameter.low > float('-inf') and parameter.high < float('inf')
    if bounded and isinstance(default, int) and not isinstance(default, bool):
        descriptor.integer_range = [
            IntegerRange(from_value=int(parameter.low), to_value=int(parameter.high), step=1)]
    elif bounded and isinstance(default, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=parameter.low, to_value=parameter.high)]
    elif bounded:
        descriptor.additional_constraints = f'each {parameter.low:g} to {parameter.high:g}'
    return descriptor


class Status:
    """A node's state in words: latched on ``~/status`` when it changes, 1 Hz on /diagnostics."""

    def __init__(self, node: Node, hardware_id: str) -> None:
        """Create the two publishers and the timer of ``node``."""
        self._message = DiagnosticStatus(
            name=node.get_fully_qualified_name().lstrip('/'), hardware_id=hardware_id)
        self._node = node
        self._logged = float('-inf')
        self._publisher = node.create_publisher(DiagnosticStatus, '~/status', LATCHED)
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._timer = node.create_timer(
            1.0, self._publish_diagnostics, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def set(self, level: bytes, message: str, **values: object) -> None:
        """Say how the node is; values are shown as they print.  Published when changed."""
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        if (self._message.level, self._message.message, self._message.values) == (
                level, message, pairs):
            return
        now = time.monotonic()
        changed = (level, message) != (self._message.level, self._message.message)
        if changed and (level != self._message.level or now - self._logged > LOG_PERIOD):
            self._logged = now
            logger = self._node.get_logger()
            # Separate calls: rclpy ties a severity to the calling line.
            if level == ERROR:
                logger.error(message)
            elif level == WARN:
                logger.warning(message)
            else:
                logger.info(message)
        self._message.level, self._message.message = level, message
        self._message.values = pairs
        self._publisher.publish(self._message)

    def _publish_diagnostics(self) -> None:
        array = DiagnosticArray(status=[self._message])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(array)


class StatePublisher:
    """Publishes a typed state latched on ``~/state``, whenever more than its stamp changes."""

    def __init__(self, node: Node, message_type: Any) -> None:
        """Create the publisher of ``node``."""
        self._node = node
        self._publisher = node.create_publisher(message_type, '~/state', LATCHED)
        self._last: Any = None

    def publish(self, message: Any) -> None:
        """Publish ``message``, whose stamp is still zero, if it differs from the last one."""
        if message == self._last:
            return
        self._last = deepcopy(message)
        message.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)


def load_model(node: Node) -> None:
    """Load the compiled model before the node goes to work, and say so if it takes its time."""
    if not is_compiled():
        node.get_logger().info('compiling the model, this once; it takes about half a minute')
    warm_up()


class EmergencyStop:
    """
    Hears emergency_stop (std_msgs/Bool): true stops the arm, false allows to resume.

    Subscribed in three ways, so that whoever publishes is heard: latched, which nodes that start
    later hear too; not latched; and not even reliable.
    """

    def __init__(self, node: Node, on_change: Callable[[bool], None] = lambda on: None) -> None:
        """Call ``on_change`` whenever it goes on or off."""
        self.on = False
        self._on_change = on_change
        for profile in (LATCHED, STREAM, SENSOR):
            node.create_subscription(Bool, 'emergency_stop', self._on_message, profile)

    def _on_message(self, message: Bool) -> None:
        if message.data != self.on:
            self.on = message.data
            self._on_change(self.on)


class ManagedNode(LifecycleNode):
    """
    A lifecycle node that logs its own failures and answers invalid transitions politely.

    Subclasses implement ``configure``, ``activate``, ``deactivate`` and ``clean_up`` and raise
    HardwareError or ValueError to refuse.  With ``autostart`` the node becomes active by itself,
    as soon as its device lets it.
    """

    def __init__(self, name: str, table: Sequence[Parameter], **options: Any) -> None:
        """Declare the parameters of ``table``."""
        super().__init__(name, **options)
        self.parameters = NodeParameters(self, table)
        self.status = Status(self, self.hardware_id())
        self.active = False
        service = self._service_change_state
        answer = service.callback

        def change_state(request: Any, response: Any) -> Any:
            try:
                return answer(request, response)
            except Exception as error:  # rclpy raises for a transition that is not valid now
                state = self._state_machine.current_state[1]
                self.get_logger().warning(f'transition refused in state {state}: {error}')
                response.success = False
                return response

        service.callback = change_state

    def hardware_id(self) -> str:
        """Name the device for diagnostics (REP-107)."""
        return 'simulated'

    def start(self) -> None:
        """Configure and activate, if need be again and again, if ``autostart`` asks for it."""
        if self.parameters['autostart']:
            self._starting = self.create_timer(
                RETRY, self._try_to_start, clock=Clock(clock_type=ClockType.STEADY_TIME))
            self._try_to_start()

    def _try_to_start(self) -> None:
        if self._state_machine.current_state[1] == 'unconfigured':
            result = self.trigger_configure()
            if result == TransitionCallbackReturn.FAILURE:
                self._starting.reset()  # the attempt itself may have taken longer
                return
            if result == TransitionCallbackReturn.SUCCESS:
                self.trigger_activate()
        self._starting.cancel()

    def configure(self) -> None:
        """Connect to the device."""

    def activate(self) -> None:
        """Start to work."""

    def deactivate(self) -> None:
        """Stop to work, hold."""

    def clean_up(self) -> None:
        """Disconnect from the device."""

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Connect."""
        return self._guarded(self.configure, super().on_configure, state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start."""
        result = self._guarded(self.activate, super().on_activate, state)
        self.active = result == TransitionCallbackReturn.SUCCESS
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop."""
        self.active = False
        return self._guarded(self.deactivate, super().on_deactivate, state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Disconnect."""
        return self._guarded(self.clean_up, super().on_cleanup, state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and disconnect, from any state."""
        self.active = False
        self._guarded(self.deactivate, super().on_shutdown, state)
        return self._guarded(self.clean_up, super().on_shutdown, state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Disconnect and go back to unconfigured, to be configured again."""
        self.active = False
        self._guarded(self.clean_up, super().on_error, state)
        return TransitionCallbackReturn.SUCCESS

    def _guarded(self, work: Any, parent: Any, state: LifecycleState) -> TransitionCallbackReturn:
        # rclpy swallows what a transition callback raises, so it is caught and said here.
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
        """Stop and disconnect before the process ends."""
        self.active = False
        self.deactivate()
        self.clean_up()
