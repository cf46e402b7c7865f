# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Recipes of CONTRIBUTING.md, followed on a copy of the suite: what they touch is enough."""

import json
import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parent.parent


class Copy:
    """A copy of the suite that is changed."""

    def __init__(self, root):
        self.root, self.touched = root, set()
        for name in ('soft_continuum', 'config', 'docs', 'msg_docs'):
            shutil.copytree(ROOT / name, root / name,
                            ignore=shutil.ignore_patterns('__pycache__', 'images'))

    def add(self, name, line, below=None):
        """Write a file of the suite, or add a line below another one."""
        path = self.root / 'soft_continuum' / name
        if below is None:
            path.write_text(line, encoding='utf-8')
            return
        text = path.read_text(encoding='utf-8')
        assert text.count(below) == 1
        path.write_text(text.replace(below, below + line), encoding='utf-8')
        self.touched.add(name)

    def run(self, *arguments):
        """Run Python on the copy and return how it ended."""
        paths = os.pathsep.join([str(self.root), os.environ.get('PYTHONPATH', '')])
        return subprocess.run([sys.executable, *arguments], cwd=self.root, capture_output=True,
                              text=True, env={**os.environ, 'PYTHONPATH': paths})

    def page(self, name):
        """Return a page after the tables were written."""
        done = self.run('-m', 'soft_continuum.cli.reference')
        assert done.returncode == 0, done.stderr
        return (self.root / name).read_text(encoding='utf-8')


@pytest.fixture
def suite(tmp_path):
    return Copy(tmp_path)


def test_a_parameter_is_one_entry_and_then_checked_and_described(suite):
    suite.add('nodes/parameter_table.py',
              "        Parameter('pose_interval', 0.0, 'shortest time between two poses', 0.0, "
              "10.0,\n                  unit='s'),\n", below='    KINEMATICS: (\n')
    (suite.root / 'given.yaml').write_text(
        'kinematics: {ros__parameters: {pose_interval: 11.0}}', encoding='utf-8')
    done = suite.run('-c', 'from soft_continuum.parameters.files import load_description\n'
                     'print(load_description(node="kinematics")["pose_interval"])\n'
                     'load_description("given.yaml", node="kinematics")')
    assert done.stdout == '0.0\n'
    assert 'pose_interval' in done.stderr and '10' in done.stderr.splitlines()[-1]
    assert '| `pose_interval` | double `0.0` s | 0 to 10 | shortest time' in suite.page(
        'msg_docs/kinematics.md')
    assert suite.touched == {'nodes/parameter_table.py'}


def test_a_planner_is_a_module_a_row_with_the_shapes_that_it_suits_and_its_settings(suite):
    suite.add('sequencing/staying.py', """
import numpy as np

from soft_continuum.sequencing.plans import Reach


def stay(validator, start, shape, first):
    away = float(np.linalg.norm(start.state.tip - shape.tips[0].position))
    return Reach(start.plan(shape), tip_error=away)
""")
    suite.add('sequencing/shape_plans.py',
              'from soft_continuum.sequencing.staying import stay\n',
              below='from soft_continuum.sequencing.reach.passage import BlockedError, Node\n')
    suite.add('sequencing/shape_plans.py',
              '    (stay, lambda shape, settings: bool(shape.tips) and settings.stay),\n',
              below='Callable[[Shape, ReachSettings], bool]], ...] = (\n')
    suite.add('sequencing/settings.py',
              "    stay: bool = setting(False, 'stay where the arm is', read_only=False)\n",
              below='    lock_in: float = LOCK_IN_STDDEV\n')
    (suite.root / 'given.yaml').write_text(
        '/**: {ros__parameters: {reach.stay: true}}', encoding='utf-8')
    plan = ['-m', 'soft_continuum', 'plan', '0.1', '0.28', '--json']
    steps = [json.loads(suite.run(*plan, *more).stdout)['steps']
             for more in ([], ['--params-file', 'given.yaml'])]
    assert steps[0] and not steps[1]
    assert '| `reach.stay` * | bool `false` |' in suite.page('msg_docs/shape_sequencer.md')
    assert suite.touched == {'sequencing/shape_plans.py', 'sequencing/settings.py'}


def test_a_verb_is_one_line_and_the_module_with_its_function(suite):
    suite.add('cli/wave.py', 'def main():\n    print("a wave")\n    return 0\n')
    suite.add('cli/registry.py', "        Verb('wave', 'wave at the arm', 'cli.wave:main'),\n",
              below="    'start': (\n")
    done = suite.run('-m', 'soft_continuum', 'wave')
    assert (done.stdout, done.returncode) == ('a wave\n', 0)
    assert 'wave at the arm' in suite.run('-m', 'soft_continuum', '--help').stdout
    assert '| `wave` | wave at the arm |' in suite.page('docs/reference/command_line.md')
    assert suite.touched == {'cli/registry.py'}
