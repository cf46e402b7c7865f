# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What of an arm in space can be unknown: parameters of its description, some by one factor.

Names: stiffness_N, ratio_N, segment_mass_N, disc_mass_N and offset_N of segment N (1 is the
lowest; the disc is the one above it), angle_N of the tendons that end at disc N; stiffness, mass
and offset for all by one factor, stretch and tilt.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, pi

from soft_continuum.analysis.unknowns import (
    check_names,
    IdentificationError,
    START_RATIO,
    Unknown,
)
from soft_continuum.mechanics.spatial import SpatialArm
from soft_continuum.parameters.arm import any_arm_from_parameters
from soft_continuum.parameters.parameter import Value

Values = Mapping[str, Value]
"""The parameters of a description, by name."""
STIFFNESSES = ('arm.bending_stiffnesses', 'arm.lateral_bending_stiffnesses',
               'arm.torsional_stiffnesses')
MASSES = ('arm.segment_masses', 'arm.disc_masses')


@dataclass(frozen=True)
class _List:
    """Lists of the description that one unknown scales, whole or at some places."""

    names: tuple[str, ...]
    places: tuple[int, ...] | None = None

    def scaled(self, values: Values, factor: float) -> Values:
        """Return the description with these numbers times a factor."""
        return {**values, **{name: tuple(
            factor * number if self.places is None or i in self.places else number
            for i, number in enumerate(_numbers(values, name))) for name in self.names}}


def spread_out(values: Values, arm: SpatialArm) -> Values:
    """Return a description whose lists have a number of its own for every part."""
    segments, tendons = arm.segments, arm.tendons
    longest = max(tendons, key=lambda tendon: tendon.end)
    offsets = longest.offset if isinstance(longest.offset, tuple) else (
        (longest.offset,) * (2 * len(segments)))
    return {
        **values,
        'arm.bending_stiffnesses': tuple(s.stiffness_y for s in segments),
        'arm.lateral_bending_stiffnesses': tuple(s.stiffness_x for s in segments),
        'arm.torsional_stiffnesses': tuple(
            0.0 if s.torsional_stiffness == inf else s.torsional_stiffness
            for s in segments),
        'arm.stiffness_ratios': tuple(0.0 if s.jam.rigid else s.jam.ratio for s in segments),
        'arm.segment_masses': tuple(s.mass for s in segments),
        'arm.disc_masses': tuple(d.mass for d in arm.discs),
        'arm.guide_offsets': offsets,
        'arm.tendon_angles': tuple(t.angle for t in tendons),
    }


def arm_of(values: Values) -> SpatialArm:
    """Return the arm that parameters describe; raises ParameterError, also for a planar one."""
    arm = any_arm_from_parameters(values)
    if not isinstance(arm, SpatialArm):
        raise IdentificationError('the description is of a planar arm')
    return arm


def find_unknowns_in_space(names: Sequence[str], values: Values) -> tuple[Unknown[Values], ...]:
    """
    Return the unknowns of these names.

    values: of the description, as spread_out returns them.  Raises IdentificationError listing
    what there is.
    """
    arm = arm_of(values)
    ends = sorted({tendon.end for tendon in arm.tendons})
    allowed = [f'{kind}_{n}' for kind in ('stiffness', 'ratio', 'segment_mass', 'disc_mass',
                                          'offset') for n in range(1, len(arm.segments) + 1)]
    allowed += [*(f'angle_{end}' for end in ends), 'stiffness', 'mass', 'offset', 'tilt']
    allowed += ['stretch'] if values['arm.tendon_axial_stiffness'] else []
    check_names(names, allowed)
    return tuple(_unknown(name, values, arm) for name in names)


