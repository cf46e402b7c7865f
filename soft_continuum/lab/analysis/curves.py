# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Force-displacement curves of a segment, one per repetition (paper, IV-A).

Repetitions are separate files, blocks with one header below or beside one another, the values of a
repetition column, or one long record in which the displacement returns to its start.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
import re

import numpy as np

from soft_continuum.lab.analysis.delimited import (
    Column,
    MeasurementError,
    Quantity,
    read_table,
    Table,
)
from soft_continuum.mechanics.arm import Array
from soft_continuum.text import MAX_NAME, printable

MIN_POINTS = 10  # on the way up, for a slope that means something
SWING = 0.5  # of the range, or of the rise before: a fall between two repetitions
RISE = 0.2  # of that fall: a rise after it
LEAST_SWING = 0.1  # of the range: a smaller one finds the zero
NOISE = 6.0  # median second differences: a smaller one is noise
JUMP = 0.5  # of the range: a row is wrong that differs by more from those before and after
GAP = 0.75  # of the range: rows beyond are overflows, or marks of missing values
NEW_PAGE = 0.1  # of the range: a block that begins higher goes on with the one before
MAX_CURVES = 50
MAX_POINTS = 100_000  # of all curves together

FORCE = Quantity('force', ('force', 'load', 'kraft', 'f', 'forza', 'carico', 'fuerza', 'carga',
                           'forca', 'kracht'), 'N', options=True)
DISPLACEMENT = Quantity(
    'displacement', ('displacement', 'travel', 'deflection', 'extension', 'crosshead', 'stroke',
                     'position', 'weg', 'verformung', 'durchbiegung', 'u', 'deplacement',
                     'spostamento', 'corsa', 'desplazamiento', 'deslocamento', 'verplaatsing',
                     'deformation', 'distance', 'disp', 'displ'),
    'm', options=True)
TIME = Quantity('time', ('time', 'zeit', 't', 'temps', 'tempo', 'tiempo'), required=False,
                options=True)
REPETITION = Quantity('repetition', ('repetition', 'cycle', 'cycles', 'zyklus', 'zyklen',
                                     'wiederholung', 'specimen'), required=False, options=True)
SPECIMEN = (r'(?:specimen|sample|(?:probe|pr\u00fcf)k\u00f6rper|pr\u00fcfling|probe|muestra|'
            r'provino|[\u00e9e]prouvette|repetition|replicate|wiederholung|piece)'
            r'[\W_]*(?:no|nr)?[\W_]*')
RUN = r'(?:test|run|trial|cycle|zyklus|versuch|messung|measurement|essai|ensayo|prova)[\W_]*'
NAMED = rf'(?:{SPECIMEN}|{RUN})+(?:\d[\d\W_]*|[a-z])|\d+ ?_ ?\d+'
"""Names above repeated headers that are those of specimens: Sample A, Test 1, 1 _ 2."""


@dataclass(frozen=True, eq=False)
class Curve:
    """
    One repetition: loading, and unloading if it was measured.

    displacement: (points,) m.  force: (points,) N.  name: file and repetition.
    """

    name: str
    displacement: Array
    force: Array

    @property
    def turn(self) -> int:
        """Index of the largest displacement, where loading ends."""
        return int(np.argmax(self.displacement))

    @property
    def loading(self) -> tuple[Array, Array]:
        """Displacement (m) and force (N) up to the largest displacement."""
        return self.displacement[:self.turn + 1], self.force[:self.turn + 1]

    @property
    def unloading(self) -> tuple[Array, Array]:
        """Displacement (m) and force (N) from the largest displacement on; one point if none."""
        return self.displacement[self.turn:], self.force[self.turn:]


