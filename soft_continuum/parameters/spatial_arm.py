# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The parameters that make an arm a spatial one: its tendons by name, and how it bends and twists.

Their defaults are those of a planar arm, which has a right and a left tendon.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import cos, inf, pi, sin
import re
from typing import Any

from soft_continuum.mechanics.arm import Disc
from soft_continuum.mechanics.spatial.arm import (
    SpatialArm,
    SpatialSegment,
    SpatialTendon,
)
from soft_continuum.mechanics.spatial.chain import SpatialChain
from soft_continuum.parameters.parameter import Parameter, ParameterError, spread

NO_NAMES = ('',)
SPATIAL_PER_SEGMENT = (
    Parameter('arm.lateral_bending_stiffnesses', (0.0,),
              'E I of each segment of a spatial arm about x; 0: as about y, a round spring',
              0.0, 1e3, unit='N m^2'),
    Parameter('arm.torsional_stiffnesses', (0.0,),
              'G J of each segment of a spatial arm; 0: it does not twist',
              0.0, 1e3, unit='N m^2'),
)
TENDONS = (
    Parameter('arm.tendon_names', NO_NAMES,
              'name of each tendon, which makes the arm a spatial one; one empty name: a planar '
              'arm with right_tendon and left_tendon'),
    Parameter('arm.tendon_angles', (0.0,),
              'where each tendon is at the base: angle about z from x', -2 * pi, 2 * pi,
              unit='rad'),
    Parameter('arm.tendon_ends', (0,),
              'number of the disc where each tendon ends, 1 above the first segment; 0: the last',
              0, 1000),
    Parameter('arm.tendon_twists', (0.0,),
              'by how much each tendon winds around the arm; 0: parallel to it', -1e3, 1e3,
              unit='rad/m'),
)
SPATIAL_PARAMETERS = (
    *TENDONS,
    Parameter('arm.spacers', 0,
              'guides of the tendons inside each segment of a spatial arm, evenly spaced', 0, 100),
)
SAME_ANGLE = 1e-3  # rad
NAME = re.compile(r'[A-Za-z]\w{0,99}', re.ASCII)


def refuse_spatial(get: Mapping[str, Any]) -> None:
    """Refuse what only spatial arms have; get: checked parameters of a planar one, by name."""
    for parameter in (*SPATIAL_PER_SEGMENT, *SPATIAL_PARAMETERS):
        value = get[parameter.name.removeprefix('arm.')]
        if isinstance(value, tuple):
            value = tuple(set(value))  # of all segments
        if value not in (parameter.default, ()):
            raise ParameterError(
                f'parameter {parameter.name} is given, but a planar arm has none; give '
                f'arm.tendon_names to describe a spatial one, or leave {parameter.name} out')


def spatial_arm(get: Mapping[str, Any]) -> SpatialArm:
    """
    Return the spatial arm of checked parameters, by their names without ``arm.``.

    Lists of segments, guides and discs are complete, without zeros that stand for something else.
    Raises ParameterError, and ArmError for what is not a physical arm.
    """
    names = get['tendon_names']
    for name in names:
        if not NAME.fullmatch(name) or names.count(name) > 1:
            raise ParameterError(
                f'parameter arm.tendon_names is {list(names)}; each tendon needs a name of its '
                'own, of letters, digits and _, such as tendon_1')
    angles, ends, twists = (
        spread(parameter.name, get[parameter.name.removeprefix('arm.')], len(names),
               f'arm.tendon_names has {len(names)}', alone=parameter.name != 'arm.tendon_angles')
        for parameter in TENDONS[1:])
    count = len(get['segment_lengths'])
    if max(ends) > count:
        raise ParameterError(
            f'parameter arm.tendon_ends is {list(ends)}; allowed: 1 to {count}, the discs above '
            f'the {count} segments, or 0 for the last')
    reached = max(end or count for end in ends)
    if reached < count:
        passed = ' and '.join(str(number) for number in range(reached + 1, count + 1))
        raise ParameterError(
            f'parameter arm.tendon_ends is {list(ends)}, so no tendon passes segment {passed}; '
            f'let one end at {count}, or at 0, the last disc')
    _refuse_same_place(names, angles, ends, twists, count)
    tendons = tuple(
        SpatialTendon(name, angle, get['guide_offsets'][:2 * (end or count)], end or count, twist,
                      friction=get['tendon_friction'], free_length=get['tendon_free_length'])
        for name, angle, end, twist in zip(names, angles, ends, twists, strict=True))
    slope, gravity = get['mounting_angle'], get['gravity']
    arm = SpatialArm(
        tuple(_segment(get, i) for i in range(count)),
        tuple(Disc(height, mass) for height, mass in zip(
            get['disc_heights'], get['disc_masses'], strict=True)),
        tendons, get['bodies_per_segment'], get['spacers'], get['discretisation'], get['payload'],
        gravity=(gravity * sin(slope), 0.0, -gravity * cos(slope)))
    if not (axial := get['tendon_axial_stiffness']):
        return arm
    return replace(arm, tendons=tuple(
        replace(tendon, compliance=float(length) / axial)
        for tendon, length in zip(tendons, SpatialChain(arm).straight_ropes, strict=True)))


def _refuse_same_place(names: Sequence[str], angles: Sequence[float], ends: Sequence[int],
                       twists: Sequence[float], count: int) -> None:
    """Refuse two tendons that are one: at the same angle all the way, to the same disc."""
    for second in range(len(names)):
        for first in range(second):
            apart = (angles[second] - angles[first] + pi) % (2.0 * pi) - pi
            if (abs(apart) < SAME_ANGLE and twists[first] == twists[second]
                    and (ends[first] or count) == (ends[second] or count)):
                raise ParameterError(
                    f'{names[first]} and {names[second]} are one tendon: both are at '
                    f'{angles[first]:g} rad and end at disc {ends[first] or count}; give '
                    'another angle in arm.tendon_angles, or another disc in arm.tendon_ends')


def _segment(get: Mapping[str, Any], i: int) -> SpatialSegment:
    about_y = get['bending_stiffnesses'][i]
    return SpatialSegment(
        get['segment_lengths'][i], get['lateral_bending_stiffnesses'][i] or about_y, about_y,
        get['torsional_stiffnesses'][i] or inf, get['segment_masses'][i],
        get['jams'][i], get['outer_diameters'][i], get['bending_angle_limits'][i],
        soft_law=get['soft_laws'][i])
