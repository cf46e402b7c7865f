# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What could be wrong with an arm, how each of it would move what is measured, and how likely."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from math import log, pi

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from soft_continuum.estimation.commands import Commands
from soft_continuum.estimation.dimensions import disc_rows, PLANE
from soft_continuum.estimation.estimator import Estimator
from soft_continuum.estimation.measuring import (
    DiscMeasurement,
    Point,
    predicted,
    relative_distance,
)
from soft_continuum.estimation.unknowns import Layout
from soft_continuum.mechanics.arm import PointForce
from soft_continuum.mechanics.chain import Array, Equilibrium
from soft_continuum.mechanics.sensitivity import Linearisation
from soft_continuum.mechanics.statics import Statics, StaticsError

LONGER = (-1.5e-3, -2.5e-3, -4e-3, -6.5e-3)
OFFSETS = (*LONGER, 1.5e-3, 2.5e-3, 4e-3)
"""m by which a tendon is shorter than its motor says; each stands for those nearest to it."""
PART = 0.25  # deviation of what happened, as a part of such a step
FORCE = 0.5  # N: deviation of a load
SHIFT, TURN = 5e-3, 0.1  # m, rad: of a sensor or camera
LOAD_STEPS = (1.0, 1.0, 0.5, 0.5)  # towards a load
FOUND = 0.3  # part by which it may still differ
UNMOVED = 0.3  # part of the squared distance that a load may leave
YIELDING = 1.0  # deviation of what a jam gives way by, as a part of what it is bent by
GIVEN = 0.3  # deviation of the way that a leaking segment gives, as a part of it
BLUR = 0.15  # of a displacement: how well the statics know what a fault does
UNEVEN = 0.3  # of it, as a part of that


class Cause(Enum):
    """What is wrong: the values of Anomaly.msg."""

    UNKNOWN = 0
    TENDON_SLIPPED = 1
    STEPS_LOST = 2
    NOT_STIFF = 3
    NOT_SOFT = 4
    LOAD = 5
    SENSOR_MOVED = 6
    CAMERA_MOVED = 7


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """
    Something that could be wrong, and by how much it would displace what is measured.

    number: segment or disc as in topic names, or which tendon (0-based).  point: what is measured,
    less what it is with no fault.  expected: (k,) of these values, m and rad.  directions: (k, n)
    of them for deviations of size 1 of n sizes that are not known.  unit: of the first sizes, m,
    rad or N for each of them that is 1.  step: m by which a tendon is shorter as expected.  blur:
    part of a displacement by which it may differ from this pattern.  covariance: (k, k) of what
    is measured, were it so.
    """

    cause: Cause
    number: int
    point: Point
    expected: Array
    directions: Array
    covariance: Array
    unit: float = 0.0
    step: float = 0.0
    blur: float = BLUR


@dataclass(frozen=True, eq=False)
class Verdict:
    """
    How well a hypothesis explains what was measured.

    likelihood: its logarithm.  sizes: (n,) of the hypothesis.  displacement: (k,) m and rad, what
    it explains.  left: what it does not, as squared Mahalanobis distance over its expected value.
    """

    hypothesis: Hypothesis
    likelihood: float
    sizes: Array
    displacement: Array
    left: float

    @property
    def size(self) -> float:
        """What the message says: m longer for a tendon, or m, N."""
        one = self.hypothesis
        if one.step:
            return -one.step * (1.0 + PART * float(self.sizes[0]))
        return one.unit * float(np.linalg.norm(self.sizes[:2]))


def log_likelihood(values: Array, covariance: Array) -> float:
    """Return the logarithm of the density of a normal distribution about 0."""
    found = -0.5 * (values @ cho_solve(cho_factor(covariance), values)
                    + np.linalg.slogdet(covariance)[1] + len(values) * log(2.0 * pi))
    return float(found)


def judge(one: Hypothesis) -> Verdict:
    """Return how well a hypothesis explains what is measured."""
    point = one.point
    away, rows, covariance = point.values - one.expected, one.directions, one.covariance
    weighted = cho_solve(cho_factor(covariance), rows).T
    sizes = np.linalg.solve(weighted @ rows + np.eye(rows.shape[1]), weighted @ away)
    moved = one.expected + rows @ sizes
    blurred = covariance + _blur(one, moved)
    rest = point.values - moved
    return Verdict(one, log_likelihood(away, blurred + rows @ rows.T), sizes, moved,
                   relative_distance(rest, blurred))


def _blur(one: Hypothesis, moved: Array) -> Array:
    """
    Return the covariance (k, k) of what the statics do not know of a displacement (k,).

    They know how it bends each segment to a part of that, and evenly along it to a smaller one.
    """
    point = one.point
    chain = point.statics.chain
    evenly = np.repeat(np.eye(chain.segments), chain.joints_per_segment, axis=0)
    turning = _measured(point, disc_rows(
        chain, point.state.joint_angles, evenly / chain.joints_per_segment))
    bends = np.linalg.lstsq(turning, moved, rcond=None)[0]
    bent = turning * bends
    uneven = np.maximum(np.abs(moved - bent.sum(axis=1)), UNEVEN * _extent(moved, point))
    return np.asarray(one.blur**2 * (bent @ bent.T + np.diag(uneven**2)))


def _extent(moved: Array, point: Point) -> Array:
    """Return for every value how far its disc is displaced (m), or turned (rad), (k,)."""
    found = np.abs(moved)
    for disc in np.unique(point.discs):
        along = (point.discs == disc) & (point.coordinates < 2)
        found[along] = np.linalg.norm(moved[along])
    return found


