# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Write down what the nodes publish, for the command report."""

import argparse
from pathlib import Path
import sys

from soft_continuum.analysis.recording import FILES, RecordingWriter
from soft_continuum.analysis.results import claim
from soft_continuum.commands.common import guarded, number_in
from soft_continuum.mechanics.arm import TENDONS

NAME = 'record'


def main(argv: list[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = argparse.ArgumentParser(
        prog=NAME, description='Record tendons, points, pressures, stiffness and progress of a '
        'running arm into CSV files, until Ctrl-C.', allow_abbrev=False)
    parser.add_argument('--output', type=Path, default=Path('recording'), metavar='DIR',
                        help='where the files are written (default: recording)')
    parser.add_argument('--force', action='store_true', help='overwrite a recording that exists')
    parser.add_argument('--duration', type=number_in(0.1, 1e6, 's'), metavar='S',
                        help='end after so many seconds')
    parser.add_argument('--goal', action='store_true',
                        help='end when the goal that runs, or begins next, has ended')
    parser.add_argument('--namespace', default='', help='namespace of the nodes')
    status = 0

    def run(options: argparse.Namespace) -> None:
        nonlocal status
        from soft_continuum.nodes.recorder import record  # needs ROS

        claim(options.output, FILES, options.force)
        with RecordingWriter(options.output, TENDONS) as writer:
            status = record(options, writer)

    return guarded(NAME, run, parser.parse_args(argv)) or status


if __name__ == '__main__':
    sys.exit(main())
