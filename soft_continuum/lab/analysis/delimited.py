# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Delimited text from testing machines and spreadsheets, as columns in SI units.

A table is a header with all required columns, units in it, ``Force [N]``, or in a separate row
below it, and rows of numbers.  Of several tables the longest is read; tables with the same header
are blocks of one.  Numbers are read with the decimal mark that all of them allow; if both marks
fit, the user must choose: a file is never read a thousand times too large.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
import csv
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import takewhile
from pathlib import Path
import re
from typing import Any
import unicodedata

import numpy as np
from numpy.typing import NDArray

from soft_continuum.extras import needed
from soft_continuum.text import MAX_NAME, printable, read_bytes

Array = NDArray[np.float64]  # not that of mechanics, for which numba would be imported

MAX_SIZE = 10_000_000  # bytes of a file
MAX_ROWS = 100_000
MAX_COLUMNS = 200
MAX_HEADER = 200  # characters of a cell of the header
MAX_SUBHEADERS = 3  # lines below the header down to the units
MAX_WRAPPED = 10  # lines of a row whose cells are wrapped

DELIMITERS = {';': 'semicolons', '\t': 'tabs', ',': 'commas', '  ': 'blanks', ' ': 'blanks'}
UNITS = {'N': 'N, mN, kN, gf, kgf, lbf', 'm': 'm, mm, um, in', 'rad': 'rad, deg', 'kg': 'kg, g'}
"""Units named in messages, by SI unit."""
NAMES = frozenset((
    'newton', 'dyne', 'force_gram', 'force_kilogram', 'force_pound', 'force_ounce', 'kip',
    'meter', 'micron', 'inch', 'foot', 'thou', 'radian', 'degree', 'gram', 'pound', 'ounce',
    'second', 'minute', 'hour'))
PREFIXES = frozenset(('', 'kilo', 'deca', 'deci', 'centi', 'milli', 'micro'))
"""Units are those of pint, but a rod or a link in a header is none, Mm a misprint, Nm no nm."""
BRACKETS = re.compile(r'[\[({<]([^\[\](){}<>]*)[\])}>]')
EDGES = ' []()<>{}'
SUFFIX = re.compile(
    r'(.+?)(?:\s*[,/]\s*|\s+in\s+|[_ ]|\.\.)([^\W\d_]{1,3}|\N{DEGREE SIGN})[_.]?')
SCALED = re.compile(
    r'[*/^\u00d7\u00f7]\s*\d|\d\s*[*\u00d7]|[(\[{<]\s*x\s*\d|\d\s*x\s*[)\]}>]'
    r'|\b(?:log(?:10)?|ln|times|divided|multiplied|normali[sz]ed)\b', re.IGNORECASE)
"""What a header says of numbers that are not those of its unit: Force (x10) [N], Force/2 [N]."""
LEADING = re.compile(r'(?:in|units?:?)\s+(?=\S)|units?:', re.IGNORECASE)
COMMENTS = ('#', '%')
COMMENT = re.compile(r'[#%]{1,2}(?:\s+|$)')
RULE = '-=|+:,; \t'  # characters of a line below a header
PREPOSITIONS = frozenset(('at', 'of', 'to', 'from', 'per', 'in', 'on', 'bei', 'von', 'pro', 'de'))
OF_CHANNELS = frozenset(
    ('sensor', 'cell', 'channel', 'ch', 'kanal', 'count', 'number', 'no', 'nr'))
"""Words that may follow the name of a quantity: force cell 2, cycle count."""
AMONG = 2.0
"""Whole numbers up to so many times the largest one with a mark may be among them, as decimals."""
JUMP, STEP = 0.5, 0.25
"""Largest step over the range of a column, exceeded only with a wrong mark."""
MOTION_CAPTURE = re.compile(
    r'Format Version[,;\t]|(?:NO_OF_FRAMES|PathFileType)\b|Frame[,;\t]Sub ?Frame[,;\t]'
    r'|.*\bRigid Body[,;\t]Rigid Body\b')

