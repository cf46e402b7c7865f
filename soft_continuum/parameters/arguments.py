# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Options and questions: one style of help, errors, numbers and exit codes for all verbs."""

import argparse
from collections.abc import Callable
import os
from pathlib import Path
import re
import sys
from typing import Any, NoReturn, TypeVar

from soft_continuum.parameters.parameter import name_hint
from soft_continuum.text import printable

T = TypeVar('T')
DONE, FAILED, WRONG_USAGE, NO_NODES, AS_PREDICTED, INTERRUPTED = 0, 1, 2, 3, 4, 130
MAX_LINE = 4000  # characters of an error message
EXIT_CODES = ('exit status: 0 done, 1 refused or failed, 2 wrong usage or bad input, 3 no nodes, '
              '4 done as predicted, 130 interrupted')
SERVICE = re.compile(
    r'(call )?/?(?:(?:~|\btendon_actuation|\bkinematics)/(stop|resume|reference|reset)\b'
    r'|\bjamming_valves/segment_(\w+)/set_stiff)')
"""Services that a verb calls, as named in messages of the nodes."""
PROGRAM = 'SOFT_CONTINUUM_PROGRAM'
"""Environment variable: the command before the verb, if it is a wrapper (./run)."""


def command_name(verb: str = '') -> str:
    """
    Return how the user called a verb, for usage lines and error messages.

    That is ``./run demo``, ``ros2 run soft_continuum doctor``, ``soft_continuum stop`` and so on.
    """
    script = Path(sys.argv[0])
    if PROGRAM in os.environ:
        program = os.environ[PROGRAM]
    elif script.parent.parts[-2:] == ('lib', 'soft_continuum'):
        program, verb = 'ros2 run soft_continuum', script.name
    elif script.parts[-2:] == ('soft_continuum', '__main__.py'):
        program = 'python -m soft_continuum'
    else:
        program = 'soft_continuum'
    return f'{program} {verb}'.strip()


def in_verbs(text: str) -> str:
    """Return a message of a node with command-line verbs instead of ROS services."""
    def verb(match: re.Match[str]) -> str:
        call, name, segment = match.groups()
        if name == 'stop':  # available everywhere
            return name
        typed = command_name(name or 'soften')
        return f'{"type " if call else ""}`{typed}{f" {segment}" if segment else ""}`'

    return SERVICE.sub(verb, text)


def number_in(low: float, high: float, unit: str) -> Callable[[str], float]:
    """Return a parser of a number between bounds."""
    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float('nan')
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(
                f'{text!r} given; allowed: {low:g} to {high:g} {unit}'.rstrip())
        return value

    return read


def whole_number_in(low: int, high: int) -> Callable[[str], int]:
    """Return a parser of a whole number between bounds."""
    def read(text: str) -> int:
        if not (text.isdecimal() and low <= int(text) <= high):
            raise argparse.ArgumentTypeError(
                f'{text!r} given; allowed: a whole number from {low} to {high}')
        return int(text)

    return read


def given_path(text: str) -> Path:
    """Return a path; ~ is the home, also in --option=~/file, which the shell leaves as it is."""
    return Path(os.path.expanduser(text))


COMMON_OPTIONS: dict[str, dict[str, Any]] = {
    '--params-file': {
        'type': given_path, 'action': 'append', 'default': [], 'metavar': 'FILE',
        'help': 'ROS 2 parameter file; may be repeated, later files override earlier ones '
                "(default: the paper's arm, simulated)"},
    '--output': {
        'type': given_path, 'default': Path(), 'metavar': 'DIR',
        'help': 'output directory (default: %(default)s)'},
    '--force': {'action': 'store_true', 'help': 'overwrite existing results'},
    '--namespace': {
        'default': '', 'metavar': 'NAME', 'help': 'namespace of the nodes, such as left'},
    '--timeout': {
        'type': number_in(0.01, 3600.0, 's'), 'default': 5.0, 'metavar': 'S',
        'help': 'maximum wait for nodes to be found and to answer (default: 5 s)'},
    '--decimal': {
        'choices': ('.', ','),
        'help': 'decimal mark of the CSV files, if their numbers are ambiguous'},
    '--json': {
        'action': 'store_true', 'help': 'print JSON, one document per line, in SI units'},
}
"""The options that mean the same for every verb that has them."""
FOR_ANALYSIS = ('--params-file', '--output', '--force')
FOR_NODES = ('--namespace', '--timeout', '--json')


