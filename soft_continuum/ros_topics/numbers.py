# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A number for each segment, from or to topics, for several message types."""

from collections.abc import Callable, Sequence
from typing import Any, TYPE_CHECKING

from soft_continuum.hardware.protocols import HardwareError

if TYPE_CHECKING:
    from soft_continuum.ros_topics.link import CommandPublisher, Listener, RosLink

PREFIX = 'ros_jamming.'
BOOL, NUMBER, ARRAY = 'std_msgs/Bool', 'std_msgs/Float64', 'std_msgs/Float64MultiArray'
PRESSURE = 'sensor_msgs/FluidPressure'


class Numbers:
    """One number per segment, from a topic for each or from one topic with all of them."""

    def __init__(self, link: 'RosLink', name: str, kind: str, topics: Sequence[str], count: int,
                 timeout: float) -> None:
        """Subscribe; name: of the parameter.  timeout: s."""
        self._listeners: list[Listener] = [
            link.listen(kind, PREFIX + name, topic, timeout) for topic in topics]
        self._kind, self._count = kind, count
        self._values: list[float | None] = [None] * count

    def update(self) -> bool:
        """Take new messages; return whether every number is known.  Raises HardwareError."""
        for i, listener in enumerate(self._listeners):
            for message, _ in listener.take():
                if self._kind == ARRAY:
                    if len(message.data) != self._count:
                        raise HardwareError(f'{listener.topic} has {len(message.data)} numbers; '
                                            f'needed: one for each of {self._count}')
                    self._values = [float(value) for value in message.data]
                else:
                    self._values[i] = float(
                        message.fluid_pressure if self._kind == PRESSURE else message.data)
        return None not in self._values

    def check(self) -> None:
        """Raise HardwareError when a number is stale."""
        for listener in self._listeners:
            listener.check()

    @property
    def values(self) -> tuple[float, ...]:
        """The numbers."""
        return tuple(value for value in self._values if value is not None)


class Commands:
    """One number per segment, to a topic for each or to one topic with all of them."""

    def __init__(self, link: 'RosLink', name: str, kind: str, topics: Sequence[str]) -> None:
        """Create publishers; name: of the parameter.  Nothing is sent."""
        from soft_continuum.ros_topics.link import message_class

        self._message, self._array = message_class(kind), kind == ARRAY
        self._of: Callable[[float], Any] = bool if kind == BOOL else float
        self._publishers: list[CommandPublisher] = [
            link.publish_to(kind, PREFIX + name, topic) for topic in topics]

    def send(self, item: int, values: Sequence[float]) -> None:
        """Send one of the values, with the others where all share a topic."""
        if self._array:
            self._publishers[0].send(self._message(data=[float(value) for value in values]))
        else:
            self._publishers[item].send(self._message(data=self._of(values[item])))
