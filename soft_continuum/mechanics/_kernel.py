# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The compiled functions, for the rest of the mechanics: ``_kernel.functions().newton(...)``.

numba makes an extension module of them once, in a process of its own, and everything that solves
loads that: numba itself takes more than a second and 70 MB.  Where no extension can be built (no
C++ compiler) numba compiles in the process and keeps that on disk; without numba the source runs
as it is, slower, with the same result.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import cache
import hashlib
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec, module_from_spec, spec_from_file_location
import os
from pathlib import Path
import shutil
import stat
import subprocess
import sys
import sysconfig
import tempfile
from typing import Any, NamedTuple
import warnings

import numpy as np

from soft_continuum.mechanics._compile import Function, jit, MARKED
from soft_continuum.mechanics.plane import _assembly, _lanes, _newton
from soft_continuum.mechanics.space import _assembly as _spatial_assembly
from soft_continuum.mechanics.space import _path

# An extension does not check the strides of arrays that it is given.  What users may have made can
# have any; what the solver lays out for itself is contiguous, which is faster.
VECTOR, MATRIX, TENSOR, INDICES = 'f8[:]', 'f8[:, :]', 'f8[:, :, :]', 'i8[:]'
LIST, TABLE, BLOCKS, NUMBERS = 'f8[::1]', 'f8[:, ::1]', 'f8[:, :, ::1]', 'i8[::1]'
STATE = f'UniTuple({LIST}, 3)'
SYSTEM = f'Tuple(({TABLE}, {TABLE}, {BLOCKS}, {TABLE}, {TABLE}, {NUMBERS}))'
DRIVE = f'Tuple(({NUMBERS}, {LIST}, {LIST}, {NUMBERS}))'
LINKS = (f'Tuple(({BLOCKS}, {BLOCKS}, {BLOCKS}, {TABLE}, {NUMBERS}, {TABLE}, i8[:, ::1], '
         f'{TABLE}, {BLOCKS}, {LIST}))')
ROUTING = f'Tuple(({MATRIX}, {INDICES}, {INDICES}, {INDICES}, {MATRIX}))'
BATCH = (
    f'void(Tuple(({TABLE}, {TABLE}, {TABLE})), '
    f'Tuple(({BLOCKS}, {BLOCKS}, {BLOCKS}, {BLOCKS}, {TABLE}, i8[:, ::1])), {NUMBERS}, '
    f'Tuple(({NUMBERS}, {TABLE}, {TABLE}, {NUMBERS})), {TABLE}, '
    f'{NUMBERS}, {LIST}, {LIST}, {NUMBERS}, i8, i8)')
SIGNATURES = {
    'newton': f'Tuple((i8, i8, f8, f8))({STATE}, {SYSTEM}, {DRIVE}, {LIST}, f8, {LIST})',
    'equilibrium':
        f'Tuple((i8, i8, f8, f8))(UniTuple({VECTOR}, 2), {SYSTEM}, {DRIVE}, Tuple((i8, f8)), b1, '
        f'{LIST}, UniTuple({LIST}, 4))',
    'newton_batch': BATCH,
    'newton_lanes': BATCH,
    'moment_balance': f'f8[::1]({VECTOR}, {VECTOR}, {SYSTEM}, i8)',
    'dense_system':
        f'Tuple((f8[:, ::1], f8[:, ::1], f8[:, ::1]))({VECTOR}, {VECTOR}, {SYSTEM}, i8)',
    'spatial_lay_out':
        'Tuple((f8[:, :, ::1], f8[:, :, ::1], f8[:, ::1], i8[::1], f8[:, ::1], i8[:, ::1], '
        'f8[:, ::1], i8[::1], f8[::1]))'
        f'({TENSOR}, {INDICES}, {VECTOR}, {MATRIX}, {MATRIX}, '
        f'{ROUTING}, i8)',
    'spatial_follow':
        f'Tuple((f8, i8, f8, b1))(Tuple(({TENSOR}, {VECTOR}, {VECTOR})), '
        f'Tuple(({VECTOR}, {MATRIX}, {MATRIX}, {ROUTING}, {VECTOR}, {VECTOR})), '
        f'Tuple(({INDICES}, {BLOCKS}, {BLOCKS}, {LIST})), '
        f'Tuple((f8[:, :, :, ::1], {TABLE}, b1[:, ::1], {BLOCKS})), '
        f'Tuple(({NUMBERS}, {LIST}, {TABLE}, {BLOCKS}, f8)), b1, b1)',
    'spatial_follow_batch':
        f'void(Tuple((f8[:, :, :, :], {MATRIX}, {MATRIX})), '
        f'Tuple(({MATRIX}, {TENSOR}, {TENSOR}, '
        f'Tuple(({TENSOR}, {INDICES}, {INDICES}, {INDICES}, {TENSOR})), {MATRIX}, {MATRIX})), '
        f'Tuple(({INDICES}, f8[:, :, :, ::1], {BLOCKS}, {LIST})), '
        f'Tuple(({BLOCKS}, b1[:, :, ::1], f8[:, :, :, ::1])), '
        f'Tuple((i8[:, ::1], {TABLE}, {BLOCKS})), b1[::1], '
        f'Tuple(({LIST}, {NUMBERS}, {LIST}, b1[::1])), i8, i8)',
    'spatial_balance': f'f8[::1]({BLOCKS}, {LIST}, {LINKS})',
    'spatial_linearise':
        f'Tuple(({TABLE}, {TABLE}, {LIST}, {TABLE}, {TABLE}))({BLOCKS}, {LIST}, {LINKS})',
}
PASSING = 3  # exit status of a build that may do another time: no numba yet, no space
KEPT = 8  # versions in the cache of the user
BUILD_TIMEOUT = 900.0  # s: ten times as long as it takes
BUILD = f"""import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from soft_continuum.mechanics._kernel import build_here
try:
    build_here(Path(sys.argv[2]))
except (ImportError, OSError) as error:
    print(f'{{type(error).__name__}}: {{error}}', file=sys.stderr)
    sys.exit({PASSING})"""
