# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The work of a study in units, each some random shapes or one query of a design, by full statics.

The result of a unit depends on seed, design and unit alone, so a study is reproducible on any
machine and in any order of units.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf, nan
from time import perf_counter
from typing import Any

import numpy as np

from soft_continuum.lab.study.design import Design, Study
from soft_continuum.mechanics import Arm, set_shape, Statics, StaticsError
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.directions import hinged
from soft_continuum.planning.obstacles import CollisionScene
from soft_continuum.planning.planner import Planner, PlanSettings
from soft_continuum.planning.plans import Shape, TipGoal
from soft_continuum.planning.settings import reach_from_parameters
from soft_continuum.planning.shape_plans import plan_shapes

SHAPES, QUERIES = 'shapes', 'queries'
"""Kinds of work."""
UNIT_TIME = 0.5
"""Approximate time for the shapes of one unit, s; more for spatial arms that often fall."""
HELD, TENSION, TRAVEL, TOUCHES, FALLS = 'held', 'tension', 'travel', 'touches', 'falls'
"""Outcomes of a shape; beyond a limit of the rig; nearer to an obstacle than the margin; no
tendons hold it."""
DRAWS = 30  # random shapes tried to find one that the arm holds
FOUND, NOT_FOUND, NONE = 'found', 'not found', 'none'
"""Outcomes of a query; NONE: no random shape was held and clear, so there was no goal."""
OF_TIP = ('x', 'y', 'z', 'pointing_x', 'pointing_y', 'pointing_z', 'tension', 'pull')


@dataclass(frozen=True)
class Unit:
    """Some shapes, or one query, of a design, by number."""

    kind: str
    design: int
    first: int
    count: int

    @property
    def name(self) -> str:
        """Its name, in the order of design and number."""
        return f'{self.kind}-{self.design:06d}-{self.first:08d}'


def work_units(study: Study) -> list[Unit]:
    """Return the work of a study, in order."""
    found = []
    for design in study.designs:
        size = round(UNIT_TIME / design.arm.bend_time)
        found += [Unit(SHAPES, design.number, first, min(size, study.shapes - first))
                  for first in range(0, study.shapes, size)]
        found += [Unit(QUERIES, design.number, number, 1) for number in range(study.queries)]
    return found


def compute(design: Design, unit: Unit, seed: int) -> tuple[dict[str, list[Any]], float]:
    """Return the rows of a unit as columns, and the computing time (s)."""
    began = perf_counter()
    rows = (shapes(design, unit.first, unit.count, seed) if unit.kind == SHAPES
            else [query(design, unit.first, seed)])
    return {name: [row[name] for row in rows] for name in rows[0]}, perf_counter() - began


def shapes(design: Design, first: int, count: int, seed: int) -> list[dict[str, Any]]:
    """
    Return the rows of some shapes of a design, from a number on.

    Columns: design, shape; softenings; solves; bent_1, ... commanded bending of each segment (rad;
    for spatial arms about x, and turned_1, ... about y); outcome; x, y, z (m) and direction of the
    tip (unit vector); tension, the largest (N); pull, the largest (m); nan for none.
    """
    arm, statics = design.arm, Statics(design.arm)
    draw = np.random.default_rng([seed, design.number, first, 0])
    jamming = bool(design.values['arm.jamming'])
    around = CollisionScene(arm, design.obstacles)
    rows = []
    for shape in range(first, first + count):
        bending = drawn(arm, draw, jamming)
        state = state_with_bending(statics, bending, jamming)
        soft = int(bending.any(axis=1).sum())
        row: dict[str, Any] = {
            'design': design.number, 'shape': shape, 'softenings': soft if jamming else 0,
            'solves': soft if jamming and state is not None else 1}
        for s, (about, axes) in enumerate(zip(bending, arm.bending_axes, strict=True), start=1):
            row |= {f'{name}_{s}': float(value) for name, value in zip(
                ('bent', 'turned'), about[axes], strict=False)}
        numbers = [nan] * len(OF_TIP) if state is None else np.concatenate([
            state.poses[-1, :3], state.rotations[-1][:, 2],
            [np.max(state.tensions), np.abs(state.pulls).max()]]).tolist()
        rows.append(row | {'outcome': outcome_of(state, design.values, around)}
                    | dict(zip(OF_TIP, numbers, strict=True)))
    return rows


