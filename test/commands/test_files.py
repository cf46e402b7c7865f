# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Files that nobody should give to a verb are answered in one line, before they cost anything."""

import os
from pathlib import Path
import re

import pytest

from soft_continuum.lab.analysis import characterisation as characterize
from soft_continuum.lab.analysis import identification as identify
from soft_continuum.lab.analysis import validation as validate
from soft_continuum.lab.analysis import workspace
from soft_continuum.lab.recordings import record, report
from soft_continuum.lab.recordings.bag import BAG
from soft_continuum.lab.recordings.tables import export, TABLES
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.description import load_description
from support.bags import other_run

DATA = Path(__file__).resolve().parents[2] / 'data' / 'simulated_specimen'
POINTS, PULLS = (DATA / f'SIMULATED_paper_{kind}.csv' for kind in ('points', 'pulls'))
SEGMENT = ('--segment', '2', '--lever-arm', '0.025')
CURVE = 'displacement [mm],force [N]\n'
SECTION = '/**:\n  ros__parameters:\n'


@pytest.fixture
def refusal(capsys):
    """Return a function that runs a verb that refuses its input: the one line that says why."""
    def call(verb, *words):
        assert getattr(verb, 'main', verb)([str(word) for word in words]) == 2
        output, error = capsys.readouterr()
        assert output == '' and error.count('\n') == 1 and error[:-1].isprintable()
        assert len(error) < 5000
        return error

    return call


@pytest.fixture
def recording(tmp_path):
    """Return a recording."""
    folder = tmp_path / 'recording'
    folder.mkdir()
    other_run(folder / BAG)
    return folder


def special_files(folder):
    """Return paths of what is no file: they have no end, or nobody to write to them."""
    pipe = folder / 'pipe'
    os.mkfifo(pipe)
    return Path('/dev/zero'), pipe, folder


def test_a_device_a_pipe_and_a_directory_are_no_files_to_any_verb(refusal, tmp_path):
    for path in special_files(tmp_path):
        for line in (refusal(characterize, path, *SEGMENT), refusal(validate, path, PULLS),
                     refusal(identify, POINTS, path), refusal(workspace, '--params-file', path)):
            assert f'{path}: cannot be read: ' in line


@pytest.mark.parametrize(('text', 'words'), [
    (SECTION + '    a: &a [1, 1]\n    b: [*a, *a]\n', r'line 4, column 9.*ROS reads no alias'),
    ('#' * 100_001, 'larger than 0.1 MB'),
    (SECTION + '    arm: {gravity: 0x' + 'f' * 9000 + '}\n',
     r"is '0xf+\.\.\. \(9004 characters\); allowed: finite numbers"),
    (SECTION + '    arm: {gravity: [' + 'x, ' * 9000 + ']}\n', 'arm.gravity is .* characters'),
    (SECTION + '    arm: {? ' + 'k' * 90000 + ' : 1}\n', 'unknown parameter arm.kkk'),
    (SECTION + '    arm: {"gra\\evity\\n": 1}\n', r'unknown parameter arm\.gra\\x1bvity\\n'),
    (SECTION + '    arm: {segment_lengths: [' + '0.1, ' * 101 + ']}\n', 'allowed: up to 100'),
])
def test_a_description_that_would_take_minutes_is_refused_by_its_size(tmp_path, text, words):
    path = tmp_path / 'rig.yaml'
    path.write_text(text, encoding='utf-8')
    with pytest.raises(ParameterError, match=words) as refused:
        load_description(path)
    assert len(str(refused.value)) < 5000


@pytest.mark.parametrize(('text', 'words'), [
    (CURVE + '1.0,2.0\n' * 100_000, 'has 100001 lines; at most 100000 are read'),
    ('\n' * 10_000_001, 'larger than 10 MB'),
    (f'displacement [mm],force{" " * 120_000}x\n1,2\n', 'no column for force'),
    ('force [N],' * 100_000, 'neither this line'),
    ('neither,nor\n' * 20_000, 'neither this line'),
    (CURVE + ''.join(f'{k % 20},{k % 20}\n' for k in range(2000)), 'at most 50 of 100000'),
    ('\x1b]0,owned\x07,force [N]\n1,2\n', r'\\x1b\]0.*owned\\x07'),
])
def test_a_measurement_that_would_take_minutes_is_refused_by_its_size(
        refusal, tmp_path, text, words):
    path = tmp_path / 'curve.csv'
    path.write_text(text, encoding='utf-8')
    line = refusal(characterize, path, *SEGMENT)
    assert re.search(words, line)


def test_a_link_that_leads_nowhere_is_not_written_through(refusal, recording, tmp_path):
    target = tmp_path / 'target'
    out = tmp_path / 'out'
    out.mkdir()
    for verb, words, names in (
            (workspace, (), ['workspace.png']), (report, (recording,), ['report.html']),
            (validate, (POINTS, PULLS), ['validate.png', 'validate.csv']),
            (record, (), [BAG]),
            (export, (recording,), [*(f'{name}.csv' for name in TABLES), 'description.yaml'])):
        for name in names:
            link = out / name
            link.symlink_to(target)
            assert f'{link} exists; add --force' in refusal(verb, *words, '--output', out)
            link.unlink()
    assert not target.exists()