BLANKS = ' \u00a0\u2007\u2008\u2009\u202f'
APOSTROPHES = "'\u2019"
OTHER = {'.': ',', ',': '.'}
NUMERIC, DIGITS, WORD = 'number', 'digits', 'word'
"""Kinds of cells: digits are those of a date, of a numbered name."""
NUMBER = {mark: re.compile(
    rf'[-+\u2212]?(?:(?:\d+(?:{re.escape(mark)}\d*)?|{re.escape(mark)}\d+)(?:[eE][-+]?\d+)?'
    rf'|[1-9]\d{{0,2}}(?P<by>[{re.escape(other)}{BLANKS}{APOSTROPHES}])\d{{3}}'
    rf'(?:(?P=by)\d{{3}})*(?:{re.escape(mark)}\d*)?)', re.ASCII) for mark, other in OTHER.items()}
"""By decimal mark: digits, or groups of three with one separator between them."""
WRITTEN = {mark: {**dict.fromkeys(map(ord, BLANKS + APOSTROPHES + other)), ord(mark): '.',
                  ord('\u2212'): '-'} for mark, other in OTHER.items()}
"""Replacements that convert such a number for Python."""


class MeasurementError(ValueError):
    """A file of measurements is invalid; the message names file, line and remedy."""


class _OtherUnit(MeasurementError):
    """The unit of a column is that of another quantity."""


@dataclass(frozen=True)
class Quantity:
    """
    A column to find.

    name: also that of its options.  aliases: words for it in a header, lower case, without
    accents.  unit: of SI; empty for text and plain numbers.
    options: whether the verb has --NAME-column and, with a unit, --NAME-unit.
    """

    name: str
    aliases: tuple[str, ...]
    unit: str = ''
    required: bool = True
    options: bool = False

    def remedy(self, otherwise: str) -> str:
        """Return how to name the column: by its option, or ``otherwise`` in the file."""
        return f'name it with --{self.name}-column' if self.options else otherwise


@dataclass(frozen=True)
class Column:
    """
    One column: its header, its factor to SI, its cells and their lines.

    number: of the column in the file, from 1.
    """

    quantity: Quantity
    path: Path
    header: str
    factor: float
    cells: tuple[str, ...]
    lines: tuple[int, ...]
    number: int
    decimal: str = '.'

    def part(self, start: int, end: int) -> 'Column':
        """Return the rows from start to end."""
        return replace(self, cells=self.cells[start:end], lines=self.lines[start:end])

    def numbers(self) -> Array:
        """Return the values (rows,) in SI; raises MeasurementError for invalid numbers."""
        values = np.array([_number(cell, self.decimal) for cell in self.cells], dtype=float)
        for bad in np.flatnonzero(~np.isfinite(values)):
            raise MeasurementError(
                f'{self.path}, line {self.lines[bad]}: {self.header} is {self.cells[bad]!r}, not '
                f'a finite number{" with a decimal comma" if self.decimal == "," else ""}; '
                'delete this line or export the measurement again')
        return self.factor * values

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
    """
    The columns of each quantity, by its name; several if the header has several.

    blocks: first row and the row after the last of each block; one unless the header is repeated.
    above, below: line and cells of rows above the headers, and from there to the numbers.
    """

    path: Path
    columns: Mapping[str, tuple[Column, ...]]
    blocks: tuple[tuple[int, int], ...]
    above: Sequence[tuple[int, Sequence[str]]]
    below: Sequence[tuple[int, Sequence[str]]]

    def column(self, name: str) -> Column:
        """Return the only column of a quantity; raises MeasurementError if there are more."""
        found = self.columns[name]
        if len(found) > 1:
            quantity = found[0].quantity
            alike = len({c.header for c in found}) < len(found)
            raise MeasurementError(
                f'{self.path}: {len(found)} columns may be the {name}: '
                + ', '.join(repr(c.header) + f' (column {c.number})' * alike for c in found) + '; '
                + quantity.remedy('rename or delete all but one')
                + ', by its number' * (alike and quantity.options))
        return found[0]

    def numbers(self, name: str, usual: Any) -> list[Any]:
        """Return the values (rows) of a quantity in SI; usual: of each row without the column."""
        return (self.column(name).numbers().tolist() if self.columns[name] else
                [usual] * self.blocks[-1][1])