def _unknown(name: str, values: Values, arm: SpatialArm) -> Unknown[Values]:
    kind, _, number = name.rpartition('_')
    if not number.isdecimal():
        return _of_all(name, values)
    index = int(number) - 1
    if kind == 'angle':
        which = [i for i, tendon in enumerate(arm.tendons) if tendon.end == index + 1]
        start = arm.tendons[which[0]].angle
        return Unknown(name, 'rad', start, start - 1.0, start + 1.0, 0.5,
                       lambda v, angle: _turned(v, which, angle),
                       f'add shapes that the tendons of disc {number} bend to several sides')
    part, parameter, place, unit, remedy = {
        'stiffness': (_List(STIFFNESSES, (index,)), STIFFNESSES[0], index, 'N m^2',
                      f'add a shape in which the weight bends segment {number}'),
        'ratio': (_List(('arm.stiffness_ratios',), (index,)), 'arm.stiffness_ratios', index, '',
                  'a segment that is all but rigid has no ratio; add shapes with a payload'),
        'segment_mass': (_List(MASSES[:1], (index,)), MASSES[0], index, 'kg',
                         f'weigh segment {number}, and leave {name} out'),
        'disc_mass': (_List(MASSES[1:], (index + 1,)), MASSES[1], index + 1, 'kg',
                      f'weigh the disc above segment {number}, and leave {name} out'),
        'offset': (_List(('arm.guide_offsets',), (2 * index, 2 * index + 1)),
                   'arm.guide_offsets', 2 * index, 'm',
                   'measure the distance of the guides from the backbone'),
    }[kind]
    value = _numbers(values, parameter)[place]
    if value == 0.0:
        if kind != 'ratio':
            raise IdentificationError(f'{name} is 0 in the description, so no factor of it can be '
                                      'identified; describe it as well as it is known')
        value = START_RATIO
    if kind == 'ratio':
        return Unknown(name, unit, value, 1.001, 100.0 * value, value,
                       lambda v, ratio: _put(v, parameter, index, ratio), remedy)
    times = 3.0 if kind == 'offset' else 20.0
    return Unknown(name, unit, value, value / times, value * times, value,
                   lambda v, to: part.scaled(v, to / _numbers(v, parameter)[place]), remedy)


def _of_all(name: str, values: Values) -> Unknown[Values]:
    """Return an unknown of the whole arm; factors are those of the description it began with."""
    if name == 'tilt':
        start = _number(values, 'arm.mounting_angle')
        return Unknown(name, 'rad', start, start - 0.5, start + 0.5, 0.1,
                       lambda v, angle: {**v, 'arm.mounting_angle': angle},
                       'level the base, or add shapes to several sides')
    if name == 'stretch':
        start = 1.0 / _number(values, 'arm.tendon_axial_stiffness')
        return Unknown(name, '1/N, 1/E A', start, start / 100.0, start * 100.0, start,
                       lambda v, value: {**v, 'arm.tendon_axial_stiffness': 1.0 / value},
                       'stretch shows where tendons carry much; add shapes that bend far')
    part, what, remedy = {
        'stiffness': (_List(STIFFNESSES), 'of E I described',
                      'add shapes that a known payload bends'),
        'mass': (_List(MASSES), 'of the masses described',
                 'weigh segments and discs, and leave mass out'),
        'offset': (_List(('arm.guide_offsets',)), 'of the offsets described',
                   'measure the distance of the guides from the backbone'),
    }[name]
    return Unknown(name, what, 1.0, 0.1, 10.0, 1.0, part.scaled, remedy)


def _put(values: Values, name: str, place: int, value: float) -> Values:
    return {**values, name: tuple(
        value if i == place else other for i, other in enumerate(_numbers(values, name)))}


def _turned(values: Values, which: Sequence[int], angle: float) -> Values:
    """Return the description with tendons turned together, the first of them to an angle, rad."""
    angles = list(_numbers(values, 'arm.tendon_angles'))
    more = angle - angles[which[0]]
    for i in which:
        angles[i] = (angles[i] + more + pi) % (2.0 * pi) - pi
    return {**values, 'arm.tendon_angles': tuple(angles)}


def changed(values: Values, begun: Values) -> dict[str, Value]:
    """Return the parameters of a description that are not those of the one it began with."""
    return {name: value for name, value in values.items() if value != begun[name]}


def _numbers(values: Values, name: str) -> tuple[float, ...]:
    found = values[name]
    assert isinstance(found, tuple)
    return tuple(float(number) for number in found)


def _number(values: Values, name: str) -> float:
    found = values[name]
    assert isinstance(found, float)
    return found
