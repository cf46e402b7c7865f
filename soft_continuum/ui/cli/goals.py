# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Goals on the command line: bending angles, the tip and its path."""

from argparse import ArgumentTypeError, Namespace
from math import degrees, inf, isfinite, pi, radians
from pathlib import Path
from typing import TYPE_CHECKING

from soft_continuum.client import Tip
from soft_continuum.parameters.arguments import number_in, Parser

if TYPE_CHECKING:
    from soft_continuum.client.sequence import Bending

UNITS = {'m': 1.0, 'cm': 1e-2, 'mm': 1e-3}
MAX_POSITION = 10.0  # m
MAX_POINTS = 200  # of a path; shape_sequencer accepts no more


def parse_bendings(text: str) -> tuple['Bending', ...]:
    """Read ``10,20,30`` or ``10,20@120,30@-60`` in degrees; return rad."""
    try:
        values = tuple(tuple(radians(float(number)) for number in part.split('@'))
                       for part in text.split(','))
    except ValueError:
        values = ((),)
    if not all(len(value) in (1, 2) and all(map(isfinite, value)) for value in values):
        raise ArgumentTypeError(
            f'{text!r} given; needed: a bending angle in degrees for each segment, such as '
            '10,20,30; for spatial arms with a direction, such as 10@0,20@120,30@-60')
    return tuple(value[0] if len(value) == 1 else (value[0], value[1]) for value in values)


def add_tip(parser: Parser, needed: bool = True) -> None:
    """Add the options of one goal of the tip; needed: whether its position is required."""
    parser.add_argument('position', nargs='+' if needed else '*', type=_number, metavar='X [Y] Z',
                        help='position of the tip in base_link: x and z, or x, y and z')
    add_unit(parser, 'position and tolerance')
    parser.add_argument('--angle', type=number_in(-360.0, 360.0, 'degrees'), metavar='DEG',
                        help='direction of the tip in the plane of x and z: degrees from z '
                        'towards x')
    parser.add_argument('--direction', type=_direction, metavar='X,Y,Z',
                        help='direction of the tip: a vector of any length')
    add_tolerance(parser)
    parser.add_argument('--angle-tolerance', type=number_in(0.0, 180.0, 'degrees'), default=0.0,
                        metavar='DEG', help='tolerance of that direction, degrees (default: '
                        f'reach.angle_tolerance, {degrees(radians(2.0)):g} degrees)')


def add_unit(parser: Parser, of: str) -> None:
    """Add the unit of lengths; of: the lengths it applies to."""
    parser.add_argument('--unit', choices=UNITS, default='m', help=f'{of} (default: %(default)s)')


def add_tolerance(parser: Parser) -> None:
    """Add the position tolerance of the tip."""
    parser.add_argument('--tolerance', type=number_in(0.0, inf, ''), default=0.0, metavar='D',
                        help='position tolerance of the goal, in that unit (default: '
                        'reach.position_tolerance, 1 mm)')


def tip_problem(options: Namespace) -> str:
    """Return the problem with the options of add_tip; empty if there is none."""
    position, scale = options.position, UNITS[options.unit]
    if len(position) not in (2, 3):
        return (f'{len(position)} number{"s" if len(position) != 1 else ""} given; needed: '
                'x and z, or x, y and z')
    for name, value in (*zip('xyz' if len(position) == 3 else 'xz', position, strict=True),
                        ('--tolerance', options.tolerance)):
        if abs(scale * value) > MAX_POSITION:
            return (f'{name} is {value:g} {options.unit}; allowed: up to {MAX_POSITION:g} m'
                    + ('; in mm? add --unit mm' if options.unit == 'm' else ''))
    if options.angle is not None and options.direction is not None:
        return 'give --angle or --direction, not both'
    return ''


def given_tip(options: Namespace) -> Tip:
    """Return the goal from the options of add_tip."""
    scale = UNITS[options.unit]
    return Tip(tuple(scale * value for value in options.position),
               None if options.angle is None else radians(options.angle), options.direction, None,
               scale * options.tolerance, min(pi, radians(options.angle_tolerance)))


def read_tip_path(path: Path, unit: str = 'm', tolerance: float = 0.0,
                  decimal: str | None = None) -> list[Tip]:
    """
    Return the goals of a CSV file with the columns x, z, and optionally y and angle.

    unit: of lengths if the header has none; angles are then in degrees.  tolerance: m, 0 for the
    default.  decimal: the mark, if the numbers are ambiguous.  Raises MeasurementError naming
    file, line and remedy.
    """
    from soft_continuum.lab.analysis.delimited import MeasurementError, Quantity, read_table
    table = read_table(path, [
        Quantity('x', ('x',), 'm'), Quantity('z', ('z',), 'm'),
        Quantity('y', ('y',), 'm', required=False),
        Quantity('angle', ('angle',), 'rad', required=False)],
        usual={'x': unit, 'y': unit, 'z': unit, 'angle': 'deg'}, decimal=decimal)
    names = [name for name in 'xyz' if table.columns[name]]
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
    angles = table.numbers('angle', None)
    for number, angle in enumerate(angles, start=1):
        if angle is not None and abs(angle) > 2.0 * pi:
            raise MeasurementError(f'{path}: the angle of point {number} is {angle:g} rad; '
                                   'allowed: one turn either way')
    return [Tip(row, angle, tolerance=tolerance)
            for row, angle in zip(rows, angles, strict=True)]


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = inf
    if not isfinite(value):
        raise ArgumentTypeError(f'{text!r} given; needed: x and z, or x, y and z, such as '
                                '150 220 --unit mm')
    return value


def _direction(text: str) -> tuple[float, ...]:
    try:
        values = tuple(map(float, text.split(',')))
    except ValueError:
        values = ()
    if len(values) != 3 or not all(map(isfinite, values)) or not any(values):
        raise ArgumentTypeError(f'{text!r} given; needed: three numbers x,y,z that are not all 0')
    return values
