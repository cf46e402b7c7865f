# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans to a goal of the tip: so far base first, to the shape with the fewest softenings."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.mechanics.inverse import angles_for_tip
from soft_continuum.sequencing.planner import PlanError, Shape, ShapePlan, ShapePlanner
from soft_continuum.sequencing.reach.goal import ReachSettings, Surroundings, TipGoal
from soft_continuum.sequencing.reach.result import PlannedStep, Reach


def reach(planner: ShapePlanner, state: Any, pulls: Sequence[float], goal: TipGoal,
          surroundings: Surroundings, settings: ReachSettings | None = None) -> Iterator[Reach]:
    """
    Yield plans to a goal of the tip, each better than the one before it.

    state: of the arm at rest, with all segments stiff if it has jamming.  pulls: (tendons,) m of
    its motors.  Raises PlanError for a start or a goal that is none, or when abandoned.
    """
    settings = settings or ReachSettings()
    statics = planner.statics
    arm = statics.chain.arm
    goal.check(arm)
    if surroundings.clearance(state).distance <= 0.0:
        raise PlanError(f'the arm touches {surroundings.clearance(state).obstacle} at its start')
    try:
        if isinstance(arm, Arm):
            x, _, z = goal.position
            turn = None
            if goal.rotation is not None and goal.kind != 'position':
                turn = float(np.arctan2(goal.rotation[0, 2], goal.rotation[2, 2]))
            there = angles_for_tip(statics, float(x), float(z), turn, state).state
        else:
            from soft_continuum.mechanics.spatial.tip import bending_for_tip
            there = bending_for_tip(statics, goal.position, goal.rotation
                                    if goal.kind != 'position' else None, state).state
        shape = Shape('tip', tuple(there.bending_angles.tolist()), 0.0,
                      tuple(there.bending_directions.tolist()))
        plan = planner.plan(state, pulls, [shape])[0]
    except (StaticsError, PlanError) as error:
        yield Reach(None, str(error), (), *errors(goal, state))
        return
    yield judged(plan, goal, surroundings, settings)


def follow(planner: ShapePlanner, state: Any, pulls: Sequence[float], goals: Sequence[TipGoal],
           surroundings: Surroundings, settings: ReachSettings | None = None
           ) -> Iterator[Reach]:
    """Yield a plan through goals of the tip, one after the other; otherwise as ``reach``."""
    moves: list[Any] = []
    steps: list[PlannedStep] = []
    worst, start = np.zeros(2), np.asarray(pulls, dtype=float)
    for goal in goals:
        *_, found = reach(planner, state, start.tolist(), goal, surroundings, settings)
        worst = np.maximum(worst, [found.tip_error, found.turn_error])
        if found.plan is None:
            break
        state = found.plan.state
        moves += found.plan.moves
        steps += found.steps
        start = moves[-1].pulls[-1] if moves else start
    whole = None if found.plan is None else replace(found.plan, moves=tuple(moves))
    yield Reach(whole, found.why, tuple(steps), *worst)


def judged(plan: ShapePlan, goal: TipGoal, surroundings: Surroundings, settings: ReachSettings
           ) -> Reach:
    """Return a plan with what can be said about the states after its moves."""
    near = surroundings.clearance(plan.state)
    why = '' if near.distance >= settings.margin else (
        f'{near.obstacle} is nearer than the margin of {settings.margin:g} m')
    steps = [PlannedStep((plan.state,), near.distance, near.obstacle, move.largest_tension,
                         move.duration + settings.softening_time) for move in plan.moves]
    tip, turn = errors(goal, plan.state)
    if tip > goal.position_tolerance:
        why = f'the nearest that the tip can get is {tip * 1e3:.1f} mm away'
    return Reach(plan, why, tuple(steps), tip, turn)


def errors(goal: TipGoal, state: Any) -> tuple[float, float]:
    """Return how far the tip of a state is from a goal, m, and how far it is turned, rad."""
    tip, turned = state.backbone[-1], state.rotations[-1]
    away = float(np.linalg.norm(tip - goal.position))
    if goal.rotation is None or goal.kind == 'position':
        return away, 0.0
    if goal.kind == 'direction':
        part = goal.rotation[:, 2] @ turned[:, 2]
    else:
        part = 0.5 * (np.trace(goal.rotation.T @ turned) - 1.0)
    return away, float(np.arccos(np.clip(part, -1.0, 1.0)))