HERE = Path(__file__).parent
SMALLEST_PART = 50  # problems of a batch that a thread takes at a time
FAILURE = 'failure'  # where it is noted why the extension could not be built


class Functions(NamedTuple):
    """The functions, and their backend: ``extension``, ``numba`` or ``python``."""

    newton: Function
    equilibrium: Function
    newton_batch: Function
    newton_lanes: Function
    moment_balance: Function
    dense_system: Function
    spatial_lay_out: Function
    spatial_follow: Function
    spatial_follow_batch: Function
    spatial_balance: Function
    spatial_linearise: Function
    runs_in: str


SOURCE = Functions(
    _newton.newton, _newton.equilibrium, _newton.newton_batch, _lanes.newton_lanes,
    _assembly.moment_balance, _assembly.dense_system, _path.lay_out, _path.follow,
    _path.follow_batch, _spatial_assembly.balance, _spatial_assembly.linearise, 'python')
"""The functions as plain Python."""


@cache
def functions() -> Functions:
    """Return the fastest available functions; the first call ever takes up to a minute."""
    cache = user_cache()
    for _ in range(2):  # the first look removes one that is damaged
        if must_build() and cache is not None:
            build(cache)
        if (found := _load()) is not None:
            return found
    try:
        made = jit(_writable(cache))
    except ImportError:
        return SOURCE
    return SOURCE._replace(
        runs_in='numba', **{name: made[getattr(SOURCE, name)] for name in SIGNATURES})


def warm_up() -> None:
    """
    Build or load the compiled solver now rather than in the first solve.

    The first build takes up to a minute, loading some milliseconds.
    """
    functions()


def must_build() -> bool:
    """Return whether the first call of ``functions`` builds the extension."""
    return not _built() and find_spec('numba') is not None and not why_not_built()


def why_not_built() -> str:
    """Return what prevents building the extension; empty if no cause is known."""
    compiler = (sysconfig.get_config_var('CXX') or 'c++').split()[0]
    if shutil.which(compiler) is None:
        return f'there is no C++ compiler ({compiler}); install one, such as g++'
    if not Path(sysconfig.get_path('include'), 'Python.h').exists():
        return 'the headers of Python are missing; install them, such as python3-dev'
    cache = user_cache()
    if cache is None:
        return 'there is no directory for it that is yours alone; set XDG_CACHE_HOME to one'
    try:
        lines = (cache / FAILURE).read_text(encoding='utf-8').split('\n')
    except OSError:
        return ''
    return f'{lines[-1]}; the full output is in {cache / FAILURE}: delete it to try again'


def build(directory: Path) -> str:
    """
    Build the extension in ``directory``; return why that failed, or an empty string.

    Not in this process, which would keep numba.  In a session of its own, so that Ctrl-C does not
    meet the compiler.
    """
    try:
        done = subprocess.run(
            [sys.executable, '-P', '-c', BUILD, str(HERE.parents[1]), str(directory)],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, start_new_session=True,
            timeout=BUILD_TIMEOUT)
    except subprocess.TimeoutExpired:
        return f'it was not built within {BUILD_TIMEOUT:g} s, by this process or another one'
    cache = _writable(user_cache())
    if done.returncode == 1 and cache is not None:  # it would fail the next time, too
        with suppress(OSError), tempfile.TemporaryDirectory(dir=cache) as scratch:
            note = Path(scratch, FAILURE)
            note.write_text(done.stderr.strip(), encoding='utf-8')
            note.replace(cache / FAILURE)
    return done.stderr.strip().rpartition('\n')[2] if done.returncode else ''


def build_here(directory: Path) -> None:
    """Build the extension unless it exists by now; raises errors of numba and the compiler."""
    import fcntl
    directory.mkdir(parents=True, exist_ok=True)
    with open(directory / 'kernel.lock', 'w') as lock, warnings.catch_warnings(action='ignore'):
        fcntl.flock(lock, fcntl.LOCK_EX)  # four nodes may start at once
        if not (directory / _file_name()).exists() and not (directory / FAILURE).exists():
            _compile(directory)
            _remove_old(directory)


