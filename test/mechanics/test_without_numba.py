# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Without numba the same source runs as plain Python, with the same result."""

import json
import os
from pathlib import Path
import subprocess
import sys

import numpy as np
import paper_arm as paper
import pytest

from soft_continuum.mechanics import _compile, LEFT, RIGHT, SLACK, Statics

HERE = Path(__file__).parent

BLOCKED = """
import sys
sys.modules['numba'] = None  # from here on, importing numba fails
from soft_continuum.mechanics import _newton
print(type(_newton.newton).__name__)
"""

SCRIPT = """
import json
import sys
if 'without' in sys.argv:
    sys.modules['numba'] = None  # from here on, importing numba fails
sys.path.insert(0, sys.argv[1])
import test_without_numba
print(json.dumps(test_without_numba.journey()))
"""


def journey():
    """Return what the solver finds on a way with slack, both tendons, a fall and locked ones."""
    found = []

    def keep(state):
        found.append({
            'angles': state.joint_angles.tolist(), 'tensions': state.tensions.tolist(),
            'pulls': state.pulls.tolist(), 'jumped': bool(state.jumped)})
        return state

    statics = Statics(paper.build(bodies_per_segment=6))
    straight = statics.chain.straight()
    state = keep(statics.bend(straight, 0, paper.ANGLE))
    state = keep(statics.solve(state, (state.pulls[RIGHT] + 0.005, SLACK), paper.only(1)))
    state = keep(statics.bend(state, 2, -paper.ANGLE))
    state = keep(statics.solve(
        state, (state.pulls[RIGHT] - 0.004, state.pulls[LEFT] - 0.002), paper.only(2)))
    keep(statics.solve(straight, (SLACK, SLACK), (True, True, True)))
    upside_down = Statics(paper.build(bodies_per_segment=3, mounting_angle=3.0))
    keep(upside_down.solve(
        upside_down.chain.straight(), (0.015, -0.016), (True, True, False)))
    return found


def environment():
    """Return the environment of this process with the package on the path."""
    path = [os.environ.get('PYTHONPATH'), str(HERE.parents[1])]
    return {**os.environ, 'PYTHONPATH': os.pathsep.join(p for p in path if p)}


def run(*arguments):
    """Run the journey in an interpreter of its own."""
    done = subprocess.run(
        [sys.executable, '-c', SCRIPT, str(HERE), *arguments],
        capture_output=True, text=True, check=False, env=environment(), cwd=HERE)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope='module')
def plain():
    """Return the journey without numba."""
    return run('without')


def test_plain_python_and_compiled_code_agree_to_rounding(plain):
    pytest.importorskip('numba')
    for plain_state, compiled_state in zip(plain, journey(), strict=True):
        assert plain_state['jumped'] == compiled_state['jumped']
        for quantity in ('angles', 'pulls'):
            assert np.array(plain_state[quantity]) == pytest.approx(
                np.array(compiled_state[quantity]), abs=1e-12)
        assert np.array(plain_state['tensions']) == pytest.approx(
            np.array(compiled_state['tensions']), rel=1e-12, abs=1e-10)


def test_the_journey_meets_slack_tendons_taut_pairs_and_a_fall(plain):
    assert plain[1]['tensions'][RIGHT] == 0.0  # segment 2 sags, as in the paper
    assert any(state['jumped'] for state in plain)


def test_numba_is_really_absent():
    done = subprocess.run(
        [sys.executable, '-c', BLOCKED], capture_output=True, text=True, check=False,
        env=environment(), cwd=HERE)
    assert done.stdout.strip() == 'function', done.stderr


def total(values):
    """Return the sum of an array."""
    result = 0.0
    for value in values:
        result += value
    return result


@pytest.mark.parametrize('known', [True, False])
def test_a_numba_without_the_private_option_for_reference_counts_compiles_as_well(
        known, monkeypatch):
    cpu = pytest.importorskip('numba.core.cpu')
    if not known:
        monkeypatch.setattr(cpu, 'CPUTargetOptions', type('Options', (), {}))
    function = _compile.borrowing(total)
    assert ('_nrt' in function.targetoptions) == known
    assert function(np.arange(4.0)) == 6.0


def test_the_model_counts_as_compiled_when_all_of_it_is(tmp_path, monkeypatch):
    # numba makes the directory when it begins.
    monkeypatch.setattr(_compile, 'COMPILED', True)
    monkeypatch.setattr(_compile, '_CACHE', str(tmp_path))
    monkeypatch.setattr(_compile, '_COMPLETE', str(tmp_path / 'complete'))
    assert not _compile.is_compiled()
    _compile.note_compiled()
    assert _compile.is_compiled()
