# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Plans of shapes that are held with less than the full vacuum.

They are set with every segment stiff; then the vacuum of one segment after the other is lowered,
and the arm gives way under tendons and gravity by the law of its jams.  Segments are bent so much
further before that the wanted angles hold after it, as far as that can be.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.either import bending_of
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.parameters.shapes import angles_problem
from soft_continuum.sequencing.planner import PlanError, Shape, ShapePlan, ShapePlanner

STEPS = 5
"""States on the way of a vacuum from full to what is wanted: where jams yield, the way counts."""
PASSES = 6
"""Plans of a shape that are made at most, each bent by what the one before it missed."""
HELPS = 0.9
"""Of what was missed: a pass that leaves more than that is the last."""


def plan_held(planner: ShapePlanner, state: Any, start: Array, shape: Shape) -> ShapePlan:
    """
    Return the plan of a shape with vacuums, from a state with every segment stiff.

    start: (tendons,) present pulls of the motors, m.  Raises PlanError.
    """
    wanted = bending_of(planner.statics.chain.arm, shape.bending_angles, shape.bending_directions)
    shift, best, least = np.zeros_like(wanted), None, np.inf
    for _ in range(PASSES):
        try:
            moves, stiff = planner.moves(state, start, shape, shift)
            pulls = moves[-1].pulls[-1] if moves else start
            held = _held(planner, planner.jammed(stiff, pulls), pulls, shape)
        except PlanError:
            if best is None:
                raise
            break
        missed = wanted - held.bending
        most = float(np.linalg.norm(missed.reshape(len(missed), -1), axis=1).max())
        helps = most < HELPS * least
        if most < least:
            best, least = ShapePlan(shape, moves, held, stiff=stiff), most
        if most <= planner.settings.angle_tolerance or not helps:
            break
        shift = shift + missed
    assert best is not None
    return best if least <= planner.settings.angle_tolerance else replace(
        best, warning=f'{shape.name} is predicted to be {np.degrees(least):.1f} degrees off with '
                      'its vacuums')


def _held(planner: ShapePlanner, state: Any, pulls: Array, shape: Shape) -> Any:
    """Return the state with the vacuums of a shape, from one with the full vacuum."""
    full = planner.settings.full_vacuum
    wanted = [min(1.0, vacuum / full) for vacuum in shape.vacuums]
    try:
        for parts in _lowered(wanted):
            planner.check_wanted()
            state = planner.jammed(state, pulls, parts)
            planner.check_limits(np.atleast_2d(pulls), float(np.nan_to_num(state.tensions).max()))
    except (StaticsError, PlanError) as error:
        raise PlanError(f'{shape.name}: with its vacuums: {error}') from None
    if problem := angles_problem(state.bending_angles.tolist(), planner.statics.chain.arm):
        raise PlanError(f'{shape.name}: with its vacuums the arm gives way too far: {problem}')
    return state


def _lowered(wanted: Sequence[float]) -> list[list[float]]:
    """Return the parts of the full vacuum on the way, one segment after the other."""
    parts, way = [1.0] * len(wanted), []
    for segment, part in enumerate(wanted):
        if part < 1.0:
            for lowered in np.linspace(1.0, part, STEPS + 1)[1:].tolist():
                parts[segment] = lowered
                way.append(parts.copy())
    return way
