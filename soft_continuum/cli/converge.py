# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How many rigid bodies a segment needs (paper, III-B)."""

import argparse
from collections.abc import Sequence

import numpy as np

from soft_continuum.analysis.convergence import converge
from soft_continuum.analysis.result_figures import convergence_figure
from soft_continuum.analysis.results import reserve_outputs, text_table
from soft_continuum.arguments import FOR_ANALYSIS, number_in, Parser, whole_number_in
from soft_continuum.cli.common import described_arm, run_verb
from soft_continuum.parameters.arm import check_actuation

NAME = 'converge'
USUAL_BODIES, USUAL_SPANS = 16, 4


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = Parser(NAME, 'Convergence analysis: relative change of the bending angles from n '
                    'to n + 1 bodies per segment at constant pulls.', *FOR_ANALYSIS)
    parser.add_argument('--angle', type=number_in(1.0, 120.0, 'degrees'), default=36.0,
                        metavar='DEGREES', help='bending angle of every segment (default: 36)')
    parser.add_argument('--tolerance', type=number_in(1e-6, 0.1, ''), default=1e-3, metavar='PART',
                        help='relative change that counts as converged (default: 0.001)')
    parser.add_argument('--most', type=whole_number_in(3, 200), metavar='N',
                        help=f'largest number of bodies (default: {USUAL_BODIES}, or with spacers '
                        f'{USUAL_SPANS} for each span if that is more)')
    parser.add_argument('--gravity', action='store_true',
                        help='include the weight of the arm (default: without, as in the paper)')
    return run_verb(parser, _run, argv, 'matplotlib')


def _run(options: argparse.Namespace) -> None:
    values, arm = described_arm(options)
    check_actuation(arm, values)
    figure, = reserve_outputs(options.output, [f'{NAME}.png'], options.force)
    if not options.gravity:
        arm = arm.without_gravity()
    most = options.most or max(USUAL_BODIES, USUAL_SPANS * (arm.spacers + 1))
    jamming = bool(values['arm.jamming'])
    found = converge(arm, [np.radians(options.angle)] * len(arm.segments), options.tolerance,
                     most, jamming)
    segments = range(1, len(arm.segments) + 1)
    print(f'Constant pulls: those that bend every segment to {options.angle:g} degrees with n = '
          f'{arm.bodies_per_segment}, {"with" if options.gravity else "without"} gravity.\n')
    rows = [[f'{n}{" *" if n == found.converged else ""}',
             *(f'{np.degrees(a):.3f}' for a in angles),
             *(f'{100 * c:.4f}' if np.isfinite(c) else '' for c in change),
             *(f'{100 * e:.3f}' for e in error)]
            for n, angles, change, error in zip(
                found.bodies, found.angles, found.change, found.error, strict=True)]
    print(text_table(['n', *(f'angle {s}, deg' for s in segments),
                      *(f'change {s}, %' for s in segments),
                      *(f'error {s}, %' for s in segments)], rows))
    print('\nChange: from n to the next. Error: against the continuum; it is not the change.')
    if found.converged is None:
        print(f'Not converged: no change stays below {100 * options.tolerance:g} % up to '
              f'n = {most}; raise --most or --tolerance.')
    else:
        print(f'Converged at n = {found.converged}: every change is below '
              f'{100 * options.tolerance:g} % from there on.')
    convergence_figure(figure, found, options.tolerance)
    print(f'Figure: {figure}')
