# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The examples run as they stand, anywhere."""

from pathlib import Path
import subprocess
import sys

from matplotlib.image import imread

EXAMPLES = Path(__file__).parents[1] / 'examples'


def test_the_mechanics_example_solves_prints_and_draws(tmp_path):
    ran = subprocess.run([sys.executable, EXAMPLES / 'solve_a_shape.py'], cwd=tmp_path,
                         capture_output=True, text=True, timeout=120, check=True)
    assert ran.stdout.startswith('pulls (right, left): [')
    assert ran.stderr == ''
    assert imread(tmp_path / 'c_form.png').std() > 0.05  # something is drawn
