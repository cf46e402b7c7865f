# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Valves or vacuum regulators, a pump and pressure sensors of another node, on topics."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from math import inf
from typing import Any, ClassVar, TYPE_CHECKING

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.protocols import HardwareError, JammingReading
from soft_continuum.parameters.parameter import Parameter, ParameterError, spread, TOPIC_NAME
from soft_continuum.ros_topics.device import POLL_INTERVAL, RosDevice

if TYPE_CHECKING:
    from soft_continuum.ros_topics.link import CommandPublisher, Listener, RosLink

PREFIX = 'ros_jamming.'
BOOL, NUMBER, ARRAY = 'std_msgs/Bool', 'std_msgs/Float64', 'std_msgs/Float64MultiArray'
PRESSURE = 'sensor_msgs/FluidPressure'
ABSOLUTE, GAUGE = 'absolute', 'gauge'
REPEAT = 0.05  # s after which a command is sent again that is not confirmed: one may be lost
SAME_SETPOINT = 0.01
"""Tolerance of a set-point that is read back, as a share of max_vacuum."""


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


class SegmentCommands:
    """One number per segment, to a topic for each or to one topic with all of them."""

    def __init__(self, link: 'RosLink', name: str, kind: str, topics: Sequence[str]) -> None:
        """Create publishers; name: of the parameter.  Nothing is sent."""
        from soft_continuum.ros_topics.link import short_message_class

        self._message, self._array = short_message_class(kind), kind == ARRAY
        self._of: Callable[[float], Any] = bool if kind == BOOL else float
        self._publishers: list[CommandPublisher] = [
            link.publish_to(kind, PREFIX + name, topic) for topic in topics]

    def send(self, item: int, values: Sequence[float]) -> None:
        """Send one of the values, with the others where all share a topic."""
        if self._array:
            self._publishers[0].send(self._message(data=[float(value) for value in values]))
        else:
            self._publishers[item].send(self._message(data=self._of(values[item])))


