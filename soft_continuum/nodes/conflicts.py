# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that must not act as one arm: of one name, of two versions, for two arms."""

from collections import defaultdict
from collections.abc import Mapping
from functools import partial
from math import inf
from typing import Any

from std_msgs.msg import String

from soft_continuum.nodes.about import About, Instance, PERIOD
from soft_continuum.nodes.entries import repeat, subscribe
from soft_continuum.parameters.nodes import DESCRIBED
from soft_continuum.ros.age import Age
from soft_continuum.ros.names import INSTANCE, NODES, TELEOP, UNKNOWN_NODE
from soft_continuum.ros.qos import SENSOR
from soft_continuum.ros.text import plain

ENDED_AFTER = 1.5  # s after its last sign of life for a node to count as ended
TOPICS = ('tendon_states', 'joint_states', *(f'{node}/state' for node in (*NODES, TELEOP)))
MAX_AHEAD = 0.2
"""s by which the clock of another computer may be ahead: as much more motion may be queued."""
MAX_NAMES = 5  # of publishers that are listed


DIFFERENCES = (
    ('version', 'version', 'install one version on every computer'),
    ('description', 'a description of the arm with digest', 'start every node with the same '
     'description; `soft_continuum doctor --network` names the parameters that differ'),
)
"""Of Instance: what must be the same, how it is said, and the remedy."""


class Conflicts:
    """
    Notices whatever would make two nodes act as one, or two arms be taken for one.

    The graph alone would not do: a node that was killed stays in it for many seconds.  So every
    node publishes on ~/instance that it runs, by which version and for which arm, and this
    receives it of another one with its name, and of all the other nodes of the arm.
    """

    def __init__(self, node: Any, segments: int, parameters: Mapping[str, Any]) -> None:
        """Watch on behalf of ``node``, for an arm of so many segments."""
        self.problem = ''
        self._node, self._about = node, About(node, parameters)
        of_segments = [f'segment_{n}/{topic}' for n in range(1, segments + 1)
                       for topic in ('stiff', 'pressure')]
        self._topics = [node.resolve_topic_name(topic) for topic in (*TOPICS, *of_segments)]
        self._same_name = Age()
        subscribe(node, String, INSTANCE, self._on_same_name, SENSOR)
        self._others = {name: (Instance(''), Age()) for name in DESCRIBED
                        if name != node.get_name()}
        self._ahead: dict[str, tuple[float, float]] = {}  # s, by the last two messages of a node
        for name in self._others:
            subscribe(node, String, INSTANCE.replace('~', name), partial(self._on_other, name),
                      SENSOR)
        repeat(node, PERIOD, self._check_now)

    def _on_same_name(self, message: String) -> None:
        if Instance.from_ros(message).process != self._about.own.process:
            self._same_name.refresh()
            self._check_at_first()

    def _on_other(self, name: str, message: String) -> None:
        _, age = self._others[name]
        instance = Instance.from_ros(message)
        age.refresh()
        self._others[name] = instance, age
        if instance.time is not None:
            _, last = self._ahead.get(name, (-inf, -inf))
            self._ahead[name] = last, instance.time - self._about.time
        if any(self._differs(instance, attribute) for attribute, *_ in DIFFERENCES):
            self._check_at_first()

    def _differs(self, instance: Instance, attribute: str) -> bool:
        own = getattr(self._about.own, attribute)  # '' of a node that has no description
        return bool(own) and getattr(instance, attribute) != own

    def _check_at_first(self) -> None:
        """Check now, unless a problem is known: of a flood every message would cost a look."""
        if not self.problem:
            self._check_now()

    def lost(self, name: str, timeout: float) -> bool:
        """Return whether one of the other nodes was heard of, but not for ``timeout`` s."""
        return timeout < self._others[name][1].seconds < inf

    def _check_now(self) -> None:
        node, problems = self._node, []
        if self._same_name.seconds <= ENDED_AFTER:
            problems.append(
                f'another {node.get_fully_qualified_name()} is running; end one of the two, or '
                'give one a namespace')
        for topic in self._topics:
            if node.count_publishers(topic) < 2:  # to list them takes many times as long
                continue
            names = sorted({f'{info.node_namespace.rstrip("/")}/{info.node_name}'
                            for info in node.get_publishers_info_by_topic(topic)
                            if info.node_name != UNKNOWN_NODE})
            if len(names) > 1:
                some = ' and '.join(map(plain, names[:MAX_NAMES]))
                problems.append(f'{topic} is published by {some}; end all but one')
        for difference in DIFFERENCES:
            problems += self._differences(*difference)
        problems += self._clocks()
        self.problem = '; '.join(problems)
        node.status.alarm('conflict', self.problem)

    def _clocks(self) -> list[str]:
        """Return whose clock is ahead of that of this node: a late message is no sign of that."""
        found = {}
        for name, (instance, age) in self._others.items():
            ahead = min(self._ahead.get(name, (-inf, -inf)))  # in one, a clock may have been set
            if age.seconds <= ENDED_AFTER and ahead > MAX_AHEAD:
                found[instance.host] = name, ahead
        return [
            f'the clock of {name} on {host or "an unknown computer"} is {ahead:.2f} s ahead of '
            f'that of {self._node.get_name()} on {self._about.own.host}; allowed: {MAX_AHEAD:g} '
            's; let both computers take their time from one server (chrony)'
            for host, (name, ahead) in found.items()]

    def _differences(self, attribute: str, what: str, remedy: str) -> list[str]:
        """Return how the nodes that run differ from this one in an attribute of Instance."""
        own, found = self._about.own, defaultdict(list)
        for name, (instance, age) in self._others.items():
            if age.seconds <= ENDED_AFTER and self._differs(instance, attribute):
                found[getattr(instance, attribute), instance.host].append(name)
        return [
            f'{" and ".join(names)} on {host or "an unknown computer"} '
            f'{"have" if len(names) > 1 else "has"} {what} '
            f'{value or "unknown"}, {self._node.get_name()} on {own.host} '
            f'{getattr(own, attribute)}: {remedy}' for (value, host), names in found.items()]
