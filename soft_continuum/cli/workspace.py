# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Reachable tips with and without gravity, by the order in which segments are set."""

import argparse
from collections.abc import Sequence
import sys
from time import monotonic

from soft_continuum.analysis.result_figures import workspace_figure
from soft_continuum.analysis.results import reserve_outputs, text_table
from soft_continuum.analysis.workspace import furthest_apart, reach
from soft_continuum.arguments import FOR_ANALYSIS, Parser, whole_number_in
from soft_continuum.cli.common import described_arm, run_verb
from soft_continuum.mechanics.arm import Arm, ArmError
from soft_continuum.mechanics.statics import warm_up

NAME = 'workspace'
MAX_SHAPES = 50000
"""Shapes that --per-segment may ask for: some minutes."""
USUAL_SHAPES = 2000
"""Shapes that are computed without --per-segment: some seconds."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = Parser(NAME, 'Where the tip can go, with and without gravity, when segments are '
                    'set from the base on or from the tip on.', *FOR_ANALYSIS)
    parser.add_argument('--per-segment', type=whole_number_in(2, 101), metavar='N',
                        help='bending angles between the limits of each segment (default: 11, '
                        f'fewer where that would be more than {USUAL_SHAPES} shapes)')
    return run_verb(parser, _run, argv)


def _run(options: argparse.Namespace) -> None:
    _, arm = described_arm(options)
    angles = options.per_segment or default_angles(len(arm.segments))
    count = angles**len(arm.segments)
    if count > MAX_SHAPES:
        fitting = int(MAX_SHAPES**(1.0 / len(arm.segments)))
        remedy = (f'--per-segment {fitting} is the most that is practical' if fitting > 1 else
                  f'an arm of so many segments has too many for any; allowed: {MAX_SHAPES}')
        raise ArmError(f'{angles} angles in each of {len(arm.segments)} segments are '
                       f'{count} shapes; {remedy}')
    figure, = reserve_outputs(options.output, [f'{NAME}.png'], options.force)
    base_first = tuple(range(len(arm.segments)))
    cases = [('without gravity', arm.without_gravity(), base_first),
             ('gravity, base first', arm, base_first),
             ('gravity, tip first', arm, base_first[::-1])]
    reaches = []
    duration = len(cases) * _duration(arm, angles)
    print(f'{len(cases)} times {count} shapes, about {duration:.0f} s; --per-segment changes that',
          file=sys.stderr, flush=True)
    for number, (title, model, order) in enumerate(cases, start=1):
        print(f'{number} of {len(cases)}, {title} ...', file=sys.stderr, flush=True)
        reaches.append((title, reach(model, order, angles)))
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


def default_angles(segments: int) -> int:
    """Return the bending angles of each segment that make no more than USUAL_SHAPES shapes."""
    return max(2, min(11, int(USUAL_SHAPES**(1.0 / segments))))


def _duration(arm: Arm, angles: int) -> float:
    """Estimate how long ``reach`` takes (s), from the two extreme angles of each segment."""
    def solves(count: int) -> int:
        return sum(count**n for n in range(1, len(arm.segments) + 1))

    warm_up()
    begin = monotonic()
    reach(arm, range(len(arm.segments)), 2)
    return (monotonic() - begin) * solves(angles) / solves(2)
