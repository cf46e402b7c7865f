# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters that describe the arm, and the Arm that they describe."""

from collections.abc import Mapping, Sequence
from math import inf, pi
from typing import Any

from soft_continuum.mechanics.arm import (
    Arm,
    ArmError,
    Disc,
    PAPER,
    SECOND_ORDER,
    Segment,
    STANDARD_GRAVITY,
    Tendon,
)
from soft_continuum.mechanics.laws import Jam, LawError, linear, MomentCurvature
from soft_continuum.mechanics.stiffness import second_moment_of_area
from soft_continuum.parameters.parameter import Parameter, ParameterError

ARM_PARAMETERS = (
    Parameter('arm.segment_lengths', (0.07, 0.07, 0.07),
              'bending length of each segment, base first, m', 1e-3, 10.0),
    Parameter('arm.outer_diameters', (0.05, 0.0425, 0.035),
              'outer diameter of each segment, m', 1e-3, 10.0),
    Parameter('arm.leaf_thicknesses', (0.0005, 0.00035, 0.00025),
              'thickness of each leaf spring, m', 1e-5, 1e-2),
    Parameter('arm.leaf_widths', (0.0127, 0.0127, 0.0127),
              'width of each leaf spring, m', 1e-4, 1.0),
    Parameter('arm.youngs_modulus', 200e9,
              "Young's modulus of the leaf springs, Pa", 1e6, 1e12),
    Parameter('arm.bending_stiffnesses', (0.0,),
              'measured E I of each soft segment, N m^2; 0: that of its leaf spring', 0.0, 1e3),
    Parameter('arm.segment_masses', (0.069, 0.05, 0.034),
              'mass of each segment between its discs, kg', 0.0, 10.0),
    Parameter('arm.disc_heights', (0.03, 0.03, 0.03, 0.03),
              'height of each disc, base first, m', 1e-3, 10.0),
    Parameter('arm.disc_masses', (0.06, 0.06, 0.045, 0.033),
              'mass of each disc, base first, kg', 0.0, 10.0),
    Parameter('arm.guide_offsets', (0.0,),
              'distance of the tendon guides from the backbone at the lower and upper end of '
              'each segment, m; 0: half its outer diameter', 0.0, 10.0),
    Parameter('arm.bending_angle_limits', (pi / 3, pi / 3, pi / 3),
              'largest bending angle of each segment to either side, rad', 1e-3, 2 * pi),
    Parameter('arm.stiffness_ratios', (0.0,),
              'bending stiffness of each segment stiff over soft, K; 0: rigid when stiff',
              0.0, 1e6),
    Parameter('arm.yield_moments', (0.0,),
              'moment that the jam of each segment bears at full vacuum, N m; 0: any', 0.0, 1e6),
    *(Parameter(f'arm.{state}_{column}', (0.0,), f'{meaning}, {unit}: a table that starts at 0 '
                f'for each segment one after another, 0 alone for {without}', 0.0, 1e6)
      for state, without in (('soft', 'its bending stiffness'), ('stiff', 'its stiffness ratio'))
      for column, meaning, unit in (
          ('curvatures', f'curvatures of measured {state} segments', '1/m'),
          ('moments', 'moments at these curvatures', 'N m'))),
    Parameter('arm.bodies_per_segment', 12,
              'rigid bodies of the chain model in each segment', 1, 1000),
    Parameter('arm.discretisation', PAPER,
              'springs of the chain: equal as in the paper, or second order',
              choices=(PAPER, SECOND_ORDER)),
    Parameter('arm.tendon_axial_stiffness', 0.0,
              'E A of the tendons, N; 0: they do not stretch', 0.0, 1e9),
    Parameter('arm.tendon_free_length', 0.0,
              'length of tendon between stepper and base, m', 0.0, 100.0),
    Parameter('arm.tendon_friction', 0.0, 'Capstan friction coefficient at every guide', 0.0, 2.0),
    Parameter('arm.payload', 0.0, 'mass at the top of the tip disc, kg', 0.0, 100.0),
    Parameter('arm.mounting_angle', 0.0,
              'rotation of the base about +y from upright, rad (pi: hanging)', -2 * pi, 2 * pi),
    Parameter('arm.gravity', STANDARD_GRAVITY, 'gravity, m/s^2; 0 leaves it out', 0.0, 100.0),
)

