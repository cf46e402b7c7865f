# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings: tables and reports, whatever the arm's tendons are called."""

import numpy as np
import pytest

from soft_continuum.lab.analysis import report
from soft_continuum.lab.analysis.recording import Recording, TABLES, write_tables
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
