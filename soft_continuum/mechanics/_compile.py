# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Decorators for functions that numba compiles; nothing is compiled here, and numba is not imported.

The decorated functions, in the neighbouring modules, are plain Python over arrays.  ``_kernel``
compiles them and provides them to the rest of the mechanics.
"""

from collections.abc import Callable
from pathlib import Path
import sys
from typing import Any

Function = Callable[..., Any]

MARKED: dict[Function, dict[str, Any]] = {}
"""The options of numba for each function."""


def compiled(function: Function) -> Function:
    """Mark a function to be compiled, free of the interpreter lock."""
    MARKED[function] = {'nogil': True, 'error_model': 'numpy'}
    return function


def borrowing(function: Function) -> Function:
    """
    Mark a function to be compiled without reference counts: one that allocates nothing.

    It takes tuples of many arrays; counting references to each would cost a third of a solve.
    """
    MARKED[compiled(function)]['_nrt'] = False
    return function


def inlined(function: Function) -> Function:
    """Mark a function, as ``borrowing``, to be compiled into its caller."""
    MARKED[borrowing(function)]['forceinline'] = True
    return function


def jit(directory: Path | None = None) -> dict[Function, Any]:
    """
    Put a dispatcher of numba in the place of every marked function, and return them.

    directory: where numba keeps what it compiles; by default it does not.  Raises ImportError
    without numba.
    """
    import numba
    from numba.core.cpu import CPUTargetOptions
    unknown = set() if hasattr(CPUTargetOptions, '_nrt') else {'_nrt'}  # private: it may go
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(directory or '')
    try:
        made = {function: numba.njit(
                    cache=directory is not None,
                    **{name: options[name] for name in options.keys() - unknown})(function)
                for function, options in MARKED.items()}
    finally:
        numba.config.CACHE_DIR = before
    for module in {sys.modules[function.__module__] for function in MARKED}:
        for name, value in list(vars(module).items()):
            if callable(value) and value in made:
                setattr(module, name, made[value])
    return made
