# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is asked about a new arm, in that order, and what is suggested where nobody knows."""

from collections.abc import Callable, Mapping
from math import ceil, inf, pi, tau

from soft_continuum.new_arm import estimates
from soft_continuum.new_arm.answers import (
    Answers,
    one,
    per_disc,
    per_end,
    per_segment,
    PLANAR,
    Question,
    some_segments,
    SPATIAL,
    Suggestion,
    TENDONS,
)
from soft_continuum.new_arm.estimates import Material, MATERIALS

OF_RODS = (SPATIAL, TENDONS)
SPARE_PULL = 1.2  # times the largest pull by geometry
EXAMPLE = 'an example'
ROPE = 0.3e-3  # m
MAX_ANGLE = 179.0 * pi / 180.0


def _by_kind(name: str, text: str, parameter: str, unit: str, values: Mapping[str, float],
             count: Callable[[Answers], int] = one, high: float = inf) -> Question:
    """Return a question about kinds of arms, for each of which a number (SI) is suggested."""
    return Question(name, text, lambda a: Suggestion((values[a.kind],), EXAMPLE), parameter, unit,
                    count, high=high, kinds=tuple(values))


def _material(a: Answers) -> Material:
    return MATERIALS[a.text('material')]


def _guides(a: Answers) -> Suggestion:
    part, why = (0.4, '0.4 times') if a.kind == TENDONS else (0.5, 'half')
    return Suggestion([part * d for d in a.each('outer_diameters')],
                      f'{why} the outer diameter')


def _youngs_modulus(a: Answers) -> Suggestion:
    return Suggestion((_material(a).youngs_modulus,), f'typical of {_material(a).name}')


def _mm(a: Answers, name: str) -> str:
    return f'{", ".join(f"{1e3 * length:g}" for length in a.all(name))} mm'


def _bending(a: Answers) -> Suggestion:
    modulus = a.one('youngs_modulus')
    of = f'E = {modulus / 1e9:g} GPa'
    if a.kind == PLANAR:
        leaves = zip(a.each('leaf_widths'), a.each('leaf_thicknesses'), strict=True)
        return Suggestion([estimates.leaf_stiffness(b, t, modulus) for b, t in leaves],
                          f'E I of leaf springs alone, {_mm(a, "leaf_thicknesses")}, {of}')
    return Suggestion([estimates.rod_stiffness(d, modulus) for d in a.each('rod_diameters')],
                      f'E I of rods alone, {_mm(a, "rod_diameters")}, {of}')


def _torsion(a: Answers) -> Suggestion:
    if a.kind == SPATIAL:
        return Suggestion((0.0,), 'the jamming sleeve lets no segment twist')
    poisson = _material(a).poisson
    return Suggestion([estimates.torsional_stiffness(k, poisson)
                       for k in a.each('bending_stiffnesses')],
                      f'G J of a round rod, E I / (1 + nu) with nu = {poisson:g}')


def _backbone_mass(a: Answers, segment: int) -> float:
    length, density = a.each('segment_lengths')[segment], _material(a).density
    if a.kind == PLANAR:
        section = a.each('leaf_widths')[segment] * a.each('leaf_thicknesses')[segment]
        return density * section * length
    return estimates.rod_mass(a.each('rod_diameters')[segment], length, density)


def _segment_masses(a: Answers) -> Suggestion:
    backbone = [_backbone_mass(a, s) for s in range(a.segments)]
    if a.kind == TENDONS:
        spacer = [a.one('spacers') * estimates.rod_mass(
            d, estimates.SPACER_THICKNESS, estimates.DISC_DENSITY)
            for d in a.each('outer_diameters')]
        return Suggestion([one + other for one, other in zip(backbone, spacer, strict=True)],
                          'rod, and full spacers of 1 mm of printed resin')
    sleeve = [estimates.jamming_mass(d, length) for d, length in zip(
        a.each('outer_diameters'), a.each('segment_lengths'), strict=True)]
    return Suggestion([one + other for one, other in zip(backbone, sleeve, strict=True)],
                      'ground coffee in 0.25 mm of latex, and the spring')


def _disc_masses(a: Answers) -> Suggestion:
    diameters = a.each('outer_diameters')
    return Suggestion(
        [estimates.rod_mass(d, h, estimates.DISC_DENSITY) for d, h in zip(
            (diameters[0], *diameters), a.all('disc_heights', a.segments + 1), strict=True)],
        'full discs of printed resin, 1.18 g/cm^3, nothing on them')


def _ends(a: Answers) -> Suggestion:
    if a.kind == TENDONS:
        return Suggestion(range(1, a.segments + 1), 'each segment has tendons of its own')
    return Suggestion((a.segments,), 'all end at the tip, as in the paper')


def _first_angles(a: Answers) -> Suggestion:
    ends = len(a.all('tendon_ends'))
    return Suggestion([tau * i / (a.one('tendons') * ends) for i in range(ends)],
                      'all evenly spaced, no two in one place')


def _stretch(a: Answers) -> Suggestion:
    if a.kind == TENDONS:
        return Suggestion((estimates.rope_stiffness(ROPE),),
                          'E A of a braided steel rope of 0.3 mm')
    return Suggestion((0.0,), 'the tendons are taken not to stretch')


def _free_length(a: Answers) -> Suggestion:
    if a.one('tendon_axial_stiffness') == 0.0:
        return Suggestion((0.0,), 'it counts only for tendons that stretch')
    return Suggestion((0.3,), EXAMPLE)


