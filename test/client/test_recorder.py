# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""A run is recorded by a process of its own, and turned into a page."""

from collections.abc import Iterator
from pathlib import Path
import resource
import signal
import subprocess
import sys

import numpy as np
import pytest
from ros_rig import Rig

from soft_continuum.analysis.recording import DESCRIPTION, read_recording
from soft_continuum.cli.report import main as report
from soft_continuum.nodes.up import description_file
from soft_continuum.parameters.files import load_arm


class RecordProcess:
    """The command record, of the rig."""

    def __init__(self, rig: Rig, directory: Path, *options: str) -> None:
        self.directory = directory
        self._rig = rig
        self.process = subprocess.Popen(
            [sys.executable, '-m', 'soft_continuum', 'record', '--output', str(directory),
             '--namespace', rig.namespace, *options],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def wait_until_it_records(self) -> None:
        def recorded() -> bool:
            assert self.process.poll() is None, self.process.communicate()
            return all((self.directory / f'{name}.csv').exists() and len(
                (self.directory / f'{name}.csv').read_text().splitlines()) > 3
                for name in ('tendons', 'points', 'pressures', 'stiff'))
        self._rig.wait_for(recorded, 'a recording')
        # The rig's own action client is one.
        self._rig.wait_for(lambda: self._rig.observer.count_subscribers(
            'run_shape_sequence/_action/feedback') >= 2, 'feedback')

    def end(self) -> tuple[int, str, str]:
        out, err = self.process.communicate(timeout=30)
        return self.process.returncode, out, err


@pytest.fixture
def recorder(arm: Rig, here: None, tmp_path: Path) -> Iterator[RecordProcess]:
    found = RecordProcess(arm, tmp_path / 'run', '--goal')
    found.wait_until_it_records()
    yield found
    found.process.kill()
    found.process.wait()


def test_a_goal_is_recorded_to_its_end_and_reported(
        arm: Rig, recorder: RecordProcess, capsys: pytest.CaptureFixture[str]) -> None:
    assert arm.goal('s_form', hold=0.5).result()[0] == 'SUCCEEDED'
    status, out, err = recorder.end()
    assert (status, err) == (0, '')
    assert 's recorded in' in out
    held, = read_recording(recorder.directory).held_shapes()
    assert held.shape == 's_form'
    ends = [(p.position.x, p.position.z) for p in arm.segment_poses.last.poses]
    assert held.points[2::2, [0, 2]] == pytest.approx(np.array(ends) * 1e3, abs=0.1)
    assert held.pulls == pytest.approx(np.array(arm.pulls) * 1e3, abs=0.01)
    assert load_arm(recorder.directory / DESCRIPTION) == load_arm(description_file())
    assert report([str(recorder.directory)]) == 0
    page = (recorder.directory / 'report.html').read_text('utf-8')
    assert 'arm in namespace /arm_under_test' in page
    assert page.count('data:image/png') == 2
    assert 's_form: moving segment 2' in page
    assert 'http' not in page  # it needs nothing else
    assert report([str(recorder.directory)]) == 2  # no overwriting
    assert '--force' in capsys.readouterr().err


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_what_was_recorded_before_it_was_ended_is_kept(
        recorder: RecordProcess, number: signal.Signals) -> None:
    recorder.process.send_signal(number)
    status, _, err = recorder.end()
    assert status == (-signal.SIGKILL if number == signal.SIGKILL else 0)
    assert 'Traceback' not in err
    assert len(read_recording(recorder.directory).tendons) > 2


def test_a_disk_that_is_full_ends_it_and_keeps_what_there_is(recorder: RecordProcess) -> None:
    sizes = [path.stat().st_size for path in recorder.directory.glob('*.csv')]
    resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (max(sizes), max(sizes)))
    status, _, err = recorder.end()
    assert status == 1
    assert err.startswith(f'record: cannot write to {recorder.directory} any more: ')
    assert len(err.splitlines()) == 1
    assert len(read_recording(recorder.directory).tendons) > 2


def test_without_nodes_it_says_how_to_start_them(rig: Rig, here: None, tmp_path: Path) -> None:
    status, _, err = RecordProcess(rig, tmp_path).end()
    assert status == 1
    assert './run up' in err


@pytest.mark.parametrize(('name', 'text', 'words'), [
    ('tendons', 'time [s],right pull [mm],left pull [mm]\n1.0,2.0,nothing\n2.0,1.0,1.0\n',
     'line 2'),
    ('tendons', 'a,b,c\n', 'line 1 must be'),
    ('events', 'time [s],source,event\n1.0,a\n2.0,a,b\n', 'line 2 has 2 fields'),
    ('points', None, 'record'),
])
def test_a_damaged_recording_is_named_by_file_and_line(
        tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, text: str | None,
        words: str) -> None:
    from soft_continuum.analysis.recording import RecordingWriter

    with RecordingWriter(tmp_path, ('right_tendon', 'left_tendon')):
        pass
    path = tmp_path / f'{name}.csv'
    path.unlink() if text is None else path.write_text(text)
    assert report([str(tmp_path), '--output', str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert f'{name}.csv' in said
    assert words in said
