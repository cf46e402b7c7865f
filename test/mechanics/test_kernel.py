# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled solver: built once, away from the process that solves."""

from dataclasses import replace
import importlib.util
import os
from pathlib import Path
import shutil
import subprocess
import sys

import numpy as np
import pytest

from soft_continuum.mechanics import _compile, _kernel, RIGHT, SLACK, solve_batch, Statics
from soft_continuum.mechanics.batch import solve_batch as spatial_batch
from soft_continuum.mechanics.laws import Jam
from soft_continuum.mechanics.sensitivity import Linearisation
from soft_continuum.mechanics.space.sensitivity import SpaceLinearisation
from soft_continuum.mechanics.space.statics import SpaceStatics
from support import paper_arm as paper
from support.flat_arm import made_of

HERE = Path(__file__).parent


def journey():
    """Return what the solver finds on a way with slack, both tendons, a fall and locked ones."""
    found = []

    def keep(state):
        found.append(state)
        return state

    statics = Statics(paper.build(bodies_per_segment=6))
    straight = statics.chain.straight()
    state = keep(statics.bend(straight, 0, paper.ANGLE))
    state = keep(statics.solve(state, (state.pulls[RIGHT] + 0.005, SLACK), paper.only(1)))
    state = keep(statics.bend(state, 2, -paper.ANGLE))
    state = keep(statics.solve(
        state, (state.pulls[RIGHT] - 0.004, state.pulls[1] - 0.002), paper.only(2)))
    keep(statics.solve(straight, (SLACK, SLACK), (True, True, True)))
    upside_down = Statics(paper.build(bodies_per_segment=3, mounting_angle=3.0))
    keep(upside_down.solve(upside_down.chain.straight(), (0.015, -0.016), (True, True, False)))
    return found


def in_a_process(script, cache, *arguments, **environment):
    """Return what a script prints in an interpreter that keeps what it compiles in ``cache``."""
    path = [str(HERE.parents[1]), str(HERE.parent), os.environ.get('PYTHONPATH', '')]
    done = subprocess.run(
        [sys.executable, '-c', script, *arguments], capture_output=True, text=True, check=False,
        cwd=HERE, env={**os.environ, 'PYTHONPATH': os.pathsep.join(path),
                       'XDG_CACHE_HOME': str(cache), **environment})
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_plain_python_and_compiled_code_agree_to_rounding(monkeypatch):
    if _kernel.functions().runs_in == 'python':
        pytest.skip('numba is not installed')
    compiled = journey()
    monkeypatch.setattr(_kernel, 'functions', lambda: _kernel.SOURCE)
    plain = journey()
    for one, other in zip(plain, compiled, strict=True):
        assert one.jumped == other.jumped
        assert one.joint_angles == pytest.approx(other.joint_angles, abs=1e-12)
        assert one.pulls == pytest.approx(other.pulls, abs=1e-12)
        assert one.tensions == pytest.approx(other.tensions, rel=1e-12, abs=1e-10)
    assert plain[1].tensions[RIGHT] == 0.0  # segment 2 sags, as in the paper
    assert any(state.jumped for state in plain)


SOLVE = """
import sys
from support import paper_arm as paper
from soft_continuum.mechanics import _kernel, SLACK, Statics
hanging = Statics(paper.build(bodies_per_segment=2, mounting_angle=3.0))
hanging.solve(hanging.chain.straight(), (0.015, -0.016), (True, True, False))
print(_kernel.functions().runs_in, *({'numba', 'scipy'} & set(sys.modules)))
"""


def test_who_solves_loads_nothing_that_takes_seconds():
    if importlib.util.find_spec('numba') is None or shutil.which('c++') is None:
        pytest.skip('the solver cannot be built here')
    assert in_a_process(SOLVE, _kernel.user_cache().parents[1]).split() == ['extension']


def test_without_numba_the_source_runs_as_it_is(tmp_path):
    absent = "import sys\nsys.modules['numba'] = None  # its import fails\n"
    assert in_a_process(absent + SOLVE, tmp_path).split()[0] == 'python'


def test_without_a_compiler_numba_does_it_in_the_process_and_why_is_said(tmp_path):
    pytest.importorskip('numba')
    script = """
import numpy as np
from soft_continuum.mechanics import _kernel, _linear_algebra
found = _kernel.functions()
matrix, right_side = np.array([[2.0, 0.0], [0.0, 4.0]]), np.ones(2)
assert _linear_algebra.small_solve(matrix, right_side, 2)
print(found.runs_in, right_side, _kernel.why_not_built())
"""
    printed = in_a_process(script, tmp_path, PATH='')
    assert printed.startswith('numba [0.5  0.25] there is no C++ compiler')
    assert 'install' in printed
    assert any(path.suffix == '.nbc' for path in tmp_path.rglob('*'))  # kept for the next start


def test_a_build_that_fails_is_not_tried_again_and_leaves_its_reason(tmp_path, monkeypatch):
    pytest.importorskip('numba')
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    monkeypatch.setattr(_kernel, 'HERE', tmp_path)
    monkeypatch.setattr(_kernel, 'BUILD', 'raise RuntimeError("of the compiler")')
    monkeypatch.setattr(_kernel, 'jit', lambda _: dict.fromkeys(_kernel.SOURCE[:-1], max))
    assert _kernel.must_build()
    assert _kernel.functions.__wrapped__().runs_in == 'numba'
    assert not _kernel.must_build()
    assert 'RuntimeError: of the compiler' in _kernel.why_not_built()
    assert str(tmp_path) in _kernel.why_not_built()


