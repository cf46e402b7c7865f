# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``record``: what the nodes publish, as CSV files for ``report``."""

import argparse
from collections.abc import Sequence
from math import inf

from soft_continuum.analysis.recording import FILES
from soft_continuum.analysis.results import claim
from soft_continuum.arguments import (
    add_namespace_option,
    add_output_options,
    number_in,
    Parser,
)
from soft_continuum.cli.common import guarded


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    parser = Parser('record', 'Record tendons, points, pressures, stiffness and progress of a '
                    'running arm into CSV files, until Ctrl-C.')
    parser.add_argument('--duration', type=number_in(0.1, 1e6, 's'), metavar='S', default=inf,
                        help='end after so many seconds')
    parser.add_argument('--goal', action='store_true',
                        help='end when the goal that runs, or begins next, has ended')
    add_namespace_option(parser)
    add_output_options(parser, 'recording')
    return guarded('record', _run, parser.parse_args(argv))


def _run(options: argparse.Namespace) -> int:
    from soft_continuum.client.recorder import record  # needs ROS

    claim(options.output, FILES, options.force)
    return record(options.output, namespace=options.namespace, duration=options.duration,
                  goal=options.goal)
