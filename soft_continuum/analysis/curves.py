# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Force-displacement curves of a segment, one repetition after the other (paper, IV-A).

Repetitions are separate files, blocks of columns side by side, the values of a repetition column,
or one long record in which the displacement comes back to where it began.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from soft_continuum.analysis.delimited import (
    Column,
    FORCE_UNITS,
    LENGTH_UNITS,
    MeasurementError,
    Quantity,
    read_table,
    Table,
    TIME_UNITS,
)
from soft_continuum.mechanics.chain import Array

MIN_POINTS = 10  # on the way up, for a slope that means something
MAX_CURVES = 50
MAX_POINTS = 100_000  # of all curves together

FORCE = Quantity('force', ('force', 'load', 'kraft', 'f'), FORCE_UNITS)
DISPLACEMENT = Quantity(
    'displacement', ('displacement', 'travel', 'deflection', 'extension', 'crosshead', 'stroke',
                     'weg', 'verformung', 'durchbiegung', 'u'), LENGTH_UNITS)
TIME = Quantity('time', ('time', 'zeit', 't'), TIME_UNITS, required=False)
REPETITION = Quantity('repetition', ('repetition', 'cycle', 'zyklus', 'wiederholung'),
                      required=False)


@dataclass(frozen=True, eq=False)
class Curve:
    """
    One repetition: the way up, and down again where it was measured.

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
                units: Mapping[str, str] | None = None) -> tuple[Curve, ...]:
    """
    Read all repetitions from files.

    columns, units: by quantity (force, displacement, time, repetition), where the header does
    not say it.  Raises MeasurementError naming file, line and remedy.
    """
    curves: list[Curve] = []
    for path in paths:
        table = read_table(path, (FORCE, DISPLACEMENT, TIME, REPETITION), columns, units)
        forces = table.columns['force']
        if len(forces) == len(table.columns['displacement']) > 1:
            blocks = [_block(table, k) for k in range(len(forces))]
        else:
            blocks = _split(table)
        curves += [
            _curve(f'{table.path.name} #{k}' if len(blocks) > 1 else table.path.name, *block)
            for k, block in enumerate(blocks, start=1)]
        points = sum(len(curve.force) for curve in curves)
        if len(curves) > MAX_CURVES or points > MAX_POINTS:
            raise MeasurementError(
                f'{path}: with this file there are {len(curves)} repetitions of {points} points '
                f'in all; at most {MAX_CURVES} of {MAX_POINTS} points are compared: give fewer, '
                'or every tenth point; or is the displacement noise')
    return tuple(curves)


def _block(table: Table, place: int) -> tuple[Column, Array, Array]:
    """Return the columns of one of several repetitions that stand side by side."""
    force, displacement = table.columns['force'][place], table.columns['displacement'][place]
    if len(force.cells) != len(displacement.cells):
        line = min(force.lines[-1:] + displacement.lines[-1:], default=0) + 1
        raise MeasurementError(
            f'{table.path}, line {line}: repetition {place + 1} has {len(force.cells)} forces and '
            f'{len(displacement.cells)} displacements; repair the columns')
    return displacement, displacement.numbers(), force.numbers()


def _split(table: Table) -> list[tuple[Column, Array, Array]]:
    """Return the repetitions that stand below one another."""
    column = table.column('displacement')
    displacement, force = column.numbers(), table.column('force').numbers()
    if table.has('repetition'):
        labels = table.column('repetition').cells
        starts = [0, *(i for i in range(1, len(labels)) if labels[i] != labels[i - 1])]
    else:
        starts = _starts(displacement)
    if table.has('time'):
        _check_time(table.column('time'), starts)
    ends = [*starts[1:], len(force)]
    return [(Column(column.path, column.header, column.factor, column.cells[a:b],
                    column.lines[a:b], column.decimal), displacement[a:b], force[a:b])
            for a, b in zip(starts, ends, strict=True)]


def _starts(displacement: Array) -> list[int]:
    """Return where the displacement, back from more than half its range, rises again."""
    u = displacement * (1.0 if abs(displacement.max()) >= abs(displacement.min()) else -1.0)
    swing = 0.5 * (u.max() - u.min())
    starts, rising, extreme = [0], True, 0
    for i, value in enumerate(u):
        if rising:
            if value >= u[extreme]:
                extreme = i
            elif u[extreme] - value > swing:
                rising, extreme = False, i
        elif value <= u[extreme]:
            extreme = i
        elif value - u[extreme] > swing:
            starts.append(extreme)
            rising, extreme = True, i
    return starts


def _check_time(time: Column, starts: Sequence[int]) -> None:
    """Refuse time that steps back, other than where a repetition starts."""
    values = time.numbers()
    for i in np.flatnonzero(np.diff(values) < 0.0) + 1:
        if i not in starts:
            raise MeasurementError(
                f'{time.path}, line {time.lines[i]}: {time.header} steps back from '
                f'{time.cells[i - 1]} to {time.cells[i]} within a repetition; put the rows in '
                'order or the repetitions into files of their own')


def _curve(name: str, column: Column, displacement: Array, force: Array) -> Curve:
    where = f'{column.path}, line {column.lines[0] if column.lines else "?"}'
    # A machine that pushes counts both negative.
    if displacement.size and abs(displacement.min()) > abs(displacement.max()):
        displacement, force = -displacement, -force
    curve = Curve(name, displacement, force)
    up = curve.turn + 1 if displacement.size else 0
    if up < MIN_POINTS:
        raise MeasurementError(
            f'{where}: the repetition that starts here has {up} points up to its largest '
            f'displacement; {MIN_POINTS} or more are needed: measure it in smaller steps')
    if np.ptp(curve.loading[0]) == 0.0 or np.ptp(curve.loading[1]) == 0.0:
        raise MeasurementError(f'{where}: force or displacement does not change in the repetition '
                               'that starts here; check which columns were exported')
    return curve
