# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Ways to set a shape without the suite's own closed loop, for comparison."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.lab import angles_of, Lab
from soft_continuum.mechanics import Arm, constant_curvature, Jam
from soft_continuum.mechanics.arm import Array
from soft_continuum.planning.planner import Planner, timed
from soft_continuum.planning.plans import Shape
from soft_continuum.planning.shape_plans import plans_to
from soft_continuum.sim.twin.model_errors import ModelErrors

SETTLING = 1.0  # s after each motion

PROPORTIONAL, INTEGRAL = 0.1, 0.7  # of the PI controller, per iteration
ITERATIONS = 20
TOLERANCE = np.radians(0.1)


@dataclass(frozen=True)
class Goal:
    """
    A shape: bending angles (segments,), rad, and the tip (3,), m, that they shall give.

    directions: (segments,) rad, of a spatial arm.
    """

    angles: tuple[float, ...]
    tip: tuple[float, ...]
    directions: tuple[float, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """
    How a contender ended.

    corrections: of each segment, motions after its first.  failed: why it gave up, empty for not.
    """

    corrections: tuple[int, ...]
    failed: str = ''


Contender = Callable[[Lab, Goal, Any], Outcome]
"""Sets the arm of a lab to a goal, given the described arm; may raise LabError or PlanError."""


def open_loop(lab: Lab, goal: Goal, arm: Arm) -> Outcome:
    """Plan by the model, and carry that out."""
    planner = Planner(arm, lab.description.settings)
    plan, = plans_to(planner, [Shape('goal', goal.angles, 0.0, goal.directions)], pulls=lab.pulls)
    for move in plan.moves:
        lab.switch(move.segment, False)
        lab.follow(move.times, move.pulls)
        lab.wait(SETTLING)
        lab.switch(move.segment, True)
    return Outcome((0,) * len(goal.angles))


def open_loop_told(lab: Lab, goal: Goal, arm: Arm) -> Outcome:
    """Plan with the stiffnesses, masses and K that the plant really has."""
    return open_loop(lab, goal, told(arm, lab.differences))


def told(arm: Arm, given: ModelErrors) -> Arm:
    """Return the arm with the stiffnesses, masses, K and yield moment of a plant."""
    factors = np.broadcast_to(given.stiffness_factors, len(arm.segments)).tolist()
    jam = Jam(ratio=given.stiff_ratio, yield_moment=given.yield_moment)
    return replace(
        arm,
        segments=tuple(
            replace(s, stiffness_y=factor * s.stiffness_y,
                    mass=given.mass_factor * s.mass, jam=jam)
            for s, factor in zip(arm.segments, factors, strict=True)),
        discs=tuple(replace(d, mass=given.mass_factor * d.mass) for d in arm.discs))


def pi_on_angles(lab: Lab, goal: Goal, arm: Arm) -> Outcome:
    """
    Set one segment after the other by a PI controller of its measured bending angle.

    What it says is turned into pulls by constant curvature: one tendon is pulled in, the other
    paid out, with a little slack.
    """
    settings = lab.description.settings
    corrections, failed = [0] * len(goal.angles), ''
    for segment, wanted in enumerate(goal.angles):
        lab.switch(segment, False)
        measured = angles_of(arm, lab.measure_all())
        angles = np.array([*goal.angles[:segment], *measured[segment:]])
        other = 1 if wanted > measured[segment] else 0
        total, command = 0.0, wanted
        for iteration in range(ITERATIONS + 1):
            angles[segment] = command
            pulls = np.clip(_arcs(arm, angles, other, settings.antagonist_slack),
                            *settings.pull_limits)
            times, points = timed(np.array([lab.pulls, pulls]), settings.speed,
                                  settings.acceleration)
            lab.follow(times, points)
            lab.wait(SETTLING)
            corrections[segment] = iteration
            measured = angles_of(arm, lab.measure_all())
            error = wanted - float(measured[segment])
            if abs(error) < TOLERANCE:
                break
            total += error
            command = wanted + PROPORTIONAL * error + INTEGRAL * total
        else:
            failed = (f'segment {segment + 1} was {np.degrees(error):.2f} degrees off after '
                      f'{ITERATIONS} iterations')
        lab.switch(segment, True)
    return Outcome(tuple(corrections), failed)


def _arcs(arm: Arm, angles: Array, other: int, slack: float) -> Array:
    """Return the pulls (2,) m of arcs of these angles (segments,), rad; ``other`` has slack, m."""
    limits = arm.bending_angle_limits
    bending = np.column_stack([np.zeros(len(angles)), np.clip(angles, -limits, limits)])
    pulls = constant_curvature.pulls(arm, bending)
    pulls[other] -= slack
    return pulls
