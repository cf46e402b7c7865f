# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the shape library, and the paper's shapes."""

from collections.abc import Callable, Mapping, Sequence
from math import degrees, pi, radians
from typing import Any

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.directions import direction_problem
from soft_continuum.parameters.parameter import (
    degrees_hint,
    name_hint,
    Parameter,
    ParameterError,
)

BENDING_ANGLE = radians(36.0)
PAPER_SHAPES = {
    'c_form': (BENDING_ANGLE, BENDING_ANGLE, BENDING_ANGLE),
    'upright_c_form': (-BENDING_ANGLE, BENDING_ANGLE, BENDING_ANGLE),
    's_form': (BENDING_ANGLE, -BENDING_ANGLE, BENDING_ANGLE),
}
"""Bending angles (rad) of the shapes of the paper (III-A, Fig. 1c), for three segments."""
SHAPE_PREFIX, DIRECTION_PREFIX = 'shapes.', 'shape_directions.'
VACUUM_PREFIX = 'shape_vacuums.'
ROUNDING = 1e-6  # rad: of a limit that was written with seven digits
SHAPE_NAMES = Parameter(
    'shape_names', tuple(PAPER_SHAPES), 'names of the shapes in the library')


def shape_parameter(name: str) -> Parameter:
    """Return the parameter that has the bending angles of a shape."""
    return Parameter(
        f'{SHAPE_PREFIX}{name}', PAPER_SHAPES.get(name, ()),
        f'bending angles of the shape {name}, base first, within arm.bending_angle_limits; empty: '
        'those of the paper, for its shapes', unit='rad')


def direction_parameter(name: str) -> Parameter:
    """Return the parameter that has the bending directions of a shape."""
    return Parameter(
        f'{DIRECTION_PREFIX}{name}', (), f'bending directions of the shape {name}, base first, '
        'about z from x of the disc below each segment; empty: 0 for all, as for planar arms',
        unit='rad')


def vacuum_parameter(name: str) -> Parameter:
    """Return the parameter that has the vacuums of a shape."""
    return Parameter(
        f'{VACUUM_PREFIX}{name}', (), 'for rigs with regulators, vacuum below ambient of each '
        f'segment while the shape {name} is held, base first; empty: every segment stiff',
        0.0, 101e3, unit='Pa')


def shapes_from_parameters(values: Mapping[str, Any], arm: Arm
                           ) -> dict[str, tuple[float, ...]]:
    """
    Return the shape library: bending angles (rad) per segment by name.

    The paper's shapes need not be given; they are left out where the number of segments is not
    three, and where the arm does not bend so.

    Raises ParameterError for a shape without angles, of the wrong length or beyond the limits,
    for directions that the arm does not have, and for vacuums that do not fit.
    """
    names: tuple[str, ...] = SHAPE_NAMES.check(  # type: ignore[assignment]
        values.get(SHAPE_NAMES.name, SHAPE_NAMES.default))
    if len(set(names)) < len(names):
        raise ParameterError(f'shape_names lists a shape twice: {list(names)}')
    given = _given(values, SHAPE_PREFIX)
    directions = directions_from_parameters(values)
    library: dict[str, tuple[float, ...]] = {}
    for name in names:
        parameter = shape_parameter(name)
        if name not in given and len(PAPER_SHAPES.get(name, arm.segments)) != len(arm.segments):
            continue
        if name not in given and not parameter.default:
            raise ParameterError(
                f'shape_names lists {name}, but there is no parameter {parameter.name}'
                + name_hint(name, {*PAPER_SHAPES, *given} - set(names)))
        angles: tuple[float, ...] = parameter.check(  # type: ignore[assignment]
            given.get(name, parameter.default))
        towards = directions.get(name, ())
        if not (name in given or towards) and angles_problem(angles, arm):
            continue
        if problem := _angles_problem(angles, arm):
            raise ParameterError(f'parameter {parameter.name}: {problem}')
        if problem := _directions_problem(angles, towards, arm):
            of = direction_parameter(name) if towards else parameter
            raise ParameterError(f'parameter {of.name}: {problem}')
        library[name] = angles
    vacuums = vacuums_from_parameters(values)
    for name, those in vacuums.items():
        if problem := vacuums_problem(those, arm, values['full_vacuum'], values['soft_vacuum'],
                                      values['arm.jamming']):
            raise ParameterError(f'parameter {vacuum_parameter(name).name}: {problem}')
    for prefix, named in ((SHAPE_PREFIX, given), (DIRECTION_PREFIX, directions),
                          (VACUUM_PREFIX, vacuums)):
        for name in named:
            if name not in names:
                raise ParameterError(f'parameter {prefix}{name}: the shape is not listed in '
                                     f'shape_names{name_hint(name, names)}')
    return library


