# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Parameters: one table of what exists, read by the nodes and by the library from the same file.

A ROS 2 parameter file is YAML: node names (``/**`` for all) over ``ros__parameters`` over nested
keys.  ``load_parameters`` reads it without ROS and refuses what the tables do not know.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
import difflib
from math import inf
from pathlib import Path
import re
from typing import Any

import yaml

ROS_NUMBER = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?')
"""What ROS reads as a number; YAML 1.1 takes some of it, such as 2e2, as text."""
MOST = 1e308
DEEPEST = 20  # keys below one another in a parameter file

Value = bool | int | float | str | tuple[float, ...] | tuple[str, ...]


class ParameterError(ValueError):
    """A parameter, or the file it stands in, is not usable; the message says which and why."""


@dataclass(frozen=True)
class Parameter:
    """
    One parameter: its name, default (whose type it has), what it means and what it may be.

    low, high: bounds of a number, or of every number of an array.  choices: the allowed strings.
    read_only: cannot change while the node runs.  is_range: two numbers, the smaller first.
    """

    name: str
    default: Value
    description: str
    low: float = -inf
    high: float = inf
    choices: tuple[str, ...] = ()
    read_only: bool = True
    is_range: bool = False

    def check(self, value: Any) -> Value:
        """Return ``value`` in this parameter's type; raise ParameterError when it does not fit."""
        if isinstance(self.default, tuple):
            return self._list(value)
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise self._error(value, 'true or false')
            return value
        if isinstance(self.default, str):
            if not isinstance(value, str) or (self.choices and value not in self.choices):
                raise self._error(value, ' or '.join(self.choices) or 'text')
            return value
        if isinstance(self.default, int) and not (
                isinstance(value, int) and not isinstance(value, bool)):
            raise self._error(value, 'a whole number')
        number = self._number(value, value)
        return int(number) if isinstance(self.default, int) else number

    def _list(self, value: Any) -> Value:
        if isinstance(value, str | bytes | Mapping | Set) or not hasattr(value, '__iter__'):
            raise self._error(value, 'a list')
        if self.default and isinstance(self.default[0], str):  # type: ignore[index]
            if not all(isinstance(item, str) for item in value):
                raise self._error(value, 'a list of texts')
            return tuple(value)
        numbers = tuple(self._number(item, value) for item in value)
        if self.is_range and not (len(numbers) == 2 and numbers[0] < numbers[1]):
            raise self._error(value, 'two numbers, the smaller first')
        return numbers

    def _number(self, item: Any, given: Any) -> float:
        if isinstance(item, str) and ROS_NUMBER.fullmatch(item):
            item = float(item)
        if isinstance(item, bool) or not isinstance(item, int | float) or not (
                abs(item) <= MOST):  # also what is too large for a float, or nan
            raise self._error(given, 'finite numbers')
        if not self.low <= item <= self.high:
            raise self._error(given, f'{self.low:g} to {self.high:g}')
        return float(item)

    def _error(self, value: Any, allowed: str) -> ParameterError:
        return ParameterError(
            f'parameter {self.name} is {value!r}; allowed: {allowed} ({self.description})')


def load_parameters(path: str | Path, known: Sequence[Parameter], node: str = '',
                    prefixes: Sequence[str] = ()) -> dict[str, Value]:
    """
    Return the parameters of ``node`` from a ROS 2 parameter file, flattened to dotted names.

    Values that the file leaves out have their defaults.  Arguments and errors are those of
    ``given_parameters``.
    """
    return {p.name: p.default for p in known} | given_parameters(path, known, node, prefixes)


def given_parameters(path: str | Path, known: Sequence[Parameter], node: str = '',
                     prefixes: Sequence[str] = ()) -> dict[str, Value]:
    """
    Return what a ROS 2 parameter file says for ``node``, checked, flattened to dotted names.

    Names that start with one of ``prefixes`` are free (a library of shapes).  Raises
    ParameterError naming the file and the key when the file cannot be read, is malformed, or has
    a key or value that is not allowed.
    """
    given = read_parameter_file(path, node)
    table = {p.name: p for p in known}
    values: dict[str, Value] = {}
    for name, value in given.items():
        try:
            if name in table:
                values[name] = table[name].check(value)
            elif any(name.startswith(prefix) for prefix in prefixes):
                values[name] = value
            else:
                close = difflib.get_close_matches(name, table, n=1)
                raise ParameterError(
                    f'unknown parameter {name}'
                    + (f'; did you mean {close[0]}?' if close else '.')
                    + f' Known: {", ".join(sorted(table))}')
        except ParameterError as error:
            raise ParameterError(f'{path}: {error}') from None
    return values


def read_parameter_file(path: str | Path, node: str = '') -> dict[str, Any]:
    """
    Return all that a ROS 2 parameter file says for ``node`` (by its last name), flattened.

    Raises ParameterError naming the file, and the line or key, when it cannot be read.
    """
    try:
        document = yaml.safe_load(Path(path).read_text(encoding='utf-8'))
    except OSError as error:
        raise ParameterError(f'{path}: cannot be read: {error.strerror}') from None
    except UnicodeDecodeError as error:
        raise ParameterError(f'{path}: is not UTF-8 text: {error.reason}') from None
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        where = f', line {mark.line + 1}, column {mark.column + 1}' if mark else ''
        raise ParameterError(
            f'{path}{where}: not valid YAML: {getattr(error, "problem", error)}') from None
    except (ValueError, LookupError, AttributeError, TypeError, RecursionError) as error:
        # What PyYAML lets through from the values it makes, and from paths that are none.
        raise ParameterError(f'{path}: not valid YAML: {type(error).__name__} {error}') from None
    if not isinstance(document, Mapping):
        raise ParameterError(
            f'{path}: a parameter file starts with a node name, or /** for all nodes')
    flat: dict[str, Any] = {}
    applies = bool(node)  # a file for other nodes says nothing to this one
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
    if prefix.count('.') > DEEPEST:
        raise ParameterError(f'{path}: keys are nested too deeply: {prefix[:40]}...')
    for key, value in tree.items():
        name = f'{prefix}{key}'
        if isinstance(value, Mapping):
            _flatten(path, value, f'{name}.', flat)
        elif value is None:
            raise ParameterError(f'{path}: key {name} has no value')
        else:
            flat[name] = value
