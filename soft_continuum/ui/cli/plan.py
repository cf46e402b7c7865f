# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The plan that brings the tip to a position, step by step, without nodes."""

import argparse
from collections.abc import Sequence
import json
from math import ceil, isfinite
import os
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

import numpy as np
import scipy

from soft_continuum.client import Tip
from soft_continuum.extras import require
from soft_continuum.lab.analysis.verbs import (
    described_arm,
    DPI,
    new_figure,
    ResultError,
    run_verb,
    text_table,
)
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.drawing import draw_arm, projection_of, SOFT
from soft_continuum.parameters.arguments import (
    DONE,
    FAILED,
    given_path,
    number_in,
    Parser,
    whole_number_in,
)
from soft_continuum.planning.obstacles import CollisionScene, Obstacle
from soft_continuum.planning.obstacles.drawing import draw_obstacles
from soft_continuum.planning.obstacles.files import load_obstacles
from soft_continuum.planning.planner import Planner, PlanSettings
from soft_continuum.planning.plans import PlanResult, Shape, TipGoal, WHOLE_ARM
from soft_continuum.planning.settings import reach_from_parameters
from soft_continuum.planning.shape_plans import plan_shapes, plans_to
from soft_continuum.ui.cli.goals import (
    add_tip,
    given_tip,
    parse_bendings,
    read_tip_path,
    tip_problem,
    UNITS,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = 'plan'
SUFFIXES = '.png', '.svg', '.pdf', '.gif'
COLUMNS = 4
FRAMES = 20  # of each step of an animation
RATE, REST = 12, 6  # frames per second, and that many at the end of each step
PATH, GOAL = 'tab:blue', 'tab:green'
GIF_DPI = 90
MARGIN = 0.03  # m around all that is drawn


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = Parser(NAME, 'Plan how to bring the tip to a position: order of softened segments, '
                    'bending angles, duration, tension and distance from obstacles. Needs neither '
                    'a rig nor nodes.',
                    '--params-file', '--json', '--force', '--decimal')
    add_tip(parser, needed=False)
    parser.add_argument('--path', type=given_path, metavar='FILE',
                        help='instead of a position, a path: a CSV file with the columns x and z, '
                        'or x, y and z, and optionally angle')
    parser.add_argument('--from', dest='start', type=parse_bendings, metavar='A,B,C',
                        help='bending angle of each segment at the start, base first, degrees '
                        '(default: straight). For spatial arms, A@D bends towards the direction D')
    parser.add_argument('--obstacles', type=given_path, metavar='FILE',
                        help='YAML file of obstacles')
    parser.add_argument('--margin', type=number_in(0.0, 1000.0, 'mm'), metavar='MM',
                        help='minimum distance from obstacles (default: obstacles.margin)')
    parser.add_argument('--time-limit', type=number_in(0.1, 600.0, 's'), metavar='S',
                        help='maximum duration of the search (default: reach.time_limit)')
    parser.add_argument('--states', type=whole_number_in(10, 100_000_000), metavar='N',
                        help='number of states to evaluate in the search for a better plan '
                        '(default: reach.states)')
    parser.add_argument('--seed', type=whole_number_in(0, 1_000_000), metavar='N',
                        help='seed of the random search (default: reach.seed)')
    parser.add_argument('-o', '--picture', type=given_path, metavar='FILE',
                        help='write a picture of every step (.png, .svg or .pdf) or an animation '
                        '(.gif)')
    return run_verb(parser, lambda options: _run(parser, options), argv)


def _run(parser: Parser, options: argparse.Namespace) -> int:
    if bool(options.position) == bool(options.path):
        parser.error('give a position, such as 150 220 --unit mm, or --path FILE')
    if options.position and (problem := tip_problem(options)):
        parser.error(problem)
    if options.picture:
        require('matplotlib')
        if options.picture.suffix not in SUFFIXES:
            parser.error(f'-o {options.picture}: allowed: names that end in '
                         f'{", ".join(SUFFIXES)}')
        if not os.access(options.picture.parent, os.W_OK):
            parser.error(f'-o {options.picture}: the directory does not exist or is not writable')
        if options.picture.exists() and not options.force:
            raise ResultError(f'{options.picture} exists; add --force to overwrite it')
    values, arm = described_arm(options)
    for name, value in (('obstacles.margin', options.margin and 1e-3 * options.margin),
                        ('reach.time_limit', options.time_limit), ('reach.seed', options.seed),
                        ('reach.states', options.states)):
        if value is not None:
            values[name] = value
    around = CollisionScene(arm, load_obstacles(options.obstacles) if options.obstacles else ())
    tips = (read_tip_path(options.path, options.unit, UNITS[options.unit] * options.tolerance,
                          options.decimal)
            if options.path else [given_tip(options)])
    start, found = _planned(arm, values, around, options.start, tips)
    _print(found, options.json, len(tips) > 1)
    if options.picture and found.plan is not None and found.steps:
        plan_figure(options.picture, start, found, around.obstacles,
                    np.array([tip.place for tip in tips]))
        print(f'Picture: {options.picture}', file=sys.stderr)
    if found.cut_short and not found.why:
        print('The time limit ended the search; more time may give a better plan.',
              file=sys.stderr)
    return parser.fail(found.why, FAILED) if found.why else DONE


def _planned(arm: Arm, values: dict[str, Any], around: CollisionScene,
             start: Sequence[Any] | None, tips: Sequence[Tip]) -> tuple[Any, PlanResult]:
    """Return the state at the start, and the plan; raises PlanError for an invalid goal."""
    planner, settings = Planner(arm, PlanSettings.of(values)), reach_from_parameters(values)
    goals = tuple(_goal(tip, values) for tip in tips)
    for goal in goals:
        goal.check(arm)
    state, pulls = planner.statics.chain.straight(), np.zeros(len(arm.tendon_names))
    if start is not None:
        pairs = [bend if isinstance(bend, tuple) else (bend, 0.0) for bend in start]
        directions = tuple(direction for _, direction in pairs)
        begin, = plans_to(planner, [Shape('--from', tuple(angle for angle, _ in pairs), 0.0,
                                          directions if any(directions) else ())])
        state, pulls = begin.state, begin.pulls(pulls)
    found, = plan_shapes(planner, state, pulls, [Shape('tip', (), tips=goals)], around, settings)
    return state, found


def _goal(tip: Tip, values: dict[str, Any]) -> TipGoal:
    return TipGoal(
        np.array(tip.place), None if tip.kind == 'position' else
        scipy.spatial.transform.Rotation.from_quat(tip.quaternion).as_matrix(), tip.kind,
        tip.tolerance or values['reach.position_tolerance'],
        tip.angle_tolerance or values['reach.angle_tolerance'])


def _print(found: PlanResult, as_json: bool, path: bool) -> None:
    """Print the steps and their totals; path: whether there are several goals."""
    moves = found.plan.moves if found.plan is not None else ()
    if as_json:
        print(json.dumps({
            'found': not found.why, 'message': found.why, 'tip_error': found.tip_error,
            'turn_error': found.turn_error, 'steps': [{
                'segment': move.segment + 1,
                'bending_angles': step.states[-1].bending_angles.tolist(),
                'bending_directions': step.states[-1].bending_directions.tolist(),
                'motion_time': move.duration, 'time': step.duration, 'tension': step.tension,
                'clearance': step.clearance if isfinite(step.clearance) else None,
                'obstacle': step.obstacle, 'tip': step.states[-1].backbone[-1].tolist()}
                for move, step in zip(moves, found.steps, strict=True)]}))
        return
    rows = [[str(number), 'all' if move.segment == WHOLE_ARM else str(move.segment + 1),
             _angles(step.states[-1]), f'{step.duration:.1f}', f'{step.tension:.1f}',
             _clearance(step.clearance, step.obstacle),
             ', '.join(f'{1e3 * value:.1f}' for value in step.states[-1].backbone[-1])]
            for number, (move, step) in enumerate(zip(moves, found.steps, strict=True), start=1)]
    if rows:
        print(text_table(['step', 'segment', 'bending angles, degrees', 'time s', 'tension N',
                          'clearance mm', 'tip x, y, z mm'], rows))
    turned = f' and {np.degrees(found.turn_error):.1f} degrees' if found.turn_error else ''
    off = f'{1e3 * found.tip_error:.1f} mm{turned}'
    what = 'move' if any(move.segment == WHOLE_ARM for move in moves) else 'softening'
    print(f'{found.softenings} {what}{"" if found.softenings == 1 else "s"}, '
          f'{found.duration:.0f} s, up to {found.tension:.1f} N, clearance '
          f'{_clearance(*found.clearance)}; '
          + (f'the tip leaves its path by up to {off}' if path
             else f'the tip ends {off} from its goal'))


def _angles(state: Any) -> str:
    towards = [f'@{degrees % 360 - 360 * (degrees % 360 > 180)}' for degrees in np.degrees(
        state.bending_directions).round().astype(int).tolist()]
    return ' '.join(f'{angle:+.1f}{direction}' for angle, direction in zip(
        np.degrees(state.bending_angles), towards or [''] * len(state.bending_angles),
        strict=True))


def _clearance(distance: float, obstacle: str) -> str:
    return f'{1e3 * distance:.1f} ({obstacle})' if isfinite(distance) else 'no obstacle'


def plan_figure(path: Path, start: Any, found: PlanResult, obstacles: Sequence[Obstacle],
                goals: Array) -> None:
    """
    Write a picture of a plan that has steps, in mm.

    path: its suffix, one of SUFFIXES, selects the kind.  start: the state at the start.  goals:
    (k, 3) m, of the tip.  Planar arms and their obstacles are seen along y.
    """
    picture = _Picture(start, found, obstacles, goals)
    if path.suffix == '.gif':
        picture.move(path)
    else:
        picture.write(path)


class _Picture:
    """Drawing shared by all panels and frames."""

    def __init__(self, start: Any, found: PlanResult, obstacles: Sequence[Obstacle], goals: Array
                 ) -> None:
        assert found.plan is not None
        arm = start.chain.arm
        self.projection, self.picked = projection_of(arm), np.flatnonzero(arm.pose_axes[:3])
        self.goals, self.steps, self.obstacles = goals, found.steps, obstacles
        self.titles = [f'{number}: ' + (
            'the whole arm' if move.segment == WHOLE_ARM else f'segment {move.segment + 1}')
            for number, move in enumerate(found.plan.moves, start=1)]
        self.soft = [move.segment for move in found.plan.moves]
        self.start, self.end = start, found.steps[-1].states[-1]
        states = [start, *(state for step in found.steps for state in step.states)]
        points = 1e3 * np.vstack([goals, np.zeros((1, 3)), *(s.backbone for s in states)])
        around = 1e3 * (MARGIN + start.chain.disc_radii.max())
        self.low, self.high = points.min(axis=0) - around, points.max(axis=0) + around
        self.tips = [1e3 * np.array([s.backbone[-1] for s in step.states])
                     for step in found.steps]

    def write(self, path: Path) -> None:
        """Write a panel for the start and for the end of each step."""
        count = 1 + len(self.steps)
        columns = min(count, COLUMNS)
        rows = ceil(count / columns)
        width, _, height = self.high - self.low
        tall = min(7.0, max(2.5, 3.2 * height / width)) if self.projection is None else 3.6
        figure = new_figure(3.6 * columns, (tall + 0.8) * rows)
        self._draw(self._axes(figure, rows, columns, 1), self.start, 'start', None, 0)
        for number, step in enumerate(self.steps):
            axes = self._axes(figure, rows, columns, number + 2)
            self._draw(axes, step.states[-1], self.titles[number], self.soft[number], number + 1)
        figure.savefig(path, dpi=DPI)

    def move(self, path: Path) -> None:
        """Write an animation."""
        from matplotlib.animation import PillowWriter
        from matplotlib.figure import Figure
        figure = Figure(figsize=(5.0, 5.0))
        writer = PillowWriter(fps=RATE)
        with writer.saving(figure, path, GIF_DPI):
            for number, step in enumerate(self.steps):
                chosen = np.unique(np.linspace(0, len(step.states) - 1, FRAMES).round())
                for i in chosen.astype(int).tolist():
                    figure.clear()
                    self._draw(self._axes(figure, 1, 1, 1), step.states[i], self.titles[number],
                               self.soft[number], number, self.tips[number][:i + 1])
                    writer.grab_frame()
                for _ in range(REST):
                    writer.grab_frame()

    def _axes(self, figure: 'Figure', rows: int, columns: int, number: int) -> Any:
        return figure.add_subplot(rows, columns, number, projection=self.projection)

    def _draw(self, axes: Any, state: Any, title: str, soft: int | None, done: int,
              running: Array | None = None) -> None:
        """Draw a state with the path of the tip in previous steps and in this one."""
        draw_arm(axes, state)
        draw_obstacles(axes, self.obstacles)
        for tips in (*self.tips[:done], *([] if running is None else [running])):
            axes.plot(*tips[:, self.picked].T, color=PATH, linewidth=1.2)
        axes.plot(*(1e3 * self.goals[:, self.picked]).T, 'x', color=GOAL, markersize=8,
                  markeredgewidth=2)
        for name, k in zip('xyz', self.picked, strict=False):
            axes.set(**{f'{name}lim': (self.low[k], self.high[k])})
        if self.projection is None:
            axes.set_ylabel('z in mm')
        else:
            axes.set_box_aspect(self.high - self.low, zoom=0.88)
            axes.locator_params(axis='y', nbins=4)  # seen nearly end on
        axes.set_title(title, color='black' if soft is None else SOFT)