class RosVacuum(RosDevice):
    """Common base of valves and regulators of another node."""

    driver = 'jamming driver'

    def __init__(self, values: Mapping[str, Any], clock: Clock = STEADY) -> None:
        """Take checked parameters; raises ParameterError.  Nothing is opened yet."""
        super().__init__(clock)
        self._parameters = values
        self._segments = len(values['arm.segment_lengths'])
        self._timeout: float = values[f'{PREFIX}timeout']
        self._scales: tuple[float, ...] = spread(
            f'{PREFIX}pressure_scales', values[f'{PREFIX}pressure_scales'], self._segments,
            f'the arm has {self._segments} segments')
        self._zero = (values['ambient_pressure']
                      if values[f'{PREFIX}pressures_are'] == GAUGE else 0.0)
        for name in ('pressure', 'command', 'state'):
            self._topics(name)
        self._pressures: Numbers
        self._states: Numbers
        self._commands: SegmentCommands

    def _topics(self, name: str) -> tuple[str, ...]:
        """Return the topics of pressures, commands or states."""
        topics: tuple[str, ...] = self._parameters[f'{PREFIX}{name}_topics']
        shared = self._parameters[f'{PREFIX}{name}_type'] == ARRAY
        count = 1 if shared else self._segments
        if len(topics) != count or len(set(topics)) != count or not all(topics):
            raise ParameterError(
                f'parameter {PREFIX}{name}_topics is {list(topics)}; needed: '
                + (f'one topic, because {PREFIX}{name}_type is {ARRAY}' if shared else
                   f'a topic for each of {self._segments} segments'))
        return topics

    def _connect(self, link: 'RosLink') -> None:
        kinds = {name: self._parameters[f'{PREFIX}{name}_type']
                 for name in ('pressure', 'command', 'state')}
        self._pressures = Numbers(link, 'pressure_topics', kinds['pressure'],
                                  self._topics('pressure'), self._segments, self._timeout)
        self._states = Numbers(link, 'state_topics', kinds['state'], self._topics('state'),
                               self._segments, self._timeout)
        self._commands = SegmentCommands(link, 'command_topics', kinds['command'],
                                         self._topics('command'))

    def _take_first(self) -> str:
        return '' if self._update() else 'not all pressures and states were received'

    def _inputs(self) -> tuple[Numbers, ...]:
        return self._pressures, self._states

    def _update(self) -> bool:
        """Take what came; return whether everything is known."""
        with self._receiving() as link:
            known = [numbers.update() for numbers in self._inputs()]
            if self._opened:
                link.check()
                for numbers in self._inputs():
                    numbers.check()
        return all(known)

    def close(self) -> None:
        """Disconnect; everything stays as it is."""
        self._closing.set()
        if self._opened:
            self._disconnect()

    def _absolute(self) -> tuple[float, ...]:
        """Return the absolute pressures, Pa; raises HardwareError for what cannot be one."""
        low, high = self._parameters[f'{PREFIX}plausible_pressures']
        pressures = tuple(self._zero + scale * value for scale, value in zip(
            self._scales, self._pressures.values, strict=True))
        for i, pressure in enumerate(pressures):
            if pressure < low or pressure > high:  # nan is a broken sensor, and known as one
                raise HardwareError(
                    f'segment {i + 1}: an absolute pressure of {pressure:.4g} Pa; plausible: '
                    f'{low:g} to {high:g} Pa; check {PREFIX}pressure_scales (Pa per unit of the '
                    f'message) and {PREFIX}pressures_are ({ABSOLUTE} or {GAUGE})')
        return pressures

    @abstractmethod
    def _reported(self) -> tuple[float, ...]:
        """Return the reports of all segments, as sent; raises HardwareError for invalid ones."""

    def _set(self, segment: int, value: float, same: Callable[[float], bool], what: str) -> None:
        """Send a value for a segment until its state is the ``same``; raises HardwareError."""
        with self._lock:
            self._update()
            # Of the others nothing is changed: they get what they report.
            values = [value if i == segment else state
                      for i, state in enumerate(self._reported())]
            self._confirm(lambda: self._commands.send(segment, values),
                          lambda: same(self._states.values[segment]), what)

    def _confirm(self, send: Callable[[], None], done: Callable[[], bool], what: str) -> None:
        assert self.link is not None
        looks = self.link.looks
        begin, sent = looks(), -REPEAT
        while (now := looks()) < begin + self._timeout:
            if now >= sent + REPEAT:
                send()
                sent = now
            self._clock.sleep(POLL_INTERVAL)
            self._update()
            if done():
                return
        raise HardwareError(f'{what} does not follow: it does not report the change within '
                            f'{self._timeout:g} s ({PREFIX}timeout); check its node, '
                            f'{PREFIX}command_topics and {PREFIX}state_topics')


