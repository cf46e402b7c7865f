# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The questions about a new arm, in order, and their suggested answers.

Stiffnesses and masses are estimated from sizes and materials.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, inf, pi, tau
from typing import TypeAlias

from soft_continuum.mechanics.stiffness import second_moment_of_area
from soft_continuum.parameters.parameter import Parameter, ParameterError, Value
from soft_continuum.ros.parameter_table import ALL_PARAMETERS

PLANAR, SPATIAL, TENDONS = KINDS = ('planar', 'spatial', 'tendons')
UNITS = {'': 1.0, 'mm': 1e-3, 'g': 1e-3, 'degrees': pi / 180.0, 'GPa': 1e9, 'N': 1.0,
         'N m^2': 1.0}
"""Input units, in SI."""
COUNTS = ('segments', 'tendons')  # integer questions that are not parameters
DIGITS = 4  # of suggestions
PARAMETERS = {p.name: p for p in ALL_PARAMETERS}
Given: TypeAlias = str | tuple[float, ...]
"""A choice, or numbers in the input unit."""
OF_RODS = (SPATIAL, TENDONS)
SPARE_PULL = 1.2  # times the largest pull by geometry
EXAMPLE = 'an example'
ROPE, ROPE_MODULUS = 0.3e-3, 70e9  # m; Pa, E A over the area of the circle around a braided rope
MAX_ANGLE = 179.0 * pi / 180.0
DISC_DENSITY = 1180.0  # kg/m^3, printed resin
POWDER_DENSITY = 450.0  # kg/m^3, ground coffee
SKIN_THICKNESS, SKIN_DENSITY = 0.25e-3, 930.0  # m, kg/m^3, latex
SPACER_THICKNESS = 1e-3  # m


class AnswerError(ParameterError):
    """An answer is invalid; the message says what was given and what is allowed."""

    def __init__(self, name: str, problem: str) -> None:
        """name: of the question."""
        super().__init__(f'{name}: {problem}')
        self.name = name


@dataclass(frozen=True)
class Suggestion:
    """A choice or numbers (in SI) assumed when nothing is known, and their origin."""

    value: str | Sequence[float]
    why: str


@dataclass(frozen=True)
class Answer:
    """An answer, in the input unit; assumed: why it was assumed, empty if it was given."""

    value: Given
    assumed: str = ''


