# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
ROS 2 parameter files, which describe arm and rig, read and written without ROS.

Such a file is YAML: node names (``/**`` for all), below them ``ros__parameters``, below that
nested keys.  A key that no table of parameters has is refused.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

import yaml

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.either import AnyArm
from soft_continuum.parameters.arm import any_arm_from_parameters, arm_from_parameters
from soft_continuum.parameters.nodes import ALL_PARAMETERS, jamming_settings, NODE_PARAMETERS
from soft_continuum.parameters.parameter import (
    as_yaml,
    name_hint,
    Parameter,
    ParameterError,
    Value,
)
from soft_continuum.parameters.shapes import (
    DIRECTION_PREFIX,
    SHAPE_PREFIX,
    shapes_from_parameters,
    VACUUM_PREFIX,
)
from soft_continuum.text import printable, read_bytes, write_whole

MAX_DEPTH = 20  # keys below one another in a parameter file
MAX_SIZE = 100_000  # bytes of such a file
WIDTH = 99  # of the comments in one

UNCHECKED = (SHAPE_PREFIX, DIRECTION_PREFIX, VACUUM_PREFIX, 'use_sim_time', 'qos_overrides.',
             'start_type_description_service')
"""Names, or how they begin, that are allowed without being in a table; ROS nodes have the rest."""


def load_description(*paths: str | Path, node: str = '') -> dict[str, Value]:
    """
    Read description files as ``node`` (or the library, without one) sees them; later ones win.

    Raises ParameterError naming the file and the key: also for keys that no node has, lists that
    do not fit together, shapes outside the limits, and thresholds in the wrong order.
    """
    values: dict[str, Value] = {p.name: p.default for p in ALL_PARAMETERS}
    for path in paths:
        values |= given_parameters(path, ALL_PARAMETERS, node, prefixes=UNCHECKED)
    try:
        arm = any_arm_from_parameters(values)
        shapes_from_parameters(values, arm)
        jamming_settings(values)
    except ParameterError as error:
        raise ParameterError(f'{", ".join(str(path) for path in paths)}: {error}') from None
    return values


def load_arm(*paths: str | Path) -> Arm:
    """
    Read a planar arm from description files.

    Raises ParameterError as load_description does, and for a spatial arm.
    """
    return arm_from_parameters(load_description(*paths))


def load_any_arm(*paths: str | Path) -> AnyArm:
    """Read an arm, planar or spatial; raises ParameterError as load_description does."""
    return any_arm_from_parameters(load_description(*paths))


def load_rig(paths: Sequence[str | Path]) -> dict[str, Value]:
    """
    Return every parameter as the node that has it reads it from ``paths``; later files win.

    Raises ParameterError as load_description does, and for a parameter that two nodes would read
    differently.
    """
    values: dict[str, Value] = {}
    owners: dict[str, str] = {}
    for node, table in NODE_PARAMETERS.items():
        seen = load_description(*paths, node=node)
        for name in (p.name for p in table):
            owner = owners.setdefault(name, node)
            if values.setdefault(name, seen[name]) != seen[name]:
                raise ParameterError(
                    f'parameter {name} is {values[name]} for {owner} and {seen[name]} for {node}; '
                    'write it once, below /**')
    return values


def write_parameters(path: Path, values: Mapping[str, Value], comments: Sequence[str],
                     notes: Mapping[str, str] | None = None, digits: int = 8) -> None:
    """Write parameters_text to a file, whole or not at all."""
    write_whole(path, parameters_text(values, comments, notes, digits))


def parameters_text(values: Mapping[str, Value], comments: Sequence[str],
                    notes: Mapping[str, str] | None = None, digits: int = 8) -> str:
    """
    Return a parameter file for all nodes.

    values: by dotted names, those of a group one after the other.  comments: lines at the top.
    notes: of parameters, by their names, which become comments above them.  digits: of numbers.
    """
    lines = [f'# {" ".join(comment.splitlines())}'.rstrip() for comment in comments]
    lines += ['/**:', '  ros__parameters:']
    group = ''
    for name, value in values.items():
        section, _, key = name.rpartition('.')
        if section != group:
            group = section
            lines += [f'    {group}:'] if group else ['']
        indent = 6 * ' ' if group else 4 * ' '
        lines += wrap((notes or {}).get(name, ''), WIDTH, initial_indent=f'{indent}# ',
                      subsequent_indent=f'{indent}# ')
        lines.append(f'{indent}{key}: {as_yaml(value, digits)}')
    return '\n'.join(lines) + '\n'


def given_parameters(path: str | Path, known: Sequence[Parameter], node: str = '',
                     prefixes: Sequence[str] = ()) -> dict[str, Value]:
    """
    Return what a ROS 2 parameter file sets for ``node``, checked, by dotted names.

    Names that start with one of ``prefixes`` are not checked.  Raises ParameterError naming the
    file and the key when the file cannot be read, is malformed, or has a key or value that is not
    allowed.
    """
    values = read_parameter_file(path, node)
    table = {p.name: p for p in known}
    for name, value in values.items():
        try:
            if name in table:
                values[name] = table[name].check(value)
            elif not name.startswith(tuple(prefixes)):
                raise ParameterError(f'unknown parameter {printable(name)}' + (
                    name_hint(name, table) or _known(name, table)))
        except ParameterError as error:
            raise ParameterError(f'{path}: {error}') from None
    return values


def _known(name: str, table: Iterable[str]) -> str:
    """Return which parameters there are in the group of an unknown one, or which groups."""
    group = name.partition('.')[0] + '.'
    found = [known for known in table if known.startswith(group)] or {
        f'{first}.*' if dot else first for first, dot, _ in (k.partition('.') for k in table)}
    return f'; known: {", ".join(sorted(found))}'


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Reads YAML without aliases, as ROS does: a few of them can stand for gigabytes."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()
            raise yaml.composer.ComposerError(
                None, None, f'ROS reads no alias (*{event.anchor}); write the value out',
                event.start_mark)
        return super().compose_node(parent, index)


def read_yaml(path: str | Path) -> Any:
    """
    Return what a small YAML file without aliases holds.

    Raises OSError for a file that cannot be read, ParameterError, naming the file and the line,
    for one that is not YAML.
    """
    try:
        return yaml.load(read_bytes(path, MAX_SIZE).decode('utf-8'), _Loader)
    except UnicodeDecodeError as error:
        raise ParameterError(f'{path}: is not UTF-8 text: {error.reason}') from None
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        where = f', line {mark.line + 1}, column {mark.column + 1}' if mark else ''
        raise ParameterError(
            f'{path}{where}: not valid YAML: {getattr(error, "problem", error)}') from None
    except (ValueError, LookupError, AttributeError, TypeError, RecursionError) as error:
        # Of PyYAML for values that it cannot construct, of Path for paths that it cannot open.
        raise ParameterError(f'{path}: not valid YAML: {type(error).__name__} {error}') from None


def read_parameter_file(path: str | Path, node: str = '') -> dict[str, Any]:
    """
    Return all that a ROS 2 parameter file sets for ``node`` (its name without namespace).

    Raises ParameterError naming the file, and the line or key, when it cannot be read.
    """
    try:
        document = read_yaml(path)
    except OSError as error:
        raise ParameterError(f'{path}: cannot be read: {error.strerror}') from None
    if not isinstance(document, Mapping):
        raise ParameterError(
            f'{path}: a parameter file starts with a node name, or /** for all nodes')
    flat: dict[str, Any] = {}
    applies = bool(node)  # a node may find nothing for itself in a file
    for name, section in document.items():
        if not isinstance(section, Mapping) or 'ros__parameters' not in section:
            raise ParameterError(f'{path}: key {name}: expected ros__parameters below it')
        if str(name) in ('/**', '/*') or str(name).rsplit('/', 1)[-1] == node:
            _flatten(path, section['ros__parameters'], '', flat)
            applies = True
    if not applies:
        raise ParameterError(f'{path}: has no section for all nodes (/**), only for '
                             + ', '.join(str(name) for name in document))
    return flat


def _flatten(path: str | Path, tree: Any, prefix: str, flat: dict[str, Any]) -> None:
    if not isinstance(tree, Mapping):
        raise ParameterError(f'{path}: key {prefix or "ros__parameters"}: expected keys below it')
    if prefix.count('.') > MAX_DEPTH:
        raise ParameterError(f'{path}: keys are nested too deeply: {prefix[:40]}...')
    for key, value in tree.items():
        name = f'{prefix}{key}'
        if isinstance(value, Mapping):
            _flatten(path, value, f'{name}.', flat)
        elif value is None:
            raise ParameterError(f'{path}: key {name} has no value')
        else:
            flat[name] = value
