# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How every command reads its options: one style of help, errors, numbers and exit codes."""

import argparse
from collections.abc import Callable, Sequence
from difflib import get_close_matches
import os
from pathlib import Path
import re
import sys
from typing import Any, NoReturn

DONE, FAILED, WRONG_USAGE, NO_NODES, INTERRUPTED = 0, 1, 2, 3, 130
EXIT_CODES = ('exit status: 0 done, 1 refused or failed, 2 wrong usage or bad input, 3 no nodes, '
              '130 interrupted')
PROGRAM = 'SOFT_CONTINUUM_PROGRAM'
"""Environment variable: what the user typed before the verb, where that is a wrapper (./run)."""


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


def did_you_mean(word: str, known: Sequence[str]) -> str:
    """Return ``; did you mean X?`` for the closest of the known words, or nothing."""
    close = get_close_matches(word, known, n=1)
    return f'; did you mean {close[0]}?' if close else ''


class Parser(argparse.ArgumentParser):
    """A parser that answers wrong usage in one line, and completes on TAB (argcomplete)."""

    def __init__(self, verb: str, description: str, **options: Any) -> None:
        """verb: empty for the command line as a whole."""
        settings: dict[str, Any] = {'allow_abbrev': False, 'epilog': EXIT_CODES} | options
        super().__init__(prog=command_name(verb), description=description, **settings)
        # Values such as -10,20 are no options.
        self._negative_number_matcher = re.compile(r'-[\d.]')

    # The base class is typed by overloads for namespaces of other types, which nobody here uses.
    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; on TAB print what fits instead, and end the process."""
        if '_ARGCOMPLETE' in os.environ:
            import argcomplete
            argcomplete.autocomplete(self)
        options, unknown = self.parse_known_args(args, namespace)
        if unknown:
            word = unknown[0].partition('=')[0]
            self.error(f'unknown option {word}{did_you_mean(word, [*self._option_string_actions])}'
                       if word.startswith('-') else f'unexpected argument {unknown[0]!r}')
        return options

    def error(self, message: str) -> NoReturn:
        """End the process with one line on stderr."""
        self.exit(WRONG_USAGE, f'{self.prog}: {message} ({self.prog} --help)\n')


# Options that mean the same for every verb.


def add_json_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    parser.add_argument('--json', action='store_true',
                        help='print JSON, one document per line, in SI units')


def add_namespace_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--namespace``."""
    parser.add_argument('--namespace', metavar='NAME', default='',
                        help='namespace of the nodes, such as left')


def add_arm_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of verbs that talk to nodes: ``--namespace``, ``--timeout``, ``--json``."""
    add_namespace_option(parser)
    parser.add_argument('--timeout', type=number_in(0.01, 3600.0, 's'), metavar='S', default=5.0,
                        help='longest wait for nodes to be found and to answer (default: 5 s)')
    add_json_option(parser)


def add_params_file_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--params-file``."""
    parser.add_argument('--params-file', type=Path, action='append', default=[], metavar='FILE',
                        help='parameter file as the nodes take it; may be repeated, later ones '
                             "win (default: the paper's arm, simulated)")


def add_output_options(parser: argparse.ArgumentParser, default: str = '.') -> None:
    """Add ``--output`` and ``--force``."""
    parser.add_argument('--output', type=Path, default=Path(default), metavar='DIR',
                        help='directory that results are written to (default: %(default)s)')
    parser.add_argument('--force', action='store_true', help='overwrite results that exist')


# Readers of values, for ``type=``.


def number_in(low: float, high: float, unit: str) -> Callable[[str], float]:
    """Return a reader of a number between bounds."""
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
    """Return a reader of a whole number between bounds."""
    def read(text: str) -> int:
        if not (text.isdecimal() and low <= int(text) <= high):
            raise argparse.ArgumentTypeError(
                f'{text!r} given; allowed: a whole number from {low} to {high}')
        return int(text)

    return read