class RosJamming(RosVacuum):
    """
    Valves and a pump of another node; see JammingDriver for what the methods promise.

    A pump without a topic is not switched, and counts as running.
    """

    COMMISSIONING = 'soft_continuum.ros_topics.commissioning'
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        Parameter(f'{PREFIX}pressure_topics',
                  tuple(f'segment_{n}/vacuum_sensor' for n in (1, 2, 3)),
                  'topic with the pressure of each segment, or one with all of them',
                  form=TOPIC_NAME),
        Parameter(f'{PREFIX}pressure_type', PRESSURE,
                  'message type of ros_jamming.pressure_topics',
                  choices=(PRESSURE, NUMBER, ARRAY)),
        Parameter(f'{PREFIX}pressure_scales', (1.0,), 'pressure per unit of the message, Pa; '
                  'negative if vacuum is reported as positive; a single value applies to all',
                  -1e7, 1e7),
        Parameter(f'{PREFIX}pressures_are', ABSOLUTE, 'reference of the pressures: absolute, or '
                  'gauge relative to ambient_pressure', choices=(ABSOLUTE, GAUGE)),
        Parameter(f'{PREFIX}plausible_pressures', (2e3, 200e3), 'range of absolute pressures that '
                  'a segment can have; values outside are taken to be in another unit', 0.0, 1e6,
                  is_range=True, unit='Pa'),
        Parameter(f'{PREFIX}regulators', False, 'each segment has a vacuum regulator with a '
                  'set-point instead of a valve'),
        Parameter(f'{PREFIX}command_topics', tuple(f'segment_{n}/valve' for n in (1, 2, 3)),
                  'topic of the commands for the valve or the regulator of each segment, or one '
                  'for all of them', form=TOPIC_NAME),
        Parameter(f'{PREFIX}command_type', BOOL, 'message type of that topic; for valves, true or '
                  '1 evacuates', choices=(BOOL, NUMBER, ARRAY)),
        Parameter(f'{PREFIX}state_topics', tuple(f'segment_{n}/valve_state' for n in (1, 2, 3)),
                  'topic on which the valve or regulator of each segment reports its state or '
                  'set-point, read back from the output, or one for all', form=TOPIC_NAME),
        Parameter(f'{PREFIX}state_type', BOOL, 'message type of ros_jamming.state_topics',
                  choices=(BOOL, NUMBER, ARRAY)),
        Parameter(f'{PREFIX}vacuum_scale', 1.0, 'vacuum per unit of the set-point of a regulator, '
                  'Pa; negative if set-points are gauge pressures', -1e7, 1e7),
        Parameter(f'{PREFIX}max_vacuum', 90e3, 'maximum set-point of a regulator, as vacuum below '
                  'ambient', 1e3, 101e3, unit='Pa'),
        Parameter(f'{PREFIX}pump_topic', '', 'topic that switches the pump (std_msgs/Bool); '
                  'empty: the pump switches itself', form=TOPIC_NAME),
        Parameter(f'{PREFIX}pump_state_topic', '', 'topic on which the pump reports whether it '
                  'runs (std_msgs/Bool)', form=TOPIC_NAME),
        Parameter(f'{PREFIX}timeout', 0.3, 'age at which a pressure or a state is stale, and '
                  'maximum wait for a state to follow its command', 0.05, 1.0, unit='s'),
    )

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]
                        ) -> 'RosJamming | RosRegulators':
        """
        Return the driver that checked parameters describe; raises ParameterError.

        clock: not used; a device continues when a node's clock is paused or set.
        """
        return RosRegulators(values) if values[f'{PREFIX}regulators'] else cls(values)

    @staticmethod
    def topics(values: Mapping[str, Any]) -> tuple[dict[str, str], dict[str, str]]:
        """Return type by name of the topics that are published, and that are subscribed to."""
        published, pressures, states = (
            dict.fromkeys(values[f'{PREFIX}{name}_topics'], values[f'{PREFIX}{name}_type'])
            for name in ('command', 'pressure', 'state'))
        if values[f'{PREFIX}pump_topic']:
            published[values[f'{PREFIX}pump_topic']] = BOOL
            states[values[f'{PREFIX}pump_state_topic']] = BOOL
        return published, pressures | states

    def __init__(self, values: Mapping[str, Any], clock: Clock = STEADY) -> None:
        """Take checked parameters; raises ParameterError.  Nothing is opened yet."""
        super().__init__(values, clock)
        pump = [values[f'{PREFIX}pump_topic'], values[f'{PREFIX}pump_state_topic']]
        self._has_pump = all(pump)
        if any(pump) and not self._has_pump:
            raise ParameterError(f'parameters {PREFIX}pump_topic and {PREFIX}pump_state_topic are '
                                 f'{pump}; give both, or neither for a self-controlled pump')
        self._pump: Numbers
        self._pump_commands: SegmentCommands

    def _connect(self, link: 'RosLink') -> None:
        super()._connect(link)
        get = self._parameters
        if self._has_pump:
            self._pump = Numbers(link, 'pump_state_topic', BOOL,
                                 [get[f'{PREFIX}pump_state_topic']], 1, self._timeout)
            self._pump_commands = SegmentCommands(
                link, 'pump_topic', BOOL, [get[f'{PREFIX}pump_topic']])

    def _inputs(self) -> tuple[Numbers, ...]:
        return (*super()._inputs(), *([self._pump] if self._has_pump else []))

    def read(self) -> JammingReading:
        """Return the state that was received last."""
        with self._lock:
            self._update()
            return JammingReading(self._absolute(),
                                  tuple(state == 1.0 for state in self._reported()),
                                  not self._has_pump or self._pump.values == (1.0,))

    def _reported(self) -> tuple[float, ...]:
        for i, state in enumerate(self._states.values):
            if state not in (0.0, 1.0):
                raise HardwareError(f'segment {i + 1}: its valve reports {state:g}; allowed: '
                                    f'0 or 1; check {PREFIX}state_topics')
        return self._states.values

    def set_evacuated(self, segment: int, evacuated: bool) -> None:
        """Switch the valve of a segment (0-based) and wait until it reports that."""
        wanted = float(evacuated)
        self._set(segment, wanted, lambda state: state == wanted,
                  f'the valve of segment {segment + 1}')

    def set_pump(self, running: bool) -> None:
        """Switch the pump, if it has a topic, and wait until it reports that."""
        if not self._has_pump:
            return
        with self._lock:
            self._update()
            self._confirm(lambda: self._pump_commands.send(0, [float(running)]),
                          lambda: self._pump.values == (float(running),), 'the pump')


