# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters that describe the arm, and the Arm built from them."""

from collections.abc import Mapping, Sequence
import hashlib
import json
from math import inf, pi
import re
from typing import Any

from soft_continuum.mechanics.arm import (
    Arm,
    ArmError,
    Disc,
    MIN_OFFSET,
    mounted,
    PAPER,
    SECOND_ORDER,
    Segment,
    STANDARD_GRAVITY,
    Tendon,
    tendon_pair,
)
from soft_continuum.mechanics.constant_curvature import fully_actuated
from soft_continuum.mechanics.laws import Jam, LawError, linear, MomentCurvature
from soft_continuum.mechanics.rotations import wrapped
from soft_continuum.mechanics.stiffness import second_moment_of_area
from soft_continuum.parameters.parameter import Parameter, ParameterError, spread

NO_NAMES = ('',)
SPATIAL_PER_SEGMENT = (
    Parameter('arm.lateral_bending_stiffnesses', (0.0,),
              'spatial arm: E I of each segment about x; 0: as about y, for a round spring; '
              '.inf: a hinge about y', 0.0, 1e3, unit='N m^2', infinite=True),
    Parameter('arm.torsional_stiffnesses', (0.0,),
              'G J of each segment of a spatial arm; 0: it does not twist',
              0.0, 1e3, unit='N m^2'),
)
TENDONS = (
    Parameter('arm.tendon_names', NO_NAMES,
              'name of each tendon of a spatial arm; one empty name: a planar arm with '
              'right_tendon and left_tendon'),
    Parameter('arm.tendon_angles', (0.0,),
              'where each tendon is at the base: angle about z from x', -2 * pi, 2 * pi,
              unit='rad'),
    Parameter('arm.tendon_ends', (0,),
              'number of the disc where each tendon ends, 1 above the first segment; 0: the last',
              0, 1000),
    Parameter('arm.tendon_twists', (0.0,),
              'rate at which each tendon winds around the arm; 0: parallel to it', -1e3, 1e3,
              unit='rad/m'),
)
SPATIAL_PARAMETERS = (
    *TENDONS,
    Parameter('arm.spacers', 0,
              'guides of the tendons inside each segment of a spatial arm, evenly spaced', 0, 100),
)
SAME_ANGLE = 1e-3  # rad
NAME = re.compile(r'[A-Za-z]\w{0,99}', re.ASCII)
LEAF_SPRINGS = (
    Parameter('arm.leaf_thicknesses', (0.0005, 0.00035, 0.00025),
              'thickness of each leaf spring', 1e-5, 1e-2, unit='m'),
    Parameter('arm.leaf_widths', (0.0127, 0.0127, 0.0127),
              'width of each leaf spring', 1e-4, 1.0, unit='m'),
)
PER_SEGMENT = (
    Parameter('arm.segment_lengths', (0.07, 0.07, 0.07),
              'bending length of each segment, base first', 1e-3, 10.0, unit='m'),
    Parameter('arm.outer_diameters', (0.05, 0.0425, 0.035),
              'outer diameter of each segment', 1e-3, 10.0, unit='m'),
    *LEAF_SPRINGS,
    Parameter('arm.bending_stiffnesses', (0.0,),
              'measured E I of each soft segment; 0: that of its leaf spring',
              0.0, 1e3, unit='N m^2'),
    Parameter('arm.segment_masses', (0.069, 0.05, 0.034),
              'mass of each segment between its discs', 0.0, 10.0, unit='kg'),
    Parameter('arm.bending_angle_limits', (pi / 3, pi / 3, pi / 3),
              'largest bending angle of each segment to either side', 1e-3, 2 * pi, unit='rad'),
    Parameter('arm.stiffness_ratios', (0.0,),
              'K, ratio of stiff to soft bending stiffness of each segment; 0: rigid when stiff',
              0.0, 1e6),
    Parameter('arm.yield_moments', (0.0,),
              'moment at which each jammed segment yields at full vacuum; 0: never',
              0.0, 1e6, unit='N m'),
    Parameter('arm.stiffness_exponents', (1.0,),
              'exponent n of each segment: jamming adds stiffness in proportion to (vacuum / full '
              'vacuum)^n', 0.0, 5.0),
    *SPATIAL_PER_SEGMENT,
)
PER_GUIDE = (
    Parameter('arm.guide_offsets', (0.0,),
              'distance of the tendon guides from the backbone at the lower and upper end of '
              'each segment; 0: half its outer diameter', 0.0, 10.0, unit='m'),
)
PER_DISC = (
    Parameter('arm.disc_heights', (0.03, 0.03, 0.03, 0.03),
              'height of each disc, base first', 1e-3, 10.0, unit='m'),
    Parameter('arm.disc_masses', (0.06, 0.06, 0.045, 0.033),
              'mass of each disc, base first', 0.0, 10.0, unit='kg'),
)
MEASURED_LAWS = tuple(
    Parameter(f'arm.{state}_{quantity}', (0.0,),
              f'{quantity} of the measured law of the {state} segments: one table for each '
              f'segment, each starting at 0.0; 0.0 alone: {without} applies', 0.0, 1e6, unit=unit)
    for state, without in (('soft', 'arm.bending_stiffnesses'), ('stiff', 'arm.stiffness_ratios'))
    for quantity, unit in (('curvatures', '1/m'), ('moments', 'N m')))
