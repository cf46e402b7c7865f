# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Lazy loading of modules when a name that a package exports is used."""

from collections.abc import Callable, Collection, Sequence
from importlib import import_module
from typing import Any


def names_from(package: str, names: Collection[str], modules: Sequence[str]
               ) -> Callable[[str], Any]:
    """
    Return the ``__getattr__`` of a package: it loads ``modules`` in order until one has the name.

    package: its name.  names: its exports, which may be modules themselves.
    """
    def attribute(name: str) -> Any:
        if name in names:
            for module in [name] if name in modules else modules:
                found = import_module(f'{package}.{module}')
                if module == name or hasattr(found, name):
                    return getattr(found, name, found)
        raise AttributeError(f'module {package!r} has no attribute {name!r}')

    return attribute
