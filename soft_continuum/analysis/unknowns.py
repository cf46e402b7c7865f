# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Unknowns of an arm for identification: parameters of its description, some by a common factor.

Names: stiffness_N, ratio_N, segment_mass_N, disc_mass_N and offset_N of segment N (1 is the
lowest; the disc is the one above it), angle_N of the tendons that end at disc N; stiffness, mass
and offset for all by one factor, friction, stretch and tilt.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, pi
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import Value

Values = Mapping[str, Value]
"""The parameters of a description, by name."""
STIFFNESSES = ('arm.bending_stiffnesses', 'arm.lateral_bending_stiffnesses',
               'arm.torsional_stiffnesses')
MASSES = ('arm.segment_masses', 'arm.disc_masses')
START_RATIO = 20.0  # K where the description has rigid segments
START_FRICTION = 0.05
START_MASS = 0.05  # kg, where the description has none


class IdentificationError(ValueError):
    """Unknowns cannot be identified from the data; the message says why and what to do."""


@dataclass(frozen=True)
class Unknown:
    """
    One unknown of an arm.

    unit: of its value.  start, low, high: initial value and bounds of a fit.  scale: its full
    range of change.  changes: names of the parameters that it changes.  put: returns a
    description, from spread_out, with a given value.  remedy: what to do when the data do not
    determine it.
    """

    name: str
    unit: str
    start: float
    low: float
    high: float
    scale: float
    changes: tuple[str, ...]
    put: Callable[[Values, float], Values]
    remedy: str


def stiffnesses_of(arm: Arm) -> dict[str, tuple[float, ...]]:
    """Return the stiffnesses of each segment, E I about y first, by parameter, N m^2."""
    return {name: tuple(0.0 if number == inf else number for number in numbers)
            for name, numbers in zip(
                STIFFNESSES, zip(*(s.stiffnesses for s in arm.segments), strict=True),
                strict=False)}


