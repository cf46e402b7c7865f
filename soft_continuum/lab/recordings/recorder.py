# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Records all topics of an arm into a bag; the node that does so on request."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from datetime import datetime
from functools import partial
from pathlib import Path
from queue import Empty, Queue
import threading
from time import monotonic, monotonic_ns, strftime, time_ns
from typing import Any

from rcl_interfaces.srv import ListParameters
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import SetBool
import yaml

from soft_continuum import version
from soft_continuum.client import ClientError
from soft_continuum.client.requests import Requests
from soft_continuum.client.tasks import ATTEMPTS, until
from soft_continuum.lab.recordings.bag import (
    BagError,
    BagWriter,
    definition,
    DESCRIPTION,
    message_class,
    PARAMETERS,
    PICTURES,
    Topic,
)
from soft_continuum.nodes.suite_node import ERROR, OK, StatePublisher, SuiteNode, WARN
from soft_continuum.parameters.arm import ARM_PARAMETERS
from soft_continuum.parameters.files import parameters_text
from soft_continuum.ros.entries import LOG_PERIOD, repeat, serve_later
from soft_continuum.ros.names import (
    CAMERA,
    DISC_SENSORS,
    KINEMATICS,
    NODES,
    RECORDER,
    running_nodes,
    SHARED,
    TWIN,
)
from soft_continuum.text import MAX_NAME, printable
from soft_continuum_interfaces.msg import RecorderState

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


ANSWER_TIMEOUT = 5.0  # s for the parameters of another node
REPORT_PERIOD = 0.5  # s


class Recorder(SuiteNode):
    """
    Records all topics of its namespace into MCAP files.

    Serves ~/record (std_srvs/SetBool): true begins a file, false ends it.  Publishes ~/state
    (RecorderState), ~/status and /diagnostics.  It moves nothing, and no other node needs it.
    """

    def __init__(self, **options: Any) -> None:
        """Declare parameters and the service; nothing is recorded yet.  Raises ParameterError."""
        super().__init__(RECORDER, 'recordings', **options)
        self._states = StatePublisher(self, RecorderState)
        self._recording: TopicRecorder | None = None  # that runs, or ran last
        self._attaching: Future[None] = Future()
        self._file = ''
        self._requests = Requests(self, ANSWER_TIMEOUT)
        serve_later(self, SetBool, '~/record', self._on_record)
        repeat(self, REPORT_PERIOD, self._report)

    def start(self) -> None:
        """Report that nothing is recorded yet."""
        self._report()

    def quit(self) -> None:
        """End the recording that runs."""
        if self._recording is not None:
            self._recording.close()
        self._report()

    @property
    def _runs(self) -> bool:
        return self._recording is not None and not self._recording.closed

    @property
    def _problem(self) -> str:
        """Why the recording failed; empty if it did not."""
        if self._recording is None or not self._recording.failure:
            return ''
        return (f'{self._file}: can no longer be written: {self._recording.failure}; earlier '
                'messages are kept')

    def _on_record(self, request: SetBool.Request,
                   answer: Callable[[SetBool.Response], None]) -> None:
        recording, response = self._recording, SetBool.Response(success=True)
        if request.data == self._runs:
            response.message = (f'already recording into {self._file}' if request.data else
                                'nothing is being recorded')
        elif request.data:
            response.success, response.message = self._begin()
        elif recording is not None:
            self._requests.start(self._end(recording, answer))
            return
        self._report()
        answer(response)

    async def _end(self, recording: TopicRecorder,
                   answer: Callable[[SetBool.Response], None]) -> None:
        await end_recording(recording, self._attaching, self._requests)
        self._report()
        answer(SetBool.Response(success=not self._problem, message=self._problem or (
            f'{recording.counts.total()} messages in {self._file}')))

    def _begin(self) -> tuple[bool, str]:
        directory = Path(self.parameters['recorder.directory']).expanduser()
        space = self.get_namespace().strip('/').replace('/', '_') or 'arm'
        path = directory / f'{space}_{strftime("%Y-%m-%d_%H-%M-%S")}.mcap'
        try:
            directory.mkdir(parents=True, exist_ok=True)
            recording: TopicRecorder | None = None
            while recording is None:
                try:
                    recording = TopicRecorder(
                        self, path, about(self), pictures=self.parameters['recorder.pictures'])
                except FileExistsError:  # of the same second, or of another recorder
                    path = path.with_name(f'{path.stem}_.mcap')
        except OSError as error:
            return False, (f'{path}: cannot be written: {error.strerror}; change '
                           'recorder.directory')
        except BagError as error:
            return False, str(error)
        self._attaching = self._requests.start(attach_parameters(self._requests, recording))
        self._recording, self._file = recording, str(path.absolute())
        return True, f'recording into {self._file}'

    def _report(self) -> None:
        recording = self._recording
        if recording is not None and recording.failure:
            recording.close()
        state = RecorderState(recording=self._runs, file=self._file, problem=self._problem)
        if recording is not None:
            state.messages, state.lost = recording.counts.total(), recording.lost
        self._states.publish(state)
        if state.problem:
            self.status.set(ERROR, state.problem)
        elif not state.recording:
            self.status.set(OK, 'not recording', file=self._file)
        elif state.lost:
            self.status.set(WARN, f'{state.lost} messages are lost: too large, or the disk is '
                            'too slow')
        else:
            self.status.set(OK, f'recording into {self._file}')
