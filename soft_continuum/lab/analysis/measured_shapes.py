# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Shapes set on a rig: the pulls, step by step, and the measured points of the arm.

Two files.  Points, in the frame of the base (origin at the bottom centre of the base disc, z along
the straight arm, x to the right tendon): shape, point (1 is the bottom of the base disc, then
bottom and top of each disc), x, z.  Pulls: shape, soft segment, pull of the right and the left
tendon relative to the straight arm, or the word slack; and optionally the commanded bending angle
and the payload at the tip.

For spatial arms points also have y, and pulls have a column for each tendon of the description;
without jamming there is no soft segment column: all are soft.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from soft_continuum.lab.analysis.delimited import (
    Column,
    MeasurementError,
    Quantity,
    read_table,
    Table,
)
from soft_continuum.mechanics import Arm, Equilibrium, SLACK, Statics, StaticsError
from soft_continuum.mechanics.arm import Array

BASE_TOLERANCE = 0.005  # m: the base disc cannot be further from where the frame has it
BENT_LENGTH = 0.75  # of a segment, straight from end to end when it is bent by about 150 degrees
MAX_SHAPES = 100
MAX_STEPS = 100  # of one shape

SHAPE = Quantity('shape', ('shape', 'form'))
SEGMENT = Quantity('segment', ('segment',))
IN_GERMAN = {'right': ('rechts',), 'left': ('links',)}
OPTIONAL = (
    Quantity('angle', ('angle', 'winkel'), 'rad', required=False),
    Quantity('payload', ('payload', 'nutzlast'), 'kg', required=False),
)


@dataclass(frozen=True)
class Step:
    """
    One segment (0-based) is soft while the tendons move to pulls (tendons,), m, or SLACK.

    segment: None if all are soft.  angle: commanded bending angle, rad; nan without one.
    """

    segment: int | None
    pulls: tuple[float, ...]
    angle: float = np.nan

    def soft(self, segments: int) -> tuple[bool, ...]:
        """Return which segments are soft."""
        return tuple(self.segment in (None, i) for i in range(segments))


@dataclass(frozen=True, eq=False)
class MeasuredShape:
    """
    One shape: its steps, and the measured calculation points.

    numbers: (m,) of the points, 0 for the bottom of the base disc.  positions: (m, 3), m; nan if
    not measured, as y of a planar arm.  payload: kg.
    """

    name: str
    steps: tuple[Step, ...]
    numbers: tuple[int, ...]
    positions: Array
    payload: float = 0.0

    @property
    def moving(self) -> list[int]:
        """Which rows of positions are not of the base disc, which is fixed."""
        return [row for row, number in enumerate(self.numbers) if number > 1]

    @property
    def coordinates(self) -> int:
        """Number of measured coordinates of moving points."""
        return int(np.isfinite(self.positions[self.moving]).sum())

    def misses(self, points: Array) -> Array:
        """
        Return the errors of the moving points, (m, 3), m; nan: not measured.

        points: bottom and top centre of every disc, base first, (2 * discs, 3), m.
        """
        there = points[[self.numbers[row] for row in self.moving]]
        missed: Array = there - self.positions[self.moving]
        return missed

    def errors(self, points: Array) -> Array:
        """Return the distances of the moving points from the measured ones, m."""
        distances: Array = np.linalg.norm(np.nan_to_num(self.misses(points)), axis=1)
        return distances


def read_shapes(points: str | Path, pulls: str | Path, arm: Arm, jamming: bool = True,
                decimal: str | None = None) -> tuple[MeasuredShape, ...]:
    """
    Read the shapes of a points file and a pulls file, in the order of the points file.

    jamming: whether one segment was soft at a time.  decimal: the mark, where
    the numbers allow both.  Raises MeasurementError naming file, line and remedy.
    """
    axes = arm.axes
    measured = _read_points(read_table(points, (
        SHAPE, Quantity('point', ('point', 'punkt')),
        *(Quantity(axis, (axis,), 'm') for axis in axes)), decimal=decimal), axes, arm)
    tendons = [Quantity(name, (name, *IN_GERMAN.get(name, ())), 'm') for name in arm.tendon_labels]
    pulled = _read_pulls(
        read_table(pulls, (SHAPE, *((SEGMENT,) if jamming else ()), *tendons, *OPTIONAL),
                   {name: name for name in arm.tendon_labels if name not in IN_GERMAN},
                   decimal=decimal), arm, jamming)
    for name in measured:
        if name not in pulled:
            raise MeasurementError(f'{pulls}: has no rows for shape {name!r} of {points}; it has '
                                   f'{", ".join([*pulled][:10])}')
    if len(measured) > MAX_SHAPES:
        raise MeasurementError(f'{points}: has {len(measured)} shapes; at most {MAX_SHAPES} are '
                               'computed: divide it among several files')
    shapes = []
    for name, rows in measured.items():
        positions = np.full((len(rows), 3), np.nan)
        positions[:, arm.pose_axes[:3]] = list(rows.values())
        shapes.append(MeasuredShape(name, pulled[name][0], tuple(rows), positions,
                                    pulled[name][1]))
    return tuple(shapes)


