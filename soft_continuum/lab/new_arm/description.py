# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``new-arm``: asks for an arm, and writes its description with the assumptions noted."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, tau
import os
from pathlib import Path
import re
import shlex
from typing import Any

import numpy as np

from soft_continuum.lab.analysis.verbs import (
    finish_panels,
    new_panels,
    reserve_outputs,
    ResultError,
    run_verb,
    text_table,
)
from soft_continuum.lab.new_arm.questions import (
    Answer,
    AnswerError,
    Answers,
    DRAWINGS,
    Given,
    PLANAR,
    Question,
    QUESTIONS,
    TENDONS,
)
from soft_continuum.mechanics.arm import Arm, SECOND_ORDER
from soft_continuum.mechanics.chain import Chain, Equilibrium
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.drawing import draw_arm, rim
from soft_continuum.mechanics.inverse import set_shape
from soft_continuum.mechanics.statics import Statics, StaticsError
from soft_continuum.parameters.arguments import ask, command_name, DeclinedError, one_of, Parser
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import write_parameters
from soft_continuum.parameters.parameter import name_hint, ParameterError, Value
from soft_continuum.parameters.scalars import as_yaml

ASSUMED = 'ASSUMED'
SHAPE = 'bow'
LABELS = 1.45  # times the distance of a tendon from the backbone: where its name is
PART = 0.5  # of the limits, for the segments of the first shape
LEAST_BODIES = 10  # per segment
ONLY_OF_LEAVES = ('arm.youngs_modulus', 'arm.leaf_thicknesses', 'arm.leaf_widths')
LEAF_ALONE = (0.0,)
"""Value of arm.bending_stiffnesses: E I follows from leaf springs and Young's modulus."""
NAME = 'new-arm'
FILE_NAME = re.compile(r'\w[\w.-]{0,99}', re.ASCII)


@dataclass(frozen=True)
class AnnotatedParameters:
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


def describe_arm(found: Mapping[str, Answer]) -> AnnotatedParameters:
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
    return AnnotatedParameters(in_arm | rig | library, notes, shape, directions)


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


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    parser = Parser(NAME, 'Describe an arm: asks for its data in millimetres and degrees, and '
                    'writes NAME.yaml, for `up --params-file`, and a picture, NAME.png. Unknown '
                    'values are assumed and marked. Options are answers; lists are '
                    'comma-separated, base first, and a single number applies to all.',
                    '--output', '--force')
    parser.add_argument('name', nargs='?', default='my_arm', type=_file_name, metavar='NAME',
                        help='of the files (default: my_arm)')
    parser.add_argument('--yes', action='store_true',
                        help='do not ask: assume values without an option')
    for question in QUESTIONS:
        parser.add_argument(question.option, type=_reader(question), help=question.text,
                            metavar=_metavar(question))
    return run_verb(parser, _run, argv, 'matplotlib')


def _file_name(text: str) -> str:
    if not FILE_NAME.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f'{text!r} given; allowed: letters, digits, _, - and . (--output chooses where)')
    return text.removesuffix('.yaml')


def _reader(question: Question) -> Callable[[str], Given]:
    def read(text: str) -> Given:
        try:
            return question.read(text)
        except AnswerError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return read


def _metavar(question: Question) -> str:
    return ('|'.join(question.choices) if question.choices
            else re.sub(r'\W', '', question.unit).upper() or 'N')


def _run(options: argparse.Namespace) -> None:
    given = {question.name: value for question in QUESTIONS
             if (value := getattr(options, question.name)) is not None}
    names = [f'{options.name}.yaml', f'{options.name}.png']
    force = options.force or (not options.yes and _may_overwrite(options.output, names))
    path, picture = reserve_outputs(options.output, names, force)
    if options.yes:
        found = complete(given)
        description = describe_arm(found)
        Chain(description.arm)  # or what is wrong with it
    else:
        print('Values accepted with Enter are marked as assumed in the file. Ctrl-C exits without '
              'writing.')
        found, description = _agreed(given, path)
    write_parameters(path, description.values, [
        f'An arm, described by soft_continuum {NAME}. {ASSUMED} marks what was not given: measure '
        'it,', 'or look it up.', '',
        f'soft_continuum {NAME} {options.name} {command(found)}',
        'SI units: m, kg, rad, N. docs/how_to/describe_another_arm.md goes on from here.'],
        description.notes)
    assumed = [question.name for question in questions_of(str(found['kind'].value))
               if found[question.name].assumed]
    print(f'Written: {path}' + (f'; assumed in it: {", ".join(assumed)}' if assumed else ''))
    _preview(picture, description)
    print(f'Start the arm, simulated:\n  {command_name("up")} --params-file '
          f'{shlex.quote(str(path))}')


def _may_overwrite(folder: Path, names: Sequence[str]) -> bool:
    """Ask whether to overwrite existing files; raises ResultError for a no."""
    there = [path for name in names if os.path.lexists(path := Path(folder, name))]
    if not there:
        return False
    listed = ' and '.join(map(str, there))
    if ask(f'{listed} exists: overwrite? (yes, no)', one_of('yes', 'no')) == 'no':
        raise ResultError(f'{there[0]} exists and is unchanged; give another NAME')
    return True


