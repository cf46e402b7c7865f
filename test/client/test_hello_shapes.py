# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The scripts that talk to a running arm run as they stand."""

from pathlib import Path
import runpy
import subprocess
import sys

from matplotlib.image import imread
from PIL import Image

EXAMPLES = Path(__file__).parents[2] / 'examples'
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
