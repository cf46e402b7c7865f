# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the benchmarks: ``./run bench`` or ``python -m benchmarks``."""

import argparse
from collections.abc import Callable
from importlib import import_module

from benchmarks.tables import Section, write
from benchmarks.timing import progress

NAMES = ('startup', 'solve', 'batch', 'joints', 'accuracy', 'nodes', 'loops', 'drivers', 'camera',
         'twin', 'behaviour', 'estimate', 'loop', 'blind', 'servo', 'teleop', 'faults',
         'spatial_faults', 'spatial_imus', 'spatial', 'spatial_camera', 'spatial_loop', 'tdcr',
         'ftdcr', 'plan', 'study')


def main() -> None:
    """Run what the command line asks for, print it, and write it into the documents."""
    parser = argparse.ArgumentParser(
        prog='./run bench', description='Measure, and write the tables of docs/benchmarks.')
    parser.add_argument('--only', metavar='NAME', action='append', choices=NAMES,
                        help=f'one of {", ".join(NAMES)}; may be given more than once')
    parser.add_argument('--quick', action='store_true',
                        help='few repetitions, and nothing is written')
    arguments = parser.parse_args()
    for name in arguments.only or NAMES:
        progress(f'{name} ...')
        run: Callable[[bool], Section] = import_module(f'benchmarks.{name}').run
        section = run(arguments.quick)
        print(f'\n## {name}\n\n{section.body}', flush=True)
        if not arguments.quick:
            progress(f'written to {write(section)}')


if __name__ == '__main__':
    main()