def directions_from_parameters(values: Mapping[str, Any]) -> dict[str, tuple[float, ...]]:
    """Return the bending directions (rad) per segment by name, of shapes that have some."""
    return _by_name(values, DIRECTION_PREFIX, direction_parameter)


def vacuums_from_parameters(values: Mapping[str, Any]) -> dict[str, tuple[float, ...]]:
    """Return the vacuums (Pa below ambient) per segment by name, of shapes that have some."""
    return _by_name(values, VACUUM_PREFIX, vacuum_parameter)


def _by_name(values: Mapping[str, Any], prefix: str, parameter: Callable[[str], Parameter]
             ) -> dict[str, tuple[float, ...]]:
    return {name: parameter(name).check(value)  # type: ignore[misc]
            for name, value in _given(values, prefix).items()}


def _given(values: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """Return those parameters by the names of shapes; an empty list is not given, as in ROS."""
    return {key.removeprefix(prefix): value for key, value in values.items()
            if key.startswith(prefix) and (isinstance(value, str) or not hasattr(value, '__len__')
                                           or len(value))}


def vacuums_problem(vacuums: Sequence[float], arm: Arm, full_vacuum: float,
                    soft_vacuum: float, jamming: bool) -> str:
    """
    Say why segments cannot be held with these vacuums (Pa below ambient); empty if they can.

    full_vacuum, soft_vacuum: as the parameters.  jamming: whether segments can be stiffened.
    """
    if not jamming:
        return 'vacuums are given, but this arm has no jamming (arm.jamming)'
    if len(vacuums) != len(arm.segments):
        return (f'{len(vacuums)} vacuums given, the arm has {len(arm.segments)} segments; give '
                'one for each, or none for all stiff')
    for number, vacuum in enumerate(vacuums, start=1):
        if not soft_vacuum < vacuum <= full_vacuum * (1.0 + ROUNDING):  # nan neither
            return (f'the vacuum of segment {number} is {vacuum:g} Pa; allowed: more than '
                    f'{soft_vacuum:g} (soft_vacuum) to {full_vacuum:g} Pa (full_vacuum)')
        if arm.segments[number - 1].jam.rigid and vacuum < full_vacuum * (1.0 - ROUNDING):
            return (f'the vacuum of segment {number} is {vacuum:g} Pa, but its jam is rigid in '
                    f'the description, which has no law for less than {full_vacuum:g} Pa '
                    '(full_vacuum); give arm.stiffness_ratios, and arm.yield_moments')
    return ''


def angles_problem(angles: Sequence[float], arm: Arm, directions: Sequence[float] = ()) -> str:
    """
    Say what is wrong with bending angles (rad) for this arm; empty when nothing is.

    directions: of every segment, rad; empty for 0 of all.
    """
    return _angles_problem(angles, arm) or _directions_problem(angles, directions, arm)


def _angles_problem(angles: Sequence[float], arm: Arm) -> str:
    limits = arm.bending_angle_limits.tolist()
    if len(angles) != len(limits):
        return f'{len(angles)} bending angles given, the arm has {len(limits)} segments'
    for segment, (angle, limit) in enumerate(zip(angles, limits, strict=True), start=1):
        if not abs(angle) <= limit + ROUNDING:
            return (f'the bending angle of segment {segment} is {_shown(angle)}; allowed: '
                    f'{-limit:.4g} to {limit:.4g} rad ({degrees(-limit):.4g} to '
                    f'{degrees(limit):.4g} degrees){degrees_hint(angle, -limit, limit)}')
    return ''


def _directions_problem(angles: Sequence[float], directions: Sequence[float], arm: Arm) -> str:
    if len(directions) not in (0, len(angles)):
        return (f'{len(directions)} bending directions given, the arm has {len(angles)} segments; '
                'give one for each, or none for 0 of all')
    for segment, direction in enumerate(directions, start=1):
        if not abs(direction) <= 2.0 * pi:
            return (f'the bending direction of segment {segment} is {_shown(direction)}; allowed: '
                    f'-2 pi to 2 pi rad{degrees_hint(direction, -2.0 * pi, 2.0 * pi)}')
    problems = (direction_problem(arm, segment, directions[segment] if directions else 0.0)
                for segment, angle in enumerate(angles) if angle)
    return next(filter(None, problems), '')


def _shown(angle: float) -> str:
    """Return an angle as ROS has it, and as the command line and the browser do."""
    return f'{angle:g} rad ({degrees(angle):.4g} degrees)'
