# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings: what is written is read again, whatever the arm's tendons are called."""

import numpy as np
import pytest

from soft_continuum.analysis.delimited import MeasurementError
from soft_continuum.analysis.recording import FILES, read_recording, RecordingWriter
from soft_continuum.analysis.report import report_html

THREE = ('front', 'rear_left', 'rear_right')
TILTED = (0.0, np.sin(0.3), 0.0, np.cos(0.3))  # 0.6 rad about +y


def write(directory, tendons=THREE):
    """Write a run that holds one shape."""
    with RecordingWriter(directory, tendons) as writer:
        for time in (1.0, 2.0):
            writer.write('tendons', time, *range(1, len(tendons) + 1))
            writer.write('tensions', time, *[float('nan')] * len(tendons))
            for point in range(1, 5):
                writer.write('points', time, str(point), 1.5, 0.25, 10.0 * point, *TILTED)
            writer.write('pressures', time, '1', 20.0)
            writer.write('stiff', time, '1', '1')
        writer.write('events', 1.9, 'progress', 'lean: holding')


def test_any_number_of_tendons_is_recorded_under_their_names(tmp_path):
    write(tmp_path)
    recording = read_recording(tmp_path)
    assert recording.tendon_names == THREE
    assert recording.tendons.tolist() == [[1.0, 1.0, 2.0, 3.0], [2.0, 1.0, 2.0, 3.0]]
    assert sorted(FILES) == sorted(path.name for path in tmp_path.iterdir())
    page = report_html(recording, 'three tendons')
    assert all(f'{name} pull, mm' in page for name in THREE)


def test_held_points_are_full_poses(tmp_path):
    write(tmp_path)
    held, = read_recording(tmp_path).held_shapes()
    assert held.points[:, :3].tolist() == [[1.5, 0.25, 10.0 * n] for n in range(1, 5)]
    assert held.points[0, 3:] == pytest.approx(TILTED, abs=1e-6)
    assert held.tangents == pytest.approx([np.degrees(0.6)] * 4, abs=1e-4)
    assert held.pulls.tolist() == [1.0, 2.0, 3.0]


def test_a_row_of_the_wrong_length_is_not_written(tmp_path):
    with (RecordingWriter(tmp_path, THREE) as writer,
          pytest.raises(ValueError, match=r'tendons\.csv has 3 columns after the time; given: 2')):
        writer.write('tendons', 0.0, 1.0, 2.0)


def test_recordings_of_version_0_1_are_still_read(tmp_path):
    write(tmp_path, ('right', 'left'))
    (tmp_path / 'points.csv').write_text(
        'time [s],point,x [mm],z [mm],tangent [deg]\n1.5,1,3.0,40.0,-30.0\n')
    recording = read_recording(tmp_path)
    assert recording.tendon_names == ('right', 'left')
    held, = recording.held_shapes()
    assert held.points[0, :3].tolist() == [3.0, 0.0, 40.0]
    assert held.tangents == pytest.approx([-30.0])


def test_files_of_different_tendons_do_not_make_a_recording(tmp_path):
    write(tmp_path)
    (tmp_path / 'tensions.csv').write_text('time [s],front tension [N]\n')
    with pytest.raises(MeasurementError, match=r'tensions\.csv: line 1 has the tendons front'):
        read_recording(tmp_path)
