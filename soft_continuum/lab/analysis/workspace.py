# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Workspace of the tip, and its dependence on gravity and on the order of the segments.

Not from the paper.  Each segment is bent in turn while the others are stiff.  Under gravity a
segment that is set with others already bent above it carries them at another lever arm, so the
order matters.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
import sys
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np
import scipy

from soft_continuum.lab.analysis.verbs import (
    described_arm,
    finish_panels,
    new_panels,
    progress,
    reserve_outputs,
    run_verb,
    text_table,
)
from soft_continuum.mechanics._kernel import warm_up
from soft_continuum.mechanics.arm import Arm, ArmError, Array, BEND_TIME
from soft_continuum.mechanics.directions import hinged
from soft_continuum.mechanics.grid import bends, set_each
from soft_continuum.mechanics.statics import Statics
from soft_continuum.parameters.arguments import FOR_ANALYSIS, Parser, whole_number_in
from soft_continuum.parameters.arm import check_actuation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NAME = 'workspace'
MAX_SHAPES, MAX_TIME = 50000, 100.0
"""Maximum number of shapes on request, and their maximum duration (s)."""
USUAL_SHAPES, USUAL_TIME = 2000, 8.0
"""Maximum number of shapes by default, and their maximum duration (s)."""
MOST_ANGLES = 101
USUAL_DIRECTIONS = 6


@dataclass(frozen=True, eq=False)
class SampledWorkspace:
    """
    Tips of one arm, set in one order.

    order: segments, 0-based.  tips: (m, axes), m, along the axes of the arm.  bending: (m,
    segments, 2) rad, about x and y, in the same rows.  asked: number of shapes tried, including
    those that no tendon holds.
    """

    order: tuple[int, ...]
    tips: Array
    bending: Array
    asked: int

    @property
    def hull(self) -> float:
        """Area (m^2) or volume (m^3) of the convex hull of the tips; 0 where they span none."""
        dimensions = self.tips.shape[1]
        if len(self.tips) <= dimensions or np.linalg.matrix_rank(
                self.tips - self.tips[0], tol=1e-9) < dimensions:
            return 0.0
        hull = scipy.spatial.ConvexHull(self.tips)
        return float(hull.volume)  # in the plane its volume is its area


def sample_workspace(arm: Arm, order: Sequence[int], per_segment: int, directions: int = 1,
                     jamming: bool = True) -> SampledWorkspace:
    """
    Return the tips for ``per_segment`` angles between the limits of every segment.

    A segment that bends in all directions has half as many in each of ``directions``, and
    straight.  Without ``jamming`` all segments are bent at once.  Tendon friction is neglected.
    """
    grid = bending_grid(arm, per_segment, directions)
    found = set_each(Statics(arm), grid, order, jamming=jamming,
                     progress=progress)
    axes = arm.pose_axes[:3]
    return SampledWorkspace(tuple(order),
                            np.array([state.poses[-1, :3][axes] for state, _ in found]).reshape(
                     -1, axes.sum()),
                            np.array([bending for _, bending in found]).reshape(-1, len(grid), 2),
                            prod(map(len, grid)))


def bending_grid(arm: Arm, per_segment: int, directions: int) -> list[Array]:
    """Return the bendings (k, 2), rad, of each segment; all combinations are set."""
    return [bends(arm, s, per_segment, directions) for s in range(len(arm.segments))]


def furthest_apart(one: SampledWorkspace, other: SampledWorkspace) -> float:
    """Return the largest distance (m) of tips with the same bending; nan without any."""
    return max((float(np.linalg.norm(a - b)) for a, b in tips_in_common(one, other)),
               default=float('nan'))


def tips_in_common(one: SampledWorkspace, other: SampledWorkspace) -> list[tuple[Array, Array]]:
    """Return both tips (m) for all common bendings."""
    there = {row.tobytes(): tip for row, tip in zip(other.bending, other.tips, strict=True)}
    return [(tip, there[row.tobytes()]) for row, tip in zip(one.bending, one.tips, strict=True)
            if row.tobytes() in there]


