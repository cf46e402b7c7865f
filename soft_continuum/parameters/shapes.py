# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the shape library, the paper's shapes, and the library they make."""

from collections.abc import Mapping
from math import radians
from typing import Any

from soft_continuum.mechanics.arm import Arm
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
SHAPE_PREFIX = 'shapes.'
SHAPE_NAMES = Parameter(
    'shape_names', tuple(PAPER_SHAPES), 'names of the shapes in the library')


def shape_parameter(name: str) -> Parameter:
    """Return the parameter that has the bending angles of a shape."""
    return Parameter(
        f'{SHAPE_PREFIX}{name}', PAPER_SHAPES.get(name, ()),
        f'bending angles of the shape {name}, base first, within arm.bending_angle_limits; '
        "the paper's shapes have a default", unit='rad')


def shapes_from_parameters(values: Mapping[str, Any], arm: Arm) -> dict[str, tuple[float, ...]]:
    """
    Return the shape library: bending angles (rad) per segment by name.

    The paper's shapes need not be given; they are left out where the number of segments is not
    three.

    Raises ParameterError for a shape without angles, of the wrong length or beyond the limits.
    """
    names: tuple[str, ...] = SHAPE_NAMES.check(  # type: ignore[assignment]
        values.get(SHAPE_NAMES.name, SHAPE_NAMES.default))
    if len(set(names)) < len(names):
        raise ParameterError(f'shape_names lists a shape twice: {list(names)}')
    given = {key.removeprefix(SHAPE_PREFIX): value for key, value in values.items()
             if key.startswith(SHAPE_PREFIX)}
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
        problem = angles_problem(angles, arm)
        if problem:
            raise ParameterError(f'parameter {parameter.name}: {problem}')
        library[name] = angles
    for name in given:
        if name not in names:
            raise ParameterError(f'parameter {SHAPE_PREFIX}{name}: the shape is not listed in '
                                 f'shape_names{name_hint(name, names)}')
    return library


def angles_problem(angles: tuple[float, ...], arm: Arm) -> str:
    """Say what is wrong with bending angles (rad) for this arm; empty when nothing is."""
    limits = [s.bending_angle_limit for s in arm.segments]
    if len(angles) != len(limits):
        return f'{len(angles)} bending angles given, the arm has {len(limits)} segments'
    for segment, (angle, limit) in enumerate(zip(angles, limits, strict=True), start=1):
        if not abs(angle) <= limit:
            return (f'the bending angle of segment {segment} is {angle:g} rad; allowed: '
                    f'{-limit:.4g} to {limit:.4g} rad{degrees_hint(angle, -limit, limit)}')
    return ''
