# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A second node of the same name, and other publishers of the suite's topics."""

from typing import Any
from uuid import uuid4

from std_msgs.msg import String

from soft_continuum.nodes.entries import repeat, subscribe
from soft_continuum.ros.age import Age
from soft_continuum.ros.names import NODES, TELEOP
from soft_continuum.ros.qos import SENSOR, STREAM
from soft_continuum.ros.text import plain

PERIOD = 0.2  # s between two signs of life, and two looks at the graph
ENDED_AFTER = 1.5  # s after its last sign of life for a node to count as ended
TOPICS = ('tendon_states', 'joint_states', *(f'{node}/state' for node in (*NODES, TELEOP)))
MAX_NAMES = 5  # of publishers that are listed
UNKNOWN = '_NODE_NAME_UNKNOWN_'  # of a publisher whose node has not been discovered yet


class Conflicts:
    """
    Notices whatever would make two nodes act as one.

    The graph alone would not do: a node that was killed stays in it for many seconds.  So every
    node publishes on ~/instance that it runs, and receives this of another one with its name.
    """

    def __init__(self, node: Any, segments: int) -> None:
        """Watch on behalf of ``node``, for an arm of so many segments."""
        self.problem = ''
        self._node, self._own = node, String(data=uuid4().hex)
        of_segments = [f'segment_{n}/{topic}' for n in range(1, segments + 1)
                       for topic in ('stiff', 'pressure')]
        self._topics = [node.resolve_topic_name(topic) for topic in (*TOPICS, *of_segments)]
        self._other = Age()
        self._publisher = node.create_publisher(String, '~/instance', STREAM)
        subscribe(node, String, '~/instance', self._on_instance, SENSOR)
        repeat(node, PERIOD, self._live)

    def _on_instance(self, message: String) -> None:
        if message.data != self._own.data:
            self._other.refresh()
            self._check_now()

    def _live(self) -> None:
        # Only here: an answer to every sign of life would be answered by the other node in turn.
        self._publisher.publish(self._own)
        self._check_now()

    def _check_now(self) -> None:
        node, problems = self._node, []
        if self._other.seconds <= ENDED_AFTER:
            problems.append(
                f'another {node.get_fully_qualified_name()} is running; end one of the two, or '
                'give one a namespace')
        for topic in self._topics:
            names = sorted({f'{info.node_namespace.rstrip("/")}/{info.node_name}'
                            for info in node.get_publishers_info_by_topic(topic)
                            if info.node_name != UNKNOWN})
            if len(names) > 1:
                some = ' and '.join(map(plain, names[:MAX_NAMES]))
                problems.append(f'{topic} is published by {some}; end all but one')
        self.problem = '; '.join(problems)
        node.status.alarm('conflict', self.problem)
