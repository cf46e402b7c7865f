# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What of an arm can be unknown: its names, where it stands in the arm, and how to pin it down.

Names: stiffness_N, ratio_N, segment_mass_N, disc_mass_N and offset_N of segment N (1 is the
lowest; the disc is the one above it), mass for all masses by one factor, friction, and tilt.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Generic, TypeVar

from soft_continuum.mechanics.arm import Arm, Disc, Segment
from soft_continuum.mechanics.chain import Array
from soft_continuum.parameters.parameter import Value

START_RATIO = 20.0  # K where the description has rigid segments
START_FRICTION = 0.05


class IdentificationError(ValueError):
    """Unknowns cannot be identified from the data; the message says why and what to do."""


Described = TypeVar('Described')
"""An arm, or in space the parameters that describe it."""


@dataclass(frozen=True)
class Unknown(Generic[Described]):
    """
    One unknown of an arm.

    unit: of its value.  start, low, high: where a fit begins and its bounds.  scale: a change that
    is all of it.  put: from an arm and a value to the arm that has it.  remedy: what to do when
    the data do not determine it.
    """

    name: str
    unit: str
    start: float
    low: float
    high: float
    scale: float
    put: Callable[[Described, float], Described]
    remedy: str


def find_unknowns(names: Sequence[str], arm: Arm) -> tuple[Unknown[Arm], ...]:
    """Return the unknowns of these names; raises IdentificationError listing what there is."""
    allowed = [f'{kind}_{n}' for kind in ('stiffness', 'ratio', 'segment_mass', 'disc_mass',
                                          'offset') for n in range(1, len(arm.segments) + 1)]
    allowed += ['mass', 'friction', 'tilt']
    check_names(names, allowed)
    return tuple(_unknown(name, arm) for name in names)


def check_names(names: Sequence[str], allowed: Sequence[str]) -> None:
    """Raise IdentificationError for a name that is none of those allowed, or there twice."""
    for k, name in enumerate(names):
        if name not in allowed:
            raise IdentificationError(f'there is no unknown {name!r}; known: {", ".join(allowed)}')
        if name in names[:k]:
            raise IdentificationError(f'{name} is named twice; name every unknown once')


def _unknown(name: str, arm: Arm) -> Unknown[Arm]:
    if name == 'mass':
        return Unknown(name, 'of the masses described', 1.0, 0.1, 10.0, 1.0, _all_masses,
                       'weigh segments and discs, and leave mass out')
    if name == 'friction':
        start = max(arm.tendon.friction, START_FRICTION)
        return Unknown(name, '', start, 1e-4, max(0.5, 1.5 * start), 0.1,
                       lambda a, v: replace(a, tendon=replace(a.tendon, friction=v)),
                       'with rigid stiff segments friction changes no shape, only the tension; '
                       'measure it as a ratio of forces along a bent tendon')
    if name == 'tilt':
        return Unknown(name, 'rad', arm.mounting_angle, arm.mounting_angle - 0.5,
                       arm.mounting_angle + 0.5, 0.1,
                       lambda a, v: replace(a, mounting_angle=v),
                       'level the base, or add shapes to both sides')
    kind, _, number = name.rpartition('_')
    index = int(number) - 1
    segment, disc = arm.segments[index], arm.discs[index + 1]
    law = {'stiffness': segment.soft_law, 'ratio': segment.jam.law}.get(kind)
    if law is not None:
        raise IdentificationError(
            f'{name} cannot be identified: a measured table of moment over curvature takes its '
            f'place; leave it out, or take the table of segment {number} out of the description')
    if kind == 'stiffness':
        value = segment.bending_stiffness
        return Unknown(name, 'N m^2', value, value / 20, value * 20, value,
                       lambda a, v: a.with_bending_stiffness(index, v),
                       f'add a shape at whose end segment {index + 1} is soft with both tendons '
                       'slack, so that its own spring holds the weight')
    if kind == 'ratio':
        value = START_RATIO if segment.jam.rigid else segment.jam.ratio
        return Unknown(name, '', value, 1.001, 100.0 * value, value,
                       lambda a, v: _segment(a, index, lambda s: replace(
                           s, jam=replace(s.jam, ratio=v))),
                       'a segment that is all but rigid has no ratio; characterise it stiff, or '
                       'add shapes with a payload')
    if kind == 'offset':
        lower, upper = segment.guide_offsets
        value = 0.5 * (lower + upper)
        return Unknown(name, 'm', value, value / 3, value * 3, value,
                       lambda a, v: _segment(a, index, lambda s: replace(
                           s, guide_offsets=(v * lower / value, v * upper / value))),
                       'measure the distance of the guides from the backbone')
    mass = segment.mass if kind == 'segment_mass' else disc.mass
    value = mass or 0.05
    part = 'segment' if kind == 'segment_mass' else 'disc above segment'
    return Unknown(name, 'kg', value, 0.01 * value, 10.0 * value, value,
                   (lambda a, v: _segment(a, index, lambda s: replace(s, mass=v)))
                   if kind == 'segment_mass' else
                   (lambda a, v: _disc(a, index + 1, lambda d: replace(d, mass=v))),
                   f'weigh the {part} {index + 1}, and leave {name} out')


def _segment(arm: Arm, index: int, change: Callable[[Segment], Segment]) -> Arm:
    return replace(arm, segments=tuple(
        change(s) if i == index else s for i, s in enumerate(arm.segments)))


def _disc(arm: Arm, index: int, change: Callable[[Disc], Disc]) -> Arm:
    return replace(arm, discs=tuple(
        change(d) if i == index else d for i, d in enumerate(arm.discs)))


def _all_masses(arm: Arm, factor: float) -> Arm:
    return replace(arm, segments=tuple(replace(s, mass=factor * s.mass) for s in arm.segments),
                   discs=tuple(replace(d, mass=factor * d.mass) for d in arm.discs))


def with_values(described: Described, unknowns: Sequence[Unknown[Described]], values: Array
                ) -> Described:
    """Return the arm with values for its unknowns."""
    for unknown, value in zip(unknowns, values.tolist(), strict=True):
        described = unknown.put(described, value)
    return described


def parameters_of(arm: Arm, unknowns: Sequence[Unknown[Arm]]) -> dict[str, Value]:
    """Return the parameters of the description that the unknowns change."""
    names = ' '.join(u.name for u in unknowns)
    parameters: dict[str, Value] = {'arm.discretisation': arm.discretisation}
    if 'stiffness' in names:
        parameters['arm.bending_stiffnesses'] = tuple(s.bending_stiffness for s in arm.segments)
    if 'ratio' in names:
        parameters['arm.stiffness_ratios'] = tuple(0.0 if s.jam.ratio == inf else s.jam.ratio
                                                   for s in arm.segments)
    if 'mass' in names:
        parameters['arm.segment_masses'] = tuple(s.mass for s in arm.segments)
        parameters['arm.disc_masses'] = tuple(d.mass for d in arm.discs)
    if 'offset' in names:
        parameters['arm.guide_offsets'] = tuple(o for s in arm.segments for o in s.guide_offsets)
    if 'friction' in names:
        parameters['arm.tendon_friction'] = arm.tendon.friction
    if 'tilt' in names:
        parameters['arm.mounting_angle'] = arm.mounting_angle
    return parameters
