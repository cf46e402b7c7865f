# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A run is recorded by a process of its own, and turned into a page and tables."""

from collections import Counter
from itertools import groupby
from pathlib import Path
import resource
import signal
import subprocess
import sys

from geometry_msgs.msg import PoseArray
from mcap.reader import make_reader
import numpy as np
import pytest
from sensor_msgs.msg import Image, JointState
from std_srvs.srv import SetBool
import yaml

from soft_continuum.client import Arm
from soft_continuum.lab.recordings.bag import (
    BAG,
    BagReader,
    DefinitionError,
    DESCRIPTION,
    message_class,
)
from soft_continuum.lab.recordings.playback import Playback
from soft_continuum.lab.recordings.report import main as report
from soft_continuum.lab.recordings.tables import export, read_recording
from soft_continuum.ros.description import load_arm
from soft_continuum.ros.entries import EVERY_STATE, LATCHED
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import RecorderState
from support.ros_rig import assert_declined, DEADLINE

TOPICS = ('tendon_states', 'disc_poses', 'segment_1/pressure', 'jamming_valves/state',
          'shape_sequencer/state', 'kinematics/state', 'tendon_actuation/status')


class RecordProcess:
    """The command record, of the rig."""

    def __init__(self, rig, directory, *options):
        self.directory, self.file = directory, directory / BAG
        self._rig, self._size = rig, 1000
        self.process = subprocess.Popen(
            [sys.executable, '-m', 'soft_continuum', 'record', '--output', str(directory),
             '--namespace', rig.namespace, *options],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def seen(self):
        """Return how many messages of each topic, without the namespace, are on the disk."""
        with BagReader(self.file) as bag:
            return Counter(message.topic.name.removeprefix(f'{self._rig.namespace}/')
                           for message in bag.messages())

    def wait_until_it_records(self):
        def recorded():
            assert self.process.poll() is None, self.process.communicate()
            size = self.file.stat().st_size if self.file.exists() else 0
            if size <= self._size:  # nothing new to read
                return False
            self._size, seen = size, self.seen()
            return set(TOPICS) <= set(seen) and seen['tendon_states'] > 2
        self._rig.wait_for(recorded, 'a recording')

    def end(self):
        out, err = self.process.communicate(timeout=DEADLINE)
        return self.process.returncode, out, err


@pytest.fixture
def recorder(arm, here, tmp_path):
    found = RecordProcess(arm, tmp_path / 'run', '--goal')
    found.wait_until_it_records()
    yield found
    found.process.kill()
    found.process.wait()


def test_a_goal_is_recorded_to_its_end_reported_and_played(arm, recorder):
    assert arm.goal('c_form', 's_form').result()[0] == 'SUCCEEDED'
    status, out, err = recorder.end()
    assert (status, err) == (0, '')
    assert f's recorded in {recorder.file}: ' in out
    recording = read_recording(recorder.directory)
    assert [text for _, source, text in recording.events if source == 'shape_sequencer'] == [
        'idle', 'running c_form', 'running s_form', 'idle']
    first, held = recording.held_shapes()
    assert (first.shape, held.shape) == ('c_form', 's_form')
    ends = [(p.position.x, p.position.z) for p in arm.segment_poses.last.poses]
    assert held.points[2::2, [0, 2]] == pytest.approx(np.array(ends) * 1e3, abs=0.1)
    assert held.pulls == pytest.approx(np.array(arm.pulls) * 1e3, abs=0.01)
    assert report([str(recorder.directory)]) == 0
    page = (recorder.directory / 'report.html').read_text('utf-8')
    assert 'arm in namespace /arm_under_test' in page
    assert page.count('data:image/png') == 2
    assert 's_form: moving segment 2' in page
    assert 'arm.segment_lengths</td>' in page
    assert 'http' not in page  # it needs nothing else
    assert export([str(recorder.directory)]) == 0
    assert load_arm(recorder.directory / DESCRIPTION) == load_arm(description_file())
    # Other tools find what they need: every definition, the QoS, the parameters of the nodes.
    with recorder.file.open('rb') as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None
    assert not summary.statistics.channel_message_counts.keys() ^ summary.channels.keys()
    latched = {c.topic for c in summary.channels.values() if yaml.safe_load(
        c.metadata['offered_qos_profiles'])[0]['durability'] == 'transient_local'}
    assert f'{arm.namespace}/jamming_valves/state' in latched
    assert f'{arm.namespace}/tendon_states' not in latched
    with BagReader(recorder.file) as bag:
        for message in bag.messages():
            bag.decoded(message)
    values = yaml.safe_load(bag.attachments['parameters.yaml'])
    assert values['tendon_actuation']['ros__parameters']['tendon_driver'] == 'simulated'
    assert_played_as_recorded(arm, recorder.file)


def assert_played_as_recorded(arm, file):
    """Claim that a playback publishes what was recorded, and has the description of the arm."""
    with Playback(file) as playback, Arm(playback.namespace, timeout=DEADLINE) as player:
        arm.wait_for(lambda: player.state.pulls, 'the begin of the recording')
        assert player.state.pulls == (0.0, 0.0)
        assert player.description == load_arm(description_file())
        heard = []
        arm.on_ros_thread(lambda: arm.observer.create_subscription(
            JointState, f'{playback.namespace}/tendon_states', heard.append, 1000, raw=True))
        arm.wait_for(lambda: len(heard) > 1, 'what stands still to be repeated')
        playback.play(True)
        arm.wait_for(lambda: playback.position > 1.0, 'the first second')
        playback.play(False)
        with BagReader(file) as bag:
            recorded = [message.data for message in bag.messages()
                        if message.topic.name.endswith('/tendon_states')]
        arm.wait_for(lambda: not playback.playing, 'a pause')
        # While it stands still it repeats the last one, which need not be the first.
        played = [message for message, _ in groupby(heard)]
        begin = played.index(recorded[1])
        assert played[begin:begin + 5] == recorded[1:6]
        assert set(heard) <= set(recorded)
        playback.seek(1e9)
        arm.wait_for(lambda: player.state.pulls == pytest.approx(arm.pulls), 'its end')
        end = pytest.approx(arm.disc_poses.last.poses[-1].position.x)
        arm.wait_for(lambda: player.state.tip.x == end, 'the last pose, which comes after it')
        for wrong in (float('nan'), -float('inf')):
            playback.seek(wrong)
        arm.wait_for(lambda: playback.position == playback.duration, 'no other time')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_what_was_recorded_before_it_was_ended_is_kept(recorder, number):
    recorder.process.send_signal(number)
    status, _, err = recorder.end()
    killed = number == signal.SIGKILL
    assert status == (-signal.SIGKILL if killed else 0)
    assert 'Traceback' not in err
    recording = read_recording(recorder.directory)
    assert len(recording.tendons) > 2
    assert bool(recording.damage) == killed


def test_a_disk_that_is_full_ends_it_and_keeps_what_there_is(recorder):
    size = recorder.file.stat().st_size + 1000
    resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (size, size))
    status, _, err = recorder.end()
    assert status == 1
    assert err.startswith(f'record: can no longer write to {recorder.file}: ')
    assert len(err.splitlines()) == 1
    assert len(read_recording(recorder.directory).tendons) > 2