def workspace_figure(path: str | Path, workspaces: Sequence[tuple[str, SampledWorkspace]],
                     base: SampledWorkspace, height: float) -> None:
    """
    Write a figure of tips, a panel for each set, and their displacement by gravity; mm.

    For planar arms it shows their density, with the displacement below; for spatial arms side and
    top views, darker for larger displacements.  base: the tips whose outline is drawn in every
    panel.  height: of the straight arm, m.
    """
    flat, count = base.tips.shape[1] == 2, len(workspaces)
    figure, panels = new_panels(2, count, 4.2 * count, 6.8 if flat else 8.4)
    for column, (title, sampled) in enumerate(workspaces):
        above, below = panels[column::count]
        pairs = np.array(tips_in_common(sampled, base)).reshape(-1, 2, base.tips.shape[1]) * 1e3
        moves = sampled is not base and len(pairs) > 0
        if flat:
            if sampled.tips.size:
                tips = above.hexbin(*(1e3 * sampled.tips.T), gridsize=30, mincnt=1, cmap='Greys',
                                    vmin=0.0, linewidths=0.1)
                figure.colorbar(tips, ax=above, label='tips in a cell', shrink=0.6)
            _outline(above, base.tips, base.hull)
            below.set_visible(moves)
            views = [(below, 0, 1)] if moves else []
        else:
            views = [(above, 0, 2), (below, 0, 1)]
        moved = np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1)
        order = np.argsort(moved)  # the furthest on top
        for axes, i, j in views:
            points = axes.scatter(pairs[order, 0, i], pairs[order, 0, j], c=moved[order], s=7,
                                  cmap='Greys', vmin=0.0, edgecolors='0.6', linewidths=0.3,
                                  label='tip' if not column else None)
            if not flat:
                _outline(axes, base.tips[:, [i, j]], base.hull)
                axes.set_ylabel(f'{"xyz"[j]} in mm')
        if moves:
            figure.colorbar(points, ax=[axes for axes, *_ in views], label='moved by gravity, mm',
                            shrink=0.6)
        above.plot([0.0, 0.0], [0.0, 1e3 * height], color='0.0', linewidth=2.5,
                   label='straight arm')
        above.set_title(title)
    finish_panels(path, figure, 3)


def _outline(axes: 'Axes', tips: Array, hull: float) -> None:
    """Draw the outline of tips (n, 2), m, unless their hull is nothing."""
    if hull > 0.0:
        around = scipy.spatial.ConvexHull(tips).vertices
        outline = 1e3 * tips[np.append(around, around[0])]
        axes.plot(*outline.T, '--', color='0.0', linewidth=0.9, label='outline without gravity')


# The verb.


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
        raise ArmError(f'{max(map(len, bending_grid(arm, angles, directions)))} bendings in each '
                       f'of {len(arm.segments)} segments are {count} shapes; '
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
        reaches.append((title, sample_workspace(model, order, angles, directions, jamming)))
    print(_table(reaches, arm.axes))
    print('\nHeld: shapes that a tendon can hold. Apart: largest distance from the tip with the '
          'same bending angles without gravity.')
    workspace_figure(figure, reaches, reaches[0][1], arm.length)
    print(f'Figure: {figure}')


def _table(reaches: Sequence[tuple[str, SampledWorkspace]], axes: str) -> str:
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
    return prod(map(len, bending_grid(arm, angles, directions)))


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
    """Estimate how long ``sample_workspace`` takes (s), from two bendings of each segment."""
    def solves(angles: int, directions: int) -> int:
        each = list(map(len, bending_grid(arm, angles, directions)))
        return sum(prod(each[:n + 1]) for n in range(len(each)))

    warm_up()
    begin = monotonic()
    sample_workspace(arm, range(len(arm.segments)), 2, 1, jamming)
    return (monotonic() - begin) * solves(angles, directions) / solves(2, 1)
