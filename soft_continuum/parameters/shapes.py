# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters that list shapes, and the shape library that they make."""

from collections.abc import Mapping
from math import pi
from typing import Any

from soft_continuum.mechanics.arm import Arm
from soft_continuum.parameters.parameter import Parameter, ParameterError

SHAPE_PARAMETERS = (
    Parameter('shape_names', ('c_form', 'upright_c_form', 's_form'),
              'names of the shape library; the bending angles of each are in shapes.<name>'),
)
SHAPE_PREFIX = 'shapes.'
BEND = 36.0 * pi / 180.0
PAPER_SHAPES = {
    'c_form': (BEND, BEND, BEND),
    'upright_c_form': (-BEND, BEND, BEND),
    's_form': (BEND, -BEND, BEND),
}
"""The shapes of the paper (III-A, Fig. 1c), for an arm of three segments."""


def shapes_from_parameters(values: Mapping[str, Any], arm: Arm) -> dict[str, tuple[float, ...]]:
    """
    Return the shape library: bending angles (rad) per segment by name.

    The paper's shapes need not be given; they are left out where the number of segments is not
    three.

    Raises ParameterError for a shape without angles, of the wrong length or beyond the limits.
    """
    names = SHAPE_PARAMETERS[0].check(values.get('shape_names', SHAPE_PARAMETERS[0].default))
    library: dict[str, tuple[float, ...]] = {}
    if len(set(names)) < len(names):  # type: ignore[arg-type]
        raise ParameterError(f'shape_names lists a shape twice: {list(names)}')  # type: ignore[arg-type]
    for name in names:  # type: ignore[union-attr]
        key = f'{SHAPE_PREFIX}{name}'
        given = values.get(key)
        if given is None and str(name) in PAPER_SHAPES:
            given = PAPER_SHAPES[str(name)]
            if len(given) != len(arm.segments):
                continue
        if given is None:
            raise ParameterError(f'shape_names lists {name}, but there is no parameter {key}')
        angles = Parameter(key, (0.0,), 'bending angles, rad, base first').check(given)
        problem = angles_problem(angles, arm)  # type: ignore[arg-type]
        if problem:
            raise ParameterError(f'parameter {key}: {problem}')
        library[str(name)] = angles  # type: ignore[assignment]
    for key in values:
        if key.startswith(SHAPE_PREFIX) and key.removeprefix(SHAPE_PREFIX) not in names:  # type: ignore[operator]
            raise ParameterError(f'parameter {key}: the shape is not listed in shape_names')
    return library


def angles_problem(angles: tuple[float, ...], arm: Arm) -> str:
    """Say what is wrong with bending angles (rad) for this arm; empty when nothing is."""
    limits = [s.bending_angle_limit for s in arm.segments]
    if len(angles) != len(limits):
        return f'{len(angles)} bending angles given, the arm has {len(limits)} segments'
    for segment, (angle, limit) in enumerate(zip(angles, limits, strict=True), start=1):
        if not abs(angle) <= limit:
            return (f'the bending angle of segment {segment} is {angle:g} rad; '
                    f'allowed: {-limit:.4g} to {limit:.4g} rad')
    return ''
