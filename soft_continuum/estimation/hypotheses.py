# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Fault hypotheses for an arm: predicted displacements and their likelihoods."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import auto, Enum
from math import log, pi
from typing import Any

import numpy as np
import scipy

from soft_continuum.estimation.discs import bent_evenly, camera_moved, pose_error
from soft_continuum.estimation.estimator import Estimator
from soft_continuum.estimation.measuring import (
    ActuatorState,
    DiscMeasurement,
    LinearisationPoint,
    predicted,
    relative_distance,
)
from soft_continuum.estimation.unknowns import UnknownIndices
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.mechanics.sensitivity import Linearisation
from soft_continuum.mechanics.statics import Statics

LONGER = (-1.5e-3, -2.5e-3, -4e-3, -6.5e-3)
OFFSETS = (*LONGER, 1.5e-3, 2.5e-3, 4e-3)
"""m by which a tendon may be shorter than its motor reports; each covers nearby values."""
PART = 0.25  # deviation of what happened, as a part of such a step
FORCE = 0.5  # N: deviation of a load
SHIFT, TURN = 5e-3, 0.1  # m, rad: of a sensor or camera
SENSOR_SCALES = np.repeat([SHIFT, TURN], 3)
LOAD_STEPS = (1.0, 1.0, 0.5, 0.5)  # towards a load
FOUND = 0.3  # part by which it may still differ
UNMOVED = 0.3  # part of the squared distance that a load may leave
YIELDING = 1.0  # deviation of what a jam gives way by, as a part of what it is bent by
GIVEN = 0.3  # deviation of the way that a leaking segment gives, as a part of it
BLUR = 0.15  # of a displacement: how well the statics know what a fault does
UNEVEN = 0.3  # of it, as a part of that


class Cause(Enum):
    """Causes of anomalies, named as in Anomaly.cause."""

    UNKNOWN = auto()
    TENDON_SLIPPED = auto()
    STEPS_LOST = auto()
    NOT_STIFF = auto()
    NOT_SOFT = auto()
    LOAD = auto()
    SENSOR_MOVED = auto()
    CAMERA_MOVED = auto()


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """
    A possible fault, and the displacement of measurements that it would cause.

    number: segment or disc as in topic names, or tendon (0-based).  point: measurements less their
    values without a fault.  expected: (k,) of these values, m and rad.  directions: (k, n), their
    change per standard deviation of n unknown sizes.  unit: m, rad or N per unit of the first
    sizes.  step: m, assumed shortening of a tendon.  blur: relative error of the displacement
    pattern.  covariance: (k, k) of the measurements under this hypothesis.
    """

    cause: Cause
    number: int
    point: LinearisationPoint
    expected: Array
    directions: Array
    covariance: Array
    unit: float = 0.0
    step: float = 0.0
    blur: float = BLUR


@dataclass(frozen=True, eq=False)
class Verdict:
    """
    How well a hypothesis explains the measurements.

    likelihood: its logarithm.  sizes: (n,) of the hypothesis.  displacement: (k,) m and rad,
    explained.  left: unexplained, as squared Mahalanobis distance over its expected value.
    """

    hypothesis: Hypothesis
    likelihood: float
    sizes: Array
    displacement: Array
    left: float

    @property
    def size(self) -> float:
        """Size for the message: m longer for a tendon, or m, N."""
        one = self.hypothesis
        if one.step:
            return -one.step * (1.0 + PART * float(self.sizes[0]))
        return one.unit * float(np.linalg.norm(self.sizes[:3]))


def log_likelihood(values: Array, covariance: Array) -> float:
    """Return the logarithm of the density of a normal distribution about 0."""
    factor = scipy.linalg.cho_factor(covariance)
    found = -0.5 * (values @ scipy.linalg.cho_solve(factor, values)
                    + np.linalg.slogdet(covariance)[1] + len(values) * log(2.0 * pi))
    return float(found)


def judge(one: Hypothesis) -> Verdict:
    """Return how well a hypothesis explains the measurements."""
    point = one.point
    away, rows, covariance = point.values - one.expected, one.directions, one.covariance
    weighted = scipy.linalg.cho_solve(scipy.linalg.cho_factor(covariance), rows).T
    sizes = np.linalg.solve(weighted @ rows + np.eye(rows.shape[1]), weighted @ away)
    moved = one.expected + rows @ sizes
    blurred = covariance + _blur(one, moved)
    rest = point.values - moved
    return Verdict(one, log_likelihood(away, blurred + rows @ rows.T), sizes, moved,
                   relative_distance(rest, blurred))


def _blur(one: Hypothesis, moved: Array) -> Array:
    """
    Return the covariance (k, k) of model errors for a displacement (k,).

    The bending of each segment has a relative error, its distribution along it a smaller one.
    """
    point = one.point
    turning = point.measured(bent_evenly(point.state))
    bends = np.linalg.lstsq(turning, moved, rcond=None)[0]
    bent = turning * bends
    uneven = np.maximum(np.abs(moved - bent.sum(axis=1)), UNEVEN * _extent(moved, one))
    return np.asarray(one.blur**2 * (bent @ bent.T + np.diag(uneven**2)))


def _extent(moved: Array, one: Hypothesis) -> Array:
    """Return for every value the displacement (m) or turn (rad) of its disc, (k,)."""
    found, discs = np.abs(moved), one.point.discs
    is_shift = one.point.parts[:, :3].any(axis=1)
    for disc in np.unique(discs):
        for alike in (is_shift, ~is_shift):
            of_disc = (discs == disc) & alike
            found[of_disc] = np.linalg.norm(moved[of_disc])
    return found


