# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""MCAP files, whole or damaged, ours or of others; their tables and reports."""

import re
import struct

from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer as OtherWriter
import numpy as np
import pytest

from soft_continuum.lab.analysis.delimited import MeasurementError
from soft_continuum.lab.recordings import report
from soft_continuum.lab.recordings.bag import BagError, BagReader, BagWriter, Topic
from soft_continuum.lab.recordings.report import report_html
from soft_continuum.lab.recordings.tables import (
    _fields,
    export,
    read_recording,
    Recording,
    TABLES,
    write_tables,
)
from soft_continuum.ros.description import load_description
from support.bags import JOINTS, other_run

TEXT = Topic('/arm/said', 'std_msgs/msg/String', 'string data\n', '')
ABOUT = {'version': '9.9', 'namespace': '/arm', 'begun': '2026-01-02T03:04:05'}


def string(text):
    """Return a std_msgs/String as CDR."""
    data = text.encode() + b'\0'
    return b'\0\1\0\0' + struct.pack('<I', len(data)) + data


def write(path, count=20, close=True):
    """Write messages, flushed after every fifth."""
    writer = BagWriter(path, ABOUT)
    writer.attach('note.txt', 'hello', 1)
    for n in range(count):
        writer.write(TEXT, 1000 + n, string(f'message {n}'))
        if n % 5 == 4:
            writer.flush()
    if close:
        writer.close()
    return writer


def read(path):
    """Return what was said, and the reader."""
    with BagReader(path) as bag:
        return [bag.decoded(message).data for message in bag.messages()], bag


@pytest.mark.parametrize('given', ['.', 'rosbag2_0.db3'])
@pytest.mark.parametrize('name', ['rosbag2_0.db3', 'rosbag2_0.db3.zstd'])
def test_a_bag_of_sqlite_is_refused_with_the_way_to_convert_it(tmp_path, given, name):
    (tmp_path / 'metadata.yaml').write_text('rosbag2_bagfile_information: {}\n', encoding='utf-8')
    (tmp_path / name).write_bytes(b'SQLite format 3\0')
    with pytest.raises(MeasurementError, match=r'SQLite \(db3\).*ros2 bag convert -i '
                       + re.escape(str(tmp_path)) + ' -o mcap.yaml'):
        read_recording(tmp_path / given)


def test_what_was_written_is_read_also_by_others_and_by_its_index(tmp_path):
    write(tmp_path / 'a.mcap')
    said, bag = read(tmp_path / 'a.mcap')
    assert said == [f'message {n}' for n in range(20)]
    assert (bag.about, bag.attachments, bag.damage) == (ABOUT, {'note.txt': 'hello'}, '')
    with (tmp_path / 'a.mcap').open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary.statistics.message_count == 20
        assert reader.get_header().profile == 'ros2'
        assert [message.data for *_, message in reader.iter_decoded_messages()] == [
            f'message {n}' for n in range(20)]
        assert len(list(reader.iter_messages(starting_at=1015))) == 5


def test_what_was_flushed_is_there_whatever_happens(tmp_path):
    writer = write(tmp_path / 'a.mcap', 12, close=False)
    said, bag = read(tmp_path / 'a.mcap')
    assert said == [f'message {n}' for n in range(10)]
    assert 'its end is missing' in bag.damage
    writer.close()


def test_cut_anywhere_it_gives_what_is_whole(tmp_path):
    write(tmp_path / 'a.mcap')
    whole = (tmp_path / 'a.mcap').read_bytes()
    lengths = []
    for end in range(0, len(whole), 7):
        (tmp_path / 'cut.mcap').write_bytes(whole[:end])
        try:
            said, bag = read(tmp_path / 'cut.mcap')
        except BagError as error:
            assert 'not an MCAP file' in str(error)
            assert not lengths
            continue
        assert bag.damage
        assert said == [f'message {n}' for n in range(len(said))]
        lengths.append(len(said))
    assert lengths == sorted(lengths) and lengths[-1] == 20


