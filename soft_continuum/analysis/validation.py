# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Models against measured shapes: constant curvature, chain, chain under gravity (paper, V, Fig. 5).

Every model gets the pulls that the rig got.  Errors are distances between calculation points; the
base disc, which cannot move, does not count.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from soft_continuum.analysis.measured_shapes import (
    loaded,
    MeasuredShape,
    seen_from_the_side,
    simulate_steps,
    Step,
)
from soft_continuum.analysis.results import progress
from soft_continuum.mechanics import constant_curvature, LEFT, RIGHT
from soft_continuum.mechanics.arm import Arm, ArmError
from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.either import AnyArm, statics_of
from soft_continuum.mechanics.spatial import constant_curvature as in_space
from soft_continuum.mechanics.spatial import SpatialArm
from soft_continuum.mechanics.statics import SLACK, Statics, StaticsError

CONSTANT_CURVATURE = 'constant curvature'
WITHOUT_GRAVITY = 'chain, no gravity'
WITH_GRAVITY = 'chain, gravity'
CORRECTED = 'chain, gravity, corrected'


@dataclass(frozen=True, eq=False)
class Prediction:
    """
    One shape by one model.

    points: (2 * discs, 3), x, z in m and tangent in rad, or in space x, y, z in m.  slack: of each
    step, whether no tendon was taut at its end.  jumped: whether the arm went over to another
    equilibrium on the way.  needed: of each step, tendon and its pull (m) that bend the segment to
    the angle that was set; None where no angle was given or no tendon can, and in space.
    """

    model: str
    shape: MeasuredShape
    points: Array
    slack: tuple[bool, ...]
    jumped: bool
    needed: tuple[tuple[int, float] | None, ...]

    @property
    def errors(self) -> Array:
        """Distance (m) of the measured points, without those of the base disc."""
        distances: Array = np.linalg.norm(self.shape.misses(self), axis=1)
        return distances

    @property
    def side(self) -> Array:
        """All points as seen from the side, x and z, (2, 2 * discs), m."""
        return seen_from_the_side(self.points[:, :self.shape.positions.shape[1]])

    @property
    def relative_errors(self) -> Array:
        """Errors over the distance of the measured point from the base."""
        from_base: Array = np.linalg.norm(self.shape.positions[self.shape.moving], axis=1)
        return self.errors / from_base

    @property
    def segments(self) -> list[int]:
        """Segment (0-based) that each of the errors belongs to: that below the disc."""
        return [self.shape.numbers[row] // 2 - 1 for row in self.shape.moving]


def predict(shapes: Sequence[MeasuredShape], arm: AnyArm, corrected: AnyArm | None = None
            ) -> tuple[Prediction, ...]:
    """
    Return what each model says for each shape, shape by shape.

    corrected: the arm with measured stiffness.  Raises StaticsError naming model, shape and step.
    """
    predictions = []
    for shape in progress(shapes, 'shapes'):
        predictions.append(_constant_curvature(shape, arm) if isinstance(arm, Arm)
                           else _arcs_in_space(shape, arm))
        predictions.append(_chain(WITHOUT_GRAVITY, shape, arm.without_gravity()))
        predictions.append(_chain(WITH_GRAVITY, shape, arm))
        if corrected is not None:
            predictions.append(_chain(CORRECTED, shape, corrected))
    return tuple(predictions)


def _constant_curvature(shape: MeasuredShape, arm: Arm) -> Prediction:
    angles, aimed, needed = np.zeros(len(arm.segments)), np.zeros(len(arm.segments)), []
    for step in shape.steps:
        assert step.segment is not None  # in the plane
        angles[step.segment] = 0.0
        others = constant_curvature.pulls(arm, angles.tolist())
        angles[step.segment] = _arc_angle(arm, step, others)
        aimed[step.segment] = step.angle if np.isfinite(step.angle) else angles[step.segment]
        tendon = RIGHT if aimed[step.segment] > 0.0 else LEFT
        needed.append((tendon, constant_curvature.pulls(arm, aimed.tolist())[tendon])
                      if np.isfinite(step.angle) else None)
    slack = tuple(step.pulls == (SLACK, SLACK) for step in shape.steps)
    return Prediction(CONSTANT_CURVATURE, shape,
                      constant_curvature.poses(arm, angles.tolist()), slack, False, tuple(needed))


def _arcs_in_space(shape: MeasuredShape, arm: SpatialArm) -> Prediction:
    """Return arcs with the pulls of the tendons; straight ones where these say too little."""
    bending = np.zeros((len(arm.segments), 2))
    for step in shape.steps:
        soft = step.soft(len(arm.segments))
        bending[list(soft)] = 0.0
        with suppress(ArmError):
            bending = in_space.bending(
                arm, [pull if pull > SLACK else np.nan for pull in step.pulls], bending, soft)
    slack = tuple(set(step.pulls) == {SLACK} for step in shape.steps)
    return Prediction(CONSTANT_CURVATURE, shape, in_space.poses(arm, bending)[0], slack, False,
                      (None,) * len(shape.steps))


def _arc_angle(arm: Arm, step: Step, others: tuple[float, float]) -> float:
    """Return the smallest bending angle (rad) that the tendons of a step allow."""
    assert step.segment is not None  # in the plane
    segment = arm.segments[step.segment]
    limit = segment.bending_angle_limit
    bounds = []
    for tendon, sign in ((RIGHT, 1.0), (LEFT, -1.0)):
        pull = step.pulls[tendon] - others[tendon]
        try:
            angle = constant_curvature.bending_angle(segment, pull) if pull != -np.inf else -limit
        except ArmError:  # paid out or pulled in beyond the limit
            angle = -limit if pull < 0.0 else limit
        bounds.append(sign * angle)
    least, most = bounds
    return float(np.clip(0.0, least, most)) if least <= most else 0.5 * (least + most)


def _chain(model: str, shape: MeasuredShape, arm: AnyArm) -> Prediction:
    statics = statics_of(loaded(arm, shape))
    try:
        states = simulate_steps(statics, shape.steps, shape.name)
    except StaticsError as error:
        raise StaticsError(f'{model}: {error}', error.state) from None
    return Prediction(
        model, shape, states[-1].points,
        tuple(not np.any(np.nan_to_num(state.tensions) > 0.0) for state in states),
        any(state.jumped for state in states),
        _needed(statics, shape) if isinstance(statics, Statics) else (None,) * len(states))


def _needed(statics: Statics, shape: MeasuredShape) -> tuple[tuple[int, float] | None, ...]:
    """Return tendon and pull for the angle of each step, as far as a tendon holds it there."""
    state, needed = statics.chain.straight(), []
    for step in shape.steps:
        if step.segment is None or not np.isfinite(step.angle):
            break
        try:
            state = statics.bend(state, step.segment, step.angle)
        except StaticsError:
            break
        tendon = RIGHT if state.tensions[RIGHT] >= state.tensions[LEFT] else LEFT
        needed.append((tendon, float(statics.commanded_pulls(state)[tendon])))
    return (*needed, *[None] * (len(shape.steps) - len(needed)))
