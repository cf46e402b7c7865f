# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Compilation with numba where it is installed; otherwise the same source runs as it is.

What is compiled is kept on disk.  numba would go by the date of each file and miss a change in
another one that is compiled into it, so the place is named after the contents of all of them.
"""

from collections.abc import Callable
import hashlib
import os
from pathlib import Path
from typing import Any

Function = Callable[..., Any]

try:
    import numba

    COMPILED = True
    prange = numba.prange
except ImportError:  # numba is optional: see docs/explanation/performance.md
    COMPILED = False
    prange = range


def _cache_directory() -> str:
    sources = sorted(Path(__file__).parent.glob('_[a-z]*.py'))
    digest = hashlib.sha256(b''.join(path.read_bytes() for path in sources)).hexdigest()[:16]
    cache = os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache')
    return os.path.join(cache, 'soft_continuum', digest)


def compiled(function: Function, **options: bool) -> Function:
    """Compile with numba, kept on disk and free of the interpreter lock."""
    if not COMPILED:
        return function
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _CACHE
    try:
        dispatcher: Function = numba.njit(
            cache=True, nogil=True, error_model='numpy', **options)(function)
    finally:
        numba.config.CACHE_DIR = before
    return dispatcher


def _without_reference_counts() -> dict[str, bool]:
    """Return the option that turns reference counts off: private, so numba may not know it."""
    try:
        from numba.core.cpu import CPUTargetOptions
    except ImportError:
        return {}
    return {'_nrt': False} if hasattr(CPUTargetOptions, '_nrt') else {}


def borrowing(function: Function, **options: bool) -> Function:
    """
    Compile with numba without reference counts, for functions that allocate nothing.

    They take tuples of many arrays; counting references to each would cost a third of a solve.
    """
    return compiled(function, **_without_reference_counts(), **options)


def inlined(function: Function) -> Function:
    """Compile with numba, as ``borrowing``, into the caller."""
    return borrowing(function, forceinline=True)


def is_compiled() -> bool:
    """Tell whether there is nothing left to compile: whether warm_up once came to its end."""
    return not COMPILED or os.path.exists(_COMPLETE)


def note_compiled() -> None:
    """Note that everything is compiled, for ``is_compiled``."""
    if COMPILED and os.path.isdir(_CACHE):
        with open(_COMPLETE, 'w', encoding='ascii'):
            pass


_CACHE = _cache_directory()
_COMPLETE = os.path.join(_CACHE, 'complete')  # numba makes the directory before it compiles