def hypotheses(point: LinearisationPoint, commands: ActuatorState, reference: Estimator,
               in_motion: bool) -> list[Hypothesis]:
    """
    Return all hypotheses except wrongly reported segments.

    point: of the reference, with these commands.  in_motion: whether the motors moved since.
    """
    state, statics, layout = point.state, point.statics, reference.layout
    pulled = commands.pulls + point.unknowns[layout.offset]
    covariance, nothing = point.covariance(reference.covariance), np.zeros(len(point.values))
    found = []

    def slipped(tendon: int, step: float) -> Hypothesis:
        """Return that of another shape, in which other unknowns may count."""
        other = statics.solve(
            state, pulled + step * np.eye(layout.tendons)[tendon],
            [not stiff for stiff in state.stiff], vacuum=state.vacuum or None,
            sliding=commands.sliding)
        rows = _rows_at(point, statics, other, layout, commands)
        directions = np.column_stack([
            PART * step * rows[:, layout.offset.start + tendon], _yielding(other, rows, layout)])
        return Hypothesis(
            Cause.TENDON_SLIPPED, tendon, point, point.measured(pose_error(other, point.state)),
            directions, rows @ reference.covariance @ rows.T + point.noise, step=step)

    for tendon in range(layout.tendons):
        for step in OFFSETS if in_motion else LONGER:
            if state.taut[tendon] or step > 0.0:
                with suppress(StaticsError):
                    found.append(slipped(tendon, step))
    for segment in range(layout.segments):
        found += loads(point, commands, reference, segment + 1)
    for disc in np.unique(point.discs).tolist():
        free = (point.discs == disc)[:, None] * point.parts
        found.append(Hypothesis(Cause.SENSOR_MOVED, disc, point, nothing, free * SENSOR_SCALES,
                                covariance, SHIFT, blur=0.0))
    if len(np.unique(point.discs)) > 1:  # one disc alone cannot show this
        moved = point.measured(camera_moved(state)) * SENSOR_SCALES
        found.append(Hypothesis(Cause.CAMERA_MOVED, 0, point, nothing, moved, covariance, SHIFT,
                                blur=0.0))
    return found


def loads(point: LinearisationPoint, commands: ActuatorState, reference: Estimator, disc: int
          ) -> list[Hypothesis]:
    """
    Return hypotheses of forces on a disc, linearised at their best fit: tendons may become slack.

    The arguments are those of ``hypotheses``.
    """
    state, arm, found = point.state, point.statics.chain.arm, []
    pulls = commands.pulls + point.unknowns[reference.layout.offset]
    covariance = point.covariance(reference.covariance)

    def about(statics: Any, there: Any, force: Array) -> Hypothesis:
        """Return that of forces near one with which the arm has another shape."""
        forces = Linearisation(statics, there, commands.sliding).forces()
        pushed = FORCE * point.measured(forces.poses[:, :, 3 * disc - 3:3 * disc])
        rows = _rows_at(point, statics, there, reference.layout, commands)
        return Hypothesis(
            Cause.LOAD, disc, point,
            point.measured(pose_error(there, point.state)) - pushed @ force / FORCE, pushed,
            rows @ reference.covariance @ rows.T + point.noise, FORCE)

    for tensions in (state.tensions, np.zeros_like(state.tensions)):
        one = about(point.statics, replace(state, tensions=tensions), np.zeros(3))
        force = FORCE * judge(one).sizes
        with suppress(StaticsError):
            for part in LOAD_STEPS:
                statics: Any = Statics(arm.with_force(disc, force))
                one = about(statics, statics.solve(
                    replace(state, chain=statics.chain), pulls,
                    [not stiff for stiff in state.stiff], vacuum=state.vacuum or None,
                    sliding=commands.sliding), force)
                verdict = judge(one)
                change = FORCE * verdict.sizes - force
                force = force + part * change
            # With a slack tendon all sizes are likely: the load itself must explain the motion.
            rest = relative_distance(point.values - verdict.displacement, covariance)
            size = float(np.linalg.norm(force))
            if (float(np.linalg.norm(change)) < FOUND * max(FORCE, size)
                    and rest < UNMOVED * relative_distance(point.values, covariance)):
                found.append(one)
    return found


def otherwise(cause: Cause, segment: int, point: LinearisationPoint, other: Estimator,
              discs: Sequence[DiscMeasurement]) -> Hypothesis:
    """
    Return the hypothesis that a segment is not as stiff, or as soft, as reported.

    segment: as in topic names.  point: of the reference.  other: the estimate that assumes it.
    discs: the measurements.
    """
    there, layout = other.expected(discs), other.layout
    moved = point.values - there.values
    directions = (_yielding(there.state, there.rows, layout) if cause is Cause.NOT_SOFT
                  else GIVEN * moved[:, None])
    return Hypothesis(cause, segment, point, moved, directions,
                      there.covariance(other.covariance))


def _yielding(state: Any, rows: Array, layout: UnknownIndices) -> Array:
    """
    Return the uncertainty of the bending of stiff segments under load, m and rad.

    Shape (k, 2 * segments).  How far tendons bend jams is poorly known, and jams yield.
    """
    bent = state.jam_deflection * np.array(state.stiff)[:, None]
    return np.asarray(YIELDING * bent.ravel() * rows[:, layout.held])


def _rows_at(point: LinearisationPoint, statics: Any, other: Any, layout: UnknownIndices,
             commands: ActuatorState) -> Array:
    """Return the rows (k, size) of a point for another shape."""
    rows = point.rows.copy()
    rows[:, :layout.model] = point.measured(predicted(
        statics, layout, other, commands.sliding).rates.poses)[:, :layout.model]
    return rows
