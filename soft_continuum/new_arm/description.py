# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The description derived from answers: parameters, with the assumptions noted."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil, tau
from typing import Any

from soft_continuum.mechanics.arm import Arm, SECOND_ORDER
from soft_continuum.new_arm.answers import (
    Answer,
    AnswerError,
    Answers,
    Given,
    PLANAR,
    Question,
    TENDONS,
)
from soft_continuum.new_arm.questions import QUESTIONS
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import Value

ASSUMED = 'ASSUMED'
SHAPE = 'bow'
PART = 0.5  # of the limits, for the segments of the first shape
LEAST_BODIES = 10  # per segment
ONLY_OF_LEAVES = ('arm.youngs_modulus', 'arm.leaf_thicknesses', 'arm.leaf_widths')
LEAF_ALONE = (0.0,)
"""Value of arm.bending_stiffnesses: E I follows from leaf springs and Young's modulus."""


@dataclass(frozen=True)
class Description:
    """
    Parameters by their dotted names, each with a note.

    shape, directions: bending angle and direction of each segment in the shape SHAPE, rad; no
    directions: all 0.
    """

    values: Mapping[str, Value]
    notes: Mapping[str, str]
    shape: tuple[float, ...]
    directions: tuple[float, ...]

    @property
    def arm(self) -> Arm:
        """The arm; raises ParameterError if the answers do not describe one."""
        return arm_from_parameters(self.values)


def questions_of(kind: str) -> tuple[Question, ...]:
    """Return the questions about a kind of arm."""
    return tuple(question for question in QUESTIONS if kind in question.kinds)


def complete(given: Mapping[str, Given],
             ask: Callable[[Question, Answers, Answer], Given | None] = lambda *_: None
             ) -> dict[str, Answer]:
    """
    Return an answer to every question about the arm, by its name.

    given: answers that are known.  ask: gets a question, the previous answers and the suggestion,
    and returns an answer, or None to accept the suggestion.  Raises AnswerError if an answer
    contradicts previous ones, or belongs to a question about other kinds of arms.
    """
    found: dict[str, Answer] = {}
    for question in QUESTIONS:
        if found and found['kind'].value not in question.kinds:
            if question.name in given:
                raise AnswerError(question.name, f'is for {" and ".join(question.kinds)}, not for '
                                  f'{found["kind"].value}')
            continue
        before = Answers(QUESTIONS, found)
        suggested = question.suggested(before)
        answer = given.get(question.name)
        if answer is None:
            answer = ask(question, before, suggested)
        if answer is not None:
            question.check(answer, before)
        found[question.name] = suggested if answer is None else Answer(answer)
    return found


def describe(found: Mapping[str, Answer]) -> Description:
    """Return the description that follows from complete answers."""
    answers = Answers(QUESTIONS, found)
    values: dict[str, Value] = {}
    notes: dict[str, str] = {}
    for question in questions_of(answers.kind):
        name, answer = question.parameter, found[question.name]
        if not name or (name in ONLY_OF_LEAVES and answers.kind != PLANAR):
            continue
        if name == 'arm.tendon_ends':
            values['arm.tendon_names'] = ()  # its position in the file
        values[name] = question.value(answer)
        notes[name] = question.sets.description if question.sets else ''
        if answer.assumed:
            notes[name] += f'. {ASSUMED}: {answer.assumed}'
    values['arm.segment_lengths'] = answers.each('segment_lengths')  # its length counts segments
    offsets = answers.all('guide_offsets')
    if len(offsets) > 1:  # at the lower and the upper end of each segment
        values['arm.guide_offsets'] = tuple(offset for offset in offsets for _ in range(2))
    if answers.kind == PLANAR and found['bending_stiffnesses'].assumed:
        values['arm.bending_stiffnesses'] = LEAF_ALONE
    if answers.kind != PLANAR:
        _tendons(answers, values)
    guides = 1 + (round(answers.one('spacers')) if answers.kind == TENDONS else 0)
    values['arm.bodies_per_segment'] = guides * ceil(LEAST_BODIES / guides)
    values['arm.discretisation'] = SECOND_ORDER
    notes['arm.discretisation'] = 'second_order: as accurate with few bodies; converge shows it'
    if answers.kind == TENDONS:
        values['arm.jamming'] = False
    in_arm = {name: value for name, value in values.items() if name.startswith('arm.')}
    limit = answers.one('pull_limit')
    shape = tuple(PART * angle for angle in answers.each('bending_angle_limits'))
    rig: dict[str, Value] = {
        'tendon_driver': 'simulated', 'pull_limits': (-limit, limit),
        'tension_limit': values['tension_limit']}
    if answers.kind != TENDONS:
        rig['jamming_driver'] = 'simulated'
    notes['tendon_driver'] = 'grbl: boards of up to 4 steppers (docs/how_to/set_up_a_rig.md)'
    notes['pull_limits'] = 'smallest and largest tendon pull; negative: paid out [m]' + (
        f'. {ASSUMED}: {found["pull_limit"].assumed}' if found['pull_limit'].assumed else '')
    notes[f'shapes.{SHAPE}'] = 'A first shape: bending angle of each segment [rad]'
    library: dict[str, Value] = {'shape_names': (SHAPE,), f'shapes.{SHAPE}': shape}
    directions: tuple[float, ...] = ()
    if answers.kind != PLANAR and (towards := _last_tendon(values)):
        directions = library[f'shape_directions.{SHAPE}'] = (towards,) * len(shape)
        notes[f'shape_directions.{SHAPE}'] = (
            'Where each segment bends to, about z from x: to a tendon that passes all [rad]')
    return Description(in_arm | rig | library, notes, shape, directions)


def _last_tendon(values: Mapping[str, Value]) -> float:
    """Return the angle of a tendon that ends at the tip, rad; it lies in the plane if all do."""
    ends: Any = values['arm.tendon_ends']
    angles: Any = values['arm.tendon_angles']
    return float(angles[ends.index(max(ends))])


def _tendons(answers: Answers, values: dict[str, Value]) -> None:
    """Replace the answers about tendons of a spatial arm by its tendons."""
    ends = [round(end) for end in answers.all('tendon_ends')]
    count = round(answers.one('tendons'))
    firsts = answers.all('first_tendon_angles', len(ends))
    some = [(end, i, (first + tau * i / count) % tau)
            for end, first in zip(ends, firsts, strict=True) for i in range(count)]
    values['arm.tendon_names'] = tuple(
        f'tendon_{i + 1}' if len(ends) == 1 else f'segment_{end}_{i + 1}' for end, i, _ in some)
    values['arm.tendon_angles'] = tuple(angle for *_, angle in some)
    values['arm.tendon_ends'] = tuple(end for end, *_ in some)


def shown(question: Question, answer: Answer) -> str:
    """Return an answer as typed."""
    if isinstance(answer.value, str):
        return answer.value
    return ','.join(f'{number:.12g}' for number in answer.value)


def command(found: Mapping[str, Answer]) -> str:
    """Return the options that give the same answers."""
    given = [f'{question.option} {shown(question, found[question.name])}'
             for question in questions_of(str(found['kind'].value))
             if not found[question.name].assumed]
    return ' '.join([*given, '--yes'])
