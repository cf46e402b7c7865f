# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The scripts that talk to a running arm run as they stand."""

from pathlib import Path
import subprocess
import sys

from matplotlib.image import imread
from PIL import Image

ANIMATION = Path(__file__).parents[2] / 'examples' / 'animate_a_run.py'
RATES = {'tendon_rate': 20.0, 'jamming_rate': 20.0}  # Hz: that leave time for the script
EXAMPLE = Path(__file__).parents[2] / 'examples' / 'hello_shapes.py'


def test_the_example_runs_on_an_arm_that_is_there(make_rig, here, tmp_path):
    make_rig(namespace='/').start_arm(**RATES)
    ran = subprocess.run([sys.executable, EXAMPLE], cwd=tmp_path, capture_output=True, text=True,
                         timeout=110)
    assert ran.stderr == ''
    assert ran.returncode == 0
    assert [line.split()[0] for line in ran.stdout.splitlines() if 'reached' in line] == [
        'c_form', 'upright_c_form', 's_form']
    assert imread(tmp_path / 'straight.png').std() > 0.05  # something is drawn


def test_the_animation_shows_the_run(make_rig, here, tmp_path):
    make_rig(namespace='/').start_arm(**RATES, shape_names=['c_form', 's_form'])
    ran = subprocess.run([sys.executable, ANIMATION], cwd=tmp_path, capture_output=True,
                         text=True, timeout=110)
    assert (ran.returncode, ran.stderr) == (0, '')
    with Image.open(tmp_path / 'run.gif') as picture:
        assert picture.n_frames > 10


def test_the_example_has_ten_lines():
    body = EXAMPLE.read_text(encoding='utf-8').split('"""')[2]
    assert len([line for line in body.splitlines() if line.strip()]) <= 10