@pytest.fixture
def nothing_built(tmp_path, monkeypatch):
    """Return an empty cache of the user; numba is not asked for anything."""
    pytest.importorskip('numba')
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    monkeypatch.setattr(_kernel, 'HERE', tmp_path)
    monkeypatch.setattr(_kernel, 'jit', lambda _: dict.fromkeys(_kernel.SOURCE[:-1], max))
    return _kernel.user_cache()


def test_a_build_that_may_do_another_time_is_tried_again(nothing_built, monkeypatch):
    monkeypatch.setattr(_kernel, 'BUILD', f'import sys; sys.exit({_kernel.PASSING})')
    assert _kernel.functions.__wrapped__().runs_in == 'numba'
    assert _kernel.must_build()


def test_a_damaged_extension_is_built_anew(nothing_built, monkeypatch):
    built = next(iter(_kernel._built()), None)
    assert built is None
    good = (Path.home() / '.cache' / 'soft_continuum' / _kernel._digest() / _kernel._file_name())
    if not good.exists():
        pytest.skip('the solver was not built')
    nothing_built.mkdir(parents=True)
    (nothing_built / _kernel._file_name()).touch()  # as after a loss of power
    monkeypatch.setattr(_kernel, 'BUILD', 'import shutil, sys; shutil.copy('
                        f'{str(good)!r}, sys.argv[2])')
    assert _kernel.functions.__wrapped__().runs_in == 'extension'


def test_a_cache_that_others_can_write_to_is_not_believed(nothing_built, tmp_path):
    nothing_built.mkdir(parents=True)
    nothing_built.parent.chmod(0o777)
    assert _kernel.user_cache() is None
    assert 'yours alone' in _kernel.why_not_built()
    assert _kernel.functions.__wrapped__().runs_in == 'numba'


def test_a_cache_that_cannot_be_written_costs_time_only(tmp_path, monkeypatch):
    pytest.importorskip('numba')
    file = tmp_path / 'file'
    file.touch()
    monkeypatch.setenv('XDG_CACHE_HOME', str(file))
    monkeypatch.setattr(_kernel, 'HERE', tmp_path)
    given = []

    def jit(directory):
        given.append(directory)
        return dict.fromkeys(_kernel.SOURCE[:-1], max)

    monkeypatch.setattr(_kernel, 'jit', jit)
    assert _kernel.functions.__wrapped__().runs_in == 'numba'
    assert given == [None]


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
    monkeypatch.setattr(_compile, 'MARKED', {})
    monkeypatch.setattr(sys.modules[__name__], 'total', total)  # undone at the end
    function = _compile.borrowing(total)
    made = _compile.jit()[function]
    assert ('_nrt' in made.targetoptions) == known
    assert made(np.arange(4.0)) == 6.0


def fits(value, kind):
    """Return whether an argument is what the extension, which does not check, takes it for."""
    types = pytest.importorskip('numba').types
    if isinstance(kind, types.BaseTuple):
        return len(value) == len(kind) and all(map(fits, value, kind))
    if isinstance(kind, types.Array):
        return (value.dtype == np.dtype(str(kind.dtype)) and value.ndim == kind.ndim
                and (kind.layout != 'C' or value.flags.c_contiguous))
    return isinstance(value, int if isinstance(kind, types.Integer) else float | int)


def test_the_extension_is_given_arrays_of_the_types_that_it_is_built_for(monkeypatch):
    sigutils = pytest.importorskip('numba.core.sigutils')
    wrong, called = [], set()

    def checked(name, function):
        kinds, _ = sigutils.normalize_signature(_kernel.SIGNATURES[name])

        def call(*arguments):
            called.add(name)
            if len(arguments) != len(kinds) or not all(map(fits, arguments, kinds)):
                wrong.append((name, arguments))
            return function(*arguments)
        return call

    real = _kernel.functions()
    watched = real._replace(**{name: checked(name, getattr(real, name))
                               for name in _kernel.SIGNATURES})
    monkeypatch.setattr(_kernel, 'functions', lambda: watched)
    states = journey()
    arm = paper.build(bodies_per_segment=2, tendon=made_of(friction=0.2))
    jammed = Statics(replace(arm, segments=tuple(
        replace(segment, jam=Jam(ratio=50.0)) for segment in arm.segments)))
    straight = jammed.chain.straight()
    # Whole numbers and lists, as people write them.
    state = jammed.solve(straight, [0, 0], [1, 1, 1], sliding=[1, 0])
    state = jammed.bend(state, 1, 0.2, sliding=(1, -1))
    Linearisation(jammed, state, (1, -1)).pulls()
    hanging = Statics(paper.build(bodies_per_segment=2, mounting_angle=np.pi))
    solve_batch(hanging, hanging.chain.straight(), np.array([[0, 0], [0.001, -1]]).T, [1, 0, 0])
    solve_batch(jammed, straight, np.array([[0, 0], [0.001, -1]]).T, [1, 0, 0], sliding=[0, 0])
    solve_batch(hanging, hanging.chain.straight(), [0, 0.001], [1, 0, 0])
    solid = SpaceStatics(paper.build(bodies_per_segment=2, mounting_angle=np.pi))
    bent = solid.solve(solid.chain.straight(), [0, -1], [1, 1, 0], tensions=[np.nan, 0])
    bent = solid.solve(bent, bent.pulls - 0.001, (False, True, False))
    SpaceLinearisation(solid, bent).stiffness_factors()
    spatial_batch(solid, bent, [[0, -1], [0.001, SLACK]], (False, True, False))
    assert len(states) == 6 and called == set(_kernel.SIGNATURES)
    assert not wrong