@dataclass
class _Block:
    """
    A header, a row of units if there is one, and rows by lines.

    words: rows above the numbers, including the units.
    """

    line: int
    header: list[str]
    places: dict[Quantity, list[int]]
    rows: list[tuple[int, list[str]]] = field(default_factory=list)
    units: list[str] = field(default_factory=list)
    words: list[tuple[int, list[str]]] = field(default_factory=list)

    def measured(self, row: Sequence[str]) -> list[str]:
        """Return the cells of a row that have a unit."""
        return [row[place] for quantity, places in self.places.items() if quantity.unit
                for place in places if place < len(row)]

    @property
    def numbered(self) -> bool:
        """Whether the cells have numbers where expected."""
        return any(_is_number(cell) for _, row in self.rows for cell in self.measured(row))

    @property
    def numbers_last(self) -> bool:
        """Whether the last row has numbers where expected, and is no comment nor labelled so."""
        last = self.rows[-1][1] if self.rows else ['']
        return not COMMENT.match(last[0]) and any(map(_is_number, self.measured(last)))

    def trim(self) -> '_Block':
        """Separate the row of units, and remove text below the numbers: titles, results."""
        for k, (line, row) in enumerate(self.rows[:MAX_SUBHEADERS]):
            if any(_is_number(cell) for cell in self.measured(row)):
                break
            self.words.append((line, row))
            if _is_of_units(self.measured(row)):
                self.units = row
                del self.rows[:k + 1]
                break
        while self.rows and (
                not _is_number(self.rows[-1][1][0]) and not any(self.rows[-1][1][1:])
                or self._is_label(self.rows[-1][1][0])):
            self.rows.pop()
        return self

    @cached_property
    def usual(self) -> str:
        """The kind of the first cells of most rows."""
        return Counter(_kind(row[0]) for _, row in self.rows).most_common(1)[0][0]

    def _is_label(self, cell: str) -> bool:
        """Whether the first cell of a row is the name of what follows, unlike others."""
        return _kind(cell) == WORD != self.usual or (
            self.usual == NUMERIC != _kind(cell) and bool(re.search(r'[^\W\d_]', cell)))

    def check_first(self, path: Path) -> None:
        """Raise an error if the first row says something of the columns: numbers, a scale."""
        line, row = self.rows[0]
        if self.usual and self._is_label(row[0]) and any(
                map(_is_number, self.measured(row))):
            raise MeasurementError(
                f'{path}, line {line}: {printable(row[0], MAX_NAME)!r} stands where the rows '
                'below have a number; delete this line; if it is a scale, export scaled values')
        cells = [cell for cell in row if cell]
        numbers = [str(k) for k in range(len(cells) + 1)]
        after = ''.join(cell for _, other in self.rows[1:2] for cell in self.measured(other))
        if len(cells) > 1 and cells in (numbers[:-1], numbers[1:]) and OTHER.keys() & after:
            raise MeasurementError(
                f'{path}, line {line}: the cells, {", ".join(cells[:3])}, may be the numbers of '
                f'the columns; delete this line, or write {cells[0]}.0 if it is measured')


