# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""`soft_continuum plan` prints and draws how the tip would get somewhere; no node runs."""

import json
from math import radians
from pathlib import Path

from matplotlib.image import imread
import pytest

from soft_continuum.lab.analysis.delimited import MeasurementError
from soft_continuum.ui.cli.goals import read_tip_path
from soft_continuum.ui.cli.plan import main

OBSTACLES = """
unit: mm
obstacles:
  - {name: post, shape: sphere, radius: 20, position: [-120, 0, 330]}
"""


@pytest.fixture
def plan(capsys, tmp_path, monkeypatch):
    """Return a function that plans: exit status, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    Path('around.yaml').write_text(OBSTACLES)

    def run(*words):
        try:
            status = main([*words, '--states', '2000'])  # few, for less time
        except SystemExit as ended:
            status = ended.code
        return status, *capsys.readouterr()

    return run


def test_the_steps_are_printed_and_drawn(plan):
    status, output, _ = plan(
        '150', '220', '--unit', 'mm', '--obstacles', 'around.yaml', '-o', 'plan.png')
    assert status == 0
    rows = output.splitlines()
    assert rows[0].split() == ['step', 'segment', 'bending', 'angles,', 'degrees', 'time', 's',
                               'tension', 'N', 'clearance', 'mm', 'tip', 'x,', 'y,', 'z', 'mm']
    assert len(rows) == 2 + 2 + 1 and '(post)' in rows[2]
    assert rows[-1].startswith('2 softenings') and rows[-1].endswith('mm from its goal')
    assert imread('plan.png').shape[1] > imread('plan.png').shape[0]
    status, _, errors = plan('150', '220', '--unit', 'mm', '-o', 'plan.png')
    assert (status, errors.count('\n')) == (2, 1) and '--force' in errors


def test_a_plan_in_json_is_in_si_units(plan):
    status, output, _ = plan('0.15', '0.22', '--json', '--from', '10,0,0')
    document = json.loads(output)
    assert status == 0 and document['found']
    last = document['steps'][-1]
    x, _, z = last['tip']
    assert ((x - 0.15)**2 + (z - 0.22)**2)**0.5 <= 1e-3
    assert last['clearance'] is None and 0.0 < last['tension'] < 60.0


def test_a_plan_moves(plan, monkeypatch):
    monkeypatch.setattr('soft_continuum.ui.cli.plan.FRAMES', 3)
    monkeypatch.setattr('soft_continuum.ui.cli.plan.REST', 1)
    assert plan('150', '220', '--unit', 'mm', '-o', 'plan.gif')[0] == 0
    assert Path('plan.gif').read_bytes().startswith(b'GIF8')


@pytest.mark.parametrize(('words', 'status', 'reason'), [
    (('450', '220', '--unit', 'mm'), 1, 'out of reach: the nearest tip found is 206.9 mm'),
    (('150', '220'), 2, 'x is 150 m; allowed: up to 10 m; in mm? add --unit mm'),
    (('0.15',), 2, '1 number given; needed: x and z, or x, y and z'),
    (('0.15', 'nan'), 2, "'nan' given; needed: x and z"),
    ((), 2, 'give a position, such as 150 220 --unit mm, or --path FILE'),
    (('0.15', '0.01', '0.22'), 2, 'y = 0.01 m; a planar arm moves at y = 0'),
    (('0.15', '0.22', '--direction', '0,0,0'), 2, 'three numbers x,y,z that are not all 0'),
    (('0.15', '0.22', '--angle', '9', '--direction', '0,0,1'), 2, 'give --angle or --direction'),
    (('0.15', '0.22', '--from', '90,0,0'), 2, 'allowed: -1.047 to 1.047 rad'),
    (('0.15', '0.22', '-o', 'plan.doc'), 2, '.png, .svg, .pdf, .gif'),
    (('0.15', '0.22', '-o', 'nowhere/plan.png'), 2, 'the directory does not exist'),
    (('-0.12', '0.33', '--obstacles', 'around.yaml'), 1, 'in post'),
    (('0.15', '0.22', '--obstacles', 'nothing.yaml'), 2, 'nothing.yaml: cannot be read'),
    (('--path', 'nothing.csv'), 2, 'nothing.csv: cannot be read'),
])
def test_what_cannot_be_planned_is_one_line(plan, words, status, reason):
    ended, _, errors = plan(*words)
    assert (ended, errors.count('\n')) == (status, 1), errors
    assert reason in errors


def test_a_path_is_read_with_units_of_its_header_or_of_the_option(tmp_path):
    path = tmp_path / 'path.csv'
    path.write_text('x [mm],z [mm],angle\n150,220,90\n140,250,80\n')
    first, last = read_tip_path(path, 'cm', 0.003)
    assert last.position == pytest.approx((0.14, 0.25))
    assert (first.angle, last.tolerance) == (pytest.approx(radians(90.0)), 0.003)
    path.write_text('x,z\n150,220\n')
    with pytest.raises(MeasurementError, match='x of point 1 is 150 m; allowed: up to 10 m'):
        read_tip_path(path)
    path.write_text('x,y,z\n15,1,22\n')
    only, = read_tip_path(path, 'cm')
    assert only.place == pytest.approx((0.15, 0.01, 0.22)) and only.angle is None
