# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What a node of the suite is: checked parameters, a status, and a heartbeat for the other nodes.

The status is for people, the typed state for other nodes; version, computer and arm are on a topic
and a service.
"""

from collections.abc import Iterator, Mapping, Sequence
from copy import copy, deepcopy
from dataclasses import dataclass
from math import inf
import re
import socket
import time
from typing import Any, Self
from uuid import uuid4

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from soft_continuum import version
from soft_continuum.nodes.threads import on_ros_thread
from soft_continuum.parameters.arm import description_digest
from soft_continuum.parameters.parameter import Parameter, ParameterError
from soft_continuum.ros.conversions import seconds
from soft_continuum.ros.entries import guarded, LATCHED, LOG_PERIOD, repeat, STREAM
from soft_continuum.ros.names import GET_NODE_INFO, HEARTBEAT
from soft_continuum.ros.parameter_table import default_frame, FRAME, NODE_PARAMETERS
from soft_continuum.ros.ros_time import stamp_of
from soft_continuum.text import plain, printable
from soft_continuum_interfaces import srv
from soft_continuum_interfaces.msg import Heartbeat

HEARTBEAT_PERIOD = 0.2  # s between two signs of life
MAX_CONFLICT = 500  # characters of a conflict that another node notices
REPEAT_PERIOD = 1.0  # s between two states that are the same
FAILURE_PERIOD = 5.0  # s for which a mistake of the program is shown

NUMBER = re.compile(r'-?\d+\.\d+(e[-+]?\d+)?|-?\d+(?= (?:mm|ms|s|k?Pa|N|%)(?!\w))')
"""Numbers that may change in an otherwise equal status: measured values, not part numbers."""

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class SuiteNode(Node):
    """
    A node with checked parameters, a heartbeat and a status, which reports what callbacks raise.

    Its ``start`` is called when it can be spun, ``quit`` before the process ends.
    """

    def __init__(self, name: str, hardware_id: str, **options: Any) -> None:
        """
        Declare the parameters of ``name``; raises ParameterError.

        hardware_id: for diagnostics (REP-107); {parameter} in it stands for the value of one.
        """
        super().__init__(name, **options)
        self.parameters = NodeParameters(self, NODE_PARAMETERS[name])
        self.hardware_id = hardware_id.format_map(self.parameters)
        self.status = Status(self, self.hardware_id)
        self.node_info = NodeInfoPublisher(self, self.parameters)

    def callback_failed(self, error: Exception) -> None:
        """Report what a callback raised, on the thread of ROS."""
        self.status.alarm('callback', f'{type(error).__name__}: {error}', FAILURE_PERIOD)

    def thread_failed(self, error: Exception) -> None:
        """Report what a thread of its own raised; any thread may call this."""
        on_ros_thread(self, self.callback_failed, error)

    def quit(self) -> None:
        """End; a node that moves something holds it."""


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

    def declare_numbers(self, parameter: Parameter) -> None:
        """
        Declare one more parameter, a list of numbers: empty unless it is given.

        Without a value it would empty the response of GetParameters for all others too.
        """
        name, kind = parameter.name, RosParameter.Type.DOUBLE_ARRAY
        descriptor = _descriptor(parameter)
        descriptor.type = kind.value
        try:
            value = self._node.declare_parameter(
                name, kind, ParameterDescriptor(read_only=False)).value
        except InvalidParameterTypeException as error:
            raise ParameterError(f'parameter {name}: {error}') from None
        if value is None:
            self._node.set_parameters([RosParameter(name, kind, [])])
        else:
            self._values[name] = parameter.check(value)
        self._node.set_descriptor(name, descriptor)

    def _declare(self, parameter: Parameter) -> None:
        default: Any = (default_frame(self._node.get_namespace()) if parameter == FRAME
                        else parameter.default)
        default = list(default) if isinstance(default, tuple) else default
        try:
            value = self._node.declare_parameter(
                parameter.name, default, _descriptor(parameter)).value
        except InvalidParameterTypeException as error:
            decimal = 'double' in parameter.type_name
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
                    return SetParametersResult(
                        successful=False, reason=printable(str(error), 500))
        return SetParametersResult(successful=True)

    def _after_set(self, changes: list[RosParameter]) -> None:
        for change in changes:
            if change.name in self._table:
                self._values[change.name] = self._table[change.name].check(change.value)

    def __getitem__(self, name: str) -> Any:
        """Return the present value of a parameter."""
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
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
    """Publishes the status of a node: latched on ``~/status``, and at 1 Hz on /diagnostics."""

    def __init__(self, node: Node, hardware_id: str) -> None:
        """Create the two publishers and the timer of ``node``."""
        self._message = DiagnosticStatus(
            name=node.get_fully_qualified_name().lstrip('/'), hardware_id=hardware_id)
        self._node = node
        self._logged: tuple[bytes, str] = OK, ''  # level and kind of the last
        self._log_times: dict[bytes, float] = {}  # by level: when, s (steady)
        self._publisher = node.create_publisher(DiagnosticStatus, '~/status', LATCHED)
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._own: tuple[bytes, str, dict[str, str]] = OK, '', {}
        self._shown = self._own
        self._alarms: dict[str, tuple[str, float]] = {}  # by source: text, monotonic s of its end
        repeat(node, 1.0, self._publish_diagnostics)

    @property
    def message(self) -> str:
        """The present status text."""
        return str(self._message.message)

    def set(self, level: bytes, message: str, **values: object) -> None:
        """
        Update the status and publish it if it changed; for the thread of ROS.

        level: OK, WARN or ERROR.  values: shown as printed.
        """
        self._own = level, message, {key: str(value) for key, value in values.items()}
        self._update()

    def alarm(self, source: str, text: str, seconds: float = inf) -> None:
        """Report an ERROR of ``source`` for so long, or until its ``text`` is empty."""
        if self._alarms.get(source, ('', inf))[0] != text or text and seconds < inf:
            self._alarms[source] = text, time.monotonic() + seconds
            self._update()

    def _update(self) -> None:
        level, message, values = self._own
        alarms = [text for text, end in self._alarms.values() if text and end > time.monotonic()]
        if alarms:
            own = [message] if level != OK else []
            level, message = ERROR, '; '.join([*alarms, *own])
        self._log(level, message)
        if self._shown == (level, message, values):
            return
        self._shown = level, message, values
        self._message.level, self._message.message = level, message
        self._message.values = [
            KeyValue(key=key, value=value) for key, value in values.items()]
        self._publisher.publish(self._message)

    def _log(self, level: bytes, message: str) -> None:
        """Log what changed but for numbers; of what changes faster than LOG_PERIOD, what lasts."""
        now, kind = time.monotonic(), (level, NUMBER.sub('#', message))
        if (kind == self._logged
                or now - self._log_times.get(level, -inf) <= LOG_PERIOD):
            return
        self._logged, self._log_times[level] = kind, now
        logger = self._node.get_logger()
        # Separate calls: rclpy ties a severity to the calling line.
        if level == ERROR:
            logger.error(message)
        elif level == WARN:
            logger.warning(message)
        else:
            logger.info(message)

    def _publish_diagnostics(self) -> None:
        self._update()  # alarms come to their end
        array = DiagnosticArray(status=[self._message])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(array)


class StatePublisher:
    """
    Publishes a typed state latched on ``~/state``, whenever more than its stamp changes.

    It is repeated every second, in case a subscriber received a false one.
    """

    def __init__(self, node: Node, message_type: Any) -> None:
        """Create the publisher of ``node``."""
        self._node = node
        self._publisher = node.create_publisher(message_type, '~/state', LATCHED)
        self._last: Any = None
        self._changed = Time()
        repeat(node, REPEAT_PERIOD, self._send)

    def publish(self, message: Any) -> None:
        """Publish ``message``, whose stamp is still zero, if it has changed."""
        if message != self._last:
            self._last = deepcopy(message)
            self._changed = self._node.get_clock().now().to_msg()
            self._send()

    def _send(self) -> None:
        if self._last is not None:
            message = copy(self._last)
            message.stamp = self._changed
            self._publisher.publish(message)


@dataclass(frozen=True)
class NodeInfo:
    """
    Information about a node, published five times a second on ``~/heartbeat``.

    description: parameters.arm.description_digest.  time: its ROS time, s.
    """

    process: str
    version: str = ''
    description: str = ''
    host: str = ''
    time: float = 0.0
    conflict: str = ''

    @classmethod
    def own(cls, parameters: Mapping[str, Any]) -> Self:
        """Return the information of a node of this process with these parameters."""
        return cls(uuid4().hex, version(), description_digest(parameters), socket.gethostname())

    def to_ros(self, time: float) -> Heartbeat:
        """Return a message sent at a ROS time, s."""
        return Heartbeat(
            stamp=stamp_of(time), process=self.process, host=self.host, version=self.version,
            description=self.description, conflict=self.conflict)

    @classmethod
    def from_ros(cls, message: Heartbeat) -> Self:
        """Read a message."""
        return cls(plain(message.process), plain(message.version), plain(message.description),
                   plain(message.host), seconds(message.stamp),
                   printable(message.conflict, MAX_CONFLICT))


class NodeInfoPublisher:
    """Publishes the NodeInfo of a node as ~/heartbeat, and serves ~/get_node_info."""

    def __init__(self, node: Any, parameters: Mapping[str, Any]) -> None:
        """Begin; parameters: of the node."""
        self.own = NodeInfo.own(parameters)
        self._node = node
        self._publisher = node.create_publisher(Heartbeat, HEARTBEAT, STREAM)
        answer = guarded(node, self._answer)
        node.create_service(srv.GetNodeInfo, GET_NODE_INFO,
                            lambda _, response: answer(response) or response)
        repeat(node, HEARTBEAT_PERIOD, self._publish)

    @property
    def time(self) -> float:
        """ROS time of the node, s."""
        return float(self._node.get_clock().now().nanoseconds * 1e-9)

    def _publish(self) -> None:
        self._publisher.publish(self.own.to_ros(self.time))

    def _answer(self, response: srv.GetNodeInfo.Response) -> srv.GetNodeInfo.Response:
        response.host, response.version = self.own.host, self.own.version
        response.description = self.own.description
        response.stamp = self._node.get_clock().now().to_msg()
        return response