def read_table(path: str | Path, quantities: Sequence[Quantity],
               named: Mapping[str, str] | None = None,
               units: Mapping[str, str] | None = None,
               usual: Mapping[str, str] | None = None, decimal: str | None = None) -> Table:
    """
    Read the columns of ``quantities`` from a file.

    named: header of a column, by quantity, if its aliases do not match.  units: of a quantity,
    instead of those in the header; usual: if the header has none.  decimal: the mark, if numbers
    may be read with both.  Raises MeasurementError naming file, line and remedy for files that
    are empty, have other columns, other delimiters or uneven rows.
    """
    path = Path(path)
    units, usual = units or {}, usual or {}
    delimiter, blocks, above = _blocks(path, _text(path), quantities, named or {})
    first = blocks[0]
    for block in blocks:
        block.check_first(path)
        for number, row in block.rows:
            _check_width(path, number, row, first.header, delimiter)
    rows = [row for block in blocks for row in block.rows]
    lines = tuple(number for number, _ in rows)
    cells = [tuple(row[place] for _, row in rows) for place in range(len(first.header))]
    found: list[Column] = []
    for quantity, places in first.places.items():
        wrong: list[_OtherUnit] = []
        for place in places:
            try:
                factor = _factor(f'{path}, line {first.line}', quantity, first.header[place],
                                 first.units[place:place + 1], units.get(quantity.name, ''),
                                 usual.get(quantity.name, ''))
            except _OtherUnit as error:
                wrong.append(error)
            else:
                found.append(Column(quantity, path, first.header[place], factor, cells[place],
                                    lines, place + 1))
        if wrong and len(wrong) == len(places):
            raise wrong[0]
    decimal = decimal or _decimal([c for c in found if c.quantity.unit], delimiter, cells)
    columns = {quantity.name: tuple(replace(c, decimal=decimal) for c in found
                                    if c.quantity == quantity) for quantity in quantities}
    ends = np.cumsum([len(block.rows) for block in blocks]).tolist()
    return Table(path, columns, tuple(zip([0, *ends[:-1]], ends, strict=True)), above,
                 [row for block in blocks for row in block.words])


def _text(path: Path) -> str:
    try:
        data = read_bytes(path, MAX_SIZE)
    except OSError as error:
        raise MeasurementError(f'{path}: cannot be read: {error.strerror}; check name, size and '
                               'permissions') from None
    if data.startswith((b'\xff\xfe', b'\xfe\xff')):
        return data.decode('utf-16', errors='replace')
    for first, encoding in ((1, 'utf-16-le'), (0, 'utf-16-be')):
        if data[first::2].count(0) > len(data) / 4 and not data[1 - first::2].count(0):
            return data.decode(encoding, errors='replace')
    if b'\0' in data:
        raise MeasurementError(f'{path}: is not a text file; export it as CSV')
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError:
        return data.decode('cp1252', errors='replace')  # of Windows programs


def _rows(text: str) -> Iterator[tuple[int, str]]:
    """Yield rows with the number of their first line: quoted cells may span several lines."""
    lines = text.replace('\ufeff', '').splitlines()  # there are several in files that were joined
    at = 0
    while at < len(lines):
        quotes, end = 0, at
        for end in range(at, min(at + MAX_WRAPPED, len(lines))):
            quotes += lines[end].count('"')
            if quotes % 2 == 0:
                break
        else:  # a quotation mark that is not closed, or inches
            end = at
        yield at + 1, '\n'.join(lines[at:end + 1])
        at = end + 1


def _cells(text: str, delimiter: str) -> list[str]:
    if not delimiter.strip(' '):
        # A unit in brackets belongs to the name before it.
        parts = re.split(r'\t|\s{2,}' if delimiter == '  ' else r'\s+(?![\[(])', text.strip())
        return [cell.strip('"') for cell in parts]
    try:
        return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter))]
    except csv.Error:  # a cell of 128 kB
        return [text]


