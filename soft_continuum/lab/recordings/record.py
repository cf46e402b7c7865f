# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``record``: records all topics of a running arm to an MCAP file."""

import argparse
from collections.abc import Sequence
from math import inf
from pathlib import Path
import signal
import sys
from time import monotonic
from typing import Any, TYPE_CHECKING

from soft_continuum.lab.analysis.verbs import reserve_outputs, run_verb
from soft_continuum.lab.recordings.bag import BAG
from soft_continuum.parameters.arguments import DONE, FAILED, number_in, Parser
from soft_continuum.ros.names import NODES

if TYPE_CHECKING:
    from soft_continuum.client.requests import Requests
    from soft_continuum.lab.recordings.recorder import TopicRecorder

DISCOVERY_TIMEOUT = 5.0  # s
AFTER_GOAL = 0.5  # s, in which the last state and poses of a goal arrive


class TimedRecording:
    """
    A recording that ends when it is interrupted, after a time, or with a goal.

    topics: None before it begins.
    """

    def __init__(self, requests: 'Requests', path: Path, pictures: bool, goal: bool) -> None:
        """Write nothing yet."""
        self.interrupted = False
        self.topics: TopicRecorder | None = None
        self._requests, self._path, self._pictures = requests, path, pictures
        self._goal, self._runs = goal, False

    def _ended(self) -> bool:
        if self._goal and (state := self._requests.observed.shape_sequencer) is not None:
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
        from soft_continuum.client.tasks import until
        from soft_continuum.lab.recordings import recorder
        requests, node = self._requests, self._requests.node
        if not await until(lambda: node.count_publishers('tendon_states') or self._ended(),
                           min(duration, DISCOVERY_TIMEOUT)):
            raise requests.not_found('the tendons', NODES, DISCOVERY_TIMEOUT)
        if self._ended():
            return
        self._path.unlink(missing_ok=True)  # that it may be overwritten was asked before
        self.topics = topics = recorder.TopicRecorder(
            node, self._path, recorder.about(node), pictures=self._pictures)
        try:
            attaching = requests.start(recorder.attach_parameters(requests, topics))
            if await until(self._ended, duration) and not self.interrupted:
                await until(lambda: self.interrupted, AFTER_GOAL)
            await recorder.end_recording(topics, attaching, requests)
        finally:
            topics.close()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    parser = Parser('record', f'Record to {BAG} everything that a running arm publishes, until '
                    'Ctrl-C. It can be read with report, export and replay, and with ros2 bag, '
                    'Foxglove and PlotJuggler.', '--namespace', '--output', '--force')
    parser.add_argument('--duration', type=number_in(0.1, 1e6, 's'), metavar='S', default=inf,
                        help='stop after this many seconds')
    parser.add_argument('--goal', action='store_true',
                        help='stop when the running goal, or the next one, has ended')
    parser.add_argument('--pictures', action='store_true',
                        help='also record camera images: tens of MB per second')
    parser.set_defaults(output=Path('recording'))
    return run_verb(parser, _run, argv, 'mcap')


def _run(options: argparse.Namespace) -> int:
    """Record until the time is over, a goal has ended, or Ctrl-C; return the exit status."""
    path, = reserve_outputs(options.output, [BAG], options.force)
    from soft_continuum.client.connection import Connection
    begin = monotonic()
    connection = Connection('record', options.namespace)
    try:
        recording = TimedRecording(connection.requests, path, options.pictures, options.goal)

        def interrupt(number: int, _: Any) -> None:
            # An exception would be lost in a callback, such as those of an import.
            recording.interrupted = True
            signal.signal(number, signal.SIG_DFL)

        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, interrupt)
        connection.requests.start(recording.run(options.duration)).result()
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
