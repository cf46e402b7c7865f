# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The questions about a new arm, in order, and their suggested answers.

Stiffnesses and masses are estimated from sizes and materials.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, inf, pi, tau

from soft_continuum.mechanics.stiffness import second_moment_of_area
from soft_continuum.new_arm.answers import (
    Answers,
    PLANAR,
    Question,
    SPATIAL,
    Suggestion,
    TENDONS,
)

OF_RODS = (SPATIAL, TENDONS)
SPARE_PULL = 1.2  # times the largest pull by geometry
EXAMPLE = 'an example'
ROPE, ROPE_MODULUS = 0.3e-3, 70e9  # m; Pa, E A over the area of the circle around a braided rope
MAX_ANGLE = 179.0 * pi / 180.0
DISC_DENSITY = 1180.0  # kg/m^3, printed resin
POWDER_DENSITY = 450.0  # kg/m^3, ground coffee
SKIN_THICKNESS, SKIN_DENSITY = 0.25e-3, 930.0  # m, kg/m^3, latex
SPACER_THICKNESS = 1e-3  # m


@dataclass(frozen=True)
class Material:
    """
    A material of backbones: typical values.

    youngs_modulus: Pa.  poisson: Poisson's ratio.  density: kg/m^3.
    """

    name: str
    youngs_modulus: float
    poisson: float
    density: float


MATERIALS = {
    'steel': Material('spring steel', 200e9, 0.30, 7850.0),
    'nitinol': Material('superelastic NiTi (austenite)', 60e9, 0.33, 6450.0),
    'glass': Material('glass fibre in resin', 40e9, 0.28, 1900.0),
    'carbon': Material('carbon fibre in resin', 120e9, 0.30, 1600.0),
}


def _disc(diameter: float) -> float:
    """Return the area of a disc, m^2."""
    return pi / 4.0 * diameter**2


def _by_kind(name: str, text: str, parameter: str, unit: str, values: Mapping[str, float],
             per: str = '', high: float = inf) -> Question:
    """Return a question about kinds of arms, with a suggested number (SI) for each."""
    return Question(name, text, lambda a: Suggestion((values[a.kind],), EXAMPLE), parameter, unit,
                    per, high=high, kinds=tuple(values))


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
        return Suggestion([modulus * second_moment_of_area(*leaf) for leaf in leaves],
                          f'E I of leaf springs alone, {_mm(a, "leaf_thicknesses")}, {of}')
    return Suggestion([modulus * pi * d**4 / 64.0 for d in a.each('rod_diameters')],
                      f'E I of rods alone, {_mm(a, "rod_diameters")}, {of}')


def _torsion(a: Answers) -> Suggestion:
    if a.kind == SPATIAL:
        return Suggestion((0.0,), 'the jamming sleeve lets no segment twist')
    poisson = _material(a).poisson
    return Suggestion([k / (1.0 + poisson) for k in a.each('bending_stiffnesses')],
                      f'G J of a round rod, E I / (1 + nu) with nu = {poisson:g}')


def _segment_masses(a: Answers) -> Suggestion:
    lengths, diameters = a.each('segment_lengths'), a.each('outer_diameters')
    sections: Sequence[float] = (
        [b * t for b, t in zip(a.each('leaf_widths'), a.each('leaf_thicknesses'), strict=True)]
        if a.kind == PLANAR else list(map(_disc, a.each('rod_diameters'))))
    if a.kind == TENDONS:
        around = [a.one('spacers') * DISC_DENSITY * SPACER_THICKNESS * _disc(d) for d in diameters]
        why = 'rod, and full spacers of 1 mm of printed resin'
    else:
        around = [length * (POWDER_DENSITY * _disc(d) + SKIN_DENSITY * SKIN_THICKNESS * pi * d)
                  for d, length in zip(diameters, lengths, strict=True)]
        why = 'ground coffee in 0.25 mm of latex, and the spring'
    return Suggestion([_material(a).density * section * length + more for section, length, more
                       in zip(sections, lengths, around, strict=True)], why)