class RosRegulators(RosVacuum):
    """Vacuum regulators of another node; see RegulatorDriver for what the methods promise."""

    def __init__(self, values: Mapping[str, Any], clock: Clock = STEADY) -> None:
        """Take checked parameters; raises ParameterError.  Nothing is opened yet."""
        super().__init__(values, clock)
        self._scale: float = values[f'{PREFIX}vacuum_scale']
        if BOOL in (values[f'{PREFIX}command_type'], values[f'{PREFIX}state_type']) or (
                not self._scale):
            raise ParameterError(
                f'parameter {PREFIX}regulators is true; a regulator takes and reports numbers: '
                f'{PREFIX}command_type and {PREFIX}state_type are {NUMBER} or {ARRAY}, and '
                f'{PREFIX}vacuum_scale is not 0')
        self.max_vacuum: float = values[f'{PREFIX}max_vacuum']
        self._last: dict[int, float] = {}  # Pa, by segment (0-based): the last set-points

    def read(self) -> JammingReading:
        """Return the state that was received last."""
        with self._lock:
            self._update()
            return JammingReading.of_regulators(self._absolute(), self._setpoints())

    def _setpoints(self) -> tuple[float, ...]:
        """
        Return the set-points, Pa below ambient; raises HardwareError for another unit.

        What is reported of one, such as measured of an output, may be noisy: one changes when it
        differs from what it was by more than that.
        """
        tolerance = SAME_SETPOINT * self.max_vacuum
        for i, value in enumerate(self._states.values):
            vacuum = self._scale * value
            if not -tolerance <= vacuum <= self.max_vacuum + tolerance:
                raise HardwareError(
                    f'segment {i + 1}: its regulator reports a set-point of {vacuum:.4g} Pa of '
                    f'vacuum; allowed: 0 to {self.max_vacuum:g} Pa; check {PREFIX}vacuum_scale '
                    f'and {PREFIX}max_vacuum')
            if not abs(vacuum - self._last.get(i, inf)) <= tolerance:
                self._last[i] = 0.0 if abs(vacuum) <= tolerance else vacuum
        return tuple(self._last[i] for i in range(self._segments))

    def _reported(self) -> tuple[float, ...]:
        return tuple(vacuum / self._scale for vacuum in self._setpoints())

    def set_vacuum(self, segment: int, vacuum: float) -> None:
        """Set the vacuum of a segment (0-based), Pa, and wait until it reports that."""
        tolerance = SAME_SETPOINT * self.max_vacuum
        self._set(segment, vacuum / self._scale,
                  lambda state: abs(self._scale * state - vacuum) <= tolerance,
                  f'the regulator of segment {segment + 1}')
        self._last[segment] = vacuum if vacuum > tolerance else 0.0
