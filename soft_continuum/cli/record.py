# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``record``: records all topics of the nodes to an MCAP file."""

import argparse
from collections.abc import Sequence
from math import inf
from pathlib import Path

from soft_continuum.analysis.recording import BAG
from soft_continuum.analysis.results import reserve_outputs
from soft_continuum.analysis.verbs import run_verb
from soft_continuum.arguments import number_in, Parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    parser = Parser('record', f'Record to {BAG} everything that a running arm publishes, until '
                    'Ctrl-C. It can be read with report, export and replay, and with ros2 bag, '
                    'Foxglove and PlotJuggler.', '--namespace', '--output', '--force')
    parser.add_argument('--duration', type=number_in(0.1, 1e6, 's'), metavar='S', default=inf,
                        help='stop after this many seconds')
    parser.add_argument('--goal', action='store_true',
                        help='stop when the running goal, or the next one, has ended')
    parser.add_argument('--pictures', action='store_true',
                        help='also record camera images: tens of MB per second')
    parser.set_defaults(output=Path('recording'))
    return run_verb(parser, _run, argv, 'mcap')


def _run(options: argparse.Namespace) -> int:
    path, = reserve_outputs(options.output, [BAG], options.force)
    from soft_continuum.recordings.record import record  # needs ROS
    return record(path, namespace=options.namespace, duration=options.duration,
                  goal=options.goal, pictures=options.pictures)
