# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Installed with pip in an empty environment: the mechanics and the analysis, without ROS."""

import json
import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

from soft_continuum import version

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ('bin', 'config', 'data', 'docs', 'launch', 'msg_docs', 'resource', 'soft_continuum')

SOLVE = """
from importlib.util import find_spec
import json
from pathlib import Path
import sys

import numba

from soft_continuum import version
from soft_continuum.lab.analysis.workspace import sample_workspace
from soft_continuum.mechanics import Arm, Disc, Segment, set_shape, Statics, tendon_pair
from soft_continuum.ros.description import load_arm
from soft_continuum.user_files import pages

arm = Arm((Segment.leaf_spring(0.1, 0.01),), (Disc(0.01), Disc(0.01)), tendon_pair(0.02, end=1),
          bodies_per_segment=1)
statics = Statics(arm)
bent = set_shape(statics, [0.3])
paper = load_arm(Path(sys.prefix, 'share/soft_continuum/config/manipulator.yaml'))
print(json.dumps({
    'bending_angle': float(bent.bending_angles[0]),
    'tips': len(sample_workspace(arm, [0], 3).tips),
    'segments': len(paper.segments),
    'version': version(),
    'pages': (pages() / 'docs/how_to/install.md').is_file(),
    'present': [name for name in ('matplotlib', 'rclpy', 'serial', 'viser') if find_spec(name)],
}))
"""


def uv(*arguments):
    command = shutil.which('uv', path=os.pathsep.join((str(Path(sys.executable).parent),
                                                       os.environ.get('PATH', ''))))
    assert command, 'uv is missing; requirements/tools.txt names it'
    return subprocess.run((command, *arguments), capture_output=True, text=True)


@pytest.fixture(scope='module')
def python(tmp_path_factory):
    """Return the Python of an environment in which nothing but the package is installed."""
    folder = tmp_path_factory.mktemp('installation')
    sources = folder / 'sources'  # setuptools builds in place, where colcon has its build/
    for name in SOURCES:
        shutil.copytree(ROOT / name, sources / name, ignore=shutil.ignore_patterns('__pycache__'))
    for name in ('package.xml', 'setup.cfg', 'setup.py'):
        shutil.copy(ROOT / name, sources)
    assert uv('venv', '--python', sys.executable, str(folder / 'empty')).returncode == 0
    python = folder / 'empty' / 'bin' / 'python'
    install = ('pip', 'install', '--python', str(python), str(sources),
               '--constraint', str(ROOT / 'requirements' / 'lock.txt'),
               '--build-constraint', str(ROOT / 'requirements' / 'lock.txt'))
    done = uv(*install, '--offline')  # ./run has left all of it in the cache
    if done.returncode:
        done = uv(*install)
    assert done.returncode == 0, done.stderr
    return python


def test_an_installed_package_solves_and_analyses_without_ros(python):
    # -I: nothing of this environment.  Compiling takes longer than all the rest.
    done = subprocess.run((python, '-I', '-c', SOLVE), capture_output=True, text=True,
                          env={**os.environ, 'NUMBA_DISABLE_JIT': '1'})
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result['bending_angle'] == pytest.approx(0.3, abs=1e-6)
    assert result['tips'] == 3
    assert result['segments'] == 3
    assert result['present'] == []
    assert result['version'] == version()
    assert result['pages']