ARM_PARAMETERS = (
    *PER_SEGMENT, *PER_GUIDE, *PER_DISC, *MEASURED_LAWS, *SPATIAL_PARAMETERS,
    Parameter('arm.jamming', True,
              'whether segments can be stiffened; false: all are always soft and jamming_valves '
              'is not needed'),
    Parameter('arm.youngs_modulus', 200e9,
              "Young's modulus of the leaf springs", 1e6, 1e12, unit='Pa'),
    Parameter('arm.bodies_per_segment', 12,
              'rigid bodies of the chain model in each segment', 1, 1000),
    Parameter('arm.discretisation', PAPER,
              'springs of the chain: equal as in the paper, or second order',
              choices=(PAPER, SECOND_ORDER)),
    Parameter('arm.tendon_axial_stiffness', 0.0,
              'E A of the tendons; 0: inextensible', 0.0, 1e9, unit='N'),
    Parameter('arm.tendon_free_length', 0.0,
              'length of tendon between stepper and base', 0.0, 100.0, unit='m'),
    Parameter('arm.tendon_friction', 0.0,
              'capstan friction coefficient of the tendon at every guide', 0.0, 2.0),
    Parameter('arm.payload', 0.0, 'mass at the top of the tip disc', 0.0, 100.0, unit='kg'),
    Parameter('arm.mounting_angle', 0.0,
              'rotation of the base about +y from upright; pi: hanging',
              -2 * pi, 2 * pi, unit='rad'),
    Parameter('arm.gravity', STANDARD_GRAVITY,
              'gravitational acceleration; 0: none', 0.0, 100.0, unit='m/s^2'),
)
MAX_SEGMENTS = 100


def description_digest(values: Mapping[str, Any]) -> str:
    """
    Return 16 hexadecimal digits that identify the description of an arm.

    values: checked parameters; those in ARM_PARAMETERS are used; empty if there are none.
    The digits depend neither on their order nor on the notation of their numbers.
    """
    described = {p.name: p.check(values[p.name]) for p in ARM_PARAMETERS if p.name in values}
    # Python writes the shortest decimal fraction that is read as the same float, on any machine.
    text = json.dumps(described, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16] if described else ''


def require_jamming(values: Mapping[str, Any]) -> None:
    """Raise ParameterError for an arm without jamming, in nodes that need it."""
    if not values['arm.jamming']:
        raise ParameterError(
            'arm.jamming is false: the segments of this arm cannot be stiffened, so nodes that '
            'switch them are not needed; `soft_continuum up` starts those that are')


def check_actuation(arm: Arm, values: Mapping[str, Any]) -> None:
    """Raise ParameterError for an arm whose segments cannot be bent independently."""
    if not (values['arm.jamming'] or fully_actuated(arm)):
        raise ParameterError(
            'arm.jamming is false, and the tendons of this arm cannot bend each segment '
            'independently (fewer independent tendons than bending directions): it has no shapes, '
            'so nodes that set them are not needed; `soft_continuum up` starts those that are')


