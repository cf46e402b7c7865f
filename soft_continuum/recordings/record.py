# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Records a run of an arm in a separate process: the verb ``record``."""

from math import inf
from pathlib import Path
import signal
import sys
from time import monotonic
from typing import Any

from soft_continuum.arguments import DONE, FAILED
from soft_continuum.client.connection import Connection
from soft_continuum.client.observed import SEQUENCER_STATE
from soft_continuum.client.requests import Requests
from soft_continuum.client.tasks import until
from soft_continuum.recordings.topics import (
    about,
    attach_parameters,
    end_recording,
    TopicRecorder,
)
from soft_continuum.ros.names import NODES

DISCOVERY_TIMEOUT = 5.0  # s


class Recording:
    """
    A recording that ends when it is interrupted, after a time, or with a goal.

    topics: None before it begins.
    """

    def __init__(self, requests: Requests, path: Path, pictures: bool, goal: bool) -> None:
        """Write nothing yet."""
        self.interrupted = False
        self.topics: TopicRecorder | None = None
        self._requests, self._path, self._pictures = requests, path, pictures
        self._goal, self._runs = goal, False

    def _ended(self) -> bool:
        if self._goal and (state := self._requests.observed.message(SEQUENCER_STATE)) is not None:
            before, self._runs = self._runs, state.running
            if before and not self._runs:
                return True
        return self.interrupted or bool(self.topics and self.topics.failure)

    async def run(self, duration: float) -> None:
        """
        Record from the first message of the tendons on.

        Raises ClientError without nodes, OSError when the file cannot be begun, BagError without
        the packages.
        """
        requests, node = self._requests, self._requests.node
        if not await until(lambda: node.count_publishers('tendon_states') or self._ended(),
                           min(duration, DISCOVERY_TIMEOUT)):
            raise requests.not_found('the tendons', NODES, DISCOVERY_TIMEOUT)
        if self._ended():
            return
        self._path.unlink(missing_ok=True)  # that it may be overwritten was asked before
        self.topics = topics = TopicRecorder(node, self._path, about(node),
                                             pictures=self._pictures)
        try:
            attaching = requests.start(attach_parameters(requests, topics))
            await until(self._ended, duration)
            await end_recording(topics, attaching, requests)
        finally:
            topics.close()


def record(path: Path, *, namespace: str = '', duration: float = inf, goal: bool = False,
           pictures: bool = False) -> int:
    """
    Record until the time is over, a goal has ended, or Ctrl-C; return the exit status.

    path: of the file, which is overwritten.  duration: s.  goal: whether to end with the running
    or the next goal.  pictures: whether to record camera images too.  Raises as Recording.run.
    """
    begin = monotonic()
    connection = Connection('record', namespace)
    try:
        recording = Recording(connection.requests, path, pictures, goal)

        def interrupt(number: int, _: Any) -> None:
            # An exception would be lost in a callback, such as those of an import.
            recording.interrupted = True
            signal.signal(number, signal.SIG_DFL)

        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, interrupt)
        connection.requests.start(recording.run(duration)).result()
    finally:
        connection.close()
    topics, seconds, problem = recording.topics, monotonic() - begin, ''
    if topics is None:
        problem = 'nothing was recorded'
    elif topics.failure:
        problem = (f'can no longer write to {path}: {topics.failure}; the first {seconds:.1f} s '
                   'are kept')
    else:
        print(f'{seconds:.1f} s recorded in {path}: {topics.counts.total()} messages of '
              f'{len(topics.counts)} topics')
        if topics.lost:
            problem = f'{topics.lost} messages were lost: too large, or the disk was too slow'
    if problem:
        print(f'record: {problem}', file=sys.stderr)
    return FAILED if problem else DONE
