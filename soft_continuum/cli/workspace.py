# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Reachable tips with and without gravity, by the order in which segments are set."""

import argparse
from collections.abc import Sequence
import sys

from soft_continuum.analysis.results import claim, text_table
from soft_continuum.analysis.workspace import furthest_apart, reach
from soft_continuum.analysis.workspace_figure import workspace_figure
from soft_continuum.arguments import whole_number_in
from soft_continuum.cli.common import described_arm, guarded, new_parser
from soft_continuum.mechanics.arm import ArmError

NAME = 'workspace'
MOST_SHAPES = 50000  # some minutes


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = new_parser(NAME, 'Where the tip can go, with and without gravity, when segments are '
                        'set from the base on or from the tip on.')
    parser.add_argument('--per-segment', type=whole_number_in(2, 101), default=11, metavar='N',
                        help='bending angles between the limits of each segment (default: 11)')
    return guarded(NAME, _run, parser.parse_args(argv))


def _run(options: argparse.Namespace) -> None:
    _, arm = described_arm(options)
    count = options.per_segment**len(arm.segments)
    if count > MOST_SHAPES:
        fitting = int(MOST_SHAPES**(1.0 / len(arm.segments)))
        raise ArmError(f'{options.per_segment} angles in each of {len(arm.segments)} segments are '
                       f'{count} shapes; --per-segment {fitting} is the most that is practical')
    figure, = claim(options.output, [f'{NAME}.png'], options.force)
    base_first = tuple(range(len(arm.segments)))
    cases = [('without gravity', arm.without_gravity(), base_first),
             ('gravity, base first', arm, base_first),
             ('gravity, tip first', arm, base_first[::-1])]
    reaches = []
    for title, model, order in cases:
        print(f'{title}: {count} shapes ...', file=sys.stderr, flush=True)
        reaches.append((title, reach(model, order, options.per_segment)))
    reference = reaches[0][1]
    rows = []
    for title, found in reaches:
        if not len(found.tips):
            rows.append([title, '0', str(found.asked), *['-'] * 6])
            continue
        (x0, z0), (x1, z1) = 1e3 * found.tips.min(axis=0), 1e3 * found.tips.max(axis=0)
        rows.append([title, str(len(found.tips)), str(found.asked), f'{x0:.1f}', f'{x1:.1f}',
                     f'{z0:.1f}', f'{z1:.1f}', f'{1e4 * found.area:.1f}',
                     f'{1e3 * furthest_apart(found, reference):.1f}'])
    print(text_table(['tips', 'held', 'of', 'x from mm', 'to mm', 'z from mm', 'to mm',
                      'hull cm^2', 'apart mm'], rows))
    print('\nHeld: shapes that a tendon can hold. Apart: furthest from the tip with the same '
          'bending angles without gravity.')
    workspace_figure(figure, reaches, reference, arm.length)
    print(f'Figure: {figure}')