def _read_points(table: Table, axes: str, arm: Arm
                 ) -> dict[str, dict[int, tuple[float, ...]]]:
    names, numbers = table.column('shape'), table.column('point')
    most = 2 * len(arm.discs)
    shapes: dict[str, dict[int, tuple[float, ...]]] = {}
    places = np.column_stack([table.column(axis).numbers() for axis in axes])
    for name, number, place, line in zip(
            names.cells, numbers.whole_numbers(), places, names.lines, strict=True):
        where = f'{table.path}, line {line}'
        if not 1 <= number <= most:
            raise MeasurementError(f'{where}: there is no point {number}; this arm has 1 to '
                                   f'{most}, bottom and top of each disc')
        rows = shapes.setdefault(name, {})
        if number - 1 in rows:
            raise MeasurementError(f'{where}: point {number} of shape {name!r} is given twice; '
                                   'give repeated measurements names of their own')
        shown = ', '.join(f'{value:.4g}' for value in place)
        if np.linalg.norm(place) > 2.0 * arm.length:
            raise MeasurementError(
                f'{where}: ({shown}) m is further away than the arm is long '
                f'({arm.length:.4g} m); is the unit in the header right')
        at_base = np.append(np.zeros(len(axes) - 1), 0.0 if number == 1 else arm.discs[0].height)
        if number <= 2 and np.linalg.norm(place - at_base) > BASE_TOLERANCE:
            raise MeasurementError(
                f'{where}: point {number} of the base disc is at ({shown}) m; it must be at '
                f'({", ".join(f"{value:g}" for value in at_base)}): transform the points to the '
                'frame of the base disc')
        rows[number - 1] = tuple(place.tolist())
    for name, rows in shapes.items():
        if max(rows) <= 1:
            raise MeasurementError(f'{table.path}: shape {name!r} has points of the base disc '
                                   'only; measure the discs that move')
        _check_lengths(f'{table.path}: shape {name!r}', rows, arm)
    last = max(map(max, shapes.values()))
    if last < most - 2:
        raise MeasurementError(
            f'{table.path}: no shape has a point above {last + 1}, of disc {last // 2 + 1}; this '
            f'arm has {len(arm.discs)} discs: give the arm that was measured as --params-file, or '
            f'measure point {most - 1} or {most} at least once')
    return shapes


def _check_lengths(where: str, rows: Mapping[int, tuple[float, ...]], arm: Arm) -> None:
    """Raise MeasurementError if discs or segments differ in length from the arm."""
    for one in sorted(rows):
        if one + 1 not in rows:
            continue
        length = float(np.linalg.norm(np.subtract(rows[one + 1], rows[one])))
        if one % 2:
            part = f'segment {one // 2 + 1}'
            most = arm.segments[one // 2].length
            least = BENT_LENGTH * most
        else:
            part = f'disc {one // 2 + 1}'
            least = most = arm.discs[one // 2].height
        if not least - BASE_TOLERANCE <= length <= most + BASE_TOLERANCE:
            raise MeasurementError(
                f'{where}: points {one + 1} and {one + 2} are {1e3 * length:.4g} mm apart, but '
                f'{part} of this arm is {1e3 * most:.4g} mm long: give the arm that was measured '
                'as --params-file, or correct the points')


def _read_pulls(table: Table, arm: Arm, jamming: bool
                ) -> dict[str, tuple[tuple[Step, ...], float]]:
    names = table.column('shape')
    segments = (table.column('segment').whole_numbers() if jamming else [None] * len(names.cells))
    steps: dict[str, list[Step]] = {}
    payload: dict[str, float] = {}
    for name, segment, angle, mass, pulls, line in zip(
            names.cells, segments, table.numbers('angle', np.nan), table.numbers('payload', 0.0),
            zip(*(_pulls(table.column(t)) for t in arm.tendon_labels), strict=True),
            names.lines,
            strict=True):
        where = f'{table.path}, line {line}'
        if segment is not None and not 1 <= segment <= len(arm.segments):
            raise MeasurementError(f'{where}: there is no segment {segment}; this arm has 1 to '
                                   f'{len(arm.segments)}')
        if any(pull > arm.length for pull in pulls):
            raise MeasurementError(
                f'{where}: a pull of {max(pulls):.4g} m is more than the arm is long '
                f'({arm.length:.4g} m); is the unit in the header right')
        if payload.setdefault(name, mass) != mass:
            raise MeasurementError(f'{where}: the payload of shape {name!r} changes from step to '
                                   'step; give the shape one payload')
        if len(steps.setdefault(name, [])) == MAX_STEPS:
            raise MeasurementError(f'{where}: shape {name!r} has more than {MAX_STEPS} steps; '
                                   'give repeated measurements names of their own')
        steps[name].append(Step(None if segment is None else segment - 1, pulls, angle))
    return {name: (tuple(rows), payload[name]) for name, rows in steps.items()}


def _pulls(column: Column) -> list[float]:
    """Return pulls in m; the word slack is SLACK."""
    slack = [cell.lower() == 'slack' for cell in column.cells]
    cells = tuple('0' if s else cell for s, cell in zip(slack, column.cells, strict=True))
    values = replace(column, cells=cells).numbers().tolist()
    return [SLACK if s else value for s, value in zip(slack, values, strict=True)]


def sliding(start: Equilibrium, step: Step) -> tuple[int, ...]:
    """Return the sliding of tendons in a step: 1 to the base, -1 to the tip, 0 slack."""
    return tuple(0 if pull == SLACK else 1 if pull > before else -1
                 for pull, before in zip(step.pulls, start.pulls.tolist(), strict=True))


def simulate_steps(statics: Statics, steps: Sequence[Step], name: str = '') -> list[Equilibrium]:
    """
    Return the equilibrium after each step, from the straight arm.

    Raises StaticsError naming shape and step.
    """
    state: Equilibrium = statics.chain.straight()
    states: list[Equilibrium] = []
    for number, step in enumerate(steps, start=1):
        try:
            state = statics.solve(state, step.pulls, step.soft(statics.chain.segments),
                                  sliding=sliding(state, step))
        except StaticsError as error:
            what = ('all segments' if step.segment is None else f'segment {step.segment + 1}')
            raise StaticsError(f'shape {name}, step {number} ({what} soft): {error}', error.state
                               ) from None
        states.append(state)
    return states