def hypotheses(point: Point, commands: Commands, reference: Estimator, in_motion: bool
               ) -> list[Hypothesis]:
    """
    Return all that could be wrong, but for segments that are not as they are reported.

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
            PART * step * rows[:, layout.offset.start + tendon], _yielding(other, rows)])
        return Hypothesis(
            Cause.TENDON_SLIPPED, tendon, point, _displaced(point, other), directions,
            rows @ reference.covariance @ rows.T + point.noise, step=step)

    for tendon in range(layout.tendons):
        for step in OFFSETS if in_motion else LONGER:
            if state.taut[tendon] or step > 0.0:
                with suppress(StaticsError):
                    found.append(slipped(tendon, step))
    for segment in range(layout.segments):
        found += loads(point, commands, reference, segment + 1)
    poses = state.points[::2]
    for disc in np.unique(point.discs).tolist():
        free = (point.discs == disc)[:, None] * np.eye(PLANE.pose)[point.coordinates]
        found.append(Hypothesis(Cause.SENSOR_MOVED, disc, point, nothing,
                                free * (SHIFT, SHIFT, TURN), covariance, SHIFT, blur=0.0))
    found.append(Hypothesis(Cause.CAMERA_MOVED, 0, point, nothing, _measured(
        point, camera_directions(poses)) * (SHIFT, SHIFT, TURN), covariance, SHIFT, blur=0.0))
    return found


def loads(point: Point, commands: Commands, reference: Estimator, disc: int
          ) -> list[Hypothesis]:
    """
    Return forces on a disc: linearised where they explain most, for a tendon may become slack.

    The arguments are those of ``hypotheses``.
    """
    state, arm, found = point.state, point.statics.chain.arm, []
    pulls = commands.pulls + point.unknowns[reference.layout.offset]
    covariance = point.covariance(reference.covariance)

    def about(statics: Statics, there: Equilibrium, force: Array) -> Hypothesis:
        """Return that of forces near one with which the arm has another shape."""
        rates = Linearisation(statics, there, commands.sliding).forces().joint_angles
        pushed = FORCE * _measured(point, disc_rows(
            statics.chain, there.joint_angles, rates[:, 2 * disc - 2:2 * disc]))
        rows = _rows_at(point, statics, there, reference.layout, commands)
        return Hypothesis(
            Cause.LOAD, disc, point, _displaced(point, there) - pushed @ force / FORCE,
            pushed, rows @ reference.covariance @ rows.T + point.noise, FORCE)

    for tensions in (state.tensions, np.zeros_like(state.tensions)):
        one = about(point.statics, replace(state, tensions=tensions), np.zeros(2))
        force = FORCE * judge(one).sizes
        with suppress(StaticsError):
            for part in LOAD_STEPS:
                statics = Statics(replace(arm, forces=(
                    *arm.forces, PointForce(disc, *force.tolist()))))
                one = about(statics, statics.solve(
                    replace(state, chain=statics.chain), pulls,
                    [not stiff for stiff in state.stiff], vacuum=state.vacuum or None,
                    sliding=commands.sliding), force)
                verdict = judge(one)
                change = FORCE * verdict.sizes - force
                force = force + part * change
            # With a slack tendon anything is likely: the load itself has to move the arm so.
            rest = relative_distance(point.values - verdict.displacement, covariance)
            size = float(np.linalg.norm(force))
            if (float(np.linalg.norm(change)) < FOUND * max(FORCE, size)
                    and rest < UNMOVED * relative_distance(point.values, covariance)):
                found.append(one)
    return found


def otherwise(cause: Cause, segment: int, point: Point, other: Estimator,
              discs: Sequence[DiscMeasurement]) -> Hypothesis:
    """
    Return that a segment is not as stiff, or as soft, as reported.

    segment: as in topic names.  point: of the reference.  other: the estimate that took it to be
    so.  discs: what is measured.
    """
    there = other.expected(discs)
    moved = point.values - there.values
    if cause is Cause.NOT_SOFT:
        return Hypothesis(cause, segment, point, moved, _yielding(there.state, there.rows),
                          there.covariance(other.covariance))
    return Hypothesis(cause, segment, point, moved, GIVEN * moved[:, None],
                      there.covariance(other.covariance))


def _yielding(state: Equilibrium, rows: Array) -> Array:
    """
    Return by how much more what bends a stiff segment may bend it: (k, segments) m and rad.

    Tendons that pull against jams bend them by an amount that is hardly known, and they yield.
    """
    bent = (state.joint_angles - state.held_angles).reshape(len(state.stiff), -1).sum(axis=1)
    return np.asarray(YIELDING * bent * state.stiff * rows[:, :len(bent)])


def _measured(point: Point, of_discs: Array) -> Array:
    """Return those that are measured, of (discs, 3, n) or (discs, 3)."""
    picked: Array = of_discs[point.discs, point.coordinates]
    return picked


def _displaced(point: Point, other: Equilibrium) -> Array:
    """Return by how much a shape displaces what is measured, (k,) m and rad."""
    return _measured(point, other.points[::2] - point.state.points[::2])


def _rows_at(point: Point, statics: Statics, other: Equilibrium, layout: Layout,
             commands: Commands) -> Array:
    """Return the rows of a point (k, size) as they are in another shape."""
    rows = point.rows.copy()
    rows[:, :layout.model] = _measured(point, predicted(
        statics, layout, other, commands.sliding).pose_rows)[:, :layout.model]
    return rows


def camera_directions(poses: Array) -> Array:
    """Return how poses (n, 3) are seen displaced by a camera that moved, (n, 3, 3)."""
    found = np.tile(np.eye(PLANE.pose), (len(poses), 1, 1))
    found[:, 0, 2], found[:, 1, 2] = poses[:, 1], -poses[:, 0]
    return found