def read_curves(paths: Sequence[str | Path], columns: Mapping[str, str] | None = None,
                units: Mapping[str, str] | None = None, decimal: str | None = None
                ) -> tuple[Curve, ...]:
    """
    Read all repetitions from files.

    columns, units: by quantity (force, displacement, time, repetition), if missing in the
    header.  decimal: the mark, if the numbers allow both.  Raises MeasurementError naming
    file, line and remedy.
    """
    curves: list[Curve] = []
    for path in paths:
        table = read_table(path, (FORCE, DISPLACEMENT, TIME, REPETITION), columns, units,
                           decimal=decimal)
        parts = [part for sides in _sides(table) for block in _whole(table, *sides)
                 for part in _split(table, *sides, *block)]
        curves += [
            _curve(f'{table.path.name} #{k}' if len(parts) > 1 else table.path.name, *part)
            for k, part in enumerate(parts, start=1)]
        points = sum(len(curve.force) for curve in curves)
        if len(curves) > MAX_CURVES or points > MAX_POINTS:
            raise MeasurementError(
                f'{path}: with this file there are {len(curves)} repetitions of {points} points '
                f'in all; at most {MAX_CURVES} of {MAX_POINTS} points are compared: give fewer, '
                'or every tenth point; or is the displacement noise')
    return tuple(curves)


def _sides(table: Table) -> list[tuple[Column, Column]]:
    """Return displacement and force, for each repetition if headers repeat them."""
    found = table.columns['displacement'], table.columns['force']
    if len(found[0]) == len(found[1]) and all(
            len({column.header for column in columns}) == 1 for columns in found):
        sides = list(zip(*found, strict=True))
        _check_alike(table, sides)
    else:
        sides = [(table.column('displacement'), table.column('force'))]
    for side in sides:
        _check_clocks(table.columns['time'], *sorted(side, key=lambda column: column.number))
    return sides


def _check_clocks(times: Sequence[Column], first: Column, second: Column) -> None:
    """Raise an error if each of two columns stands behind its own time and these differ."""
    own = [[time for time in times if after < time.number < column.number][-1:]
           for after, column in ((0, first), (first.number, second))]
    for one, other in zip(*own, strict=False):
        try:
            differ = one.numbers() != other.numbers()
        except MeasurementError:  # the time of day
            differ = np.array(one.cells) != np.array(other.cells)
        for row in np.flatnonzero(differ)[:1]:
            raise MeasurementError(
                f'{first.path}, line {first.lines[row]}: {first.header} was taken at '
                f'{one.cells[row]} and {second.header} at {other.cells[row]}; export both at the '
                'same times, or delete the column of times that is none of them')


def _check_alike(table: Table, sides: Sequence[tuple[Column, Column]]) -> None:
    """Raise an error for repeated columns that another row names differently: channels."""
    places = [[column.number - 1 for column in side] for side in sides]
    # In English a probe is a sensor.
    kind = NAMED if 'kraft' in sides[0][1].header.lower() else NAMED.replace('|probe|', '|')
    if len({_length(side) for side in sides}) > 1:
        kind = '.*'  # channels would end together
    named = any(_name_specimens(row, places, kind) for _, row in table.above)
    numbered = rf'{kind}|(?:no|nr)?\W*\d+(?: ?- ?\d+)?'
    for rows, are_below in ((table.below, True), (() if named else table.above, False)):
        for line, row in rows:
            cells, over = _over(row, places)
            # A title has nothing above the other sides.
            if (are_below or any(cells[max(places[0]) + 1:])) and any(
                    [said[k] for k in place] != [said[k] for k in places[0]]
                    for place in places for said in ((cells, over) if are_below else (over,))
                    ) and not _name_specimens(row, places, numbered):
                choices = ' and '.join(
                    f'--{quantity.name}-column {" or ".join(str(c.number) for c in columns)}'
                    for quantity, columns in zip((DISPLACEMENT, FORCE), zip(*sides, strict=True),
                                                 strict=True))
                raise MeasurementError(
                    f'{table.path}, line {line}: columns with one header are not called the same '
                    f'here ({", ".join(repr(printable(cell, MAX_NAME)) for cell in row if cell)}),'
                    f' so they may be several channels: give the numbers of the columns, {choices}'
                    '; if they are repetitions, call them Specimen 1, Specimen 2 there')


def _over(row: Sequence[str], places: Sequence[Sequence[int]]) -> tuple[list[str], list[str]]:
    """Return the cells of a row, and what stands over each column: in it, or before it."""
    cells = [*row, *[''] * (max(map(max, places)) + 1 - len(row))]
    # One name stands over all the columns of a side, in the first of them.
    return cells, [next((cell for cell in reversed(cells[:k + 1]) if cell), '')
                   for k in range(len(cells))]


