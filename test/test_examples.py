# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The examples run as they stand, anywhere."""

import json
from pathlib import Path
import runpy

from matplotlib import pyplot
from matplotlib.image import imread

EXAMPLES = Path(__file__).parents[1] / 'examples'


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