def spread_out(values: Values) -> Values:
    """Return a description whose lists have one number for every part."""
    arm = arm_from_parameters(values)
    offsets = _numbers(values, 'arm.guide_offsets')
    if len(offsets) == 1:
        offsets *= 2 * len(arm.segments)
    return {
        **values, **stiffnesses_of(arm),
        'arm.stiffness_ratios': tuple(0.0 if s.jam.ratio == inf else s.jam.ratio
                                      for s in arm.segments),
        'arm.segment_masses': tuple(s.mass for s in arm.segments),
        'arm.disc_masses': tuple(d.mass for d in arm.discs),
        'arm.guide_offsets': tuple(offset or arm.segments[i // 2].outer_diameter / 2
                                   for i, offset in enumerate(offsets)),
    }


def find_unknowns(names: Sequence[str], values: Values) -> tuple[Unknown, ...]:
    """
    Return the unknowns of these names.

    values: of the description, from spread_out.  Raises IdentificationError listing the known
    names.
    """
    arm = arm_from_parameters(values)
    allowed = [f'{kind}_{n}' for kind in ('stiffness', 'ratio', 'segment_mass', 'disc_mass',
                                          'offset') for n in range(1, len(arm.segments) + 1)]
    if len(_numbers(values, 'arm.tendon_angles')) == len(arm.tendon_ends):
        allowed += [f'angle_{end}' for end in sorted(set(arm.tendon_ends))]
    allowed += ['stiffness', 'mass', 'offset', 'friction', 'tilt']
    allowed += ['stretch'] if values['arm.tendon_axial_stiffness'] else []
    for k, name in enumerate(names):
        if name not in allowed:
            raise IdentificationError(f'there is no unknown {name!r}; known: {", ".join(allowed)}')
        if name in names[:k]:
            raise IdentificationError(f'{name} is named twice; name every unknown once')
    return tuple(_unknown(name, values, arm) for name in names)


def _unknown(name: str, values: Values, arm: Arm) -> Unknown:
    kind, _, number = name.rpartition('_')
    if not number.isdecimal():
        return _of_all(name, values, arm)
    index = int(number) - 1
    if kind == 'angle':
        which = [i for i, end in enumerate(arm.tendon_ends) if end == index + 1]
        start = _numbers(values, 'arm.tendon_angles')[which[0]]
        return Unknown(name, 'rad', start, start - 1.0, start + 1.0, 0.5, ('arm.tendon_angles',),
                       lambda v, angle: _turned(v, which, angle),
                       f'add shapes that the tendons of disc {number} bend to several sides')
    segment = arm.segments[index]
    if {'stiffness': segment.soft_law, 'ratio': segment.jam.law}.get(kind) is not None:
        raise IdentificationError(
            f'{name} cannot be identified: a measured table of moment over curvature takes its '
            f'place; leave it out, or take the table of segment {number} out of the description')
    count = {2: 'both'}.get(len(arm.tendon_names), 'all')
    names, places, unit, start, least, most, remedy = {
        'stiffness': (tuple(stiffnesses_of(arm)), (index,), 'N m^2', 0.0, 0.05, 20.0,
                      f'add a shape at whose end segment {number} is soft with {count} tendons '
                      'slack, so that its own spring holds the weight'),
        'ratio': (('arm.stiffness_ratios',), (index,), '', START_RATIO, 0.0, 100.0,
                  'a segment that is all but rigid has no ratio; characterise it stiff, or '
                  'add shapes with a payload'),
        'segment_mass': (MASSES[:1], (index,), 'kg', START_MASS, 0.01, 10.0,
                         f'weigh the segment {number}, and leave {name} out'),
        'disc_mass': (MASSES[1:], (index + 1,), 'kg', START_MASS, 0.01, 10.0,
                      f'weigh the disc above segment {number}, and leave {name} out'),
        'offset': (('arm.guide_offsets',), (2 * index, 2 * index + 1), 'm', 0.0, 1 / 3, 3.0,
                   'measure the distance of the guides from the backbone'),
    }[kind]
    value = float(np.mean([_numbers(values, names[0])[place] for place in places])) or start
    return Unknown(name, unit, value, 1.001 if kind == 'ratio' else least * value, most * value,
                   value, MASSES if names[0] in MASSES else names,
                   lambda v, to: with_mean(v, names, places, to), remedy)


def _of_all(name: str, values: Values, arm: Arm) -> Unknown:
    """Return an unknown of the whole arm; factors are relative to the initial description."""
    number: Any = values.get({
        'friction': 'arm.tendon_friction', 'tilt': 'arm.mounting_angle',
        'stretch': 'arm.tendon_axial_stiffness'}.get(name, ''))
    if name == 'friction':
        start = max(number, START_FRICTION)
        return Unknown(name, '', start, 1e-4, max(0.5, 1.5 * start), 0.1, ('arm.tendon_friction',),
                       lambda v, value: {**v, 'arm.tendon_friction': value},
                       'with rigid stiff segments friction changes no shape, only the tension; '
                       'measure it as a ratio of forces along a bent tendon')
    if name == 'tilt':
        return Unknown(name, 'rad', number, number - 0.5, number + 0.5, 0.1,
                       ('arm.mounting_angle',),
                       lambda v, angle: {**v, 'arm.mounting_angle': angle},
                       'level the base, or add shapes to several sides')
    if name == 'stretch':
        start = 1.0 / number
        return Unknown(name, '1/N, 1/E A', start, start / 100.0, start * 100.0, start,
                       ('arm.tendon_axial_stiffness',),
                       lambda v, value: {**v, 'arm.tendon_axial_stiffness': 1.0 / value},
                       'stretch shows where tendons carry much; add shapes that bend far')
    names, what, remedy = {
        'stiffness': (tuple(stiffnesses_of(arm)), 'of E I described',
                      'add shapes that a known payload bends'),
        'mass': (MASSES, 'of the masses described',
                 'weigh segments and discs, and leave mass out'),
        'offset': (('arm.guide_offsets',), 'of the offsets described',
                   'measure the distance of the guides from the backbone'),
    }[name]
    return Unknown(name, what, 1.0, 0.1, 10.0, 1.0, names,
                   lambda v, factor: _scaled(v, names, None, factor), remedy)


def _scaled(values: Values, names: Sequence[str], places: Sequence[int] | None, factor: float
            ) -> Values:
    """Return the description with lists times a factor, entirely or at some indices."""
    return {**values, **{name: tuple(
        factor * number if places is None or i in places else number
        for i, number in enumerate(_numbers(values, name))) for name in names}}


def with_mean(values: Values, names: Sequence[str], places: Sequence[int], to: float) -> Values:
    """Return the description with a mean of the first list at indices, others in proportion."""
    mean = float(np.mean([_numbers(values, names[0])[place] for place in places]))
    if mean:
        return _scaled(values, names, places, to / mean)
    return {**values, names[0]: tuple(to if i in places else number for i, number in enumerate(
        _numbers(values, names[0])))}


def _turned(values: Values, which: Sequence[int], angle: float) -> Values:
    """Return the description with tendons turned together, the first to an angle, rad."""
    angles = list(_numbers(values, 'arm.tendon_angles'))
    more = angle - angles[which[0]]
    for i in which:
        angles[i] = (angles[i] + more + pi) % (2.0 * pi) - pi
    return {**values, 'arm.tendon_angles': tuple(angles)}


def with_values(described: Values, unknowns: Sequence[Unknown], values: Array) -> Values:
    """Return the description with values for its unknowns."""
    for unknown, value in zip(unknowns, values.tolist(), strict=True):
        described = unknown.put(described, value)
    return described


def parameters_of(described: Values, unknowns: Sequence[Unknown]) -> dict[str, Value]:
    """Return the parameters of the description that the unknowns change, and its springs."""
    return {name: described[name] for name in (
        'arm.discretisation', *(name for unknown in unknowns for name in unknown.changes))}


def _numbers(values: Values, name: str) -> tuple[float, ...]:
    found: Any = values[name]
    return tuple(map(float, found))
