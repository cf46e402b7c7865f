# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Queries: tips that a design can reach, and whether a plan gets there from straight.

The tip of a random shape that the arm holds, clear of obstacles, is asked for.  A search ends
after reach.states, not after a time: its answer is then the same on every machine.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np

from soft_continuum.mechanics.statics import Statics
from soft_continuum.obstacles import CollisionScene
from soft_continuum.sequencing.moves import PlanSettings
from soft_continuum.sequencing.planner import Planner
from soft_continuum.sequencing.reach import reach, TipGoal
from soft_continuum.sequencing.settings import reach_from_parameters
from soft_continuum.study.design import Design
from soft_continuum.study.sampling import drawn, HELD, outcome_of, set_to

DRAWS = 30  # random shapes that are tried to find one that the arm holds
FOUND, NOT_FOUND, NONE = 'found', 'not found', 'none'
"""What became of a query; NONE: no random shape was held and clear, so nothing was asked."""


def query(design: Design, number: int, seed: int) -> dict[str, Any]:
    """
    Return the row of one query of a design.

    Columns: design, query, x, y, z of the goal (m); outcome; softenings, duration (s), tension
    (N), clearance (m) and tip_error (m) of the first plan, nan where there is none.
    """
    draw = np.random.default_rng([seed, design.number, number, 1])
    arm = design.arm
    values: Mapping[str, Any] = design.values
    around, statics = CollisionScene(arm, design.obstacles), Statics(arm)
    settings = replace(reach_from_parameters(values), time_limit=inf, seed=number)
    jamming = bool(values['arm.jamming'])
    nan = float('nan')
    row: dict[str, Any] = {'design': design.number, 'query': number, 'x': nan, 'y': nan, 'z': nan,
                           'outcome': NONE, 'softenings': 0, 'duration': nan, 'tension': nan,
                           'clearance': nan, 'tip_error': nan}
    for _ in range(DRAWS):
        state, _solves = set_to(statics, drawn(arm, draw, jamming), jamming)
        if outcome_of(state, values, around) == HELD:
            break
    else:
        return row
    goal = TipGoal(state.poses[-1, :3], position_tolerance=values['reach.position_tolerance'])
    row |= dict(zip('xyz', goal.position.tolist(), strict=True)) | {'outcome': NOT_FOUND}
    planner = Planner(arm, PlanSettings.of(values))
    first = next(reach(planner, planner.statics.chain.straight(),
                       (0.0,) * len(arm.tendon_names), goal, around, settings))
    return row if first.why else row | {
        'outcome': FOUND, 'softenings': first.softenings if jamming else 0,
        'duration': first.duration, 'tension': first.tension, 'clearance': first.clearance[0],
        'tip_error': first.tip_error}