def _agreed(given: dict[str, Given], path: Path) -> tuple[dict[str, Answer], AnnotatedParameters]:
    """Ask until the answers make a valid, confirmed arm; return them and their description."""
    known, asked = dict(given), set(given)  # also answers left to the suggestion

    def ask_once(question: Question, before: Answers, suggested: Answer) -> Given | None:
        if question.name in asked:
            return None
        answer = _ask(question, before, suggested)
        asked.add(question.name)
        if answer is not None:
            known[question.name] = answer
        return answer

    while True:
        try:
            found = complete(known, ask_once)
            description = describe_arm(found)
            Chain(description.arm)  # or what is wrong with it
            print(f'\n{_table(found)}\n')
            choice = ask(f'Write {path}? (yes, no, or the name of an answer to change)',
                         _one_of_names('yes', 'no'))
        except AnswerError as error:
            print(f'\n{error}', flush=True)
            choice = error.name
        except ParameterError as error:
            print(f'\n{error}', flush=True)
            choice = ask('Which answer do you want to change? (its name, or no)',
                         _one_of_names('no'))
        if choice == 'yes':
            return found, description
        if choice == 'no':
            raise DeclinedError('not confirmed, so nothing was written')
        known.pop(choice, None)
        asked.discard(choice)


def _one_of_names(*answers: str) -> Callable[[str], str]:
    names = {question.name for question in QUESTIONS}

    def read(text: str) -> str:
        name = text.replace('-', '_')
        if name not in {*answers, *names}:
            raise ValueError(f'{text!r} was typed; allowed: {", ".join(answers)}, '
                             f'{", ".join(sorted(names))}{name_hint(name, names)}')
        return name

    return read


def _ask(question: Question, before: Answers, suggested: Answer) -> Given | None:
    """Return the typed answer; None accepts the suggestion."""
    print(DRAWINGS.get(question.name, '\n'), end='')
    print(question.text)
    for name, meaning in (question.choices or {}).items():
        print(f'  {name}: {meaning}')
    default = f'{shown(question, suggested)} {question.unit}'.rstrip()
    print(f'Enter takes {default}: {suggested.assumed}')
    count = question.count(before)
    several = f', 1 or {count} numbers' if count > 1 and not question.choices else ''

    def read(text: str) -> Given | None:
        if not text:
            return None
        answer = question.read(text)
        question.check(answer, before)
        return answer

    unit = f' in {question.unit}' if question.unit else ''
    return ask(f'{question.name}{unit}{several}:', read)


def _table(found: dict[str, Answer]) -> str:
    rows = [[question.name, f'{shown(question, found[question.name])} {question.unit}'.rstrip(),
             found[question.name].assumed]
            for question in questions_of(str(found['kind'].value))]
    return text_table(['answer', 'value', 'assumed because'], rows, left=3)


def _preview(picture: Path, description: AnnotatedParameters) -> None:
    """Draw the arm; print the pulls and tension of the shape, and any limit they exceed."""
    arm = description.arm
    states: list[tuple[str, Equilibrium]] = [('straight', Chain(arm).straight())]
    jamming = bool(description.values.get('arm.jamming', True))
    angles = ', '.join(f'{angle:.0f}' for angle in np.degrees(description.shape))
    try:
        state: Equilibrium = set_shape(Statics(arm), bending_vectors(
                arm, description.shape, description.directions), jamming=jamming)
    except StaticsError as error:
        print(f'The statics do not converge for the shape {SHAPE} ({angles} degrees): {error}')
    else:
        states.append((f'{SHAPE}: {angles} degrees', state))
        tension, pull = state.tensions.max(), np.abs(state.pulls).max()
        print(f'The shape {SHAPE} ({angles} degrees) takes pulls of up to {1e3 * pull:.1f} mm and '
              f'a tension of up to {tension:.1f} N.')
        for what, value, name in (('tension', tension, 'tension_limit'),
                                  ('pull', pull, 'pull_limits')):
            limit = np.max(description.values[name])
            if value > limit:
                print(f'This {what} exceeds {name}, {as_yaml(description.values[name])}: change '
                      'the arm or the limit.')
    preview_figure(picture, states)
    print(f'Picture: {picture}')


def preview_figure(path: Path, states: Sequence[tuple[str, Equilibrium]]) -> None:
    """Write a side view of states by their titles, and the tendons at the base; in mm."""
    figure, panels = new_panels(1, len(states) + 1, 3.6 * (len(states) + 1), 5.0)
    for axes, (title, state) in zip(panels, states, strict=False):
        draw_arm(axes, state, ())
        axes.set_title(title)
    figure.delaxes(panels[-1])  # the tendons have a scale of their own
    axes, state = figure.add_subplot(1, len(panels), len(panels)), states[0][1]
    edge = 1e3 * rim(state.poses[0], state.chain.disc_radii[0])
    axes.plot(edge[:, 0], edge[:, 1], color='0.6', linewidth=1.2)
    for name, guides in zip(state.chain.arm.tendon_names, state.tendon_points, strict=True):
        x, y = 1e3 * guides[0, :2]
        axes.plot(x, y, 'o', color='0.0', markersize=4)
        axes.annotate(name, (x, y), (LABELS * x, LABELS * y), ha='center', va='center',
                      fontsize=7, parse_math=False)
    axes.set(aspect='equal', title='tendons at the base, from the tip', xlabel='x in mm',
             ylabel='y in mm')
    axes.margins(0.35)
    axes.grid(alpha=0.3)
    finish_panels(path, figure, 4)
