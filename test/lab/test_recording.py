# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings: what is written is read again, whatever the arm's tendons are called."""

import re

import numpy as np
import pytest

from soft_continuum.lab.analysis import report
from soft_continuum.lab.analysis.delimited import MeasurementError
from soft_continuum.lab.analysis.recording import FILES, read_tables, Recording, write_tables
from soft_continuum.lab.analysis.report import main as report_verb
from soft_continuum.lab.analysis.report import report_html
from soft_continuum.ros.description import load_description

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


def write(directory, tendons=THREE):
    """Write its tables."""
    write_tables(run(tendons), [directory / name for name in FILES])


def test_any_number_of_tendons_is_recorded_under_their_names_and_points_are_full_poses(tmp_path):
    write(tmp_path)
    recording = read_tables(tmp_path)
    assert recording.tendon_names == THREE
    assert recording.tendons.tolist() == [[1.0, 1.0, 2.0, 3.0], [2.0, 1.0, 2.0, 3.0]]
    assert sorted(FILES) == sorted(path.name for path in tmp_path.iterdir())
    held, = recording.held_shapes()
    assert held.points[:, :3].tolist() == [[1.5, 0.25, 10.0 * n] for n in range(1, 5)]
    assert held.points[0, 3:] == pytest.approx(TILTED, abs=1e-6)
    assert held.tangents == pytest.approx([np.degrees(0.6)] * 4, abs=1e-4)
    assert held.pulls.tolist() == [1.0, 2.0, 3.0]


def test_recordings_of_version_0_1_are_still_read(tmp_path):
    write(tmp_path, ('right', 'left'))
    (tmp_path / 'points.csv').write_text(
        'time [s],point,x [mm],z [mm],tangent [deg]\n1.5,1,3.0,40.0,-30.0\n')
    recording = read_tables(tmp_path)
    assert recording.tendon_names == ('right', 'left')
    held, = recording.held_shapes()
    assert held.points[0, :3].tolist() == [3.0, 0.0, 40.0]
    assert held.tangents == pytest.approx([-30.0])


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


def test_more_lines_than_a_recording_can_have_are_refused(tmp_path, monkeypatch):
    write(tmp_path)
    monkeypatch.setattr('soft_continuum.lab.analysis.recording.MAX_ROWS', 2)
    with pytest.raises(MeasurementError, match='more than 2 lines'):
        read_tables(tmp_path)


@pytest.mark.parametrize(('name', 'text', 'words'), [
    ('tendons', 'time [s],right pull [mm],left pull [mm]\n1.0,2.0,nothing\n2.0,1.0,1.0\n',
     'line 2'),
    ('tendons', 'a,b,c\n', 'line 1 must be'),
    ('events', 'time [s],source,event\n1.0,a\n2.0,a,b\n', 'line 2 has 2 fields'),
    ('points', None, 'record'),
    ('tensions', 'time [s],front tension [N]\n', 'line 1 has the tendons front'),
    # Countless wrong lines are refused at the first.
    ('tendons', '\n' * 4_000_000, 'line 1'),
    ('tendons', 'time [s],a,b\n' + '0,0\n' * 2_000_000, 'line 2'),
])
def test_a_damaged_table_is_named_by_file_and_line(tmp_path, capsys, name, text, words):
    write(tmp_path)
    path = tmp_path / f'{name}.csv'
    path.unlink() if text is None else path.write_text(text)
    assert report_verb([str(tmp_path)]) == 2
    assert re.search(rf'{name}\.csv: .*{re.escape(words)}', capsys.readouterr().err)
