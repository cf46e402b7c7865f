# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A recorded run: one CSV file per kind of message, written line by line, so that nothing is lost.

Times count from the start of the recording.  Lengths are in mm, angles in degrees, tensions in N,
pressures in kPa absolute: files are for people and spreadsheets.
"""

import csv
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self, TextIO

import numpy as np

from soft_continuum.analysis.delimited import MeasurementError
from soft_continuum.mechanics.chain import Array

COLUMNS = {
    'tendons': ('time [s]', 'right pull [mm]', 'left pull [mm]'),
    'tensions': ('time [s]', 'right tension [N]', 'left tension [N]'),
    'points': ('time [s]', 'point', 'x [mm]', 'z [mm]', 'tangent [deg]'),
    'pressures': ('time [s]', 'segment', 'pressure [kPa]'),
    'stiff': ('time [s]', 'segment', 'stiff'),
    'events': ('time [s]', 'source', 'event'),
}
"""Columns by file, without its ending."""


class RecordingWriter:
    """Writes a recording into a directory; use it in a ``with`` statement."""

    def __init__(self, directory: Path) -> None:
        """Begin all files anew in ``directory``, which exists."""
        self._files: list[TextIO] = []
        self._writers = {}
        for name, columns in COLUMNS.items():
            file = (directory / f'{name}.csv').open('w', encoding='utf-8', newline='', buffering=1)
            self._files.append(file)
            self._writers[name] = csv.writer(file, lineterminator='\n')
            self._writers[name].writerow(columns)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 traceback: TracebackType | None) -> None:
        """Close the files."""
        for file in self._files:
            file.close()

    def write(self, name: str, time: float, *values: float | str) -> None:
        """Add a row to the file of that name; time: s."""
        self._writers[name].writerow(
            [f'{time:.4f}', *(v if isinstance(v, str) else f'{v:.6g}' for v in values)])


@dataclass(frozen=True)
class Held:
    """A shape that was held: its name, from when (s), points (k, 3) mm, degrees, pulls (2,) mm."""

    shape: str
    time: float
    points: Array
    pulls: Array


@dataclass(frozen=True)
class Recording:
    """What was recorded: rows by file (COLUMNS) as numbers, and events as (s, source, text)."""

    tendons: Array
    tensions: Array
    points: Array
    pressures: Array
    stiff: Array
    events: list[tuple[float, str, str]] = field(default_factory=list)

    def held_shapes(self) -> list[Held]:
        """Return every shape that was held, as it was when its holding began."""
        found = []
        for time, source, text in self.events:
            shape, _, phase = text.partition(': ')
            if source != 'progress' or not phase.startswith('holding') or not len(self.tendons):
                continue
            rows = self.points[self.points[:, 0] <= time + 0.2]
            if not len(rows):
                continue
            last = rows[rows[:, 0] == rows[-1, 0]]
            pulls = self.tendons[self.tendons[:, 0] <= time + 0.2][-1, 1:]
            found.append(Held(shape, time, last[:, 2:], pulls))
        return found


def read_recording(directory: Path) -> Recording:
    """Read what RecordingWriter wrote; raises MeasurementError naming file and line."""
    numbers = {name: _numbers(directory / f'{name}.csv', columns)
               for name, columns in COLUMNS.items() if name != 'events'}
    path = directory / 'events.csv'
    events = []
    for line, row in _rows(path, COLUMNS['events']):
        events.append((_number(path, line, row[0]), row[1], row[2]))
    return Recording(**numbers, events=events)


def _rows(path: Path, columns: tuple[str, ...]) -> list[tuple[int, list[str]]]:
    try:
        with path.open(encoding='utf-8', newline='') as file:
            rows = list(enumerate(csv.reader(file), start=1))
    except OSError as error:
        raise MeasurementError(f'{path}: {error.strerror}; give the directory that the command '
                               'record has written') from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise MeasurementError(f'{path}: not a recording: {error}') from None
    if not rows or tuple(rows[0][1]) != columns:
        raise MeasurementError(f'{path}: line 1 must be: {",".join(columns)}')
    for line, row in rows[1:]:
        if len(row) != len(columns):
            if line == len(rows):  # what a killed recorder had not written to the end
                return rows[1:-1]
            raise MeasurementError(f'{path}: line {line} has {len(row)} fields instead of '
                                   f'{len(columns)}; mend or remove it')
    return rows[1:]


def _numbers(path: Path, columns: tuple[str, ...]) -> Array:
    rows = [[_number(path, line, text) for text in row] for line, row in _rows(path, columns)]
    return np.array(rows).reshape(len(rows), len(columns))


def _number(path: Path, line: int, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise MeasurementError(f'{path}: line {line}: {text!r} is not a number; mend or remove '
                               'the line') from None
