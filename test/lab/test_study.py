# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Studies give the same numbers on one process and many, and lose nothing to a killed one."""

import csv
import io
from math import cos, sin
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

from soft_continuum.lab.study.design import read_study
from soft_continuum.lab.study.running import cluster, compute, Results, run_units, work_units
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ui.cli.main import main

SMALL = """
vary:
  arm.mounting_angle: [0.0, 3.14159265]
  arm.payload: {from: 0.0, to: 0.05, steps: 4}
shapes: 120
"""
THIN = """
vary:
  one:
    - {arm.segment_lengths: [0.1], arm.outer_diameters: [0.05], arm.leaf_thicknesses: [0.0005],
       arm.leaf_widths: [0.0127], arm.segment_masses: [0.0], arm.bending_angle_limits: [1.0],
       arm.disc_heights: [0.02], arm.disc_masses: [0.0], arm.gravity: 0.0,
       arm.discretisation: second_order, arm.bodies_per_segment: 40}
shapes: 50
"""


def study_file(text, name='study.yaml'):
    path = Path(name)
    path.write_text(text, encoding='utf-8')
    return path


@pytest.fixture(scope='module')
def two_workers():
    with cluster(2) as client:
        yield client


def rows_of(results):
    """The units of a study computed here, one after the other."""
    for unit in results.missing():
        results.keep(unit, compute(results.study.designs[unit.design], unit,
                                   results.study.seed)[0])
    return [path.read_bytes() for path in results.join()]


def test_a_killed_worker_loses_nothing_and_the_numbers_are_those_of_one_process(two_workers):
    study = read_study(study_file(SMALL))
    results = Results(Path('killed'), study)
    todo = results.missing()
    assert len(todo) == 8
    for n, _ in enumerate(run_units(two_workers, results, todo)):
        if n == 1:
            os.kill(min(two_workers.run(os.getpid).values()), signal.SIGKILL)
    assert not results.missing()
    assert [path.read_bytes() for path in results.join()] == rows_of(Results(Path('alone'), study))


def test_a_study_goes_on_where_it_was_interrupted():
    study = read_study(study_file(SMALL.replace('120', '20')))
    before = Results(Path('part'), study)
    done = before.missing()[1]
    before.keep(done, compute(study.designs[done.design], done, study.seed)[0])
    Path('part/parts/.half.parquet.1').write_bytes(b'cut')
    again = Results(Path('part'), study)
    assert again.missing() == [unit for unit in work_units(study) if unit != done]
    assert rows_of(again) == rows_of(Results(Path('whole'), study))


def test_an_arm_of_one_thin_segment_reaches_what_an_arc_does():
    """Without gravity one segment is nearly an arc: its tendon is guided at its ends only."""
    results = Results(Path('one'), read_study(study_file(THIN)))
    rows_of(results)
    (_, table), = results.tables()
    assert set(table['outcome'].to_pylist()) == {'held'}
    assert set(table['softenings'].to_pylist()) == {1}
    for bent, x, z in zip(*(table[name].to_pylist() for name in ('bent_1', 'x', 'z')),
                          strict=True):
        radius = 0.1 / bent
        arc = np.array([radius * (1.0 - cos(bent)) + 0.02 * sin(bent),
                        0.02 + radius * sin(bent) + 0.02 * cos(bent)])
        assert np.hypot(*(arc - (x, z))) < 1e-3


def test_a_wall_takes_tips_away_and_plans_lead_around_it():
    study_file('obstacles: [{name: wall, shape: box, size: [0.02, 1.0, 1.0], '
               'position: [0.12, 0.0, 0.5]}]', 'wall.yaml')
    study = read_study(study_file('vary: {arm.payload: [0.0]}\nobstacles: [null, wall.yaml]\n'
                                  'shapes: 150\nqueries: 2'))
    results = Results(Path('walls'), study)
    rows_of(results)
    free, walled = (table for _, table in results.tables())
    assert 'touches' not in free['outcome'].to_pylist()
    held = [row for row in walled.to_pylist() if row['outcome'] == 'held']
    assert 20 < len(held) < 150
    assert max(row['x'] for row in held if row['z'] > 0.0) < 0.11
    for _, asked in results.tables('queries'):
        assert asked['outcome'].to_pylist() == ['found', 'found']
        assert max(asked['tip_error'].to_pylist()) <= 0.002