def _length(side: Sequence[Column]) -> int:
    """Return how many rows a side fills."""
    return max(k for k, cells in enumerate(zip(*(c.cells for c in side), strict=True), 1)
               if k == 1 or any(cells))


def _name_specimens(row: Sequence[str], places: Sequence[Sequence[int]], kind: str) -> bool:
    """Return whether cells of this kind name the specimen of each side, or any cells behind it."""
    cells, over = _over(row, places)
    names = [{over[k] for k in place} for place in places]
    said = set.union(*names)
    labels = {*cells} - said - {''}
    return (max(map(len, names)) == 1 and len(said) == len(places) and all(
        re.fullmatch(of, name[:MAX_NAME], re.IGNORECASE) for of, name in (
            [(SPECIMEN, label) for label in labels] or [(kind, name) for name in said])))


def _whole(table: Table, *side: Column) -> list[tuple[int, int]]:
    """
    Return the blocks, joined where a new page repeats the header within a repetition.

    side: displacement and force, of which one jumps where another specimen begins.
    """
    if len(table.blocks) == 1:  # sides of other lengths end in empty cells
        return [*table.blocks]
    displacement, force = (column.numbers() for column in side)
    whole = [table.blocks[0]]
    for start, end in table.blocks[1:]:
        begin = whole[-1][0]
        at, f = start - begin, force[begin:end]
        u = _upwards(displacement[begin:end], f) * displacement[begin:end]
        if u[at] - u.min() > NEW_PAGE * np.ptp(u) and not (_jumps(u, at) or _jumps(f, at)):
            whole[-1] = (begin, end)
        else:
            whole.append((start, end))
    return whole


def _split(table: Table, displacement: Column, force: Column, start: int, end: int
           ) -> list[tuple[Column, Array, Array]]:
    """Return the successive repetitions in the rows of a block."""
    # Repetitions side by side differ in length.
    while (len(table.columns['force']) > 1 and end > start
           and not displacement.cells[end - 1] and not force.cells[end - 1]):
        end -= 1
    if end == start:
        return []
    column = displacement.part(start, end)
    u, f = (_checked(side.part(start, end)) for side in (displacement, force))
    labels = {_changes(c.part(start, end).cells) for c in table.columns['repetition']}
    first = [0, *labels.pop()] if len(labels) == 1 else [0]
    starts = []
    for a, b in zip(first, [*first[1:], len(u)], strict=True):
        u[a:b], f[a:b] = _upwards(u[a:b], f[a:b]) * np.array((u[a:b], f[a:b]))
        falls = np.argmax(u[a:b]) < NEW_PAGE * (b - a)  # half cycles may be counted
        if not a or not falls or any(_jumps(values[:b], a) for values in (u, f)):
            starts += [a + k for k in _starts(u[a:b])]
    if len(times := table.columns['time']) == 1:
        _check_time(times[0].part(start, end), starts)
    ends = [*starts[1:], len(u)]
    # A machine counts the end of the last cycle as another one.
    if len(starts) > 1 and ends[-1] - starts[-1] < min(MIN_POINTS, (ends[-2] - starts[-2]) / 2):
        starts.pop()
        ends.pop()
    # It may count a few rows before or after the reversal, unless another specimen begins there.
    tops = [a + int(np.argmax(u[a:b])) for a, b in zip(starts, ends, strict=True)]
    starts[1:] = ends[:-1] = [
        here if any(_jumps(values[start:end], here - start) for values in (u, f))
        else b - int(np.argmin(u[a:b + 1][::-1]))
        for start, here, end, a, b in zip(starts, starts[1:], ends[1:], tops, tops[1:],
                                          strict=False)]
    return [(column.part(a, b), u[a:b], f[a:b]) for a, b in zip(starts, ends, strict=True)]


def _checked(column: Column) -> Array:
    """Return the numbers; raises MeasurementError for one that is unlike both neighbours."""
    values = column.numbers()
    steps = np.diff(values) / (np.ptp(values) or 1.0)
    for row in np.flatnonzero((steps[:-1] * steps[1:] < 0.0) & (
            np.minimum(abs(steps[:-1]), abs(steps[1:])) > JUMP))[:1] + 1:
        raise MeasurementError(
            f'{column.path}, line {column.lines[row]}: {column.header} is {column.cells[row]!r}, '
            'far from the rows before and after; delete this line')
    return values