def _blocks(path: Path, text: str, quantities: Sequence[Quantity], named: Mapping[str, str],
            known: bool = True) -> tuple[str, list[_Block], list[tuple[int, list[str]]]]:
    """
    Return the delimiter, the longest table, and the rows above it.

    The table is a block, or those with the same header.  known: whether columns given by their
    numbers need a header that names the quantity; otherwise any word is a header.
    """
    rows = [(number, row) for number, row in _rows(text) if row.strip()]
    if not rows:
        raise MeasurementError(f'{path}: the file is empty; export the measurement again')
    if (count := len(text.splitlines())) > MAX_ROWS:
        raise MeasurementError(f'{path}: has {count} lines; at most {MAX_ROWS} are read: '
                               'export fewer points, such as every tenth')
    if any(MOTION_CAPTURE.match(row.replace('"', '')) for _, row in rows[:10]):
        raise MeasurementError(
            f'{path}: is an export of a motion-capture program, of its bodies frame by frame in '
            'its own axes; have it publish the poses of the discs while the arm moves: '
            '`soft_continuum measure` writes points and pulls from them')
    required = [q for q in quantities if q.required or q.name in named]
    best: tuple[int, int, list[str], list[Quantity]] = (0, 0, [], required)
    bare: _Block | None = None
    for delimiter in DELIMITERS:
        blocks: list[_Block] = []
        split = [_cells(row, delimiter) for _, row in rows]
        usual = Counter(map(len, split)).most_common(1)[0][0]
        for (number, row), cells in zip(rows, split, strict=True):
            if cells[0] in COMMENTS and len(cells) == usual + 1:  # as numpy.savetxt writes it
                del cells[0]
            if (is_comment := COMMENT.match(cells[0])) and not any(map(_is_number, cells)):
                cells[0] = COMMENT.sub('', cells[0]) or cells[0]
            if 1 < len(cells) < MAX_COLUMNS and (
                    named or len(re.findall(r'[^\W\d_]+', row)) >= len(required)):
                header = [' '.join(cell.split()) for cell in cells]
                while not header[-1] and len(header) > 1:
                    header.pop()
                places = {q: [k for k, cell in enumerate(header)
                              if _matches(cell, q, named.get(q.name), k + 1, known)]
                          for q in quantities}
                missing = [q for q in required if not places[q]]
                if not missing:
                    blocks.append(_Block(number, header, places))
                    continue
                if len(required) - len(missing) > best[0]:
                    best = len(required) - len(missing), number, header, missing
            is_rule = not row.strip(RULE) and ('--' in row or '==' in row)
            if blocks and any(cells) and not (is_rule or (is_comment and blocks[-1].numbers_last)):
                blocks[-1].rows.append((number, cells))
        filled = [block for block in blocks if block.trim().rows]
        filled = [block for block in filled if block.numbered] or filled
        if filled:
            longest = max(filled, key=lambda block: len(block.rows))
            same = [block for block in filled if (block.header, block.units)
                    == (longest.header, longest.units)]
            for block in filled:
                if block not in same and 2 * len(block.rows) >= len(longest.rows):
                    raise MeasurementError(
                        f'{path}, lines {block.line} and {longest.line}: two tables that differ '
                        'in their headers; put each into a file of its own')
            above = [row for block in same for row in _above(rows, block, blocks, delimiter)]
            for block in same if named else ():
                _find_others(block, above, [q for q in required if q.name not in named], required)
            return delimiter, same, above
        if delimiter.strip(' '):
            bare = bare or next(iter(blocks), None)
    if known and any(name.isdecimal() for name in named.values()):
        return _blocks(path, text, quantities, named, known=False)
    if bare:
        raise MeasurementError(f'{path}, line {bare.line}: there are no rows below the header; '
                               'export the measured values as well')
    raise MeasurementError(_no_header(path, rows[0], best, required))