@dataclass(frozen=True)
class Question:
    """
    One question about an arm.

    name: of the answer, and of its option.  text: the question.  suggest: a function of the
    previous answers.  parameter: the parameter that the answer sets, empty if it only serves to
    derive others.  unit: one of UNITS.  per: the items that have a number each, one of PER. low,
    high: in SI, unless the parameter has them.  choices: texts with their meanings. kinds: of arms
    to which it applies.
    """

    name: str
    text: str
    suggest: Callable[['Answers'], Suggestion]
    parameter: str = ''
    unit: str = ''
    per: str = ''
    low: float = -inf
    high: float = inf
    choices: Mapping[str, str] | None = None
    kinds: tuple[str, ...] = KINDS

    @property
    def option(self) -> str:
        """The option of the command line."""
        return f'--{self.name.replace("_", "-")}'

    @property
    def sets(self) -> Parameter | None:
        """The parameter that the answer sets."""
        return PARAMETERS[self.parameter] if self.parameter else None

    @property
    def whole(self) -> bool:
        """Whether the numbers are whole ones."""
        return not self.choices and (
            self.sets.type_name.startswith('integer') if self.sets else self.name in COUNTS)

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest number, in the unit that is typed."""
        low, high = (self.sets.low, self.sets.high) if self.sets else (self.low, self.high)
        return max(low, self.low) / UNITS[self.unit], min(high, self.high) / UNITS[self.unit]

    def count(self, answers: 'Answers') -> int:
        """Return the number of values, unless one applies to all; 0: some segments."""
        return PER[self.per](answers)

    def read(self, text: str) -> Given:
        """Parse the typed text; raises AnswerError with the allowed answers."""
        if self.choices:
            if text not in self.choices:
                raise AnswerError(self.name, f'{text!r} given; allowed: {", ".join(self.choices)}')
            return text
        low, high = self.bounds
        found = []
        for word in text.replace(' ', ',').strip(',').split(','):
            try:
                number = float(word)
            except ValueError:
                number = float('nan')
            if not low <= number <= high or (self.whole and not number.is_integer()):
                raise AnswerError(
                    self.name, f'{word!r} given; allowed: {"whole " if self.whole else ""}numbers '
                    f'from {low:g} to {high:g} {self.unit}'.rstrip() + ', with commas between')
            found.append(number)
        return tuple(found)

    def check(self, value: Given, answers: 'Answers') -> None:
        """Raise AnswerError for numbers that contradict the previous answers."""
        if isinstance(value, str):
            return
        count = self.count(answers)
        if not count and (len(set(value)) < len(value) or max(value) > answers.segments):
            raise AnswerError(
                self.name, f'{", ".join(f"{number:g}" for number in value)} given; allowed: '
                f'numbers from 1 to {answers.segments}, each once')
        if count and len(value) not in {1, count}:
            several = f'1 or {count} numbers' if count > 1 else 'one number'
            raise AnswerError(self.name, f'{len(value)} numbers given; allowed: {several}')

    def suggested(self, answers: 'Answers') -> Answer:
        """Return the value assumed when nothing is known, rounded as it is shown."""
        found = self.suggest(answers)
        if isinstance(found.value, str):
            return Answer(found.value, found.why)
        numbers = [float(f'{number / UNITS[self.unit]:.{DIGITS}g}') for number in found.value]
        same = len(set(numbers)) == 1
        return Answer(tuple(numbers[:1] if same else numbers), found.why)

    def value(self, answer: Answer) -> Value:
        """Return an answer in SI, as the value of its parameter."""
        if isinstance(answer.value, str):
            return answer.value
        numbers = tuple(number * UNITS[self.unit] for number in answer.value)
        if self.sets is not None and not isinstance(self.sets.default, tuple):
            return round(numbers[0]) if self.whole else numbers[0]
        return numbers


class Answers:
    """The answers so far, in SI for estimates."""

    def __init__(self, questions: Sequence[Question], answers: Mapping[str, Answer]) -> None:
        """answers: by the names of questions."""
        self._questions = {question.name: question for question in questions}
        self._answers = answers

    def text(self, name: str) -> str:
        """Return a choice."""
        return str(self._answers[name].value)

    def all(self, name: str, count: int = 0) -> tuple[float, ...]:
        """Return numbers in SI; one is repeated ``count`` times if that is given."""
        found = tuple(number * UNITS[self._questions[name].unit]
                      for number in self._answers[name].value if not isinstance(number, str))
        return found * count if len(found) == 1 and count else found

    def one(self, name: str) -> float:
        """Return a number in SI."""
        return self.all(name)[0]

    @property
    def kind(self) -> str:
        """One of KINDS."""
        return self.text('kind')

    @property
    def segments(self) -> int:
        """Number of segments of the arm."""
        return round(self.one('segments'))

    def each(self, name: str) -> tuple[float, ...]:
        """Return a number in SI for every segment."""
        return self.all(name, self.segments)


PER: Mapping[str, Callable[[Answers], int]] = {
    '': lambda answers: 1, 'segment': lambda answers: answers.segments,
    'disc': lambda answers: answers.segments + 1, 'some segments': lambda answers: 0,
    'end': lambda answers: len(answers.all('tendon_ends'))}
"""How many numbers a question may have; discs: base first, ends: of the tendons."""


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

DRAWINGS = {
    'segments': r"""
         [=====]   disc 2: the tip
          | : |
          | : |    segment 2
         [=====]   disc 1
          | : |
          | : |    segment 1
         [=====]   disc 0: the base
        /////////
""",
    'segment_lengths': r"""
         [=====]
          | : |  ^
          | : |  |  length
          | : |  v
         [=====]
""",
    'outer_diameters': r"""
         <----->   outer diameter
         [=====]
          | : |
          | : |
""",
    'disc_heights': r"""
          | : |
         +-----+  ^
         |     |  |  height
         +-----+  v
          | : |
""",
    'guide_offsets': r"""
         [=====]
         |  :  |   |  a tendon
         |  :  |   :  the backbone
         |  :  |
            <-->   offset
""",
    'spacers': r"""
         [=====]
          | : |
          |-:-|   spacer: tendons pass it
          | : |
          |-:-|   spacer
          | : |
         [=====]
""",
    'leaf_thicknesses': r"""
            ___________
           /          /|
          /__________/ |  ^
          |__________|/   v  thickness
          <---------->
              width
""",
    'rod_diameters': r"""
           ( )    rod
         ->| |<-  diameter
           | |
""",
    'tendon_ends': r"""
         [=====]   disc 2: tendon b ends here
          | : b
         [=a===]   disc 1: tendon a ends here
          |a: b
          |a: b
         [=====]   disc 0: the base
""",
    'first_tendon_angles': r"""
                y
                |
         2 o    |      seen from the tip:
                |      tendon 1 at its angle
          ------+---o 1 - x
                |
         3 o    |
""",
    'tendon_free_length': r"""
         [=====]   base
          |   |  ^
          |   |  |  free length
          |   |  v
         (motors)
""",
    'bending_angle_limits': r"""
               \   angle
          :     \ /
          :   /===/
          :  / /
          : | |
         [=====]
""",
    'mounting_angle': r"""
            0           90          180
            ^                     ////////
          [===]       /[=>         [===]
         ///////      /              v
""",
    'pull_limit': r"""
          |   |
         [=====]   base
          |   |
          |   v    pulled in
         (motors)
""",
}
"""For a terminal, by the names of questions; one similar to the previous question has none."""
