# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A second copy of the mechanics in this process, imported as if numba were not installed."""

from importlib import import_module
import sys
from types import ModuleType

PACKAGE = 'soft_continuum.mechanics'


def mechanics_without_numba() -> ModuleType:
    """Return ``soft_continuum.mechanics`` running as plain Python; the compiled one stays."""
    kept = {name: module for name, module in sys.modules.items()
            if name == PACKAGE or name.startswith(PACKAGE + '.') or name == 'numba'}
    parent = import_module('soft_continuum')
    for name in kept:
        del sys.modules[name]
    sys.modules['numba'] = None  # type: ignore[assignment]  # makes its import fail
    try:
        plain = import_module(PACKAGE)
        assert not import_module(f'{PACKAGE}._compile').COMPILED
    finally:
        for name in [n for n in sys.modules if n == PACKAGE or n.startswith(PACKAGE + '.')]:
            del sys.modules[name]
        del sys.modules['numba']
        sys.modules.update(kept)
        if PACKAGE in kept:
            setattr(parent, 'mechanics', kept[PACKAGE])  # noqa: B010  # mypy has no such name
    return plain