@given(st.data())
def test_a_damaged_byte_is_said_or_does_no_harm(tmp_path_factory, data):
    path = tmp_path_factory.mktemp('damaged') / 'a.mcap'
    write(path, 6)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    try:
        with BagReader(path) as bag:
            for message in bag.messages():
                bag.decoded(message)
    except BagError as error:
        assert len(str(error)) < 1000


@pytest.mark.parametrize('content', [b'', b'time,a,b\n', b'\x89MCAP0\r\n', bytes(100_000)])
def test_what_is_no_bag_is_called_so(tmp_path, content, capsys):
    path = tmp_path / 'a.mcap'
    path.write_bytes(content)
    for verb in (report.main, export):
        assert verb([str(path)]) == 2
        said = capsys.readouterr().err
        assert str(path) in said and len(said.splitlines()) == 1


@pytest.mark.parametrize('compression', [CompressionType.ZSTD, CompressionType.LZ4])
def test_a_chunk_that_unpacks_to_far_more_than_it_says_is_not_unpacked(
        tmp_path, monkeypatch, compression):
    monkeypatch.setattr('soft_continuum.lab.recordings.bag.MAX_RECORD', 100_000)
    path = tmp_path / 'a.mcap'
    writer = Writer(str(path), compression=compression)
    writer.start()
    schema = writer.register_schema('a/msg/B', 'ros2msg', b'')
    writer.add_message(writer.register_channel('/a', 'cdr', schema), 1, bytes(1_000_000), 1)
    writer.finish()
    assert path.stat().st_size < 10_000
    with BagReader(path) as bag:
        assert not list(bag.messages())
    assert 'a chunk of more than 0.1 MB' in bag.damage


def bag_of(path, *channels):
    """Write one message through each channel: its topic, type, definition and data."""
    writer = Writer(str(path))
    writer.start()
    for topic, kind, text, data in channels:
        schema = writer.register_schema(kind, 'ros2msg', text.encode())
        writer.add_message(writer.register_channel(topic, 'cdr', schema), 1, data, 1)
    writer.finish()
    return path


def test_a_definition_that_would_fill_the_memory_is_refused(tmp_path):
    text = f'E[4000000000] all\n{"=" * 80}\nMSG: a/E\nuint8[1] one\n'
    path = bag_of(tmp_path / 'a.mcap', ('/a', 'a/msg/B', text, bytes(100)))
    with BagReader(path) as bag:
        message, = bag.messages()
        with pytest.raises(BagError, match='its definition is too large'):
            bag.decoded(message)


def test_two_definitions_of_one_name_are_both_understood(tmp_path):
    data = b'\0\1\0\0' + struct.pack('<dd', 1.0, 2.0)
    path = bag_of(tmp_path / 'a.mcap', ('/old', 'a/msg/B', 'float64 a\nfloat64 b\n', data),
                  ('/new', 'a/msg/B', 'float64 b\nfloat64 a\n', data))
    with BagReader(path) as bag:
        found = {m.topic.name: bag.decoded(m) for m in list(bag.messages())}
    assert (found['/old'].a, found['/old'].b) == (1.0, 2.0)
    assert (found['/new'].a, found['/new'].b) == (2.0, 1.0)


def test_topics_of_other_robots_are_left_alone(tmp_path):
    path = tmp_path / 'other.mcap'
    other_run(path, extra=True)
    recording = read_recording(path)
    assert len(recording.tendons) == 3 and not recording.damage
    assert not recording.events and not len(recording.pressures)


def test_messages_in_another_order_become_tables_in_order_of_time(tmp_path):
    path = tmp_path / 'other.mcap'
    other_run(path, times=(0, 5, 2))
    assert read_recording(path).tendons[:, 0] == pytest.approx([0.0, 2.0, 5.0])


def test_the_description_of_one_arm_is_not_taken_for_another(tmp_path):
    path = tmp_path / 'a.mcap'
    writer = BagWriter(path, {**ABOUT, 'namespace': '/'})
    writer.attach('description.yaml', '/**: {ros__parameters: {arm: {payload: 1.0}}}', 1)
    states = Topic('/left/tendon_states', 'sensor_msgs/msg/JointState', JOINTS)
    empty = b'\0\1\0\0' + bytes(8) + struct.pack('<I', 1) + b'\0' * 4 + struct.pack(
        '<III', 1, 2, 0x62) + bytes(64)
    writer.write(states, 1, empty)
    writer.close()
    assert read_recording(path).description == ''