def _changes(cells: Sequence[str]) -> tuple[int, ...]:
    return tuple(i for i in range(1, len(cells)) if cells[i] != cells[i - 1])


def _jumps(values: Array, at: int) -> bool:
    """Return whether a row is farther from the one before than others by more than twice."""
    steps = np.abs(np.diff(values))
    return bool(steps[at - 1] > 2.0 * np.delete(steps, at - 1).max(initial=0.0))


def _upwards(displacement: Array, force: Array) -> float:
    """Return -1 if a machine that pushes counts displacement and force downwards."""
    away = 1.0 if abs(displacement.max()) >= abs(displacement.min()) else -1.0
    extent = np.ptp(displacement)
    ahead = displacement[np.argmax(np.abs(force))] - displacement[0]
    # Positions of the machine have their zero elsewhere.
    is_position = abs(displacement[0]) > NEW_PAGE * extent and abs(ahead) > SWING * extent
    return float(np.sign(ahead)) if is_position else away


def _starts(u: Array) -> list[int]:
    """
    Return where the displacement, after falling, rises again.

    It falls by half the range, or by half the rise before: loops may grow.  A cycle of few points
    below half the range belongs to the one beside it.
    """
    swing = SWING * np.ptp(u)
    noise = float(np.median(np.abs(np.diff(u, 2, prepend=u[:1], append=u[-1:]))))
    least = max(LEAST_SWING * np.ptp(u), NOISE * noise)
    turns, extreme, upwards, share = [0], 0, 1.0, SWING
    for i, value in enumerate(u):
        if upwards * (value - u[extreme]) >= 0.0:
            extreme = i
        elif abs(value - u[extreme]) > min(swing, max(
                least, share * abs(u[extreme] - u[turns[-1]]))):
            turns.append(extreme)
            extreme, upwards, share = i, -upwards, RISE if upwards > 0.0 else SWING
    cycles = list(zip(turns[::2], [*turns[1::2], extreme], strict=False))
    close = NEW_PAGE * np.ptp(u)
    if len(turns) % 2 and u[turns[-1]] < u[0] - close and u[extreme] < u[0] + close:
        cycles.pop()  # the way back from the other side to where it began
    whole = [top - start >= MIN_POINTS - 1 or u[top] - u[start] > swing for start, top in cycles]
    return [0, *(start for (start, _), before, own in zip(cycles[1:], whole, whole[1:],
                                                          strict=False) if before and own)]


def _check_time(time: Column, starts: Sequence[int]) -> None:
    """Raise an error if time steps back except where a repetition or its clock starts."""
    try:
        values = time.numbers()
    except MeasurementError:  # not needed
        return
    for i in np.flatnonzero(np.diff(values) < 0.0) + 1:
        if i not in starts and values[i] > values[0]:
            raise MeasurementError(
                f'{time.path}, line {time.lines[i]}: {time.header} steps back from '
                f'{time.cells[i - 1]} to {time.cells[i]} within a repetition; put the rows in '
                'order or the repetitions into files of their own')


def _curve(name: str, column: Column, displacement: Array, force: Array) -> Curve:
    where = f'{column.path}, line {column.lines[0]}'
    for values in (displacement, force) if len(force) >= MIN_POINTS else ():
        order = np.argsort(values)
        gap = int(np.argmax(np.diff(values[order])))
        if values[order[gap + 1]] - values[order[gap]] > GAP * np.ptp(values):
            row = min(order[gap + 1:], order[:gap + 1], key=len).min()
            raise MeasurementError(
                f'{column.path}, line {column.lines[row]}: displacement or force is far from the '
                'other rows; delete this line, or export in smaller steps')
    curve = Curve(name, displacement, force)
    up = curve.turn + 1
    if up < MIN_POINTS:
        raise MeasurementError(
            f'{where}: the repetition that starts here has {up} points up to its largest '
            f'displacement; {MIN_POINTS} or more are needed: measure it in smaller steps, or '
            'delete an incomplete cycle')
    if np.ptp(curve.loading[0]) == 0.0 or np.ptp(curve.loading[1]) == 0.0:
        raise MeasurementError(f'{where}: force or displacement does not change in the repetition '
                               'that starts here; check which columns were exported')
    return curve
