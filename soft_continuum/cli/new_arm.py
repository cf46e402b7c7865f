# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``new-arm``: asks for an arm in millimetres and degrees, and writes its description."""

import argparse
from collections.abc import Callable, Sequence
import os
from pathlib import Path
import re
import shlex

import numpy as np

from soft_continuum.analysis.figures import preview_figure
from soft_continuum.analysis.results import reserve_outputs, ResultError, text_table
from soft_continuum.analysis.verbs import run_verb
from soft_continuum.arguments import ask, command_name, DeclinedError, one_of, Parser
from soft_continuum.mechanics.chain import Chain, Equilibrium
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.mechanics.inverse import set_shape
from soft_continuum.mechanics.statics import Statics
from soft_continuum.new_arm.answers import Answer, AnswerError, Answers, Given, Question
from soft_continuum.new_arm.description import (
    ASSUMED,
    command,
    complete,
    describe,
    Description,
    questions_of,
    SHAPE,
    shown,
)
from soft_continuum.new_arm.drawings import DRAWINGS
from soft_continuum.new_arm.questions import QUESTIONS
from soft_continuum.parameters.files import write_parameters
from soft_continuum.parameters.parameter import name_hint, ParameterError
from soft_continuum.parameters.scalars import as_yaml

NAME = 'new-arm'
FILE_NAME = re.compile(r'\w[\w.-]{0,99}', re.ASCII)


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
        description = describe(found)
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


def _agreed(given: dict[str, Given], path: Path) -> tuple[dict[str, Answer], Description]:
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
            description = describe(found)
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


def _preview(picture: Path, description: Description) -> None:
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
