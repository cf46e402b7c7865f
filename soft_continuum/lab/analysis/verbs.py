# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shared by the verbs: the arm, the recording, and one-line errors."""

import argparse
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
import sys

from soft_continuum import version
from soft_continuum.client.errors import ClientError, NodesMissingError
from soft_continuum.estimation.sensing.lens import LensError
from soft_continuum.estimation.sensing.sources import SourceError
from soft_continuum.extras import require
from soft_continuum.lab.analysis.delimited import MeasurementError
from soft_continuum.lab.analysis.recording import read_recording, Recording
from soft_continuum.lab.analysis.results import ResultError
from soft_continuum.mechanics import Arm, ArmError, LawError, StaticsError
from soft_continuum.parameters.arguments import (
    DeclinedError,
    DONE,
    FAILED,
    FOR_ANALYSIS,
    given_path,
    INTERRUPTED,
    NO_NODES,
    Parser,
    WRONG_USAGE,
)
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import ParameterError, Value
from soft_continuum.planning.obstacles import ObstacleError
from soft_continuum.planning.plans import PlanError
from soft_continuum.ros.description import load_description

BESIDE = Path('RECORDING')  # as --output: where the recording is
BAD_INPUT = (MeasurementError, ResultError, ParameterError, ArmError, LawError, StaticsError,
             LensError, SourceError, ObstacleError, PlanError)


def shapes_parser(name: str, description: str, known: str) -> Parser:
    """Return the parser of a verb on measured shapes; known: columns that pulls may have."""
    parser = Parser(name, description, *FOR_ANALYSIS, '--decimal')
    parser.add_argument('points', type=given_path,
                        help='CSV file: shape, point, x, z; for spatial arms also y')
    parser.add_argument('pulls', type=given_path,
                        help=f'CSV file: shape, segment, right, left and, if known, {known}; for '
                        'spatial arms one column for each tendon name; without jamming no segment '
                        'column')
    return parser


def recording_parser(name: str, description: str) -> Parser:
    """Return the parser of a verb that reads a recording and writes beside it by default."""
    parser = Parser(name, description, '--namespace', '--output', '--force')
    parser.add_argument('recording', type=given_path, metavar='RECORDING',
                        help='directory that record wrote, or an MCAP file')
    parser.set_defaults(output=BESIDE)
    return parser


def given_recording(options: argparse.Namespace, done: str) -> tuple[Recording, Path]:
    """
    Read the recording of recording_parser; return it, and the directory of the results.

    done: what is done with an incomplete recording, for the message.  Raises MeasurementError.
    """
    path: Path = options.recording
    recording = read_recording(path, options.namespace)
    if recording.damage:
        print(f'{path}: {recording.damage}; what comes before {done}', file=sys.stderr)
    beside = path if path.is_dir() else path.parent
    return recording, beside if options.output is BESIDE else options.output


def origin(verb: str, simulated: bool, measured: str) -> str:
    """Return the title of a file from a running arm; measured: what it has unless simulated."""
    return (f'{"SIMULATED arm (twin), not a measurement" if simulated else measured}; '
            f'soft_continuum {verb} {version()} on '
            f'{datetime.now().astimezone().isoformat(timespec="seconds")}')


def described_arm(options: argparse.Namespace) -> tuple[dict[str, Value], Arm]:
    """Return the parameters and the arm of ``--params-file``; raises ParameterError."""
    values = load_description(*options.params_file, namespace=options.namespace)
    return values, arm_from_parameters(values)


def run_verb(parser: Parser, run: Callable[[argparse.Namespace], int | None],
             argv: Sequence[str] | None, *needs: str) -> int:
    """
    Run a verb with its options; return its exit status, with an error as one line.

    needs: modules that it imports late; a missing one raises ImportError at once.
    """
    options = parser.parse_args(argv)
    for module in needs:
        require(module)
    try:
        return run(options) or DONE
    except BAD_INPUT as error:
        return parser.fail(error, WRONG_USAGE)
    except (ClientError, DeclinedError) as error:
        return parser.fail(error, NO_NODES if isinstance(error, NodesMissingError) else FAILED)
    except BrokenPipeError:
        raise
    except OSError as error:
        place = error.filename or getattr(options, 'output', 'the result')
        return parser.fail(f'{place}: cannot be written: {error.strerror}; choose another place',
                           WRONG_USAGE)
    except KeyboardInterrupt:
        print(file=sys.stderr)
        return parser.fail('interrupted', INTERRUPTED)
