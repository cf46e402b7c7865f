# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
ROS 2 parameter files, read and written without ROS.

Such a file is YAML: node names (``/**`` for all), below them ``ros__parameters``, below that
nested keys; parameters.overrides reads it.  A key that no table of parameters has is refused.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
import re
from textwrap import wrap
from typing import Any

import yaml

from soft_continuum.parameters.overrides import (
    ALL_NODES,
    Loader,
    Overrides,
    parse_yaml,
)
from soft_continuum.parameters.parameter import name_hint, Parameter, ParameterError, Value
from soft_continuum.parameters.scalars import as_yaml, read_scalar
from soft_continuum.text import MAX_NAME, printable, write_whole

WIDTH = 99  # of the comments in one
NUMERIC = '+-.0123456789'  # first characters of numbers

FOREIGN = re.compile(r'\A%YAML:|(?<=\n)---\s*\Z')
"""What OpenCV writes at the beginning, and `ros2 topic echo` at the end."""


def write_parameters(path: Path, values: Mapping[str, Value], comments: Sequence[str],
                     notes: Mapping[str, str] | None = None, digits: int = 8) -> None:
    """Write parameters_text to a file, whole or not at all."""
    write_whole(path, parameters_text(values, comments, notes, digits))


def parameters_text(values: Mapping[str, Value], comments: Sequence[str],
                    notes: Mapping[str, str] | None = None, digits: int = 8,
                    section: str = ALL_NODES) -> str:
    """
    Return a parameter file, for all nodes unless ``section`` names others.

    values: by dotted names; those of a group come where its first one does: a key that is there
    twice is none that can be read.  comments: lines at the top.  notes: of parameters, by their
    names, which become comments above them.  digits: of numbers.
    """
    lines = [f'# {" ".join(comment.splitlines())}'.rstrip() for comment in comments]
    lines += [f'{section}:', '  ros__parameters:']
    group = ''
    groups = list(dict.fromkeys(name.rpartition('.')[0] for name in values))
    for name, value in sorted(
            values.items(), key=lambda item: groups.index(item[0].rpartition('.')[0])):
        above, _, key = name.rpartition('.')
        if above != group:
            group = above
            lines += [f'    {group}:'] if group else ['']
        indent = 6 * ' ' if group else 4 * ' '
        lines += wrap((notes or {}).get(name, ''), WIDTH, initial_indent=f'{indent}# ',
                      subsequent_indent=f'{indent}# ')
        lines.append(f'{indent}{key}: {as_yaml(value, digits)}')
    return '\n'.join(lines) + '\n'


def given_parameters(overrides: Overrides, known: Sequence[Parameter], node: str,
                     prefixes: Sequence[str] = ()) -> dict[str, Value]:
    """
    Return what is set for a node, by its full name; checked, by dotted names.

    Names that start with one of ``prefixes`` are not checked, and left out where they have no
    value.  Raises ParameterError naming the file and the key that is not allowed.
    """
    values: dict[str, Value] = {}
    table = {p.name: p for p in known}
    for name, (value, where) in overrides.of(node).items():
        try:
            if name in table:
                if value is None:
                    raise ParameterError(f'parameter {name} is []; ROS takes an empty list for no '
                                         'value: leave the line out')
                values[name] = table[name].check(value)
            elif not name.startswith(tuple(prefixes)):
                raise ParameterError(f'unknown parameter {printable(name)}' + (
                    name_hint(name, table) or _known(name, table)))
            elif value is not None:
                values[name] = value  # type: ignore[assignment]
        except ParameterError as error:
            raise ParameterError(f'{where}: {error}') from None
    return values


def _known(name: str, table: Iterable[str]) -> str:
    """Return which parameters there are in the group of an unknown one, or which groups."""
    group = name.partition('.')[0] + '.'
    found = [known for known in table if known.startswith(group)] or {
        f'{first}.*' if dot else first for first, dot, _ in (k.partition('.') for k in table)}
    return f'; known: {", ".join(sorted(found))}'


class _Loader(Loader):
    """Reads numbers as rcl does: 1e-3 is one, 1_000 and 1:30 are texts.  Keys are unique."""

    yaml_implicit_resolvers = {first: found for first, found
                               in Loader.yaml_implicit_resolvers.items() if first not in NUMERIC}

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Return the next mapping; of equal keys PyYAML would take the last."""
        node, seen = super().compose_mapping_node(anchor), set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                raise yaml.composer.ComposerError(
                    None, None, f'key {printable(key.value, MAX_NAME)} stands there twice; '
                    'delete or rename one', key.start_mark)
            seen.add(key.value)
        return node


_Loader.add_implicit_resolver('tag:yaml.org,2002:float', re.compile('.'), list(NUMERIC))
_Loader.add_constructor('tag:yaml.org,2002:opencv-matrix', yaml.SafeLoader.construct_yaml_map)
_Loader.add_constructor('tag:yaml.org,2002:float', lambda _, node: read_scalar(node.value))


def read_yaml(path: str | Path) -> Any:
    """
    Return what a small YAML file without aliases holds, also of OpenCV or `ros2 topic echo`.

    Raises OSError for a file that cannot be read, ParameterError, naming the file and the line,
    for one that is not YAML.
    """
    return parse_yaml(path, lambda text: yaml.load(FOREIGN.sub('#', text), _Loader))
