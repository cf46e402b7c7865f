# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Records all topics of an arm into a bag, with its description and parameters."""

from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from datetime import datetime
from functools import partial
from pathlib import Path
from queue import Empty, Queue
import threading
from time import monotonic, monotonic_ns, time_ns
from typing import Any

from rcl_interfaces.srv import ListParameters
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
import yaml

from soft_continuum import version
from soft_continuum.client.errors import ClientError
from soft_continuum.client.requests import Requests
from soft_continuum.client.tasks import ATTEMPTS, until
from soft_continuum.lab.recordings.bag import (
    BagWriter,
    DESCRIPTION,
    PARAMETERS,
    PICTURES,
    Topic,
)
from soft_continuum.parameters.arm import ARM_PARAMETERS
from soft_continuum.parameters.files import parameters_text
from soft_continuum.ros.definitions import definition, message_class
from soft_continuum.ros.entries import LOG_PERIOD
from soft_continuum.ros.names import (
    CAMERA,
    DISC_SENSORS,
    KINEMATICS,
    NODES,
    running_nodes,
    SHARED,
    TWIN,
)
from soft_continuum.text import MAX_NAME, printable

LOOK_PERIOD = 0.5  # s between two looks for topics, or nodes, that are new
FLUSH_PERIOD = 0.5  # s
DEPTH, PICTURE_DEPTH = 100, 5  # messages that wait in the middleware for this process
MAX_TOPICS = 500
MAX_BYTES = 1_000_000  # of a message that is no picture
MAX_WAITING = 10_000  # messages that wait for the disk
MAX_WAITING_BYTES = 64_000_000
CLOSE_TIMEOUT = 3.0  # s; what starts this process, and the browser, wait for five
DISCOVERY = 2.0
"""Time of discovering nodes, s: their topics may be discovered before them."""
ATTACH_TIMEOUT = 10.0
"""Time (s) that the end of a recording waits for parameters: the view needs those of the arm."""
QOS = """\
- history: keep_last
  depth: {depth}
  reliability: {reliability}
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: automatic
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""


class TopicRecorder:
    """
    Writes all topics in the namespace of a node, and /tf, /diagnostics and /rosout.

    All methods must be called on the thread that spins the node; a separate thread writes.  Hidden
    topics and the ground truth of the twin are not recorded.

    counts: messages by topic.  lost: messages that were too large or arrived faster than the disk
    could write.  failure: why no more can be written, such as a full disk.  ending: whether the
    end only waits for attachments.
    """

    def __init__(self, node: Node, path: Path, about: Mapping[str, str], *,
                 pictures: bool = False) -> None:
        """Begin a file that is not there; raises OSError, and BagError without the packages."""
        self.counts: Counter[str] = Counter()
        self.lost = 0
        self.failure = ''
        self.ending = False
        self._node, self._pictures = node, pictures
        self._epoch = time_ns() - monotonic_ns()  # a clock that is set changes nothing
        self._subscriptions: dict[str, Any] = {}
        self._left_out: set[str] = set()
        self._writer = BagWriter(path, about)
        self._queue: Queue[tuple[Topic, int, bytes]] = Queue(MAX_WAITING)
        self._lock = threading.Lock()
        self._waiting = 0  # bytes
        self._attachments: list[tuple[str, str]] = []
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._write, name='recording', daemon=True)
        self._thread.start()
        self._look()
        self._timer = node.create_timer(LOOK_PERIOD, self._look, clock=Clock(
            clock_type=ClockType.STEADY_TIME))

    def attach(self, name: str, text: str) -> None:
        """Add a text file to the recording."""
        self._attachments.append((name, text))

    @property
    def closed(self) -> bool:
        """Whether the recording is closed."""
        return self._closing.is_set()

    def close(self) -> None:
        """End the recording, in CLOSE_TIMEOUT or with a failure; a second call does nothing."""
        if self.closed:
            return
        self._node.destroy_timer(self._timer)
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._closing.set()
        self._thread.join(CLOSE_TIMEOUT)
        if self._thread.is_alive():
            self.failure = (f'the disk did not accept the end within {CLOSE_TIMEOUT:g} s; the '
                            'rest is readable')

    # Which topics there are.

    def _look(self) -> None:
        space = self._node.get_namespace().rstrip('/') + '/'
        for name, _ in self._node.get_topic_names_and_types():
            if (name in self._subscriptions or name in self._left_out
                    or not (name.startswith(space) or name in SHARED)
                    or f'/{TWIN}/' in name or '/_' in name
                    or name.endswith('/parameter_events')):
                continue
            publishers = self._node.get_publishers_info_by_topic(name)
            if not publishers:
                continue  # there are subscribers, but no publisher yet
            try:
                self._subscribe(name, publishers)
            except Exception as error:  # names and types come from the network
                self._left_out.add(name)
                self._node.get_logger().warning(
                    f'{printable(name, MAX_NAME)} is not recorded: {printable(str(error))}',
                    throttle_duration_sec=LOG_PERIOD)

    def _subscribe(self, name: str, publishers: Sequence[Any]) -> None:
        """Subscribe; raises whatever is wrong with a name, a type or a QoS of the network."""
        kinds = {publisher.topic_type for publisher in publishers}
        if len(kinds) != 1:
            raise ValueError(f'it has several types: {", ".join(sorted(kinds))}')
        kind, = kinds
        if kind in PICTURES and not self._pictures:
            self._left_out.add(name)
            return
        if len(self._subscriptions) >= MAX_TOPICS:
            raise ValueError(f'there are more than {MAX_TOPICS} topics')
        profiles = [publisher.qos_profile for publisher in publishers]
        reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
        latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
        topic = Topic(name, kind, definition(kind), QOS.format(
            depth=max(1, profiles[0].depth),
            reliability='reliable' if reliable else 'best_effort',
            durability='transient_local' if latched else 'volatile'))
        self._subscriptions[name] = self._node.create_subscription(
            message_class(kind), name, partial(self._on_message, topic), QoSProfile(
                depth=PICTURE_DEPTH if kind in PICTURES else DEPTH,
                reliability=(ReliabilityPolicy.RELIABLE if reliable else
                             ReliabilityPolicy.BEST_EFFORT),
                durability=(DurabilityPolicy.TRANSIENT_LOCAL if latched else
                            DurabilityPolicy.VOLATILE)), raw=True)

    # Messages, on their way to the disk.

    def _on_message(self, topic: Topic, data: bytes) -> None:
        if self.failure or self.closed:
            return
        self.counts[topic.name] += 1
        with self._lock:
            if (self._waiting > MAX_WAITING_BYTES or self._queue.full()
                    or (len(data) > MAX_BYTES and topic.kind not in PICTURES)):
                self.lost += 1
                return
            self._waiting += len(data)
        self._queue.put((topic, self._now(), data))

    def _write(self) -> None:
        writer = self._writer
        try:
            flushed = monotonic()
            while not (self.closed and self._queue.empty()):
                try:
                    topic, time, data = self._queue.get(timeout=FLUSH_PERIOD / 4)
                except Empty:
                    pass
                else:
                    with self._lock:
                        self._waiting -= len(data)
                    writer.write(topic, time, data)
                self._write_attachments()
                if monotonic() - flushed >= FLUSH_PERIOD:
                    writer.flush()
                    flushed = monotonic()
            self._write_attachments()
        except Exception as error:  # a full disk, no memory; nothing here may end unnoticed
            self.failure = _reason(error)
        try:
            writer.close()
        except Exception as error:
            self.failure = self.failure or _reason(error)

    def _write_attachments(self) -> None:
        while self._attachments:
            self._writer.attach(*self._attachments.pop(0), self._now())

    def _now(self) -> int:
        return self._epoch + monotonic_ns()


def _reason(error: Exception) -> str:
    return printable(getattr(error, 'strerror', None) or repr(error))


def about(node: Node) -> dict[str, str]:
    """Return the metadata of a recording of an arm."""
    return {'version': version(), 'namespace': node.get_namespace(),
            'begun': datetime.now().astimezone().isoformat(timespec='seconds')}


async def attach_parameters(requests: Requests, recording: TopicRecorder) -> None:
    """Attach the parameters of the nodes as they are discovered; log failures."""
    found: dict[str, Any] = {}
    asked: set[str] = set()
    try:
        await until(lambda: all(running_nodes(requests.node).values()), DISCOVERY)
        while not set(NODES) <= asked:
            ending = recording.ending
            running = running_nodes(requests.node, (*NODES, CAMERA, DISC_SENSORS))
            for name in (name for name, runs in running.items() if runs and name not in asked):
                asked.add(name)
                await _attach_those_of(name, requests, recording, found)
            if ending:
                return
            await until(lambda: recording.ending, LOOK_PERIOD)
    except Exception as error:  # the rest is worth recording without them
        requests.node.get_logger().warning(
            f'the parameters of the nodes are not recorded: {printable(repr(error))}')


async def end_recording(recording: TopicRecorder, attaching: Future[None],
                        requests: Requests) -> None:
    """Close a recording once ``attaching`` is done, in ATTACH_TIMEOUT or without the rest."""
    recording.ending = True
    if not recording.failure and not await until(attaching.done, ATTACH_TIMEOUT):
        requests.node.get_logger().warning(
            f'the parameters of the nodes are not all recorded: no answer in {ATTACH_TIMEOUT:g} s')
    recording.close()


async def _attach_those_of(name: str, requests: Requests, recording: TopicRecorder,
                           found: dict[str, Any]) -> None:
    """Ask a node for its parameters and attach all that are found; the last attached counts."""
    try:
        listed = await requests.call(ListParameters, f'{name}/list_parameters', attempts=ATTEMPTS)
        values = await requests.parameters(name, sorted(listed.result.names))
    except ClientError as error:  # the rest is worth recording without it
        requests.node.get_logger().warning(
            f'the parameters of {name} are not recorded: {printable(str(error))}')
        return
    found[name] = {'ros__parameters': values}
    if name == KINEMATICS:
        arm = {p.name: values[p.name] for p in ARM_PARAMETERS if p.name in values}
        recording.attach(DESCRIPTION, parameters_text(arm, ['The arm that was recorded.']))
    recording.attach(PARAMETERS, yaml.safe_dump(found, default_flow_style=None))
