# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The recorder node: a service begins and ends recordings of all topics of an arm."""

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from time import strftime
from typing import Any

from std_srvs.srv import SetBool

from soft_continuum.client.requests import Requests
from soft_continuum.lab.recordings.bag import BagError
from soft_continuum.lab.recordings.topics import (
    about,
    attach_parameters,
    end_recording,
    TopicRecorder,
)
from soft_continuum.nodes.suite_node import ERROR, OK, StatePublisher, SuiteNode, WARN
from soft_continuum.ros.entries import repeat, serve_later
from soft_continuum.ros.names import RECORDER
from soft_continuum_interfaces.msg import RecorderState

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