def query(design: Design, number: int, seed: int) -> dict[str, Any]:
    """
    Return the row of a query of a design: a tip that it can reach, and a plan from straight to it.

    The goal is the tip of a random shape that the arm holds, clear of obstacles.  A search ends
    after reach.states, not after a time, so the result is the same on every machine.

    Columns: design, query, x, y, z of the goal (m); outcome; softenings, duration (s), tension
    (N), clearance (m) and tip_error (m) of the first plan, nan for none.
    """
    draw = np.random.default_rng([seed, design.number, number, 1])
    arm = design.arm
    values: Mapping[str, Any] = design.values
    around, statics = CollisionScene(arm, design.obstacles), Statics(arm)
    settings = replace(reach_from_parameters(values), time_limit=inf, seed=number)
    jamming = bool(values['arm.jamming'])
    row: dict[str, Any] = {'design': design.number, 'query': number, 'x': nan, 'y': nan, 'z': nan,
                           'outcome': NONE, 'softenings': 0, 'duration': nan, 'tension': nan,
                           'clearance': nan, 'tip_error': nan}
    tried = (state_with_bending(statics, drawn(arm, draw, jamming), jamming) for _ in range(DRAWS))
    state = next((one for one in tried if outcome_of(one, values, around) == HELD), None)
    if state is None:
        return row
    goal = TipGoal(state.poses[-1, :3], position_tolerance=values['reach.position_tolerance'])
    row |= dict(zip('xyz', goal.position.tolist(), strict=True)) | {'outcome': NOT_FOUND}
    planner = Planner(arm, PlanSettings.of(values))
    first, = plan_shapes(planner, planner.statics.chain.straight(),
                         (0.0,) * len(arm.tendon_names), [Shape('goal', (), tips=(goal,))],
                         around, settings, first=True)
    return row if first.why else row | {
        'outcome': FOUND, 'softenings': first.softenings if jamming else 0,
        'duration': first.duration, 'tension': first.tension, 'clearance': first.clearance[0],
        'tip_error': first.tip_error}


def drawn(arm: Arm, draw: np.random.Generator, jamming: bool) -> Array:
    """Return random bending within the limits for some or all segments."""
    count = len(arm.segments)
    chosen = np.ones(count, dtype=bool)
    if jamming:  # with fewer softenings a smaller set is reached
        chosen[draw.permutation(count)[draw.integers(1, count + 1):]] = False
    if hinged(arm):
        sizes = arm.bending_angle_limits * draw.uniform(-1.0, 1.0, count)
        bending = np.column_stack([sizes, sizes])
    else:
        # Even over the disc of rotation vectors.
        sizes = arm.bending_angle_limits * np.sqrt(draw.random(count))
        ways = draw.uniform(-np.pi, np.pi, count)
        bending = sizes[:, None] * np.column_stack([-np.sin(ways), np.cos(ways)])
    return np.where(arm.bending_axes & chosen[:, None], bending, 0.0)


def state_with_bending(statics: Any, bending: Array, jamming: bool) -> Any:
    """Return the state with a bending; None where no tendons hold it."""
    try:
        return set_shape(statics, bending, jamming=jamming)
    except StaticsError:
        return None


def outcome_of(state: Any, values: Mapping[str, Any], around: CollisionScene) -> str:
    """Return the outcome of a shape; state: None where no tendons hold it."""
    if state is None:
        return FALLS
    low, high = values['pull_limits']
    if np.max(state.tensions) > values['tension_limit']:
        return TENSION
    if np.min(state.pulls) < low or np.max(state.pulls) > high:
        return TRAVEL
    near = around.clearance(state).distance
    return TOUCHES if near < values['obstacles.margin'] else HELD