def arm_from_parameters(values: Mapping[str, Any]) -> Arm:
    """
    Build the arm from parameter values by their names in ARM_PARAMETERS.

    A list of one value counts for every segment, guide or disc.  A measured table takes the place
    of a bending stiffness or stiffness ratio.

    Raises ParameterError when the lists do not fit together or a value is not physical.
    """
    get: dict[str, Any] = {
        p.name.removeprefix('arm.'): p.check(values.get(p.name, p.default))
        for p in ARM_PARAMETERS}
    lengths = get['segment_lengths']
    count = len(lengths)
    for name, expected in (('outer_diameters', count), ('leaf_thicknesses', count),
                           ('leaf_widths', count), ('bending_stiffnesses', count),
                           ('segment_masses', count), ('bending_angle_limits', count),
                           ('stiffness_ratios', count), ('yield_moments', count),
                           ('guide_offsets', 2 * count),
                           ('disc_heights', count + 1), ('disc_masses', count + 1)):
        if len(get[name]) == 1:
            get[name] *= expected
        if len(get[name]) != expected:
            raise ParameterError(
                f'parameter arm.{name} has {len(get[name])} values; arm.segment_lengths has '
                f'{count}, so {expected} are needed, or one for all')
    segments = zip(
        lengths, get['outer_diameters'], get['leaf_thicknesses'], get['leaf_widths'],
        get['bending_stiffnesses'], get['segment_masses'], get['bending_angle_limits'],
        get['stiffness_ratios'], get['yield_moments'], _laws(get, 'soft', count),
        _laws(get, 'stiff', count), strict=True)
    offsets = get['guide_offsets']
    discs = zip(get['disc_heights'], get['disc_masses'], strict=True)
    modulus = get['youngs_modulus']
    if any(0.0 < offset < 1e-4 for offset in offsets):
        raise ParameterError(f'parameter arm.guide_offsets is {list(offsets)}; allowed: 0.0001 m '
                             'and more, or 0 for half the outer diameter')
    try:
        arm = Arm(
            segments=tuple(
                Segment(length=length, outer_diameter=diameter, mass=mass,
                        bending_stiffness=measured or modulus * second_moment_of_area(
                            width, thickness),
                        guide_offsets=(offsets[2 * i] or diameter / 2,
                                       offsets[2 * i + 1] or diameter / 2),
                        bending_angle_limit=limit, soft_law=soft,
                        jam=Jam(ratio=inf if stiff else ratio or inf, law=stiff,
                                yield_moment=bears or inf))
                for i, (length, diameter, thickness, width, measured, mass, limit, ratio, bears,
                        soft, stiff) in enumerate(segments)),
            discs=tuple(Disc(height=height, mass=mass) for height, mass in discs),
            bodies_per_segment=get['bodies_per_segment'],
            discretisation=get['discretisation'],
            tendon=Tendon(get['tendon_axial_stiffness'] or inf, get['tendon_free_length'],
                          get['tendon_friction']),
            payload=get['payload'],
            mounting_angle=get['mounting_angle'],
            gravity=get['gravity'])
    except (ArmError, LawError) as error:
        raise ParameterError(f'arm: {error}') from None
    for number, segment in enumerate(arm.segments, start=1):
        if segment.jam.law is not None:
            try:  # what the jam adds must be a law, too
                segment.jam.law.minus(segment.soft_law or linear(segment.bending_stiffness))
            except LawError as error:
                raise ParameterError(
                    f'parameters arm.stiff_curvatures and arm.stiff_moments, segment {number}: '
                    f'{error}; is it softer than the soft one?') from None
    return arm


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


def table_parameters(laws: Sequence[MomentCurvature | None], state: str) -> dict[str, list[float]]:
    """Return the parameters (below ``arm.``) for the measured law of every segment in a state."""
    tables = [(law.curvatures, law.moments) if law else ((0.0,), (0.0,)) for law in laws]
    return {f'{state}_curvatures': [k for curvatures, _ in tables for k in curvatures],
            f'{state}_moments': [m for _, moments in tables for m in moments]}
