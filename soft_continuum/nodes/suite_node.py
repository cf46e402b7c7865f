# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What all nodes have in common, and their parameters, checked against their table."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from soft_continuum.nodes.node_info import NodeInfoPublisher
from soft_continuum.nodes.status import FAILURE_PERIOD, Status
from soft_continuum.nodes.threads import on_ros_thread
from soft_continuum.parameters.parameter import Parameter, ParameterError
from soft_continuum.ros.parameter_table import default_frame, FRAME, NODE_PARAMETERS
from soft_continuum.text import printable


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
