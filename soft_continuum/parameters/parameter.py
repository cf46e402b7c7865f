# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a parameter is: its name, default, meaning, unit and allowed values."""

from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass
import difflib
from math import inf, pi, radians
import re
from typing import Any

ROS_NUMBER = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?')
"""What ROS reads as a number; YAML 1.1 takes some of it, such as 2e2, as text."""
MAX_NUMBER = 1e308

Value = bool | int | float | str | tuple[float, ...] | tuple[str, ...]
TYPES = {bool: 'bool', int: 'integer', float: 'double', str: 'string'}


class ParameterError(ValueError):
    """A parameter, or the file that sets it, is not usable; the message says which and why."""


@dataclass(frozen=True)
class Parameter:
    """
    One parameter: its name, default (which also gives its type), meaning and allowed values.

    low, high: bounds of a number, or of every number of a list.  choices: the allowed texts.
    read_only: cannot change while the node runs.  is_range: two numbers, the smaller first.
    unit: of the number or numbers; empty where there is none.  A default of () is a list of
    numbers that has to be given.
    """

    name: str
    default: Value
    meaning: str
    low: float = -inf
    high: float = inf
    choices: tuple[str, ...] = ()
    read_only: bool = True
    is_range: bool = False
    unit: str = ''

    @property
    def description(self) -> str:
        """The meaning with the unit, for ROS, command lines and messages."""
        return f'{self.meaning} [{self.unit}]' if self.unit else self.meaning

    @property
    def type_name(self) -> str:
        """The type as ROS names it, such as double array."""
        array = ' array' if isinstance(self.default, tuple) else ''
        return TYPES[self._item_type] + array

    @property
    def allowed(self) -> str:
        """The values that are allowed, or that every item of a list may have."""
        if self.choices:
            return ' or '.join(self.choices)
        if self._item_type in (bool, str):
            return 'true or false' if self._item_type is bool else 'text'
        return f'{self.low:g} to {self.high:g}'

    def check(self, value: Any) -> Value:
        """Return ``value`` in this parameter's type; raise ParameterError when it does not fit."""
        if isinstance(self.default, tuple):
            return self._list(value)
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise self._error(value, self.allowed)
            return value
        if isinstance(self.default, str):
            if not isinstance(value, str) or (self.choices and value not in self.choices):
                raise self._error(value, self.allowed)
            return value
        if isinstance(self.default, int) and not (
                isinstance(value, int) and not isinstance(value, bool)):
            raise self._error(value, 'a whole number')
        number = self._number(value, value)
        return int(number) if isinstance(self.default, int) else number

    @property
    def _item_type(self) -> type:
        if isinstance(self.default, tuple):
            return type(self.default[0]) if self.default else float
        return type(self.default)

    def _list(self, value: Any) -> Value:
        if isinstance(value, str | bytes | Mapping | Set) or not hasattr(value, '__iter__'):
            raise self._error(value, 'a list')
        if self._item_type is str:
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
                abs(item) <= MAX_NUMBER):  # also what is too large for a float, or nan
            raise self._error(given, 'finite numbers')
        if not self.low <= item <= self.high:
            hint = degrees_hint(item, self.low, self.high) if self.unit == 'rad' else ''
            raise self._error(given, self.allowed, hint)
        return float(item)

    def _error(self, value: Any, allowed: str, hint: str = '') -> ParameterError:
        return ParameterError(
            f'parameter {self.name} is {value!r}; allowed: {allowed} ({self.description}){hint}')


def degrees_hint(angle: float, low: float, high: float) -> str:
    """
    Return a question for an error message when a refused angle (rad) looks like degrees.

    It does when it is a whole number or more than half a turn, and is allowed (low to high, rad)
    once taken as degrees; otherwise the hint is empty.
    """
    whole = abs(angle) > pi or float(angle).is_integer()
    if whole and low <= radians(angle) <= high:
        return f'; degrees? {angle:g} degrees are {radians(angle):.4g} rad'
    return ''


def name_hint(name: str, known: Iterable[str]) -> str:
    """Return a question for an error message with the known name closest to ``name``, or ''."""
    close = difflib.get_close_matches(name, sorted(known), n=1)
    return f'; did you mean {close[0]}?' if close else ''
