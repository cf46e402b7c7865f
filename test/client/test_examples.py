# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The examples run as they stand, anywhere."""

import json
from pathlib import Path
import runpy
import subprocess
import sys

from matplotlib import pyplot
from matplotlib.image import imread
from PIL import Image

EXAMPLES = Path(__file__).parents[2] / 'examples'


def test_the_mechanics_example_solves_prints_and_draws(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / 'solve_a_shape.py'), run_name='__main__')
    output, errors = capfd.readouterr()
    assert output.startswith('pulls (right, left): [')
    assert errors == ''
    assert imread(tmp_path / 'c_form.png').std() > 0.05  # something is drawn


def test_every_cell_of_the_notebook_runs_and_says_what_the_notebook_says(monkeypatch, capsys):
    monkeypatch.chdir(EXAMPLES)
    cells = json.loads((EXAMPLES / 'statics.ipynb').read_text(encoding='utf-8'))['cells']
    names = {}
    printed = []
    pyplot.close('all')  # those of other tests
    for cell in cells:
        if cell['cell_type'] == 'code':
            exec(''.join(cell['source']), names)
            printed += [line for out in cell['outputs'] for line in out.get('text', ())]
            assert len(pyplot.get_fignums()) == any('data' in out for out in cell['outputs'])
            pyplot.close('all')
    assert capsys.readouterr().out == ''.join(printed)


HELLO = EXAMPLES / 'hello_shapes.py'


def test_the_examples_run_on_an_arm_that_is_there(make_rig, here, tmp_path, monkeypatch, capsys):
    make_rig(namespace='/').start_arm(
        tendon_rate=20.0, jamming_rate=20.0, angle_step=0.1, tendon_speed=0.05,
        shape_names=['c_form', 's_form'])
    ran = subprocess.run([sys.executable, HELLO], cwd=tmp_path, capture_output=True, text=True,
                         timeout=110)
    assert ran.stderr == ''
    assert ran.returncode == 0
    assert [line.split()[0] for line in ran.stdout.splitlines() if 'reached' in line] == [
        'c_form', 's_form']
    assert imread(tmp_path / 'straight.png').std() > 0.05  # something is drawn
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / 'animate_a_run.py'))
    assert capsys.readouterr().err == ''
    with Image.open(tmp_path / 'run.gif') as picture:
        assert picture.n_frames > 10


def test_the_example_has_ten_lines():
    body = HELLO.read_text(encoding='utf-8').split('"""')[2]
    assert len([line for line in body.splitlines() if line.strip()]) <= 10
