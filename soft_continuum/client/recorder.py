# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A client that records a run of the arm: the command ``record``."""

from contextlib import suppress
from datetime import datetime
from math import inf
from pathlib import Path
import re
import signal
import sys
from time import monotonic
from typing import Any

from rcl_interfaces.srv import ListParameters

from soft_continuum import version
from soft_continuum.analysis.recording import ABOUT, DESCRIPTION, RecordingWriter
from soft_continuum.client.connection import Connection
from soft_continuum.client.errors import ClientError
from soft_continuum.client.observed import JAMMING_STATE, ObservedArm, SEQUENCER_STATE, TOPICS
from soft_continuum.client.requests import Requests
from soft_continuum.client.tasks import until
from soft_continuum.ros.names import KINEMATICS, NODES
from soft_continuum.text import printable

DISCOVERY_TIMEOUT = 5.0  # s until the first message
BUSY_TIMEOUT = 15.0  # s, of nodes that are seen to run


class Recorder:
    """
    Writes every message of an observed arm into a recording; asks for nothing.

    interrupted: set it to end the recording.  failure: why nothing more could be written, such as
    a full disk.
    """

    def __init__(self, directory: Path, observed: ObservedArm, namespace: str) -> None:
        """Begin as soon as the tendons of the arm are known; ``directory`` exists."""
        self.goal_ended = False
        self.interrupted = False
        self.failure: OSError | None = None
        self.about = (f'soft_continuum {version()}, arm in namespace {namespace}, '
                      f'{datetime.now().astimezone().isoformat(timespec="seconds")}')
        self._directory = directory
        self.closed = False
        self._observed = observed
        self._writer: RecordingWriter | None = None
        self._begin = monotonic()
        self._events: dict[str, str] = {}  # the last of each source
        self._stiff: dict[int, bool] = {}
        observed.on_change(self._on_message)

    @property
    def ending(self) -> bool:
        """Whether nothing more is to be recorded."""
        return self.interrupted or self.closed

    @property
    def recording(self) -> bool:
        """Whether something has been written."""
        return self._writer is not None

    def close(self) -> None:
        """Close the files; what comes later is not recorded."""
        self.closed = True
        if self._writer is not None:
            with suppress(OSError):  # what could not be written before cannot be now
                self._writer.__exit__(None, None, None)

    def _on_message(self, topic: str) -> None:
        if self.closed or not self._observed.tendons:
            return
        try:
            self._record(topic)
        except OSError as error:
            self.failure = error
            self.close()

    def _record(self, topic: str) -> None:
        if self._writer is None:
            self._writer = RecordingWriter(self._directory, self._observed.tendons)
            self._event(self._writer, 0.0, ABOUT, self.about)
            for earlier in TOPICS:
                if self._observed.message(earlier) is not None:
                    self._write(self._writer, earlier)
        else:
            self._write(self._writer, topic)

    def _write(self, writer: RecordingWriter, topic: str) -> None:
        """Write the latest message of a topic."""
        observed = self._observed
        time = monotonic() - self._begin
        segment = re.match(r'segment_(\d+)/pressure', topic)
        if topic == 'tendon_states' and (pulls := observed.pulls()):
            writer.write('tendons', time, *(1e3 * pull for pull in pulls))
        elif topic == 'tendon_tensions' and (tensions := observed.tensions()):
            writer.write('tensions', time, *tensions)
        elif topic == 'disc_poses':
            for number, pose in enumerate(observed.poses(topic) or (), start=1):
                writer.write('points', time, str(number), *(1e3 * p for p in pose.position),
                                   *pose.orientation)
        elif segment and (pressure := observed.pressure(int(segment[1]))) is not None:
            writer.write('pressures', time, segment[1], pressure * 1e-3)
        elif topic == JAMMING_STATE:
            for number in range(1, observed.segments + 1):
                stiff = observed.stiff(number)
                if stiff is not None and stiff != self._stiff.get(number):
                    self._stiff[number] = stiff
                    writer.write('stiff', time, str(number), str(int(stiff)))
        elif topic == SEQUENCER_STATE:
            progress = observed.progress()
            self.goal_ended = progress is None and 'progress' in self._events
            if progress is not None:
                where = f' segment {progress.segment}' if progress.segment else ''
                text = f'{progress.shape}: {progress.phase}{where}'
                self._event(writer, time, 'progress', text)
        elif topic.endswith('/status'):
            self._event(writer, time, topic.removesuffix('/status'),
                        printable(observed.message(topic).message))

    def _event(self, writer: RecordingWriter, time: float, source: str, text: str) -> None:
        if self._events.get(source) != text:
            self._events[source] = text
            writer.write('events', time, source, text)


async def _begin(requests: Requests, directory: Path) -> Recorder:
    return Recorder(directory, requests.observed, requests.node.get_namespace())


async def _record(requests: Requests, recorder: Recorder, duration: float, goal: bool) -> None:
    """Record for ``duration`` s, or until a goal has ended; raises ClientError without nodes."""
    try:
        begun = await until(lambda: recorder.recording or recorder.ending,
                            min(duration, DISCOVERY_TIMEOUT))
        if not begun and any(requests.observed.running().values()):  # on a busy machine
            begun = await until(lambda: recorder.recording or recorder.ending,
                                min(duration, BUSY_TIMEOUT) - DISCOVERY_TIMEOUT)
        if not begun:
            raise requests.not_found('the tendons', NODES, DISCOVERY_TIMEOUT)
        await until(lambda: recorder.ending or (goal and recorder.goal_ended), duration)
    finally:
        recorder.close()
    if recorder.failure is not None:
        raise recorder.failure


async def _description(requests: Requests, recorder: Recorder) -> dict[str, Any]:
    """Return the parameters of the arm that is recorded; none of an arm without kinematics."""
    observed = requests.observed
    await until(lambda: observed.running()[KINEMATICS] or recorder.ending, inf)
    if recorder.ending:
        return {}
    listed = await requests.call(ListParameters, f'{KINEMATICS}/list_parameters',
                                 prefixes=['arm'])
    return await requests.parameters(KINEMATICS, listed.result.names)


def record(directory: Path, *, namespace: str = '', duration: float = inf,
           goal: bool = False) -> int:
    """
    Record until the time is over, a goal has ended, or Ctrl-C; return the exit status.

    directory: where the files are written.  duration: s.  goal: whether the end of the goal that
    runs, or begins next, is the end.
    """
    begin = monotonic()
    connection: Connection | None = None
    try:
        connection = Connection('recorder', namespace)
        requests = connection.requests
        recorder = requests.start(_begin(requests, directory)).result()

        def interrupt(number: int, _: Any) -> None:
            # An exception would be lost in a callback, such as those of an import.
            recorder.interrupted = True
            signal.signal(number, signal.SIG_DFL)

        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, interrupt)
        recording = requests.start(_record(requests, recorder, duration, goal))
        with suppress(ClientError):  # the rest is worth recording without it
            if values := requests.start(_description(requests, recorder)).result():
                # Imports the model, which must not keep the thread of ROS from recording.
                from soft_continuum.parameters.files import write_parameters
                write_parameters(directory / DESCRIPTION, values, [recorder.about])
        recording.result()
    except ClientError as error:
        print(f'record: {error}', file=sys.stderr)
        return 1
    except OSError as error:
        print(f'record: cannot write to {directory} any more: {error.strerror}; what was recorded '
              f'in {monotonic() - begin:.1f} s is kept', file=sys.stderr)
        return 1
    finally:
        if connection is not None:
            connection.close()
    print(f'{monotonic() - begin:.1f} s recorded in {directory}')
    return 0