def _pull_limit(a: Answers) -> Suggestion:
    needed = sum(offset * angle for offset, angle in zip(
        a.each('guide_offsets'), a.each('bending_angle_limits'), strict=True))
    return Suggestion((ceil(1e3 * SPARE_PULL * needed) / 1e3,),
                      'guide offsets times bending angle limits, and a fifth')


QUESTIONS: tuple[Question, ...] = (
    Question('kind', 'Which kind of arm is it?', lambda a: Suggestion(TENDONS, EXAMPLE), choices={
        PLANAR: 'it bends in one plane; segments are stiffened by jamming, as in the paper',
        SPATIAL: 'it bends in every direction; segments are stiffened by jamming',
        TENDONS: 'it bends in every direction, by tendons alone'}),
    Question('segments', 'How many segments does it have?',
             lambda a: Suggestion((3.0,), EXAMPLE), low=1.0, high=20.0),
    _by_kind('segment_lengths', 'How long is the part of each segment that bends, base first?',
             'arm.segment_lengths', 'mm', {PLANAR: 0.07, SPATIAL: 0.07, TENDONS: 0.08},
             count=per_segment),
    _by_kind('outer_diameters', 'What is the outer diameter of each segment?',
             'arm.outer_diameters', 'mm', {PLANAR: 0.04, SPATIAL: 0.04, TENDONS: 0.02},
             count=per_segment),
    _by_kind('disc_heights', 'How high is each disc, the base disc first?',
             'arm.disc_heights', 'mm', {PLANAR: 0.03, SPATIAL: 0.03, TENDONS: 0.005},
             count=per_disc),
    Question('guide_offsets', 'How far from the backbone are the tendons, in each segment?',
             _guides, 'arm.guide_offsets', 'mm', per_segment, low=1e-4),
    Question('spacers', 'How many guides have the tendons inside each segment?',
             lambda a: Suggestion((9.0,), EXAMPLE), 'arm.spacers', kinds=(TENDONS,)),
    Question('material', 'What is the backbone made of?',
             lambda a: Suggestion('nitinol' if a.kind == TENDONS else 'steel', EXAMPLE),
             choices={name: m.name for name, m in MATERIALS.items()}),
    Question('youngs_modulus', "What is its Young's modulus?", _youngs_modulus,
             'arm.youngs_modulus', 'GPa'),
    _by_kind('leaf_thicknesses', 'How thick is the leaf spring of each segment?',
             'arm.leaf_thicknesses', 'mm', {PLANAR: 0.00035}, count=per_segment),
    _by_kind('leaf_widths', 'How wide is it?', 'arm.leaf_widths', 'mm',
             {PLANAR: 0.0127}, count=per_segment),
    Question('rod_diameters', 'What is the diameter of the rod in each segment?',
             lambda a: Suggestion((1e-3,), EXAMPLE), unit='mm', count=per_segment,
             low=5e-5, high=0.1, kinds=OF_RODS),
    Question('bending_stiffnesses', 'What is the bending stiffness E I of each soft segment?',
             _bending, 'arm.bending_stiffnesses', 'N m^2', per_segment, low=1e-9),
    Question('torsional_stiffnesses', 'What is its torsional stiffness G J? 0: no twist',
             _torsion, 'arm.torsional_stiffnesses', 'N m^2', per_segment, kinds=OF_RODS),
    Question('segment_masses', 'What is the mass of each segment between its discs?',
             _segment_masses, 'arm.segment_masses', 'g', per_segment),
    Question('disc_masses', 'What is the mass of each disc, the base disc first?',
             _disc_masses, 'arm.disc_masses', 'g', per_disc),
    Question('tendon_ends', 'At which discs do tendons end? 1 is the disc above the first segment',
             _ends, 'arm.tendon_ends', '', some_segments, low=1.0, kinds=OF_RODS),
    Question('tendons', 'How many tendons end at each of them, evenly spaced?',
             lambda a: Suggestion((3.0,), EXAMPLE), low=2.0, high=20.0, kinds=OF_RODS),
    Question('first_tendon_angles',
             'Where is the first of them, about z from x, for each of these discs?',
             _first_angles, 'arm.tendon_angles', 'degrees', per_end,
             kinds=OF_RODS),
    Question('tendon_axial_stiffness', 'What is E A of the tendons? 0: they do not stretch',
             _stretch, 'arm.tendon_axial_stiffness', 'N'),
    Question('tendon_free_length', 'How long are the tendons between motor and base?',
             _free_length, 'arm.tendon_free_length', 'mm'),
    _by_kind('bending_angle_limits', 'How far may each segment bend?', 'arm.bending_angle_limits',
             'degrees', {PLANAR: pi / 3, SPATIAL: pi / 3, TENDONS: pi / 2}, count=per_segment,
             high=MAX_ANGLE),
    _by_kind('mounting_angle', 'How is the base mounted? 0: upright, 180: hanging',
             'arm.mounting_angle', 'degrees', {PLANAR: 0.0, SPATIAL: 0.0, TENDONS: pi}),
    Question('payload', 'What is the mass of what the tip carries?',
             lambda a: Suggestion((0.0,), 'nothing is at the tip'), 'arm.payload', 'g'),
    Question('pull_limit', 'By how much may a tendon be pulled in, or paid out?',
             _pull_limit, unit='mm', low=1e-3, high=1.0),
    _by_kind('tension_limit', 'What tension do tendons, guides and motors withstand?',
             'tension_limit', 'N', {PLANAR: 60.0, SPATIAL: 60.0, TENDONS: 10.0}),
)
