# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The definitions of message types, as bags keep them."""

from functools import cache
from importlib import import_module
from pathlib import Path
import re
from typing import Any

from ament_index_python.packages import get_package_share_directory, PackageNotFoundError

KIND = re.compile(r'([a-z][a-z0-9_]*)/msg/([A-Za-z][A-Za-z0-9]*)')
FIELD = re.compile(r'^([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^]]*\])?\s+\w+')
PRIMITIVES = {'bool', 'byte', 'char', 'string', 'wstring', 'float32', 'float64', *(
    f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64))}
LINE = '=' * 80


class DefinitionError(LookupError):
    """The definition of a type is not installed."""


def message_class(kind: str) -> Any:
    """
    Return the class of a type, pkg/msg/Name; raises DefinitionError.

    The name comes from the network or a file: only installed ROS packages that define this type
    are imported.
    """
    definition(kind)
    package, _, name = kind.split('/')
    try:
        return getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError):
        raise DefinitionError(f'{kind} is not installed for Python') from None


@cache
def definition(kind: str) -> str:
    """
    Return the definition of a type, pkg/msg/Name, followed by those of all types in it.

    As rosbag2 stores it: each of the others after a line of equals signs and ``MSG: pkg/Name``.
    Raises DefinitionError.
    """
    text = _text(kind)
    parts, found, waiting = [text], {kind}, _used(kind, text)
    while waiting:
        inner = waiting.pop(0)
        if inner not in found:
            found.add(inner)
            text = _text(inner)
            package, _, name = inner.split('/')
            parts.append(f'{LINE}\nMSG: {package}/{name}\n{text}')
            waiting += _used(inner, text)
    return '\n'.join(parts)


def _text(kind: str) -> str:
    named = KIND.fullmatch(kind)
    if named is None:
        raise DefinitionError(f'{kind!r} is not a message type')
    try:
        path = Path(get_package_share_directory(named[1]), 'msg', f'{named[2]}.msg')
        return path.read_text(encoding='utf-8')
    except (PackageNotFoundError, OSError, ValueError):
        raise DefinitionError(f'the definition of {kind} is not installed') from None


def _used(kind: str, text: str) -> list[str]:
    """Return the types of the fields, but primitive ones, as pkg/msg/Name."""
    found = []
    for line in text.splitlines():
        field = FIELD.match(line.split('#')[0].strip())
        if field and field[1] not in PRIMITIVES:
            names = field[1].split('/')
            found.append(f'{names[0] if len(names) > 1 else kind.split("/")[0]}/msg/{names[-1]}')
    return found
