# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Paths of the tip from files."""

from math import pi
from pathlib import Path

from soft_continuum.analysis.delimited import MeasurementError, Quantity, read_table
from soft_continuum.cli.tip_options import MAX_POSITION
from soft_continuum.client.tip import Tip

MAX_POINTS = 200
"""The maximum that shape_sequencer accepts."""


def read_tip_path(path: Path, unit: str = 'm', tolerance: float = 0.0,
                  decimal: str | None = None) -> list[Tip]:
    """
    Return the goals of a CSV file with the columns x, z, and optionally y and angle.

    unit: of lengths if the header has none; angles are then in degrees.  tolerance: m, 0 for the
    default.  decimal: the mark, if the numbers are ambiguous.  Raises MeasurementError naming
    file, line and remedy.
    """
    table = read_table(path, [
        Quantity('x', ('x',), 'm'), Quantity('z', ('z',), 'm'),
        Quantity('y', ('y',), 'm', required=False),
        Quantity('angle', ('angle',), 'rad', required=False)],
        usual={'x': unit, 'y': unit, 'z': unit, 'angle': 'deg'}, decimal=decimal)
    names = [name for name in 'xyz' if table.has(name)]
    rows = list(zip(*(table.column(name).numbers().tolist() for name in names), strict=True))
    if len(rows) > MAX_POINTS:
        raise MeasurementError(f'{path}: {len(rows)} points; allowed: {MAX_POINTS}; leave some '
                               'out, such as every second one')
    for number, row in enumerate(rows, start=1):
        for name, value in zip(names, row, strict=True):
            if abs(value) > MAX_POSITION:
                raise MeasurementError(
                    f'{path}: {name} of point {number} is {value:g} m; allowed: up to '
                    f'{MAX_POSITION:g} m; in mm? use --unit mm, or {name} [mm] in the header')
    angles = (table.column('angle').numbers().tolist() if table.has('angle')
              else [None] * len(rows))
    for number, angle in enumerate(angles, start=1):
        if angle is not None and abs(angle) > 2.0 * pi:
            raise MeasurementError(f'{path}: the angle of point {number} is {angle:g} rad; '
                                   'allowed: one turn either way')
    return [Tip(row, angle, tolerance=tolerance)
            for row, angle in zip(rows, angles, strict=True)]
