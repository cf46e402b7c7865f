# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Results as Markdown, and their places in the documents."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date
import os
from pathlib import Path
import platform

DOCUMENTS = Path(__file__).parents[1] / 'docs'


@dataclass(frozen=True)
class Section:
    """The result of one benchmark: its document in docs, its place there, and its text."""

    document: str
    name: str
    body: str


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; all columns but the first are aligned to the right."""
    lines = [' | '.join(head), ' | '.join(['---', *['---:'] * (len(head) - 1)])]
    lines += [' | '.join(row) for row in rows]
    return '\n'.join(f'| {line} |' for line in lines)


def number(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, without an exponent where that is short."""
    if value == 0.0 or not 1e-3 <= abs(value) < 1e6:
        return f'{value:.{digits - 1}e}' if value else '0'
    places = max(0, digits - 1 - int(f'{value:e}'.split('e')[1]))
    return f'{value:,.{places}f}'


def machine() -> str:
    """
    Return a line that says where and when the numbers were made.

    The load is that of the last minute.
    """
    return (f'{_processor()}, {len(os.sched_getaffinity(0))} cores; {date.today().isoformat()}; '
            f'load {os.getloadavg()[0]:.1f}.')


def write(section: Section) -> Path:
    """
    Put a section's text between its markers in its document.

    Raises ValueError when the document does not have them.
    """
    path = DOCUMENTS / section.document
    begin, end = f'<!-- bench: {section.name} -->', f'<!-- end: {section.name} -->'
    text = path.read_text(encoding='utf-8')
    before, opened, rest = text.partition(begin)
    _, closed, after = rest.partition(end)
    if not (opened and closed):
        raise ValueError(f'{path} needs the lines {begin} and {end}, in this order')
    path.write_text(f'{before}{begin}\n{section.body}\n{end}{after}', encoding='utf-8')
    return path


def _processor() -> str:
    for line in Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines():
        name, _, value = line.partition(':')
        if name.strip() == 'model name':
            return value.strip()
    return platform.machine()
