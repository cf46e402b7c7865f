# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a command leaves behind: tables on the screen, files that overwrite nothing."""

from collections.abc import Iterable, Sequence
from pathlib import Path


class ResultError(RuntimeError):
    """A result cannot be written; the message says where and what to do."""


def claim(directory: str | Path, names: Sequence[str], force: bool) -> tuple[Path, ...]:
    """
    Return the paths of results in a directory, which is made when it does not exist.

    Raises ResultError when one of them exists and may not be overwritten: before any work is
    done, and before any of them is written.
    """
    folder = Path(directory)
    paths = tuple(folder / name for name in names)
    there = [path for path in paths if path.exists()]
    if there and not force:
        raise ResultError(f'{there[0]} exists; add --force to overwrite it, or choose another '
                          'directory with --output')
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultError(f'{folder}: cannot be made: {error.strerror}; choose another directory '
                          'with --output') from None
    return paths


def text_table(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Return a table for the screen; all columns after ``left`` are aligned to the right."""
    cells = [list(head), *(list(row) for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(head))]
    lines = ['  '.join(cell.ljust(width) if k < left else cell.rjust(width)
                       for k, (cell, width) in enumerate(zip(row, widths, strict=True)))
             for row in cells]
    lines.insert(1, '  '.join('-' * width for width in widths))
    return '\n'.join(line.rstrip() for line in lines)
