# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the soak tests: ``./run soak`` or ``python -m soak``."""

import argparse
from collections.abc import Callable
from importlib import import_module
import sys

from benchmarks.tables import machine, Section, write
from soak.report import progress, Report

PARTS = ('sequences', 'sequences-dynamixel', 'stops', 'stops-dynamixel', 'fuzz', 'kills',
         'dynamixel', 'network', 'unattended', 'attacks')
"""Modules; after a hyphen, what drives the tendons in place of stepper motors."""
QUICK = 0.01


def main() -> int:
    """Run what the command line asks for; return 1 when a claim failed."""
    parser = argparse.ArgumentParser(
        prog='./run soak', description='Measure the reliability of the nodes on emulated devices; '
        'write docs/benchmarks/reliability.md.')
    parser.add_argument('--only', metavar='PART', action='append', choices=PARTS,
                        help=f'one of {", ".join(PARTS)}; may be given more than once')
    parser.add_argument('--share', type=float, default=1.0, metavar='SHARE',
                        help='measure only this share (above 0, at most 1) of the full amount')
    parser.add_argument('--quick', action='store_true',
                        help=f'a share of {QUICK:g}, and nothing is written')
    arguments = parser.parse_args()
    if not 0.0 < arguments.share <= 1.0:
        parser.error(f'--share is {arguments.share:g}; allowed: above 0, at most 1')
    failures: list[str] = []
    for name in arguments.only or PARTS:
        progress(f'{name} ...')
        module, *board = name.split('-')
        run: Callable[..., Report] = import_module(f'soak.{module}').run
        report = run(QUICK if arguments.quick else arguments.share, *board)
        failures += [f'{name}: {failure}' for failure in report.failures]
        section = Section('benchmarks/reliability.md', name, f'{machine()}\n\n{report.body}')
        print(f'\n## {name}\n\n{section.body}', flush=True)
        if not arguments.quick:
            progress(f'written to {write(section)}')
    for failure in failures:
        print(f'FAILED {failure}', file=sys.stderr)
    return 1 if failures else 0


if __name__ == '__main__':
    sys.exit(main())