@pytest.mark.parametrize('text, words', [
    ('', 'has the key vary'),
    ('vary: {}\nshape: 3', 'unknown key shape; did you mean shapes?'),
    ('vary: {arm.mounting_angel: [0.0]}', 'did you mean arm.mounting_angle?'),
    ('vary: {arm.payload: 3}', 'a list of the values'),
    ('vary: {arm.payload: [.nan]}', 'arm.payload is nan'),
    ('vary: {arm.payload: {from: 0, to: [1]}}', 'lists of as many numbers'),
    ('vary: {arm.payload: {times: [2]}}', 'which no factor changes'),
    ('vary: {arm.segment_lengths: [[0.07, 0.07]]}', 'design 1 (segment_lengths 0.07)'),
    ('vary: {arm.payload: {from: 0, to: 1, steps: 90000}, arm.gravity: [1, 2]}', 'sample'),
    ('vary: {arm.payload: [0]}\nshapes: 0', 'shapes is 0'),
    ('vary: {arm.payload: [0]}\ndescription: no.yaml', 'no.yaml'),
    ('vary: {}\nobstacles: [no.yaml]', 'no.yaml: cannot be read'),
    ('vary: {}\nobstacles: wall.yaml', 'a list of files'),
    ('vary: [', 'not valid YAML'),
])
def test_what_is_wrong_with_a_study_is_said(text, words):
    with pytest.raises(ParameterError) as error:
        read_study(study_file(text))
    assert words in str(error.value) and '\n' not in str(error.value)


def test_random_designs_are_drawn_the_same_for_a_seed():
    text = 'vary: {arm.payload: {from: 0, to: 0.2}, arm.gravity: [0.0, 9.8]}\nsample: 5\nseed: 3'
    one, other = (read_study(study_file(text)).designs for _ in range(2))
    assert [d.varied for d in one] == [d.varied for d in other]
    assert len({d.varied['arm.payload'] for d in one}) == 5
    assert read_study(study_file(text.replace('seed: 3', 'seed: 4'))).designs != one


def test_another_study_is_not_mixed_in_and_a_long_one_needs_consent(
        capsys, monkeypatch, two_workers):
    scheduler = ['--scheduler', two_workers.scheduler.address]
    few, more = (SMALL.replace('120', count) for count in ('20', '30'))
    assert main(['study', str(study_file(few)), *scheduler]) == 0
    said = capsys.readouterr()
    assert 'mounting_angle 3.142, payload 0.05' in said.out
    with open('study/designs.csv', encoding='utf-8') as file:
        assert [row['shapes'] for row in csv.DictReader(file)] == ['20'] * 8
    assert main(['study', str(study_file(more)), *scheduler]) == 2
    assert 'another study' in capsys.readouterr().err
    monkeypatch.setattr('soft_continuum.lab.study.summary.ASK_AFTER', 0.0)
    monkeypatch.setattr(sys, 'stdin', io.StringIO())
    long = study_file(SMALL.replace('120', '20').replace('steps: 4', 'steps: 12'), 'long.yaml')
    assert main(['study', str(long), '--output', 'long', *scheduler]) == 1
    assert 'needs --yes' in capsys.readouterr().err


def test_a_scheduler_that_is_not_there_is_named(capsys, monkeypatch):
    monkeypatch.setattr('soft_continuum.lab.study.running.CONNECT_TIMEOUT', 0.5)
    assert main(['study', str(study_file(SMALL)), '--scheduler', 'tcp://127.0.0.1:1']) == 1
    assert 'no scheduler answers at tcp://127.0.0.1:1' in capsys.readouterr().err


def test_an_interrupt_ends_all_processes_and_says_how_to_go_on():
    path = study_file(SMALL.replace('120', '50000'))
    process = subprocess.Popen(
        [sys.executable, '-m', 'soft_continuum', 'study', str(path), '--yes'],
        stderr=subprocess.PIPE, text=True, start_new_session=True)
    watch = threading.Timer(240.0, process.kill)  # of a busy machine, before pytest would
    watch.start()
    assert 'units of work left' in process.stderr.readline()
    os.killpg(process.pid, signal.SIGINT)
    said = process.communicate()[1]
    watch.cancel()
    assert process.returncode == 130
    assert 'run the same command to resume' in said and 'Traceback' not in said