def _above(rows: Sequence[tuple[int, str]], block: _Block, blocks: Sequence[_Block],
           delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield line and cells of the rows above a block, up to the numbers of another one."""
    before = [other for other in blocks if other.line < block.line and other.numbered]
    for line, row in reversed([each for each in rows if each[0] < block.line]):
        cells = _cells(row, delimiter)
        if before and (line <= before[-1].line
                       or any(_is_number(cell) for cell in before[-1].measured(cells))):
            break
        if not delimiter.strip(' '):  # nothing holds the place of an empty cell
            width = len(block.header)
            cells = [cells[place * len(cells) // width] for place in range(width)]
        yield line, cells


def _find_others(block: _Block, above: Sequence[tuple[int, list[str]]],
                 wanted: Sequence[Quantity], all_of_them: Sequence[Quantity]) -> None:
    """Find columns of unnamed quantities in further header rows."""
    near = takewhile(lambda each: not any(map(_is_number, each[1])), above)
    for _, row in (*near, *block.words):
        found = {q: [k for k, cell in enumerate(row[:len(block.header)])
                     if _matches(cell, q, None, k + 1, True)] for q in all_of_them}
        for quantity in wanted if all(found.values()) else ():
            if len(found[quantity]) > len(block.places[quantity]):
                block.places[quantity] = found[quantity]


def _no_header(path: Path, first: tuple[int, str],
               best: tuple[int, int, list[str], list[Quantity]], required: Sequence[Quantity]
               ) -> str:
    """Return what is missing; best: columns found, line, header and missing quantities."""
    found, at, header, missing = best
    if found:
        have = ', '.join(f"'{printable(cell, MAX_NAME)}'" for cell in header[:10] if cell)
        name = missing[0].name
        return (f'{path}, line {at}: no column for {" and ".join(q.name for q in missing)}; the '
                f'columns are {have}; ' + missing[0].remedy(f'write {name} above its column'))
    at, line = first
    names = ' and '.join(q.name for q in required)
    if all(map(_is_number, re.findall(r'[^;,\s]+', line))):
        return (f'{path}, line {at}: the file begins with numbers; write a header line above '
                f'them that names {names} with their units, such as Force [N]')
    return (f'{path}, line {at}: neither this line ({printable(line.strip()[:40])!r}) nor one '
            f'below is a header with columns for {names}, separated by '
            f'{", ".join(dict.fromkeys(DELIMITERS.values()))}; export it with another delimiter, '
            f'or ' + required[0].remedy(f'write {names} above the columns'))


def _matches(cell: str, quantity: Quantity, named: str | None, number: int, known: bool) -> bool:
    """Return whether a cell is the header of a quantity; named: by a header, or by its number."""
    if len(cell) > MAX_HEADER:
        return False
    if not cell.strip('+-0123456789., eE'):
        return cell == named and not known
    if named is not None and named.isdecimal():
        return number == int(named) and (
            _matches(cell, quantity, None, number, known) if known else
            bool(re.search(r'[^\W\d_]', cell)) and not _is_of_units([cell]))
    if named is not None:
        return ' '.join(named.split()) in (cell, _name(cell),
                                           BRACKETS.sub('', cell[::-1], 1)[::-1].strip())
    head = _head(cell)
    # German names are compounds: Standardkraft, Traversenweg.
    return any(head == alias or (len(alias) > 2 and head.endswith(alias))
               for alias in quantity.aliases)


def _name(cell: str) -> str:
    """Return a header cell without brackets and without a trailing unit."""
    name = cell
    while BRACKETS.search(name):
        name = BRACKETS.sub('', name)
    match = SUFFIX.fullmatch(name.strip())
    return match[1].strip() if match and _unit(match[2]) else name.strip()


@cache
def _head(cell: str) -> str:
    """Return the word of a header cell that names the quantity: Maximum Load at Break, load."""
    plain = unicodedata.normalize('NFKD', _name(cell).lower())
    words = re.findall(r'[^\W\d_]+', ''.join(c for c in plain if not unicodedata.combining(c)))
    words = words[:next((k for k, word in enumerate(words) if word in PREPOSITIONS and k), None)]
    while len(words) > 1 and words[-1] in OF_CHANNELS:
        words.pop()
    return words[-1] if words else ''


@cache
def _registry() -> Any:
    with needed(MeasurementError):
        import pint
    return pint.UnitRegistry()


@cache
def _unit(text: str) -> tuple[float, str] | None:
    """Return factor to SI, and SI unit, of a unit; None for unknown units."""
    word = LEADING.sub('', text.strip(' .'))
    if word == '\N{DEGREE SIGN}':
        word = 'deg'
    if not re.fullmatch(r'[^\W\d_]+(?:[-_ ][^\W\d_]+)?', word):
        return None
    low = word.lower()
    for spelling in dict.fromkeys((word, re.sub('^K', 'k', word), low,
                                   re.sub('[-_ ]', '', low), re.sub('[- ]', '_', low))):
        parsed = _registry().parse_unit_name(spelling)
        if parsed and parsed[0][0] in PREFIXES and parsed[0][1] in NAMES:
            value = _registry().Quantity(1.0, parsed[0][0] + parsed[0][1]).to_base_units()
            return float(value.magnitude), str(value.units)
    return None


def _is_of_units(cells: Sequence[str]) -> bool:
    """Whether the cells of a row are units: one is known, or all are in brackets."""
    filled = [cell for cell in cells if cell]
    return bool(filled) and (any(_unit(cell.strip(EDGES)) for cell in filled)
                             or all(BRACKETS.fullmatch(cell) for cell in filled))


def _factor(where: str, quantity: Quantity, header: str, below: Sequence[str], given: str,
            usual: str) -> float:
    """Return the factor of a column to SI; raises MeasurementError for units that do not fit."""
    if not quantity.unit:
        return 1.0
    option = f'--{quantity.name}-unit' if quantity.options else ''
    if not given and SCALED.search(header):
        raise MeasurementError(
            f'{where}: column {header!r} may hold other numbers than its unit says; export it '
            'unscaled, ' + (f'or give {option}' if option else 'or rename it'))
    inside = BRACKETS.findall(header)[::-1]
    suffix = SUFFIX.fullmatch(header)
    said = [text.strip(EDGES) for text in (
        [given] if given else [*inside, *below, *([suffix[2]] if suffix else [])])]
    wanted = _unit(quantity.unit)
    allowed = UNITS[quantity.unit]
    fitting = {text: unit[0] for text in said
               if (unit := _unit(text)) and wanted and unit[1] == wanted[1]}
    rows = {text.strip(EDGES) for text in below} & fitting.keys()
    first = next(iter(fitting), '')
    if other := next((text for text in fitting if fitting[text] != fitting[first]), ''):
        raise MeasurementError(
            f'{where}: column {header!r} is in {first} by its header and in {other} by '
            f'{"the row of units" if other in rows else "its end"}; '
            + (f'give {option}' if option else 'correct one of them'))
    if fitting:
        return fitting[first]
    wrong = next((text for text in said[:len(inside) + len(below) or 1] if text), '')
    if wrong and (given or inside or below):
        raise _OtherUnit(
            f'{where}: {printable(wrong, MAX_NAME)!r} is not a unit of {quantity.name}; known: '
            f'{allowed}; ' + (f'give {option}' if option and not given else 'convert the column'))
    if usual:
        return _factor(where, quantity, header, (), usual, '')
    raise MeasurementError(
        f'{where}: column {header!r} has no unit; write it as {header} '
        f'[{quantity.unit}]' + (f' or give {option}' if option else '') + f' (one of {allowed})')


def _check_width(path: Path, line: int, row: list[str], header: Sequence[str], delimiter: str
                 ) -> None:
    if any('\n' in cell for cell in row):
        raise MeasurementError(f'{path}, line {line}: a quoted cell continues in the next line; '
                               'close its quotation mark')
    while len(row) > len(header) and not row[-1]:
        row.pop()
    row += [''] * (len(header) - len(row)) if delimiter in ';\t' else []
    if len(row) != len(header):
        hint = ('; decimal commas need semicolons between the columns'
                if delimiter == ',' and len(row) > len(header) else '')
        raise MeasurementError(
            f'{path}, line {line}: {len(row)} cells separated by {DELIMITERS[delimiter]}, but the '
            f'header has {len(header)}; repair or delete this line{hint}')


def _decimal(measured: Sequence[Column], delimiter: str, table: Sequence[Sequence[str]]) -> str:
    """
    Return the decimal mark with which the columns can be read; raises MeasurementError.

    table: the cells of all columns, which decide if the required ones allow both marks.
    """
    if delimiter == ',':
        # What is in the first column, such as the number of a sample, ends no other one.
        halves = () if any('.' in cell for cells in table for cell in cells) else table[1:]
        for cells in (*(column.cells for column in measured), *halves):
            for cell, line in zip(cells, measured[0].lines, strict=True):
                if re.fullmatch(r'[-+]?0\d+', cell):
                    raise MeasurementError(
                        f'{measured[0].path}, line {line}: {cell!r} may be the end of another '
                        'number; decimal commas need semicolons between the columns; if they are '
                        'none, give --decimal .')
    excluded: dict[str, int] = {}
    unsure: list[tuple[int, Column]] = []
    for column in measured:
        for cell, line in zip(column.cells, column.lines, strict=True):
            if '.' not in cell and ',' not in cell:
                continue
            reads = _marks(cell)
            if len(reads) == 2 and _number(cell, '.') != _number(cell, ','):
                unsure.append((line, column))
            for mark in set(OTHER) - reads if reads else ():
                excluded.setdefault(mark, line)
    if len(excluded) == 2:
        raise MeasurementError(
            f'{measured[0].path}, lines {excluded[","]} and {excluded["."]}: decimal points and '
            'decimal commas in one file; export it with one of them')
    if excluded or not unsure:
        return _checked(measured, ',' if '.' in excluded else '.')
    line, column = unsure[0]
    cell = column.cells[column.lines.index(line)]
    # Columns that use the other mark otherwise, such as a time of day, 10.15, decide nothing.
    shared = ',' if ',' in cell else '.'
    votes = {mark for cells in table if any(shared in each for each in cells)
             for mark in _vote(cells)}
    if len(votes) == 1:
        return _checked(measured, votes.pop())
    if delimiter == ',' and not any(',' in cell for column in measured for cell in column.cells):
        return '.'
    raise MeasurementError(
        f'{column.path}, line {line}: {column.header} is {cell!r}, which may be '
        f'{_number(cell, "."):g} or {_number(cell, ","):g}: give the decimal mark '
        'with --decimal . or --decimal ,')


def _checked(measured: Sequence[Column], mark: str) -> str:
    """Return the mark; raises MeasurementError for a number that is an outlier with it."""
    for column in measured:
        # 4,800; 5.100; 5,400: one was corrected by hand.
        cells = [cell.replace(OTHER[mark], mark) if len(_marks(cell)) == 2 else cell
                 for cell in column.cells]
        if _jump(column.cells, mark) > JUMP and _jump(cells, mark) < STEP:
            line, cell = next((line, was) for line, was, cell in zip(
                column.lines, column.cells, cells, strict=True) if was != cell)
            raise MeasurementError(
                f'{column.path}, line {line}: {column.header} is {cell!r}, which is '
                f'{_number(cell, mark):g} with the decimal mark of the others, far from its '
                f'neighbours: correct it, or give --decimal {mark} if it is so')
    return mark


def _jump(cells: Sequence[str], mark: str) -> float:
    """Return the largest step over the range; nan where there is no range, or no number."""
    values = np.array([_number(cell, mark) for cell in cells])
    extent = np.ptp(values) if np.isfinite(values).all() else 0.0
    return float(np.abs(np.diff(values)).max() / extent) if 0.0 < extent < np.inf else np.nan


def _vote(cells: Sequence[str]) -> set[str]:
    """Return the decimal mark that a column of numbers proves; otherwise two or none."""
    filled = [cell for cell in cells if cell]
    allowed = set(OTHER).intersection(*map(_marks, filled))
    marks = {mark for mark in OTHER for cell in filled if mark in cell}
    if len(allowed) == 2 and len(marks) == 1:
        mark, = marks
        whole = any(mark not in cell and cell.strip('+-\u22120') for cell in filled)
        # 267 and 1.600: few formats drop decimals in one row and keep a 0 behind them in another.
        # Whole numbers of those lie among the others: 1, 1.110, 1.220.
        if whole and any(mark in cell and cell.endswith('0') for cell in filled):
            sizes = [max(abs(_number(cell, mark)) for cell in filled if (mark in cell) == marked)
                     for marked in (False, True)]
            if sizes[0] > AMONG * sizes[1]:
                return {OTHER[mark]}
    return allowed


def _marks(cell: str) -> set[str]:
    """Return the decimal marks with which a cell is a number."""
    return {mark for mark in '.,' if NUMBER[mark].fullmatch(cell)}


def _is_number(cell: str) -> bool:
    return bool(_marks(cell)) or cell.lower().lstrip('+-') in ('nan', 'inf', 'infinity')


def _kind(cell: str) -> str:
    """Return the kind of a cell, or nothing if it is empty."""
    return (NUMERIC if _is_number(cell) else DIGITS if re.search(r'\d', cell)
            else WORD if re.search(r'[^\W\d_]', cell) else '')


def _number(cell: str, decimal: str) -> float:
    """Return a number; nan if it is invalid with this decimal mark."""
    if not NUMBER[decimal].fullmatch(cell):
        return float('nan')
    return float(cell.translate(WRITTEN[decimal]))
