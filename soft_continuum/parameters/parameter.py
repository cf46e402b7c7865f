# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a parameter is: its name, default, meaning and allowed values."""

from collections.abc import Mapping, Set
from dataclasses import dataclass
from math import inf
import re
from typing import Any

ROS_NUMBER = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?')
"""What ROS reads as a number; YAML 1.1 takes some of it, such as 2e2, as text."""
MOST = 1e308

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
