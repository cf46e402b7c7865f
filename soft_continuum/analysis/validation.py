# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Models against measured shapes: constant curvature, chain, chain under gravity (paper, V, Fig. 5).

Every model gets the pulls of the rig.  Errors are distances between calculation points; the base
disc, which is fixed, is excluded.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from soft_continuum.analysis.measured_shapes import MeasuredShape, simulate_steps, Step
from soft_continuum.analysis.results import progress
from soft_continuum.mechanics import (
    Arm,
    ArmError,
    constant_curvature,
    SLACK,
    Statics,
    StaticsError,
)
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.directions import hinged

CONSTANT_CURVATURE = 'constant curvature'
WITHOUT_GRAVITY = 'chain, no gravity'
WITH_GRAVITY = 'chain, gravity'
CORRECTED = 'chain, gravity, corrected'


@dataclass(frozen=True, eq=False)
class Prediction:
    """
    One shape by one model.

    points: (2 * discs, 3), m.  slack: for each step, whether no tendon was taut at its end.
    jumped: whether the arm snapped to another equilibrium on the way.  needed: for each step,
    tendon and pull (m) that bend the segment to the commanded angle; None if no angle was given,
    no tendon can, or an angle does not determine the bending.
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
        return self.shape.errors(self.points)

    @property
    def relative_errors(self) -> Array:
        """Errors over the distance of the measured point from the base."""
        from_base: Array = self.shape.errors(np.zeros_like(self.points))
        return self.errors / from_base

    @property
    def segments(self) -> list[int]:
        """Segment (0-based) of each error: the one below the disc."""
        return [self.shape.numbers[row] // 2 - 1 for row in self.shape.moving]


def predict(shapes: Sequence[MeasuredShape], arm: Arm, corrected: Arm | None = None
            ) -> tuple[Prediction, ...]:
    """
    Return the results of each model for each shape, shape by shape.

    corrected: the arm with measured stiffness.  Raises StaticsError naming model, shape and step.
    """
    predictions = []
    for shape in progress(shapes, 'shapes'):
        predictions.append(_constant_curvature(shape, arm))
        predictions.append(_chain(WITHOUT_GRAVITY, shape, arm.without_gravity()))
        predictions.append(_chain(WITH_GRAVITY, shape, arm))
        if corrected is not None:
            predictions.append(_chain(CORRECTED, shape, corrected))
    return tuple(predictions)


def _constant_curvature(shape: MeasuredShape, arm: Arm) -> Prediction:
    """Return arcs for the pulls of the tendons; straight if these do not determine them."""
    bending = np.zeros((len(arm.segments), 2))
    aimed, needed = bending.copy(), []
    for step in shape.steps:
        soft = np.array(step.soft(len(arm.segments)))
        bending[soft] = aimed[soft] = 0.0
        with suppress(ArmError):
            bending = constant_curvature.bending(arm, step.pulls, bending, soft.tolist())
        before = constant_curvature.pulls(arm, aimed)
        wanted = _wanted(arm, step)
        aimed[soft] = bending[soft] if wanted is None else wanted[soft]
        pulls = constant_curvature.pulls(arm, aimed)
        most = len(pulls) - 1 - int(np.argmax((pulls - before)[::-1]))
        needed.append(None if wanted is None else (most, float(pulls[most])))
    slack = tuple(set(step.pulls) == {SLACK} for step in shape.steps)
    return Prediction(CONSTANT_CURVATURE, shape, constant_curvature.poses(arm, bending)[0], slack,
                      False, tuple(needed))


def _wanted(arm: Arm, step: Step) -> Array | None:
    """Return the bending (segments, 2), rad, of the commanded angle, if it determines one."""
    if step.segment is None or not np.isfinite(step.angle) or not hinged(arm):
        return None
    wanted = np.zeros((len(arm.segments), 2))
    wanted[step.segment] = step.angle * arm.bending_axes[step.segment]
    return wanted


def _chain(model: str, shape: MeasuredShape, arm: Arm) -> Prediction:
    statics: Statics = Statics(replace(arm, payload=arm.payload + shape.payload))
    try:
        states = simulate_steps(statics, shape.steps, shape.name)
    except StaticsError as error:
        raise StaticsError(f'{model}: {error}', error.state) from None
    return Prediction(
        model, shape, states[-1].poses[:, :3],
        tuple(not np.any(np.nan_to_num(state.tensions) > 0.0) for state in states),
        any(state.jumped for state in states),
        _needed(statics, shape))


def _needed(statics: Statics, shape: MeasuredShape) -> tuple[tuple[int, float] | None, ...]:
    """Return tendon and pull for the angle of each step, if a tendon holds it there."""
    state, needed = statics.chain.straight(), []
    for step in shape.steps:
        wanted = _wanted(statics.chain.arm, step)
        if wanted is None:
            break
        try:
            state = statics.hold(state, wanted, step.soft(len(wanted))).state
        except StaticsError:
            break
        most = int(np.argmax(state.tensions))
        needed.append((most, float(statics.commanded_pulls(state)[most])))
    return (*needed, *[None] * (len(shape.steps) - len(needed)))
