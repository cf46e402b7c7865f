# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's arm, its shapes and the tasks that are timed."""

from dataclasses import dataclass
from math import radians
from pathlib import Path

import numpy as np

from soft_continuum.mechanics import Arm, Equilibrium, LEFT, RIGHT, SLACK, Statics
from soft_continuum.ros.description import load_arm

DESCRIPTION = Path(__file__).parents[1] / 'config' / 'manipulator.yaml'
ANGLE = radians(36.0)
FORMS = {'C': (1, 1, 1), 'S': (1, -1, 1)}
ALL_PULLS = 0.042577  # m, the pulls of the three segments of the C-form together
NUDGE = 1e-4  # m, between a warm start and its solution
ALL_SOFT = (True, True, True)


def arm(gravity: bool = False) -> Arm:
    """Return the arm of config/manipulator.yaml."""
    described = load_arm(DESCRIPTION)
    return described if gravity else described.without_gravity()


@dataclass(frozen=True, eq=False)
class Task:
    """
    One solve: all segments soft, the right tendon ``pull`` m shorter, the left one slack.

    start: where it is followed from.
    """

    start: Equilibrium
    pull: float

    @property
    def pulls(self) -> tuple[float, float]:
        """Pulls of both tendons, m."""
        return self.pull, SLACK


def cold_and_warm(statics: Statics, pull: float) -> tuple[Task, Task]:
    """Return the solve from straight, and that from its result with the pull a little larger."""
    cold = Task(statics.chain.straight(), pull)
    reached = statics.solve(cold.start, cold.pulls, ALL_SOFT)
    return cold, Task(reached, pull + NUDGE)


def pull_for_tip_segment(statics: Statics, angle: float) -> float:
    """Return the right pull (m) that bends the tip segment to ``angle`` rad, all being soft."""
    tip = statics.chain.segments - 1
    state = statics.bend(statics.chain.straight(), tip, angle, [True] * (tip + 1))
    return float(state.pulls[RIGHT])


def only(segment: int, segments: int = 3) -> tuple[bool, ...]:
    """Return the mask in which one segment (0-based) is soft."""
    return tuple(i == segment for i in range(segments))


@dataclass(frozen=True)
class Step:
    """One segment of a shape is set: ``tendon`` gets shorter by ``change`` m, the other slack."""

    segment: int
    tendon: int
    change: float


def steps_of(statics: Statics, signs: tuple[int, ...]) -> list[Step]:
    """Return the steps that bend each segment in turn by ANGLE times its sign."""
    state, steps = statics.chain.straight(), []
    for segment, sign in enumerate(signs):
        bent = statics.bend(state, segment, sign * ANGLE)
        tendon = RIGHT if bent.tensions[RIGHT] > 0.0 else LEFT
        steps.append(Step(segment, tendon, float(bent.pulls[tendon] - state.pulls[tendon])))
        state = bent
    return steps


def pulls_of(step: Step, state: Equilibrium) -> tuple[float, float]:
    """Return the pulls (m) of a step from the state before it."""
    pulls = [SLACK, SLACK]
    pulls[step.tendon] = float(state.pulls[step.tendon]) + step.change
    return pulls[RIGHT], pulls[LEFT]


def walk(statics: Statics, steps: list[Step], straight: Equilibrium | None = None
         ) -> list[Equilibrium]:
    """Return the state after each step, from straight."""
    state, states = straight or statics.chain.straight(), []
    for step in steps:
        state = statics.solve(
            state, pulls_of(step, state), only(step.segment, statics.chain.segments))
        states.append(state)
    return states


def apart(statics: Statics, one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest distance (m) between calculation points of two vectors of angles."""
    difference = statics.chain.points(one) - statics.chain.points(other)
    return float(np.linalg.norm(difference, axis=1).max())
