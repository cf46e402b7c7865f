# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a parameter is: its name, default, meaning, unit and allowed values."""

from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass, field, fields
import difflib
from math import degrees, inf, pi, radians
import re
from typing import Any, TypeVar

from soft_continuum.text import printable

KindT = TypeVar('KindT')
Value = bool | int | float | str | tuple[int, ...] | tuple[float, ...] | tuple[str, ...]
MAX_NUMBER = 1e308
MAX_SHOWN = 200  # characters of a value in an error message

FRAME_NAME, TOPIC_NAME = 'frame', 'topic'
FORMS = {FRAME_NAME: re.compile(r'[^\s/]+(/[^\s/]+)*'),  # tf2 takes none that begins with /
         TOPIC_NAME: re.compile(r'(~?/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*', re.ASCII)}
FORMS_IN_WORDS = {
    FRAME_NAME: 'a frame without blanks and without / at its ends, such as left/base_link',
    TOPIC_NAME: 'a topic of letters, digits, _ and /, such as joint_states or /rig/joint_states'}
TYPES = {bool: 'bool', int: 'integer', float: 'double', str: 'string'}


class ParameterError(ValueError):
    """A parameter, or the file that sets it, is not usable; the message says which and why."""


def spread(name: str, values: tuple[Any, ...], count: int, counted: str, *, alone: bool = True
           ) -> tuple[Any, ...]:
    """
    Return the ``count`` values of a list parameter, of which one counts for all if ``alone``.

    counted: what says how many are needed, for the message.  Raises ParameterError for others.
    """
    if len(values) == 1 and alone:
        values *= count
    if len(values) != count:
        raise ParameterError(f'parameter {name} has {len(values)} values; {counted}, so {count} '
                             f'are needed{", or one for all" if alone else ""}')
    return values


@dataclass(frozen=True)
class Parameter:
    """
    One parameter: its name, default (which also gives its type), meaning and allowed values.

    low, high: bounds of a number, or of every number of a list.  choices: the allowed texts.
    read_only: cannot change while the node runs.  is_range: two numbers, the smaller first.
    unit: of the number or numbers; empty where there is none.  form: FRAME_NAME or TOPIC_NAME of
    a text that is one; it may be empty where its default is.  infinite: inf is allowed, too.  A
    default of () is a list of numbers that has to be given.
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
    form: str = ''
    infinite: bool = False

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
        if self.form:
            return FORMS_IN_WORDS[self.form]
        if self._item_type in (bool, str):
            return 'true or false' if self._item_type is bool else 'text'
        return f'{self.low:g} to {self.high:g}'

    def check(self, value: Any) -> Value:
        """Return ``value`` in this parameter's type; raise ParameterError when it does not fit."""
        if not isinstance(self.default, tuple):
            item: Value = self._item(value, value)
            return item
        if isinstance(value, str | bytes | Mapping | Set) or not hasattr(value, '__iter__'):
            raise self._error(value, 'a list')
        items = tuple(self._item(item, value) for item in value)
        if self.is_range and not (len(items) == 2 and items[0] < items[1]):
            raise self._error(value, 'two numbers, the smaller first')
        return items

    @property
    def _item_type(self) -> type:
        default = self.default
        if isinstance(default, tuple):
            return type(default[0]) if default else float
        return type(default)

    def _item(self, item: Any, given: Any) -> Any:
        """Return one item of the value that was given, or all of it where it is no list."""
        kind = self._item_type
        if kind in (bool, str):
            if not isinstance(item, kind) or (self.choices and item not in self.choices):
                raise self._error(
                    given, 'a list of texts' if isinstance(self.default, tuple) else self.allowed)
            text = str(item)
            if self.form and text != self.default and not (
                    text.isprintable() and FORMS[self.form].fullmatch(text)):
                raise self._error(given, self.allowed)
            return item
        if self.infinite and item == inf:
            return inf
        if kind is int and (isinstance(item, bool) or not isinstance(item, int)):
            raise self._error(given, 'a whole number')
        if isinstance(item, bool) or not isinstance(item, int | float) or not (
                abs(item) <= MAX_NUMBER):  # also what is too large for a float, or nan
            raise self._error(given, 'finite numbers')
        if not self.low <= item <= self.high:
            hint = degrees_hint(item, self.low, self.high) if self.unit == 'rad' else ''
            raise self._error(given, self.allowed, hint)
        return kind(item)

    def _error(self, value: Any, allowed: str, hint: str = '') -> ParameterError:
        try:
            shown = printable(repr(value), MAX_SHOWN)
        except ValueError:  # Python writes no whole number of more than 4300 digits
            shown = 'a number of thousands of digits'
        return ParameterError(
            f'parameter {self.name} is {shown}; allowed: {allowed} ({self.description}){hint}')


def setting(default: Value, meaning: str, low: float = -inf, high: float = inf, **more: Any
            ) -> Any:
    """
    Return a field of a dataclass, whose parameter of the same name has this meaning and range.

    more: as of Parameter.
    """
    return field(default=default, metadata={
        'default': default, 'meaning': meaning, 'low': low, 'high': high, **more})


def setting_parameters(kind: type[Any], prefix: str, **more: Any) -> tuple[Parameter, ...]:
    """Return the parameters PREFIX.NAME of the settings of a dataclass; more: of all."""
    return tuple(Parameter(f'{prefix}.{one.name}', **one.metadata, **more)
                 for one in fields(kind) if one.metadata)


def settings_from(kind: type[KindT], prefix: str, values: Mapping[str, Any], **more: Any
                  ) -> KindT:
    """Return the settings from values of these parameters; more: fields that are none."""
    return kind(**more, **{one.name: values[f'{prefix}.{one.name}']
                           for one in fields(kind) if one.metadata})  # type: ignore[arg-type]


def degrees_hint(angle: float, low: float, high: float) -> str:
    """
    Return a question for an error message when a refused angle (rad) looks like degrees.

    It does when it is a whole number or more than half a turn, and is allowed (low to high, rad)
    once taken as degrees; otherwise the hint is empty.  What is a round number of degrees as it is
    was not given in rad.
    """
    whole = float(angle).is_integer() or (
        abs(angle) > pi and not round(100.0 * degrees(angle), 6).is_integer())
    if whole and low <= radians(angle) <= high:
        return f'; degrees? {angle:g} degrees are {radians(angle):.4g} rad'
    return ''


RENAMED = {
    'silence_timeout': 'stale_timeout', 'load_cells.used': 'load_cells.enabled',
    'estimation.used': 'estimation.enabled', 'reach.departure': 'reach.max_deviation',
    'teleop.dead_man_button': 'teleop.enable_button', 'tags.mounts': 'tags.offsets',
    'tracker.mounts': 'tracker.offsets', 'tags.straight': 'tags.reference_corners',
    'learn': 'save-estimate'}
"""New names of parameters and of a verb, by the old ones; others that end in deviation: stddev."""


def name_hint(name: str, known: Iterable[str]) -> str:
    """Return a hint for an error message: the new or the closest known name, or ''."""
    known = sorted(known)
    new = RENAMED.get(name) or re.sub('deviation$', 'stddev', name)
    if new != name and new in known:
        return f'; it is named {new} now'
    close = difflib.get_close_matches(name, known, n=1)
    return f'; did you mean {close[0]}?' if close else ''

