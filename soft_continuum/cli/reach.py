# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The verbs ``reach`` and ``follow``, which move the tip of a running arm."""

from argparse import Namespace
from typing import TYPE_CHECKING

from soft_continuum.arguments import COMMON_OPTIONS, given_path, Parser, WRONG_USAGE
from soft_continuum.cli.operate import Action, add_hold, add_vacuums, run_action, watch_sequence
from soft_continuum.cli.output import Output
from soft_continuum.cli.tip_options import (
    add_tip,
    add_tolerance,
    add_unit,
    given_tip,
    tip_problem,
    UNITS,
)

if TYPE_CHECKING:
    from soft_continuum.client.arm import Arm


def main(verb: str) -> int:
    """Run a verb; return the exit status."""
    return run_action(verb, ACTIONS[verb])


def _reach_options(parser: Parser) -> None:
    add_tip(parser)
    add_hold(parser)
    add_vacuums(parser)


def _reach(arm: 'Arm', options: Namespace, output: Output) -> int:
    from soft_continuum.client.sequence import Held
    tip = given_tip(options)
    return watch_sequence(arm.start(
        tip if options.vacuums is None else Held(tip, options.vacuums), hold=options.hold), output)


def _follow_options(parser: Parser) -> None:
    parser.add_argument('file', type=given_path, metavar='FILE',
                        help='CSV file with the columns x and z or x, y and z, and optionally '
                        'angle')
    parser.add_argument('--decimal', **COMMON_OPTIONS['--decimal'])
    add_unit(parser, 'unit of lengths if the header has none, and of the tolerance')
    add_tolerance(parser)
    add_hold(parser)


def _follow(arm: 'Arm', options: Namespace, output: Output) -> int:
    from soft_continuum.analysis.delimited import MeasurementError
    from soft_continuum.cli.tip_path import read_tip_path
    try:
        tips = read_tip_path(options.file, options.unit, UNITS[options.unit] * options.tolerance,
                             options.decimal)
    except MeasurementError as error:
        return output.fail(error, WRONG_USAGE)
    return watch_sequence(arm.start(tips, hold=options.hold), output)


ACTIONS = {'reach': Action(_reach, _reach_options, tip_problem),
           'follow': Action(_follow, _follow_options)}