def _disc_masses(a: Answers) -> Suggestion:
    diameters = a.each('outer_diameters')
    return Suggestion(
        [DISC_DENSITY * height * _disc(d) for d, height in zip(
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
        return Suggestion((ROPE_MODULUS * _disc(ROPE),), 'E A of a braided steel rope of 0.3 mm')
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
        TENDONS: 'it bends in every direction, with tendons alone'}),
    Question('segments', 'How many segments does it have?',
             lambda a: Suggestion((3.0,), EXAMPLE), low=1.0, high=20.0),
    _by_kind('segment_lengths', 'How long is the bending part of each segment, base first?',
             'arm.segment_lengths', 'mm', {PLANAR: 0.07, SPATIAL: 0.07, TENDONS: 0.08}, 'segment'),
    _by_kind('outer_diameters', 'What is the outer diameter of each segment?',
             'arm.outer_diameters', 'mm', {PLANAR: 0.04, SPATIAL: 0.04, TENDONS: 0.02}, 'segment'),
    _by_kind('disc_heights', 'How high is each disc, the base disc first?',
             'arm.disc_heights', 'mm', {PLANAR: 0.03, SPATIAL: 0.03, TENDONS: 0.005}, 'disc'),
    Question('guide_offsets', 'How far from the backbone are the tendons, in each segment?',
             _guides, 'arm.guide_offsets', 'mm', 'segment', low=1e-4),
    Question('spacers', 'How many tendon guides are inside each segment?',
             lambda a: Suggestion((9.0,), EXAMPLE), 'arm.spacers', kinds=(TENDONS,)),
    Question('material', 'What is the backbone made of?',
             lambda a: Suggestion('nitinol' if a.kind == TENDONS else 'steel', EXAMPLE),
             choices={name: m.name for name, m in MATERIALS.items()}),
    Question('youngs_modulus', "What is its Young's modulus?", _youngs_modulus,
             'arm.youngs_modulus', 'GPa'),
    _by_kind('leaf_thicknesses', 'How thick is the leaf spring of each segment?',
             'arm.leaf_thicknesses', 'mm', {PLANAR: 0.00035}, per='segment'),
    _by_kind('leaf_widths', 'How wide is it?', 'arm.leaf_widths', 'mm',
             {PLANAR: 0.0127}, per='segment'),
    Question('rod_diameters', 'What is the diameter of the rod in each segment?',
             lambda a: Suggestion((1e-3,), EXAMPLE), unit='mm', per='segment',
             low=5e-5, high=0.1, kinds=OF_RODS),
    Question('bending_stiffnesses', 'What is the bending stiffness E I of each soft segment?',
             _bending, 'arm.bending_stiffnesses', 'N m^2', 'segment', low=1e-9),
    Question('torsional_stiffnesses', 'What is its torsional stiffness G J? 0: no twist',
             _torsion, 'arm.torsional_stiffnesses', 'N m^2', 'segment', kinds=OF_RODS),
    Question('segment_masses', 'What is the mass of each segment between its discs?',
             _segment_masses, 'arm.segment_masses', 'g', 'segment'),
    Question('disc_masses', 'What is the mass of each disc, the base disc first?',
             _disc_masses, 'arm.disc_masses', 'g', 'disc'),
    Question('tendon_ends', 'At which discs do tendons end? 1 is the disc above the first segment',
             _ends, 'arm.tendon_ends', '', 'some segments', low=1.0, kinds=OF_RODS),
    Question('tendons', 'How many tendons end at each of them, evenly spaced?',
             lambda a: Suggestion((3.0,), EXAMPLE), low=2.0, high=20.0, kinds=OF_RODS),
    Question('first_tendon_angles',
             'At what angle about z from x is the first of them, for each of these discs?',
             _first_angles, 'arm.tendon_angles', 'degrees', 'end', kinds=OF_RODS),
    Question('tendon_axial_stiffness', 'What is E A of the tendons? 0: they do not stretch',
             _stretch, 'arm.tendon_axial_stiffness', 'N'),
    Question('tendon_free_length', 'How long are the tendons between motor and base?',
             _free_length, 'arm.tendon_free_length', 'mm'),
    _by_kind('bending_angle_limits', 'How far may each segment bend?', 'arm.bending_angle_limits',
             'degrees', {PLANAR: pi / 3, SPATIAL: pi / 3, TENDONS: pi / 2}, per='segment',
             high=MAX_ANGLE),
    _by_kind('mounting_angle', 'How is the base mounted? 0: upright, 180: hanging',
             'arm.mounting_angle', 'degrees', {PLANAR: 0.0, SPATIAL: 0.0, TENDONS: pi}),
    Question('payload', 'What is the mass of the payload at the tip?',
             lambda a: Suggestion((0.0,), 'nothing is at the tip'), 'arm.payload', 'g'),
    Question('pull_limit', 'How far may a tendon be pulled in, or paid out?',
             _pull_limit, unit='mm', low=1e-3, high=1.0),
    _by_kind('tension_limit', 'What tension do tendons, guides and motors withstand?',
             'tension_limit', 'N', {PLANAR: 60.0, SPATIAL: 60.0, TENDONS: 10.0}),
)
