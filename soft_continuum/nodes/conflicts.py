# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Detection of conflicting nodes: same name, other version, other description."""

from collections import defaultdict, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from struct import unpack_from
from typing import Any

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soft_continuum.nodes.suite_node import HEARTBEAT_PERIOD, NodeInfo
from soft_continuum.ros.entries import guarded, MAX_BYTES, repeat, SENSOR, subscribe
from soft_continuum.ros.names import HEARTBEAT, NODES, TELEOP, UNKNOWN_NODE
from soft_continuum.ros.parameter_table import DESCRIBED
from soft_continuum.ros.ros_time import Age
from soft_continuum.text import plain
from soft_continuum_interfaces.msg import Heartbeat

ENDED_AFTER = 1.5  # s after its last sign of life for a node to count as ended
TOPICS = ('tendon_states', *(f'{node}/state' for node in (*NODES, TELEOP)))
MAX_AHEAD = 0.2
"""Largest advance of another computer's clock, s; it adds to the queued motion."""
GRAPH_PERIOD = 1.0  # s: another publisher is discovered no sooner
MAX_NAMES = 5  # of publishers that are listed
MAX_PROCESSES = 8  # of one name that are distinguished
JOINTS = 'joint_states'
HEARTBEAT_TYPE = 'soft_continuum_interfaces/msg/Heartbeat'
OWN_JOINTS = 500  # messages of our own that may still be on their way back


DIFFERENCES = (
    ('version', 'version', 'install one version on every computer'),
    ('description', 'a description of the arm with digest', 'start every node with the same '
     'description; `soft_continuum doctor --network` names the parameters that differ'),
)
"""Attributes of NodeInfo that must be equal: attribute, its name in messages, remedy."""


class HeartbeatReader:
    """
    Reads serialized heartbeats of one topic.

    Most equal the last one but for their stamp; of those only the stamp, which comes first, is
    converted: a heartbeat is received some 80 times a second by the nodes of an arm at rest.
    """

    def __init__(self) -> None:
        """Start without a heartbeat."""
        self._content, self._info = (b'', b''), NodeInfo('')

    def __call__(self, data: bytes, _: Any = None) -> tuple[NodeInfo, float]:
        """Return the last information, and the time of this message, s."""
        encoding, content = data[:4], (data[:4], data[12:])
        if content != self._content:
            self._info = NodeInfo.from_ros(deserialize_message(data, Heartbeat))
            self._content = content
        sec, nanosec = unpack_from('<iI' if encoding[1] & 1 else '>iI', data, 4)
        return self._info, sec + nanosec * 1e-9


@dataclass
class Heard:
    """
    A process of a node whose heartbeat was received.

    ahead: advance of its clock, s, in its last two messages: one may precede a clock change.
    """

    info: NodeInfo
    ahead: tuple[float, float] = (-inf, -inf)
    age: Age = field(default_factory=Age)


