# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The plan that brings the tip to a position, step by step, without nodes."""

import argparse
from collections.abc import Sequence
import json
from math import isfinite
import os
import sys
from typing import Any

import numpy as np
import scipy

from soft_continuum.analysis.results import ResultError, text_table
from soft_continuum.analysis.verbs import described_arm, run_verb
from soft_continuum.arguments import DONE, FAILED, given_path, number_in, Parser, whole_number_in
from soft_continuum.cli.operate import bendings
from soft_continuum.cli.plan_picture import plan_figure, SUFFIXES
from soft_continuum.cli.tip_options import (
    add_tip,
    given_tip,
    read_tip_path,
    tip_problem,
    UNITS,
)
from soft_continuum.client.tip import Tip
from soft_continuum.extras import require
from soft_continuum.mechanics.arm import Arm
from soft_continuum.obstacles import CollisionScene
from soft_continuum.obstacles.files import load_obstacles
from soft_continuum.sequencing.moves import PlanSettings
from soft_continuum.sequencing.planner import Planner
from soft_continuum.sequencing.plans import Shape, WHOLE_ARM
from soft_continuum.sequencing.reach import Reach, TipGoal
from soft_continuum.sequencing.settings import reach_from_parameters
from soft_continuum.sequencing.shape_plans import plan_shapes

NAME = 'plan'


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
    parser.add_argument('--from', dest='start', type=bendings, metavar='A,B,C',
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
             start: Sequence[Any] | None, tips: Sequence[Tip]) -> tuple[Any, Reach]:
    """Return the state at the start, and the plan; raises PlanError for an invalid goal."""
    planner, settings = Planner(arm, PlanSettings.of(values)), reach_from_parameters(values)
    goals = tuple(_goal(tip, values) for tip in tips)
    for goal in goals:
        goal.check(arm)
    state, pulls = planner.statics.chain.straight(), (0.0,) * len(arm.tendon_names)
    if start is not None:
        pairs = [bend if isinstance(bend, tuple) else (bend, 0.0) for bend in start]
        directions = tuple(direction for _, direction in pairs)
        begin, = planner.plan(state, pulls, [Shape(
            '--from', tuple(angle for angle, _ in pairs), 0.0,
            directions if any(directions) else ())])
        state = begin.state
        pulls = tuple(begin.moves[-1].pulls[-1].tolist()) if begin.moves else pulls
    found, = plan_shapes(planner, state, pulls, [Shape('tip', (), tips=goals)], around, settings)
    return state, found


def _goal(tip: Tip, values: dict[str, Any]) -> TipGoal:
    return TipGoal(
        np.array(tip.place), None if tip.kind == 'position' else
        scipy.spatial.transform.Rotation.from_quat(tip.quaternion).as_matrix(), tip.kind,
        tip.tolerance or values['reach.position_tolerance'],
        tip.angle_tolerance or values['reach.angle_tolerance'])


def _print(found: Reach, as_json: bool, path: bool) -> None:
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