def _compile(directory: Path) -> None:
    """Compile the extension; changes numba for good, so that its process is to end then."""
    from numba.pycc import CC  # its replacement is not there yet
    from numba.pycc import compiler as ahead_of_time
    new_flags = ahead_of_time.Flags

    def without_interpreter_lock() -> Any:
        flags = new_flags()
        flags.release_gil = True
        return flags

    ahead_of_time.Flags = without_interpreter_lock
    _compile_callees_once()
    made = jit()
    with tempfile.TemporaryDirectory(dir=directory) as scratch:
        extension = CC('kernel')
        extension.output_dir = scratch
        for name, signature in SIGNATURES.items():
            extension.export(name, signature)(made[getattr(SOURCE, name)].py_func)
        extension.compile()
        os.replace(Path(scratch, extension.output_file), directory / _file_name())


def _compile_callees_once() -> None:
    """
    Let numba compile called functions for the extension only, in a third of the time.

    By default it optimises each function with all its callees for execution, optimises them again
    in each caller, and adds a version for each constant argument.
    """
    from numba.core import codegen
    from numba.core.dispatcher import Dispatcher
    from numba.core.types.misc import unliteral
    for place, names in (
            (codegen.JITCodeLibrary, ('_optimize_functions', '_optimize_final_module',
                                      '_finalize_specific', 'get_pointer_to_function')),
            (codegen.JITCPUCodegen, ('_add_module', 'set_env'))):
        for name in names:
            setattr(place, name, lambda *_: 0)
    for options in MARKED.values():
        options.update(no_cpython_wrapper=True, no_cfunc_wrapper=True)
    template = Dispatcher.get_call_template

    def of_any_value(self: Any, kinds: Any, named: Any) -> Any:
        return template(self, tuple(unliteral(kind) for kind in kinds),
                        {name: unliteral(kind) for name, kind in named.items()})

    setattr(Dispatcher, template.__name__, of_any_value)


def _built() -> list[Path]:
    """Return the path from which the extension may be loaded."""
    return [path for directory in (HERE, user_cache()) if directory is not None
            and (path := directory / _file_name()).exists()]


def _load() -> Functions | None:
    """Return the functions of the extension; remove a cached one that does not load."""
    for path in _built():
        try:
            spec = spec_from_file_location('kernel', path)
            assert spec is not None and spec.loader is not None
            module = module_from_spec(spec)
            spec.loader.exec_module(module)
        except (ImportError, OSError):
            with suppress(OSError):
                path.unlink()
            continue
        return SOURCE._replace(
            runs_in='extension', **{name: getattr(module, name) for name in SIGNATURES})
    return None


@cache
def _digest() -> str:
    """Return a name that identifies all inputs of an extension; its suffix is for the Python."""
    modules = {function.__module__ for function in MARKED} | {__name__, jit.__module__}
    sources = [Path(sys.modules[name].__file__ or '') for name in sorted(modules)]
    try:
        numba = version('numba')
    except PackageNotFoundError:
        numba = ''
    return hashlib.sha256(b''.join([np.__version__.encode(), numba.encode(), *(
        path.read_bytes() for path in sources)])).hexdigest()[:16]


def _file_name() -> str:
    return f'kernel-{_digest()}{sysconfig.get_config_var("EXT_SUFFIX")}'


def user_cache() -> Path | None:
    """Return the directory in the user's cache; None without one that only the user may write."""
    given = os.environ.get('XDG_CACHE_HOME', '')
    home = Path(given if os.path.isabs(given) else os.path.expanduser('~/.cache'))
    path = home / 'soft_continuum'
    if not path.is_absolute():
        return None
    nearest = next(p for p in (path, *path.parents) if p.exists())
    status = nearest.stat()
    if status.st_uid not in (os.geteuid(), 0) or (
            path.exists() and status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)):
        return None
    return path / _digest()


def _remove_old(directory: Path) -> None:
    """Remove all but the newest versions beside ``directory``, one in the cache of the user."""
    if directory != user_cache():
        return
    versions = sorted((path for path in directory.parent.iterdir()
                       if len(path.name) == len(directory.name) and path.is_dir()),
                      key=lambda path: path.stat().st_mtime)
    for path in versions[:-KEPT]:
        shutil.rmtree(path, ignore_errors=True)


def _writable(directory: Path | None) -> Path | None:
    """Return the directory, created if necessary, or None if that fails."""
    if directory is None:
        return None
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return directory if os.access(directory, os.W_OK) else None


def in_parts(solve_part: Callable[[int, int], object], count: int) -> None:
    """Call a compiled function for parts of ``count`` problems (first, last), on all cores."""
    from concurrent.futures import ThreadPoolExecutor  # many processes solve one by one only
    workers = len(os.sched_getaffinity(0))
    parts = min(4 * workers, 1 + count // SMALLEST_PART)
    bounds = np.linspace(0, count, parts + 1).astype(int).tolist()
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(solve_part, bounds[:-1], bounds[1:]))
