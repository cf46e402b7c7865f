# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the verbs that need no nodes share: the arm, and errors in one line."""

import argparse
from collections.abc import Callable
import sys

from soft_continuum.analysis.delimited import MeasurementError
from soft_continuum.analysis.results import ResultError
from soft_continuum.analysis.unknowns import IdentificationError
from soft_continuum.arguments import (
    add_output_options,
    add_params_file_option,
    command_name,
    DONE,
    INTERRUPTED,
    Parser,
    WRONG_USAGE,
)
from soft_continuum.mechanics.arm import Arm, ArmError
from soft_continuum.mechanics.laws import LawError
from soft_continuum.mechanics.statics import StaticsError
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import load_description
from soft_continuum.parameters.parameter import ParameterError, Value

BAD_INPUT = (MeasurementError, IdentificationError, ResultError, ParameterError, ArmError,
             LawError, StaticsError)


def new_parser(name: str, description: str) -> Parser:
    """Return a parser with the options of verbs that compute something for an arm."""
    parser = Parser(name, description)
    add_params_file_option(parser)
    add_output_options(parser)
    return parser


def described_arm(options: argparse.Namespace) -> tuple[dict[str, Value], Arm]:
    """Return the parameters and the arm of ``--params-file``; raises ParameterError."""
    values = load_description(*options.params_file)
    return values, arm_from_parameters(values)


def guarded(name: str, run: Callable[[argparse.Namespace], int | None],
            options: argparse.Namespace) -> int:
    """Run a verb; return its exit status, with an error as one line on stderr."""
    try:
        return run(options) or DONE
    except BAD_INPUT as error:
        print(f'{command_name(name)}: {error}', file=sys.stderr)
    except BrokenPipeError:
        raise
    except OSError as error:
        print(f'{command_name(name)}: {error.filename or options.output}: cannot be written: '
              f'{error.strerror}; choose another directory with --output', file=sys.stderr)
    except KeyboardInterrupt:
        print(f'\n{command_name(name)}: interrupted', file=sys.stderr)
        return INTERRUPTED
    return WRONG_USAGE
