# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A client that records a run of the arm: the command ``record``."""

from math import inf
from pathlib import Path
import re
import signal
import sys
from time import monotonic

from soft_continuum.analysis.recording import RecordingWriter
from soft_continuum.client.connection import Connection
from soft_continuum.client.errors import ClientError
from soft_continuum.client.observed import JAMMING_STATE, ObservedArm, SEQUENCER_STATE, TOPICS
from soft_continuum.client.requests import Requests
from soft_continuum.client.tasks import until
from soft_continuum.ros.names import NODES

DISCOVERY_TIMEOUT = 5.0  # s


class Recorder:
    """Writes every message of an observed arm into a recording; asks for nothing."""

    def __init__(self, directory: Path, observed: ObservedArm) -> None:
        """Begin as soon as the tendons of the arm are known; ``directory`` exists."""
        self.goal_ended = False
        self._directory = directory
        self._closed = False
        self._observed = observed
        self._writer: RecordingWriter | None = None
        self._begin = monotonic()
        self._events: dict[str, str] = {}  # the last of each source
        self._stiff: dict[int, bool] = {}
        observed.on_change(self._on_message)

    @property
    def recording(self) -> bool:
        """Whether something has been written."""
        return self._writer is not None

    def close(self) -> None:
        """Close the files; what comes later is not recorded."""
        self._closed = True
        if self._writer is not None:
            self._writer.__exit__(None, None, None)

    def _on_message(self, topic: str) -> None:
        if self._closed or not self._observed.tendons:
            return
        if self._writer is None:
            self._writer = RecordingWriter(self._directory, self._observed.tendons)
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
                        observed.message(topic).message)

    def _event(self, writer: RecordingWriter, time: float, source: str, text: str) -> None:
        if self._events.get(source) != text:
            self._events[source] = text
            writer.write('events', time, source, text)


async def _record(requests: Requests, directory: Path, duration: float, goal: bool) -> None:
    """Record for ``duration`` s, or until a goal has ended; raises ClientError without nodes."""
    recorder = Recorder(directory, requests.observed)
    try:
        if not await until(lambda: recorder.recording, min(duration, DISCOVERY_TIMEOUT)):
            raise requests.not_found('the tendons', NODES, DISCOVERY_TIMEOUT)
        await until(lambda: goal and recorder.goal_ended, duration)
    finally:
        recorder.close()


def record(directory: Path, *, namespace: str = '', duration: float = inf,
           goal: bool = False) -> int:
    """
    Record until the time is over, a goal has ended, or Ctrl-C; return the exit status.

    directory: where the files are written.  duration: s.  goal: whether the end of the goal that
    runs, or begins next, is the end.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    begin = monotonic()
    connection: Connection | None = None
    try:
        connection = Connection('recorder', namespace)
        requests = connection.requests
        requests.start(_record(requests, directory, duration, goal)).result()
    except ClientError as error:
        print(f'record: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        pass
    finally:
        if connection is not None:
            connection.close()
    print(f'{monotonic() - begin:.1f} s recorded in {directory}')
    return 0