class Parser(argparse.ArgumentParser):
    """A parser with one-line errors and TAB completion (argcomplete)."""

    def __init__(self, verb: str, description: str, *common: str, **settings: Any) -> None:
        """verb: empty for the command line as a whole.  common: names in COMMON_OPTIONS."""
        super().__init__(prog=command_name(verb), description=description, epilog=EXIT_CODES,
                         allow_abbrev=False, **settings)
        if '--params-file' in common:  # it may have sections for several arms
            common = tuple(dict.fromkeys((*common, '--namespace')))
        for name in common:
            self.add_argument(name, **COMMON_OPTIONS[name])
        # Values such as -10,20 are not options.
        self._negative_number_matcher = re.compile(r'-[\d.]')

    # The base class has overloads for namespaces of other types, which are unused here.
    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; on TAB print completions instead, and end the process."""
        if '_ARGCOMPLETE' in os.environ:
            import argcomplete
            argcomplete.autocomplete(self)
        options, unknown = self.parse_known_args(args, namespace)
        if unknown:
            word = unknown[0].partition('=')[0]
            self.error(f'unknown option {word}{name_hint(word, self._option_string_actions)}'
                       if word.startswith('-') else f'unexpected argument {unknown[0]!r}')
        return options

    def error(self, message: str) -> NoReturn:
        """Exit with one line on stderr."""
        sys.exit(self.fail(f'{message} ({self.prog} --help)', WRONG_USAGE))

    def fail(self, reason: object, status: int = FAILED) -> int:
        """Print in one line on stderr why the verb failed; return its exit status."""
        print(f'{self.prog}: {printable(in_verbs(str(reason)), MAX_LINE)}', file=sys.stderr,
              flush=True)
        return status


# Questions on a terminal.


class DeclinedError(Exception):
    """The user did not confirm, or there is no terminal for questions."""


def ask(question: str, read: Callable[[str], T]) -> T:
    """
    Ask until the answer is valid; return it as parsed by ``read``.

    read: raises ValueError, naming the allowed answers, for an invalid one. Raises DeclinedError
    at the end of the input.
    """
    while True:
        try:
            return read(input(f'{question} ').strip().lower())
        except ValueError as error:
            print(error, flush=True)
        except EOFError:
            raise DeclinedError(
                'no answer came; use a terminal, or give the answers as options; --help shows '
                'them') from None


def confirm(text: str, yes: bool) -> None:
    """Print what is about to happen; unless ``yes``, ask for consent or raise DeclinedError."""
    print(f'\n{text}', flush=True)
    if not yes and ask('Ready? (yes, no)', one_of('yes', 'y', 'no', 'n')) in ('no', 'n'):
        raise DeclinedError('not confirmed, so nothing more was done')


def one_of(*answers: str) -> Callable[[str], str]:
    """Return a reader of one of the answers."""
    def read(text: str) -> str:
        if text not in answers:
            raise ValueError(f'{text!r} was typed; allowed: {", ".join(answers)}')
        return text

    return read


def number(text: str, low: float, high: float, unit: str) -> float:
    """Return a typed number; raises ValueError if it is outside the bounds."""
    try:
        value = float(text.replace(',', '.'))
    except ValueError:
        value = float('nan')
    if not low <= value <= high:
        raise ValueError(
            f'{text!r} was typed; allowed: a number from {low:g} to {high:g} {unit}')
    return value
