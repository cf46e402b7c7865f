# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Output of commands: tables on the screen, and files that overwrite nothing."""

from collections.abc import Iterable, Iterator, Sequence
import csv
from math import isfinite
import os
from pathlib import Path
import sys
from time import monotonic
from typing import TypeVar

from tqdm import tqdm

from soft_continuum.text import MAX_NAME, printable

T = TypeVar('T')
PROGRESS_PERIOD = 5.0  # s


class ResultError(RuntimeError):
    """A result cannot be written; the message says where and what to do."""


def reserve_outputs(directory: str | Path, names: Sequence[str], force: bool) -> tuple[Path, ...]:
    """
    Return the paths of results in a directory, which is created if it does not exist.

    Raises ResultError if one of them exists and may not be overwritten: before any work is done,
    and before any of them is written.
    """
    folder = Path(directory)
    paths = tuple(folder / name for name in names)
    there = [path for path in paths if os.path.lexists(path)]  # also a link that leads nowhere
    if there and not force:
        raise ResultError(f'{there[0]} exists; add --force to overwrite it, or choose another '
                          'directory with --output')
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultError(f'{folder}: cannot be made: {error.strerror}; choose another directory '
                          'with --output') from None
    return paths


def write_rows(path: Path, rows: Iterable[Sequence[object]]) -> None:
    """Write rows, the header first, as CSV; raises OSError."""
    with path.open('w', encoding='utf-8', newline='') as file:
        csv.writer(file, lineterminator='\n').writerows(rows)


def progress(items: Iterable[T], what: str, count: int | None = None) -> Iterator[T]:
    """
    Yield the items and show progress: by a bar, or by occasional lines in a pipe.

    count: number of items without a length.
    """
    total = count if count is not None else len(items)  # type: ignore[arg-type]
    if sys.stderr.isatty():
        yield from tqdm(items, what, total, leave=False)
        return
    shown = monotonic()
    for number, item in enumerate(items):
        if monotonic() - shown >= PROGRESS_PERIOD:
            shown = monotonic()
            print(f'{what}: {number} of {total}', file=sys.stderr, flush=True)
        yield item


def cell(value: float, unit: str = '', digits: str = '.2g') -> str:
    """Return a number for a table; - for nan and infinite ones."""
    return f'{value:{digits}}{unit}' if isfinite(value) else '-'


def text_table(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Return a table for the screen; all columns after ``left`` are aligned to the right."""
    cells = [[printable(cell, MAX_NAME) for cell in row] for row in (head, *rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(head))]
    lines = ['  '.join(cell.ljust(width) if k < left else cell.rjust(width)
                       for k, (cell, width) in enumerate(zip(row, widths, strict=True)))
             for row in cells]
    lines.insert(1, '  '.join('-' * width for width in widths))
    return '\n'.join(line.rstrip() for line in lines)