@pytest.fixture
def ask(arm, tmp_path):
    """Start the node; return a call of its service."""
    node, = arm.start('recorder', ready=False, recorder__directory=str(tmp_path))
    yield lambda data: arm.call(SetBool, 'recorder/record', data=data)
    arm.end(node)  # the next test has one of its own


def test_a_service_begins_and_ends_files(arm, ask, tmp_path):
    states = arm.record(RecorderState, 'recorder/state', EVERY_STATE)
    left_out = {arm.observer.create_publisher(kind, name, LATCHED): kind() for kind, name in (
        (Image, 'camera/image_raw'), (PoseArray, 'twin/disc_poses'))}
    kept = arm.observer.create_publisher(PoseArray, 'other/disc_poses', LATCHED)
    for publisher, message in (*left_out.items(), (kept, PoseArray())):
        publisher.publish(message)
    arm.wait_for(lambda: states and not states.last.recording, 'its state')
    began = ask(True)
    assert began.success
    file = Path(began.message.removeprefix('recording into '))
    assert file.parent == tmp_path
    assert 'already' in ask(True).message
    arm.wait_for(lambda: states.last.recording and states.last.messages > 100, 'messages')
    ended = ask(False)
    assert ended.success and str(file) in ended.message
    assert len(read_recording(file).tendons) > 2
    assert ask(False).message == 'nothing is being recorded'
    arm.wait_for(lambda: not states.last.recording, 'its end')
    assert states.last.file == str(file) and states.last.lost == 0
    with BagReader(file) as bag:
        seen = {message.topic.name for message in bag.messages()}
    # Pictures when they are asked for only; the truth of the twin never.
    assert kept.topic_name in seen
    assert not {publisher.topic_name for publisher in left_out} & seen
    assert ask(True).success  # again
    assert ask(False).success
    assert len(list(tmp_path.glob('*.mcap'))) == 2


def test_a_type_of_the_network_is_never_imported_as_a_program(tmp_path, monkeypatch):
    (tmp_path / 'evil').mkdir()
    (tmp_path / 'evil' / '__init__.py').write_text('raise SystemExit(1)')
    monkeypatch.syspath_prepend(tmp_path)
    for kind in ('evil/msg/A', '../evil/msg/A', 'evil', 'std_msgs/srv/String', 'os/msg/A'):
        with pytest.raises(DefinitionError):
            message_class(kind)
    assert message_class('std_msgs/msg/String').__name__ == 'String'


def test_without_force_nothing_is_overwritten_and_with_it_not_before_there_are_nodes(
        call, tmp_path):
    before, record = tmp_path / BAG, ('record', '--output', str(tmp_path), '--duration', '0.2')
    before.write_text('precious')
    assert call(*record, timeout=None)[0] == 2
    status, _, err = call(*record, '--force', timeout=None)
    assert status == 3 and './run up' in err
    assert before.read_text() == 'precious'


def test_a_node_that_cannot_write_says_so_and_goes_on(arm, tmp_path):
    file = tmp_path / 'file'
    file.touch()
    arm.start('recorder', ready=False, recorder__directory=str(file / 'below'))
    assert_declined(arm.call(SetBool, 'recorder/record', data=True), 'change recorder.directory')
    assert not arm.call(SetBool, 'recorder/record', data=True).success
