# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Delimited text as testing machines and spreadsheets write it, to columns in SI units.

The header is the first line that has all the columns that are wanted; what stands above it is
skipped.  Cells are separated by semicolons, tabs or commas; decimal commas are read where commas
do not separate.  Units stand in the header, ``Force [N]``, or in a row of their own below it.
"""

from collections.abc import Mapping, Sequence
import csv
from dataclasses import dataclass
from math import isfinite, pi
from pathlib import Path
import re

import numpy as np
from numpy.typing import NDArray

from soft_continuum.text import MAX_NAME, printable, read_bytes

Array = NDArray[np.float64]  # not that of mechanics, for which numba would be imported

MAX_SIZE = 10_000_000  # bytes of a file
MAX_ROWS = 100_000
MAX_PREAMBLE = 200  # lines above the header
MAX_COLUMNS = 200
MAX_HEADER = 200  # characters of a cell of the header

FORCE_UNITS = {'N': 1.0, 'mN': 1e-3, 'cN': 1e-2, 'kN': 1e3}
LENGTH_UNITS = {'m': 1.0, 'mm': 1e-3, 'cm': 1e-2, 'um': 1e-6, '\u00b5m': 1e-6, '\u03bcm': 1e-6}
TIME_UNITS = {'s': 1.0, 'sec': 1.0, 'ms': 1e-3, 'min': 60.0}
ANGLE_UNITS = {'rad': 1.0, 'deg': pi / 180.0, '\u00b0': pi / 180.0}
MASS_UNITS = {'kg': 1.0, 'g': 1e-3}
ALL_UNITS = {*FORCE_UNITS, *LENGTH_UNITS, *TIME_UNITS, *ANGLE_UNITS, *MASS_UNITS}

UNIT_IN_HEADER = (r'(.*?)\s*\[(.*)\]', r'(.*?)\s*\((.*)\)', r'(.*?)\s*/\s*(\S+)',
                  r'(.*?)\s+in\s+(\S+)', r'(.*?)[_ ](\S+)')
DELIMITERS = {';': 'semicolons', '\t': 'tabs', ',': 'commas'}


class MeasurementError(ValueError):
    """A file of measurements is not usable; the message names file, line and remedy."""


@dataclass(frozen=True)
class Quantity:
    """
    A column that is looked for.

    name: ours, also of the option that names the column.  aliases: words that stand for it in a
    header, lower case.  units: factor to SI by unit; empty for text and plain numbers.
    """

    name: str
    aliases: tuple[str, ...]
    units: Mapping[str, float] | None = None
    required: bool = True


@dataclass(frozen=True)
class Column:
    """One column: its header, its factor to SI, its cells and the lines they stand in."""

    path: Path
    header: str
    factor: float
    cells: tuple[str, ...]
    lines: tuple[int, ...]
    decimal: str

    def numbers(self) -> Array:
        """Return the values (rows,) in SI; raises MeasurementError for what is no number."""
        return self.factor * np.array([
            _number(self.path, line, self.header, cell, self.decimal)
            for cell, line in zip(self.cells, self.lines, strict=True)], dtype=float)

    def whole_numbers(self) -> list[int]:
        """Return the values as whole numbers; raises MeasurementError naming the line."""
        values = self.numbers()
        for value, cell, line in zip(values, self.cells, self.lines, strict=True):
            if value != round(value):
                raise MeasurementError(
                    f'{self.path}, line {line}: {self.header} is {cell!r}; it must be a whole '
                    'number')
        return [int(value) for value in values]


@dataclass(frozen=True)
class Table:
    """What was read: for each quantity its columns; more than one where the header repeats it."""

    path: Path
    columns: Mapping[str, tuple[Column, ...]]

    def column(self, name: str) -> Column:
        """Return the only column of a quantity; raises MeasurementError when there are more."""
        found = self.columns[name]
        if len(found) > 1:
            raise MeasurementError(
                f'{self.path}: {len(found)} columns may be the {name}: '
                f'{", ".join(repr(c.header) for c in found)}; name one with --{name}-column')
        return found[0]

    def has(self, name: str) -> bool:
        """Whether the file has a column of that quantity."""
        return bool(self.columns[name])


def read_table(path: str | Path, quantities: Sequence[Quantity],
               named: Mapping[str, str] | None = None,
               units: Mapping[str, str] | None = None,
               usual: Mapping[str, str] | None = None) -> Table:
    """
    Read the columns of ``quantities`` from a file.

    named: header of a column, by quantity, where it is not to be found by its aliases.  units: of
    a quantity, in place of what the header says; usual: where it says nothing.  Raises
    MeasurementError naming file, line and remedy for files that are empty, have other columns,
    other delimiters or uneven rows.
    """
    path = Path(path)
    named, units, usual = named or {}, units or {}, usual or {}
    lines = _text(path).splitlines()
    if len(lines) > MAX_ROWS:
        raise MeasurementError(f'{path}: has {len(lines)} lines; at most {MAX_ROWS} are read: '
                               'export fewer points, such as every tenth')
    if not any(line.strip() for line in lines):
        raise MeasurementError(f'{path}: the file is empty; export the measurement again')
    start, delimiter, header, places = _header(path, lines, quantities, named)
    rows = [(number, _cells(line, delimiter))
            for number, line in enumerate(lines[start + 1:], start=start + 2)
            if line.strip(f' {delimiter}')]
    unit_row: list[str] = []
    if rows and _is_unit_row(rows[0][1], places, quantities):
        unit_row = rows.pop(0)[1]
    unit_row += [''] * (len(header) - len(unit_row))
    if not rows:
        raise MeasurementError(f'{path}, line {start + 1}: there are no rows below the header; '
                               'export the measured values as well')
    for number, row in rows:
        _check_width(path, number, row, header, delimiter)
    used = [place for found in places.values() for place in found]
    decimal = '.' if delimiter == ',' else _decimal(path, rows, used)
    columns: dict[str, tuple[Column, ...]] = {quantity.name: () for quantity in quantities}
    for quantity in quantities:
        found = places[quantity.name]
        for place in found:
            factor = _factor(f'{path}, line {start + 1}', quantity, header[place],
                             units.get(quantity.name) or _split_unit(header[place])[1]
                             or unit_row[place].strip('[]() ')
                             or usual.get(quantity.name, ''))
            end = len(rows)
            # Repetitions side by side differ in length.
            while len(found) > 1 and end and not rows[end - 1][1][place]:
                end -= 1
            columns[quantity.name] += (Column(
                path, header[place], factor, tuple(row[place] for _, row in rows[:end]),
                tuple(number for number, _ in rows[:end]), decimal),)
    return Table(path, columns)


def _text(path: Path) -> str:
    try:
        data = read_bytes(path, MAX_SIZE)
    except OSError as error:
        raise MeasurementError(f'{path}: cannot be read: {error.strerror}; check name, size and '
                               'permissions') from None
    if data.startswith((b'\xff\xfe', b'\xfe\xff')):
        return data.decode('utf-16', errors='replace')
    if b'\0' in data:
        raise MeasurementError(f'{path}: is not a text file; export it as CSV')
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError:
        return data.decode('cp1252', errors='replace')  # what Windows programs write


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    except csv.Error:  # a cell of 128 kB
        return [line]


def _header(path: Path, lines: Sequence[str], quantities: Sequence[Quantity],
            named: Mapping[str, str]) -> tuple[int, str, list[str], dict[str, list[int]]]:
    """Find the header: its line (0-based), delimiter, cells and the places of each quantity."""
    required = [q.name for q in quantities if q.required or q.name in named]
    best: tuple[int, int, list[str], list[str]] = (0, 0, [], required)
    for i, line in enumerate(lines[:MAX_PREAMBLE]):
        for delimiter in DELIMITERS:
            if not 0 < line.count(delimiter) < MAX_COLUMNS:
                continue
            cells = _cells(line, delimiter)
            places = {q.name: [k for k, cell in enumerate(cells)
                               if _matches(cell, q, named.get(q.name))] for q in quantities}
            missing = [name for name in required if not places[name]]
            if not missing:
                return i, delimiter, cells, places
            if len(required) - len(missing) > best[0]:
                best = len(required) - len(missing), i, cells, missing
    score, at, cells, missing = best
    if score:
        have = ', '.join(f"'{printable(cell, MAX_NAME)}'" for cell in cells[:10] if cell)
        raise MeasurementError(
            f'{path}, line {at + 1}: no column for {" and ".join(missing)}; the columns are '
            f'{have}; name it with --{missing[0]}-column')
    at, line = next((i, line) for i, line in enumerate(lines) if line.strip())
    raise MeasurementError(
        f'{path}, line {at + 1}: neither this line ({line.strip()[:40]!r}) nor one below is a '
        f'header with columns for {" and ".join(required)}, separated by '
        f'{", ".join(DELIMITERS.values())}; export it with another delimiter, or name the columns '
        f'with --{required[0]}-column')


def _matches(cell: str, quantity: Quantity, named: str | None) -> bool:
    if not cell or len(cell) > MAX_HEADER:
        return False
    names = [cell, _split_unit(cell)[0]]
    if named is not None:
        return named.strip() in names
    for name in names:
        words = re.findall(r'[^\W\d_]+', name.lower())
        # German names are compounds: Standardkraft, Traversenweg.
        if any(word == alias or (len(alias) > 2 and word.endswith(alias))
               for word in words for alias in quantity.aliases):
            return True
    return False


def _split_unit(cell: str) -> tuple[str, str]:
    """Return name and unit of a header cell; the unit is empty where none can be told."""
    for k, pattern in enumerate(UNIT_IN_HEADER):
        match = re.fullmatch(pattern, cell.strip())
        # Without brackets only what is a unit is taken for one.
        if match and (k < 2 or match[2] in ALL_UNITS):
            return match[1].strip(), match[2].strip()
    return cell.strip(), ''


def _is_unit_row(row: Sequence[str], places: Mapping[str, Sequence[int]],
                 quantities: Sequence[Quantity]) -> bool:
    """Whether the cells of all columns that have a unit are words in place of numbers."""
    cells = [row[p] for q in quantities if q.units for p in places[q.name] if p < len(row)]
    return bool(cells) and all(cell.strip('[]() ') in ALL_UNITS for cell in cells)


def _check_width(path: Path, line: int, row: list[str], header: Sequence[str], delimiter: str
                 ) -> None:
    while len(row) > len(header) and not row[-1]:
        row.pop()
    row += [''] * (len(header) - len(row)) if delimiter != ',' else []
    if len(row) != len(header):
        hint = ('; decimal commas need semicolons between the columns'
                if delimiter == ',' and len(row) > len(header) else '')
        raise MeasurementError(
            f'{path}, line {line}: {len(row)} cells separated by {DELIMITERS[delimiter]}, but the '
            f'header has {len(header)}; repair or delete this line{hint}')


def _decimal(path: Path, rows: Sequence[tuple[int, Sequence[str]]], used: Sequence[int]) -> str:
    """Return the decimal mark of a file; raises MeasurementError when it has both."""
    seen: dict[str, int] = {}
    for line, row in rows:
        for cell in (row[place] for place in used):
            if re.fullmatch(r'[-+\d.,eE]+', cell) and any(c.isdigit() for c in cell):
                marks = re.findall('[.,]', cell)
                if marks and marks.count(marks[-1]) == 1:
                    seen.setdefault(marks[-1], line)
    if len(seen) == 2:
        raise MeasurementError(
            f'{path}, lines {seen["."]} and {seen[","]}: decimal points and decimal commas in one '
            'file; export it with one of them')
    return next(iter(seen), '.')


def _number(path: Path, line: int, header: str, cell: str, decimal: str) -> float:
    text = cell.replace(' ', '').replace('.' if decimal == ',' else ',', '').replace(',', '.')
    try:
        value = float(text)
    except ValueError:
        value = float('nan')
    if not isfinite(value):
        raise MeasurementError(f'{path}, line {line}: {header} is {cell!r}, not a finite number; '
                               'delete this line or export the measurement again')
    return value


def _factor(where: str, quantity: Quantity, header: str, unit: str) -> float:
    """Return the factor of a unit to SI; raises MeasurementError for one that is not known."""
    if not quantity.units:
        return 1.0
    allowed = ', '.join(quantity.units)
    if not unit:
        raise MeasurementError(
            f'{where}: column {header!r} has no unit; write it as {header} '
            f'[{next(iter(quantity.units))}] or give --{quantity.name}-unit (one of {allowed})')
    if unit not in quantity.units:
        raise MeasurementError(f'{where}: {unit!r} is not a unit of {quantity.name}; known: '
                               f'{allowed}; convert the column')
    return quantity.units[unit]