def test_a_bag_of_another_program_is_reported_and_exported(tmp_path, capsys):
    path = tmp_path / 'other.mcap'
    other_run(path)
    recording = read_recording(path)
    assert recording.tendon_names == ('b', 'a')
    assert recording.tendons == pytest.approx(np.array([[0, 0, 0], [1, 1, -2], [2, 2, -4]]))
    assert report.main([str(path)]) == 0
    assert 'does not contain the parameters' in (tmp_path / 'report.html').read_text()
    assert export([str(path)]) == 0
    assert (tmp_path / 'tendons.csv').read_text().splitlines()[2] == '1.0000,1,-2'
    assert export([str(path)]) == 2
    assert '--force' in capsys.readouterr().err


SEQUENCER = """\
bool running
unique_identifier_msgs/UUID goal_id
uint32 shape_index
string shape
uint32 segment
string phase
int32 error_code
================================================================================
MSG: unique_identifier_msgs/UUID
uint8[16] uuid
"""


@pytest.mark.parametrize(('goal', 'held'), [(7, ['a: moving', 'a: holding']), (0, ['a: moving'])])
def test_a_sequencer_that_was_started_again_has_held_no_shape(tmp_path, goal, held):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as file:
        writer = OtherWriter(file)
        joints = writer.register_msgdef('sensor_msgs/msg/JointState', JOINTS)
        states = writer.register_msgdef(
            'soft_continuum_interfaces/msg/ShapeSequencerState', SEQUENCER)
        writer.write_message('/tendon_states', joints, {
            'header': {'stamp': {'sec': 0, 'nanosec': 0}, 'frame_id': ''}, 'name': ['b', 'a'],
            'position': [0.0, 0.0], 'velocity': [], 'effort': []}, log_time=5)
        for time, (running, one, shape) in enumerate(((True, 7, 'a'), (False, goal, ''))):
            writer.write_message('/shape_sequencer/state', states, {
                'running': running, 'goal_id': {'uuid': [one] * 16}, 'shape_index': 0,
                'shape': shape, 'segment': 0, 'phase': 'moving' * running, 'error_code': 0},
                log_time=10 + time)
        writer.finish()
    assert [text for *_, text in read_recording(path).events] == held


def test_of_two_arms_one_is_chosen(tmp_path):
    path = tmp_path / 'two.mcap'
    other_run(path, ('/left', '/right'))
    with pytest.raises(MeasurementError, match='in the namespaces /left, /right; choose'):
        read_recording(path)
    assert len(read_recording(path, 'right').tendons) == 3
    with pytest.raises(MeasurementError, match='choose one with --namespace'):
        read_recording(path, '/middle')


def test_tables_for_matlab_and_pandas_say_the_same(tmp_path):
    from pyarrow import parquet
    from scipy.io import loadmat
    path = tmp_path / 'other.mcap'
    other_run(path)
    assert export([str(path), '--format', 'mat']) == 0
    assert export([str(path), '--format', 'parquet']) == 0
    pulls = read_recording(path).tendons
    columns = loadmat(tmp_path / 'recording.mat', simplify_cells=True)['tendons']
    assert np.column_stack([columns['time_s'], columns['b_pull_mm'], columns['a_pull_mm']]
                           ) == pytest.approx(pulls)
    table = parquet.read_table(tmp_path / 'tendons.parquet').to_pydict()
    assert list(table) == ['time [s]', 'b pull [mm]', 'a pull [mm]']
    assert np.column_stack(list(table.values())) == pytest.approx(pulls)


def test_every_column_has_a_name_of_its_own_in_matlab():
    found = _fields(['time [s]', 'a b pull', 'a-b pull', 'ä', '1', 'x' * 80 + '1', 'x' * 80 + '2'])
    assert len(set(found)) == 7
    assert all(re.fullmatch('[A-Za-z][A-Za-z0-9_]{0,62}', name) for name in found)


