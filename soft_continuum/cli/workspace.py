# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Reachable tip positions with and without gravity, by the order in which segments are set."""

import argparse
from collections.abc import Sequence
from math import prod
import sys
from time import monotonic

from soft_continuum.analysis.result_figures import workspace_figure
from soft_continuum.analysis.results import reserve_outputs, text_table
from soft_continuum.analysis.workspace import bendings, furthest_apart, Reach, reach
from soft_continuum.arguments import FOR_ANALYSIS, Parser, whole_number_in
from soft_continuum.cli.common import described_arm, run_verb
from soft_continuum.mechanics.arm import Arm, ArmError, BEND_TIME
from soft_continuum.mechanics.directions import hinged
from soft_continuum.mechanics.statics import warm_up
from soft_continuum.parameters.arm import check_actuation

NAME = 'workspace'
MAX_SHAPES, MAX_TIME = 50000, 100.0
"""Maximum number of shapes on request, and their maximum duration (s)."""
USUAL_SHAPES, USUAL_TIME = 2000, 8.0
"""Maximum number of shapes by default, and their maximum duration (s)."""
MOST_ANGLES = 101
USUAL_DIRECTIONS = 6


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = Parser(NAME, 'Compute the reachable tip positions, with and without gravity, when '
                    'segments are set from the base or from the tip; without jamming, when all '
                    'are set at once.', *FOR_ANALYSIS)
    parser.add_argument('--per-segment', type=whole_number_in(2, MOST_ANGLES), metavar='N',
                        help='number of bending angles between the limits of each segment '
                        f'(default: 11, fewer if that exceeds {USUAL_SHAPES} shapes, for spatial '
                        f'arms {round(USUAL_TIME / BEND_TIME[False])})')
    parser.add_argument('--directions', type=whole_number_in(3, 72), metavar='N',
                        help='for spatial arms: number of directions in which each segment is '
                        f'bent (default: {USUAL_DIRECTIONS})')
    return run_verb(parser, _run, argv, 'matplotlib')


def _run(options: argparse.Namespace) -> None:
    values, arm = described_arm(options)
    check_actuation(arm, values)
    if hinged(arm) and options.directions:
        raise ArmError('a planar arm bends only in its plane; leave out --directions')
    directions = options.directions or USUAL_DIRECTIONS
    jamming = bool(values['arm.jamming'])
    angles = options.per_segment or default_angles(arm, directions)
    count, most = _shapes(arm, angles, directions), _limit(arm, MAX_SHAPES, MAX_TIME)
    if count > most:
        raise ArmError(f'{max(map(len, bendings(arm, angles, directions)))} bendings in each of '
                       f'{len(arm.segments)} segments are {count} shapes; '
                       f'{_remedy(arm, directions, most)}')
    figure, = reserve_outputs(options.output, [f'{NAME}.png'], options.force)
    base_first = tuple(range(len(arm.segments)))
    cases: list[tuple[str, Arm, tuple[int, ...]]] = [
        ('without gravity', arm.without_gravity(), base_first),
        ('gravity, base first' if jamming else 'gravity', arm, base_first)]
    if jamming:
        cases.append(('gravity, tip first', arm, base_first[::-1]))
    reaches = []
    duration = len(cases) * _duration(arm, angles, directions, jamming)
    print(f'{len(cases)} times {count} shapes, about {duration:.0f} s; --per-segment changes that',
          file=sys.stderr, flush=True)
    for number, (title, model, order) in enumerate(cases, start=1):
        print(f'{number} of {len(cases)}, {title} ...', file=sys.stderr, flush=True)
        reaches.append((title, reach(model, order, angles, directions, jamming)))
    print(_table(reaches, arm.axes))
    print('\nHeld: shapes that a tendon can hold. Apart: largest distance from the tip with the '
          'same bending angles without gravity.')
    workspace_figure(figure, reaches, reaches[0][1], arm.length)
    print(f'Figure: {figure}')


def _table(reaches: Sequence[tuple[str, Reach]], axes: str) -> str:
    rows, reference = [], reaches[0][1]
    for title, found in reaches:
        if not len(found.tips):
            rows.append([title, '0', str(found.asked), *['-'] * (2 * len(axes) + 2)])
            continue
        ends = 1e3 * found.tips.min(axis=0), 1e3 * found.tips.max(axis=0)
        rows.append([title, str(len(found.tips)), str(found.asked),
                     *(f'{end:.1f}' for both in zip(*ends, strict=True) for end in both),
                     f'{1e2**len(axes) * found.hull:.1f}',
                     f'{1e3 * furthest_apart(found, reference):.1f}'])
    return text_table(['tips', 'held', 'of', *(
        head for axis in axes for head in (f'{axis} from mm', 'to mm')),
        f'hull cm^{len(axes)}', 'apart mm'], rows)


def _limit(arm: Arm, shapes: int, time: float) -> int:
    return min(shapes, round(time / arm.bend_time))


def _shapes(arm: Arm, angles: int, directions: int) -> int:
    return prod(map(len, bendings(arm, angles, directions)))


def _most_angles(arm: Arm, directions: int, count: int) -> int:
    """Return the fewest angles of each segment that give most shapes up to ``count``; 0: none."""
    shapes = {n: _shapes(arm, n, directions) for n in range(MOST_ANGLES, 1, -1)}
    fitting = [(of, -n) for n, of in shapes.items() if of <= count]
    return -max(fitting, default=(0, 0))[1]


def default_angles(arm: Arm, directions: int = USUAL_DIRECTIONS) -> int:
    """Return the bending angles of each segment that stay within the usual number of shapes."""
    return max(2, min(11, _most_angles(
        arm, directions, _limit(arm, USUAL_SHAPES, USUAL_TIME))))


def _remedy(arm: Arm, directions: int, most: int) -> str:
    fitting = _most_angles(arm, directions, most)
    if fitting > 1:
        return f'--per-segment {fitting} is the most that is practical'
    fewer = '; try --directions 3' if _shapes(arm, 2, 3) < _shapes(arm, 2, directions) else ''
    return f'an arm with this many segments always has too many; allowed: {most}{fewer}'


def _duration(arm: Arm, angles: int, directions: int, jamming: bool) -> float:
    """Estimate how long ``reach`` takes (s), from two bendings of each segment."""
    def solves(angles: int, directions: int) -> int:
        each = list(map(len, bendings(arm, angles, directions)))
        return sum(prod(each[:n + 1]) for n in range(len(each)))

    warm_up()
    begin = monotonic()
    reach(arm, range(len(arm.segments)), 2, 1, jamming)
    return (monotonic() - begin) * solves(angles, directions) / solves(2, 1)