class Conflicts:
    """
    Detects nodes that conflict by name, version, description, topics or clocks.

    The ROS graph is not sufficient: a killed node stays in it for many seconds.  So every node
    publishes its version and arm on ~/heartbeat, and this class subscribes to those of all nodes
    of the arm.  Two processes of one name run if heartbeats of both alternate: after a restart
    those of the first process have ended.
    """

    def __init__(self, node: Any, segments: int) -> None:
        """Watch on behalf of ``node``, for an arm of so many segments."""
        self.problem = ''
        self._node, self.node_info = node, node.node_info
        of_segments = [f'segment_{n}/{topic}' for n in range(1, segments + 1)
                       for topic in ('stiff', 'pressure')]
        self._topics = [node.resolve_topic_name(topic) for topic in (*TOPICS, *of_segments)]
        self._graph_age, self._shared_topics = Age(), list[str]()
        self._own_name = node.get_name()
        self._heard: dict[str, dict[str, Heard]] = {  # by name and process, the last one last
            name: {} for name in (self._own_name, *DESCRIBED)}
        self._doubled: dict[str, Age] = defaultdict(Age)
        self._heartbeats = set[str]()
        for name in self._heard:
            topic = HEARTBEAT if name == self._own_name else HEARTBEAT.replace('~', name)
            subscribe(node, Heartbeat, topic, partial(self._on_heartbeat, name), SENSOR,
                      convert=HeartbeatReader())
            self._heartbeats.add(node.resolve_topic_name(topic))
        repeat(node, HEARTBEAT_PERIOD, self._check_now)

    def _on_heartbeat(self, name: str, said: tuple[NodeInfo, float]) -> None:
        (info, time), processes = said, self._heard[name]
        last, heard = next(reversed(processes), ''), processes.pop(info.process, None)
        if heard is None:
            for process in [one for one, of in processes.items() if of.age.seconds > ENDED_AFTER]:
                del processes[process]
            if len(processes) >= MAX_PROCESSES:
                return
            heard = Heard(info)
        elif last != info.process:
            self._doubled[name].refresh()
        processes[info.process] = heard
        heard.info = info
        heard.age.refresh()
        heard.ahead = heard.ahead[1], time - self.node_info.time
        if last != info.process or any(
                self._differs(info, attribute) for attribute, *_ in DIFFERENCES):
            self._check_at_first()

    def _differs(self, info: NodeInfo, attribute: str) -> bool:
        own = getattr(self.node_info.own, attribute)  # '' of a node that has no description
        return bool(own) and getattr(info, attribute) != own

    def _check_at_first(self) -> None:
        """Check now, unless a problem is known: of a flood every message would cost a look."""
        if not self.problem:
            self._check_now()

    def heartbeat_age(self, name: str) -> float:
        """Return the s since the last heartbeat of another node; inf before the first."""
        return min((one.age.seconds for one in self._heard[name].values()), default=inf)

    def lost(self, name: str, timeout: float) -> bool:
        """Return whether the heartbeat of another node is older than ``timeout`` s."""
        return timeout < self.heartbeat_age(name) < inf

    def _others(self) -> Iterator[tuple[str, Heard]]:
        """Yield name and process of whatever other nodes run."""
        for name, processes in self._heard.items():
            for process, heard in processes.items():
                if process != self.node_info.own.process and heard.age.seconds <= ENDED_AFTER:
                    yield name, heard

    def _check_now(self) -> None:
        node = self._node
        problems = [
            f'another {node.get_namespace().rstrip("/")}/{name} is running; stop one of the two, '
            'or give one a namespace'
            for name, age in self._doubled.items() if age.seconds <= ENDED_AFTER]
        if self._graph_age.seconds >= GRAPH_PERIOD:
            self._graph_age.refresh()
            self._shared_topics = self._look_at_the_graph()
        problems += self._shared_topics
        problems += sorted({one.conflict for one in (
            self.node_info.own, *(heard.info for _, heard in self._others()))} - {''})
        for difference in DIFFERENCES:
            problems += self._differences(*difference)
        problems += self._clocks()
        self.problem = '; '.join(problems)
        node.status.alarm('conflict', self.problem)

    def _look_at_the_graph(self) -> list[str]:
        """Return conflicts of topics: several publishers, or another version."""
        found = [
            f'{topic} is also of type {plain(kind)}: that node runs another version of '
            'soft_continuum; install one version on every computer'
            for topic, kinds in self._node.get_topic_names_and_types()
            if topic in self._heartbeats for kind in kinds if kind != HEARTBEAT_TYPE]
        for topic in self._topics:
            if self._node.count_publishers(topic) < 2:  # to list them takes many times as long
                continue
            names = publishers(self._node, topic)
            if len(names) > 1:
                found.append(f'{topic} is published by {" and ".join(names)}; stop all but one')
        return found

    def _clocks(self) -> list[str]:
        """Return nodes whose clock is ahead of this one; a late message does not indicate that."""
        found = {one.info.host: (name, min(one.ahead)) for name, one in self._others()
                 if min(one.ahead) > MAX_AHEAD}
        return [
            f'the clock of {name} on {host or "an unknown computer"} is {ahead:.2f} s ahead of '
            f'that of {self._node.get_name()} on {self.node_info.own.host}; allowed: '
            f'{MAX_AHEAD:g} s; synchronize both computers to one time server (chrony)'
            for host, (name, ahead) in found.items()]

    def _differences(self, attribute: str, what: str, remedy: str) -> list[str]:
        """Return how running nodes differ from this one in an attribute of NodeInfo."""
        own, found = self.node_info.own, defaultdict(list)
        for name, one in self._others():
            if self._differs(one.info, attribute):
                found[getattr(one.info, attribute), one.info.host].append(name)
        return [
            f'{" and ".join(names)} on {host or "an unknown computer"} '
            f'{"have" if len(names) > 1 else "has"} {what} '
            f'{value or "unknown"}, {self._node.get_name()} on {own.host} '
            f'{getattr(own, attribute)}: {remedy}' for (value, host), names in found.items()]


class SharedJoints:
    """
    Detects that another node publishes joints of this arm on joint_states.

    Other joints, such as those of a base that carries the arm, are no conflict.  A message does
    not identify its sender, so our own messages are kept for a while.
    """

    def __init__(self, node: Any, names: Sequence[str], conflicts: Conflicts) -> None:
        """Watch on behalf of the ``node`` that publishes the joints with these names."""
        self._node, self._names, self._conflicts = node, frozenset(names), conflicts
        self._own: deque[tuple[int, int, bytes]] = deque(maxlen=OWN_JOINTS)
        self._age, self._shared = Age(), ''
        self._topic, self._alone = node.resolve_topic_name(JOINTS), True
        node.create_subscription(JointState, JOINTS, guarded(node, self._on_joints), SENSOR,
                                 raw=True)
        repeat(node, HEARTBEAT_PERIOD, self._check)

    def sent(self, message: JointState) -> None:
        """Note a message of our own, before it is published."""
        self._own.append(_key(message))

    def _on_joints(self, data: bytes) -> None:
        if self._alone or len(data) > MAX_BYTES:  # to convert each of our own would cost a lot
            return
        message = deserialize_message(data, JointState)
        if (shared := self._names.intersection(message.name)) and _key(message) not in self._own:
            self._shared = min(shared)
            self._age.refresh()

    def _check(self) -> None:
        node = self._node
        self._alone = node.count_publishers(self._topic) < 2
        problem = '' if self._age.seconds > ENDED_AFTER else (
            f'{self._topic} with {plain(self._shared)} is published by '
            f'{" and ".join(publishers(node, self._topic))}; stop all but {node.get_name()}, or '
            'rename the joints of the others')
        node_info = self._conflicts.node_info
        node_info.own = replace(node_info.own, conflict=problem)


def _key(message: JointState) -> tuple[int, int, bytes]:
    stamp = message.header.stamp
    return stamp.sec, stamp.nanosec, bytes(message.position)


def publishers(node: Any, topic: str) -> list[str]:
    """Return the full names of the nodes that publish a topic, a few at most."""
    names = {f'{info.node_namespace.rstrip("/")}/{info.node_name}'
             for info in node.get_publishers_info_by_topic(topic)
             if info.node_name != UNKNOWN_NODE}
    return [plain(name) for name in sorted(names)[:MAX_NAMES]]