def test_a_folder_of_several_bags_names_one_and_one_of_none_says_so(tmp_path):
    with pytest.raises(MeasurementError, match='no recording in it; give the directory that'):
        read_recording(tmp_path)
    other_run(tmp_path / 'a.mcap')
    assert len(read_recording(tmp_path).tendons) == 3
    other_run(tmp_path / 'b.mcap')
    with pytest.raises(MeasurementError, match=r'2 recordings in it; give one .*b\.mcap'):
        read_recording(tmp_path)


def test_a_recording_that_was_cut_off_is_exported_with_a_warning(tmp_path, capsys):
    path = tmp_path / 'other.mcap'
    other_run(path)
    path.write_bytes(path.read_bytes()[:-20])
    assert export([str(path)]) == 0
    assert 'its end is missing' in capsys.readouterr().err


THREE = ('front', 'rear_left', 'rear_right')
TILTED = (0.0, np.sin(0.3), 0.0, np.cos(0.3))  # 0.6 rad about +y


def run(tendons=THREE):
    """Return a run that holds one shape."""
    times = np.array([[1.0], [2.0]])
    points = [[time, n, 1.5, 0.25, 10.0 * n, *TILTED] for time in (1.0, 2.0) for n in range(1, 5)]
    return Recording(
        tuple(tendons), np.hstack([times, [range(1, len(tendons) + 1)] * 2]),
        np.hstack([times, np.full((2, len(tendons)), np.nan)]), np.array(points),
        np.array([[1.0, 1, 20.0], [2.0, 1, 20.0]]), np.array([[1.0, 1, 1.0], [2.0, 1, 1.0]]),
        [(1.9, 'progress', 'lean: holding')])


def test_any_number_of_tendons_is_recorded_under_their_names_and_points_are_full_poses(tmp_path):
    paths = [tmp_path / f'{name}.csv' for name in TABLES]
    write_tables(run(), paths)
    tendons, _, points, *_ = (path.read_text().splitlines() for path in paths)
    assert tendons[0] == ','.join(('time [s]', *(f'{name} pull [mm]' for name in THREE)))
    assert tendons[1:] == ['1.0000,1,2,3', '2.0000,1,2,3']
    assert points[1] == f'1.0000,1,1.5,0.25,10,0,{np.sin(0.3):.6g},0,{np.cos(0.3):.6g}'
    held, = run().held_shapes()
    assert held.points[:, :3].tolist() == [[1.5, 0.25, 10.0 * n] for n in range(1, 5)]
    assert held.tangents == pytest.approx([np.degrees(0.6)] * 4, abs=1e-4)
    assert held.pulls.tolist() == [1.0, 2.0, 3.0]


def test_a_report_of_hundreds_of_shapes_shows_the_first_and_says_so(monkeypatch):
    monkeypatch.setattr(report, '_image', lambda figure, _: f'{len(figure.axes)} panels')
    found = run()
    found.events.extend((2.0, 'progress', f's{k}: holding') for k in range(1100))
    page = report_html(found, 'many', {})
    assert all(f'{name} pull, mm' in page for name in THREE)
    assert 'The first 200 of 1101 shapes' in page and '12 panels' in page
    assert 'The first 1000 of 1101 events' in page


@pytest.mark.parametrize(('side', 'views'), [(0.0, 1), (30.0, 2)])
def test_a_report_of_an_arm_in_space_shows_it_from_two_sides(monkeypatch, side, views):
    shown = []
    monkeypatch.setattr(report, '_image', lambda figure, _: shown.append(figure) or '')
    found = run()
    found.points[:, 3] = side
    report_html(found, 'one', {})
    assert len(shown[0].axes[0].get_lines()) == views


def test_a_report_says_which_arm_was_recorded_when_and_by_which_version(monkeypatch):
    monkeypatch.setattr(report, '_image', lambda *_: '')
    found = run()
    found.events.append((2.0, 'recording', 'soft_continuum 9.9, namespace /left, 2026-01-02'))
    page = report_html(found, 'one', load_description())
    assert 'soft_continuum 9.9, namespace /left, 2026-01-02' in page
    assert 'arm.segment_lengths</td><td>[0.07, 0.07, 0.07]</td><td>m<' in page