def arm_from_parameters(values: Mapping[str, Any]) -> Arm:
    """
    Build the arm from parameter values by their names in ARM_PARAMETERS.

    A list of one value applies to every segment, guide, disc or tendon.  A measured law replaces a
    bending stiffness or stiffness ratio.  Without tendon names the arm is planar.

    Raises ParameterError when the lists do not fit together or a value is not physical.
    """
    get: dict[str, Any] = {
        p.name.removeprefix('arm.'): p.check(values.get(p.name, p.default))
        for p in ARM_PARAMETERS}
    if all(get['bending_stiffnesses']):  # then nothing follows from the three springs of the paper
        for spring in LEAF_SPRINGS:
            name = spring.name.removeprefix('arm.')
            get[name] = get[name][:1] if get[name] == spring.default else get[name]
    count = len(get['segment_lengths'])
    if count > MAX_SEGMENTS:
        raise ParameterError(f'parameter arm.segment_lengths has {count} values; allowed: up to '
                             f'{MAX_SEGMENTS} segments')
    for parameters, expected in ((PER_SEGMENT, count), (PER_GUIDE, 2 * count),
                                 (PER_DISC, count + 1)):
        for parameter in parameters:
            name = parameter.name.removeprefix('arm.')
            get[name] = spread(parameter.name, get[name], expected,
                               f'arm.segment_lengths has {count}')
    if any(0.0 < offset < MIN_OFFSET for offset in get['guide_offsets']):
        raise ParameterError(
            f'parameter arm.guide_offsets is {list(get["guide_offsets"])}; allowed: '
            f'{MIN_OFFSET:g} m and more, or 0 for half the outer diameter')
    get['bending_stiffnesses'] = tuple(
        given or get['youngs_modulus'] * second_moment_of_area(width, thickness)
        for given, width, thickness in zip(
            get['bending_stiffnesses'], get['leaf_widths'], get['leaf_thicknesses'], strict=True))
    get['guide_offsets'] = tuple(offset or get['outer_diameters'][i // 2] / 2
                                 for i, offset in enumerate(get['guide_offsets']))
    try:
        get['soft_laws'] = _laws(get, 'soft', count)
        get['jams'] = _jams(get, count)
        return Arm(
            tuple(_segment(get, i) for i in range(count)),
            tuple(Disc(height=height, mass=mass) for height, mass in zip(
                get['disc_heights'], get['disc_masses'], strict=True)),
            _tendons(get, count),
            **{name: get[name] for name in ('bodies_per_segment', 'spacers', 'discretisation',
                                            'payload')},
            gravity=mounted(get['mounting_angle'], get['gravity']),
            weightless_angle=get['mounting_angle'])
    except (ArmError, LawError) as error:
        raise ParameterError(f'arm: {error}') from None


def _segment(get: Mapping[str, Any], i: int) -> Segment:
    about_y = get['bending_stiffnesses'][i]
    unnamed = get['tendon_names'] in (NO_NAMES, ())
    return Segment(
        get['segment_lengths'][i],
        inf if unnamed else get['lateral_bending_stiffnesses'][i] or about_y, about_y,
        get['torsional_stiffnesses'][i] or inf, get['segment_masses'][i],
        get['jams'][i], get['outer_diameters'][i], get['bending_angle_limits'][i],
        soft_law=get['soft_laws'][i])


def _tendons(get: Mapping[str, Any], count: int) -> tuple[Tendon, ...]:
    """Return the tendons by their names; without names the pair of a planar arm."""
    alike = {'axial_stiffness': get['tendon_axial_stiffness'] or inf,
             'friction': get['tendon_friction'], 'free_length': get['tendon_free_length']}
    names = get['tendon_names']
    if names in (NO_NAMES, ()):
        _refuse_spatial(get)
        return tendon_pair(get['guide_offsets'], count, **alike)
    for name in names:
        if not NAME.fullmatch(name) or names.count(name) > 1:
            raise ParameterError(
                f'parameter arm.tendon_names is {list(names)}; each tendon needs a name of its '
                'own, of letters, digits and _, such as tendon_1')
    angles, ends, twists = (
        spread(parameter.name, get[parameter.name.removeprefix('arm.')], len(names),
               f'arm.tendon_names has {len(names)}', alone=parameter.name != 'arm.tendon_angles')
        for parameter in TENDONS[1:])
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
    return tuple(
        Tendon(name, angle, get['guide_offsets'][:2 * (end or count)], end or count, twist,
               **alike)
        for name, angle, end, twist in zip(names, angles, ends, twists, strict=True))


def _refuse_same_place(names: Sequence[str], angles: Sequence[float], ends: Sequence[int],
                       twists: Sequence[float], count: int) -> None:
    """Refuse two tendons that coincide: at the same angle along the arm, to the same disc."""
    for second in range(len(names)):
        for first in range(second):
            apart = wrapped(angles[second] - angles[first])
            if (abs(apart) < SAME_ANGLE and twists[first] == twists[second]
                    and (ends[first] or count) == (ends[second] or count)):
                raise ParameterError(
                    f'{names[first]} and {names[second]} coincide: both are at {angles[first]:g} '
                    f'rad and end at disc {ends[first] or count}; give another angle in '
                    'arm.tendon_angles, or another disc in arm.tendon_ends')


def _refuse_spatial(get: Mapping[str, Any]) -> None:
    """Refuse parameters of spatial arms; get: checked parameters of a planar arm, by name."""
    for parameter in (*SPATIAL_PER_SEGMENT, *SPATIAL_PARAMETERS):
        value = get[parameter.name.removeprefix('arm.')]
        if isinstance(value, tuple):
            value = tuple(set(value))  # of all segments
        if value not in (parameter.default, ()):
            raise ParameterError(
                f'parameter {parameter.name} is given, but a planar arm has none; give '
                f'arm.tendon_names to describe a spatial one, or leave {parameter.name} out')


def _jams(get: Mapping[str, Any], count: int) -> list[Jam]:
    """Return how each segment is stiffened; ParameterError where it would become softer."""
    jams = []
    for i, law in enumerate(_laws(get, 'stiff', count)):
        about_y = get['bending_stiffnesses'][i]
        softer = min(get['lateral_bending_stiffnesses'][i] or about_y, about_y)
        if law is not None:
            try:  # what the jam adds must be a law, too
                law.minus(get['soft_laws'][i] or linear(softer))
            except LawError as error:
                raise ParameterError(
                    f'parameters arm.stiff_curvatures and arm.stiff_moments, segment {i + 1}: '
                    f'{error}; is it softer than the soft one?') from None
        jams.append(Jam(ratio=inf if law else get['stiffness_ratios'][i] or inf, law=law,
                        yield_moment=get['yield_moments'][i] or inf,
                        stiffness_exponent=get['stiffness_exponents'][i]))
    return jams


def _laws(get: Mapping[str, Any], state: str, count: int) -> list[MomentCurvature | None]:
    """Return the measured law of every segment in a state, None where there is none."""
    names = f'{state}_curvatures', f'{state}_moments'
    tables = [_tables(name, get[name], count) for name in names]
    laws: list[MomentCurvature | None] = []
    for i, (curvatures, moments) in enumerate(zip(*tables, strict=True)):
        try:
            laws.append(None if curvatures == moments == (0.0,)
                        else MomentCurvature(curvatures, moments))
        except LawError as error:
            raise ParameterError(
                f'parameters arm.{names[0]} and arm.{names[1]}, segment {i + 1}: {error}'
            ) from None
    return laws


def _tables(name: str, values: Sequence[float], count: int) -> list[tuple[float, ...]]:
    """Cut a list into the tables of its segments, each of which starts at 0."""
    starts = [i for i, value in enumerate(values) if value == 0.0]
    if not starts or starts[0] != 0 or len(starts) not in (1, count):
        raise ParameterError(
            f'parameter arm.{name} is {list(values)}; allowed: {count} tables one after another, '
            'each starting at 0.0, or one for all; 0.0 alone is no table')
    tables = [tuple(values[a:b]) for a, b in zip(starts, [*starts[1:], None], strict=True)]
    return tables if len(tables) == count else tables * count


def table_parameters(laws: Sequence[MomentCurvature | None], state: str
                     ) -> dict[str, tuple[float, ...]]:
    """Return the parameters for the measured law of every segment in a state."""
    tables = [(law.curvatures, law.moments) if law else ((0.0,), (0.0,)) for law in laws]
    return {f'arm.{state}_curvatures': tuple(k for curvatures, _ in tables for k in curvatures),
            f'arm.{state}_moments': tuple(m for _, moments in tables for m in moments)}
