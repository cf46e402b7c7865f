# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What all commands share: options, the arm, and errors without a traceback."""

import argparse
from collections.abc import Callable
import os
from pathlib import Path
import sys

from soft_continuum.analysis.delimited import MeasurementError
from soft_continuum.analysis.results import ResultError
from soft_continuum.analysis.unknowns import IdentificationError
from soft_continuum.mechanics.arm import Arm, ArmError
from soft_continuum.mechanics.laws import LawError
from soft_continuum.mechanics.statics import StaticsError
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import load_description
from soft_continuum.parameters.parameter import ParameterError, Value

BAD_INPUT = 2  # exit status, as argparse has it for bad options
INTERRUPTED = 130


def new_parser(name: str, description: str) -> argparse.ArgumentParser:
    """Return a parser with the options that every command has."""
    parser = argparse.ArgumentParser(prog=name, description=description, allow_abbrev=False)
    parser.add_argument('--params-file', type=Path, action='append', default=[], metavar='FILE',
                        help='description of the arm as the nodes take it; may be repeated, later '
                             "ones win (default: the paper's arm)")
    parser.add_argument('--output', type=Path, default=Path(), metavar='DIR',
                        help='where results are written (default: here)')
    parser.add_argument('--force', action='store_true', help='overwrite results that exist')
    return parser


def described_arm(options: argparse.Namespace) -> tuple[dict[str, Value], Arm]:
    """Return the parameters and the arm of ``--params-file``; raises ParameterError."""
    values = load_description(*options.params_file)
    return values, arm_from_parameters(values)


def number_in(low: float, high: float, unit: str) -> Callable[[str], float]:
    """Return a reader of option values between bounds, for argparse."""
    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float('nan')
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f'{text} given; allowed: {low:g} to {high:g} {unit}')
        return value

    return read


def whole_number_in(low: int, high: int) -> Callable[[str], int]:
    """Return a reader of whole numbers between bounds, for argparse."""
    def read(text: str) -> int:
        if not (text.isdecimal() and low <= int(text) <= high):
            raise argparse.ArgumentTypeError(
                f'{text} given; allowed: a whole number from {low} to {high}')
        return int(text)

    return read


def guarded(name: str, run: Callable[[argparse.Namespace], None], options: argparse.Namespace
            ) -> int:
    """Run a command; return its exit status, with an error as one line on stderr."""
    try:
        run(options)
        sys.stdout.flush()
    except (MeasurementError, IdentificationError, ResultError, ParameterError, ArmError,
            LawError, StaticsError) as error:
        print(f'{name}: {error}', file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:  # such as into head: what was printed so far was enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        print(f'{name}: {error.filename or options.output}: cannot be written: {error.strerror}; '
              'choose another directory with --output', file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print(f'\n{name}: interrupted', file=sys.stderr)
        return INTERRUPTED
    return 0
