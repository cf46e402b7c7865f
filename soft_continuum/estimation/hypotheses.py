# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What could be wrong with an arm, how each of it would move what is measured, and how likely."""

from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from math import log, pi

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from soft_continuum.estimation.commands import Commands
from soft_continuum.estimation.estimator import Estimator
from soft_continuum.estimation.measuring import (
    disc_poses,
    Point,
    predicted,
    relative_distance,
)
from soft_continuum.estimation.unknowns import POSE
from soft_continuum.mechanics.chain import Array, Equilibrium
from soft_continuum.mechanics.sensitivity import Linearisation
from soft_continuum.mechanics.statics import StaticsError

LONGER = (-1.5e-3, -2.5e-3, -4e-3, -6.5e-3)
OFFSETS = (*LONGER, 1.5e-3, 2.5e-3, 4e-3)
"""m by which a tendon is shorter than its motor says; each stands for those nearest to it."""
PART = 0.25  # deviation of what happened, as a part of such a step
HELD, FORCE = 0.3, 0.5  # rad, N: deviations of what a segment gives way by, and of a load
SHIFT, TURN = 5e-3, 0.1  # m, rad: of a sensor or camera
BLUR = 0.15  # of a displacement: how well the statics know what a fault does


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

    number: segment or disc as in topic names, or which tendon (0-based).  expected: (k,) m and
    rad.  directions: (k, n) of it for deviations of size 1 of n sizes that are not known.  unit:
    of the first sizes, m, rad or N for each of them that is 1.  step: m by which a tendon is
    shorter as expected.  blur: part of a displacement by which it may differ from this pattern.
    covariance: (k, k) of what is measured, were it so.
    """

    cause: Cause
    number: int
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


def judge(one: Hypothesis, point: Point) -> Verdict:
    """Return how well a hypothesis explains what is measured."""
    away, rows, covariance = point.values - one.expected, one.directions, one.covariance
    weighted = cho_solve(cho_factor(covariance), rows).T
    sizes = np.linalg.solve(weighted @ rows + np.eye(rows.shape[1]), weighted @ away)
    moved = one.expected + rows @ sizes
    blurred = covariance + np.diag((one.blur * _extent(moved, point))**2)
    rest = point.values - moved
    return Verdict(one, log_likelihood(away, blurred + rows @ rows.T), sizes, moved,
                   relative_distance(rest, blurred))


def _extent(moved: Array, point: Point) -> Array:
    """Return for every value how far its disc is displaced (m), or turned (rad), (k,)."""
    found = np.abs(moved)
    for disc in np.unique(point.discs):
        along = (point.discs == disc) & (point.coordinates < 2)
        found[along] = np.linalg.norm(moved[along])
    return found


def hypotheses(point: Point, commands: Commands, reference: Estimator,
               switched: tuple[int, Equilibrium] | None, in_motion: bool) -> list[Hypothesis]:
    """
    Return all that could be wrong.

    point: of the reference, with these commands.  switched: the segment (0-based) that became
    soft last, and the shape before.  in_motion: whether the motors moved since.
    """
    state, statics, rows, layout = point.state, point.statics, point.rows, reference.layout
    covariance = point.covariance(reference.covariance)
    soft = [not one for one in state.stiff]
    pulled, sliding = commands.pulls + point.unknowns[layout.offset], commands.sliding
    poses = state.points[::2]
    found = []

    def values(of_discs: Array) -> Array:
        """Return those that are measured, of (discs, 3, n)."""
        picked: Array = of_discs[point.discs, point.coordinates]
        return picked

    def displaced(other: Equilibrium) -> Array:
        return values(other.points[::2] - poses)

    def instead(cause: Cause, number: int, other: Equilibrium) -> Hypothesis:
        """Return that of another shape, in which other unknowns may count."""
        there = rows.copy()
        there[:, :layout.model] = values(predicted(
            statics, layout, other, sliding).pose_rows)[:, :layout.model]
        return Hypothesis(cause, number, displaced(other), np.zeros((len(point.values), 0)),
                          there @ reference.covariance @ there.T + point.noise)

    for tendon in range(layout.tendons):
        column = rows[:, layout.offset.start + tendon]
        for step in OFFSETS if in_motion else LONGER:
            moved = step * column
            if state.taut[tendon] == (step < 0.0):
                # Where it becomes slack or taut, the shape is not linear in it.
                with suppress(StaticsError):
                    moved = displaced(statics.solve(
                        state, pulled + step * np.eye(layout.tendons)[tendon], soft,
                        vacuum=state.vacuum or None, sliding=sliding))
            found.append(Hypothesis(Cause.TENDON_SLIPPED, tendon, moved,
                                    PART * moved[:, None], covariance, step=step))
    nothing = np.zeros(len(point.values))
    # A load may slacken the tendons.
    forces = [values(disc_poses(statics.chain, state.joint_angles, Linearisation(
        statics, replace(state, tensions=tensions), sliding).forces().joint_angles)[1])
              for tensions in (state.tensions, np.zeros(layout.tendons))]
    for segment in range(layout.segments):
        if state.stiff[segment]:
            found.append(Hypothesis(Cause.NOT_STIFF, segment + 1, nothing,
                                    HELD * rows[:, [segment]], covariance))
            with suppress(StaticsError):
                found.append(instead(Cause.NOT_STIFF, segment + 1, statics.solve(
                    state, pulled, [one or n == segment for n, one in enumerate(soft)],
                    vacuum=state.vacuum or None, sliding=sliding)))
        found += [Hypothesis(Cause.LOAD, segment + 1, nothing,
                             FORCE * force[:, 2 * segment:2 * segment + 2], covariance, FORCE)
                  for force in forces]
    if switched is not None:
        number, before = switched
        with suppress(StaticsError):
            found.append(instead(Cause.NOT_SOFT, number + 1, statics.solve(
                replace(before, chain=statics.chain), pulled,
                [one and n != number for n, one in enumerate(soft)],
                vacuum=before.vacuum or None, sliding=sliding)))
    for disc in np.unique(point.discs).tolist():
        free = (point.discs == disc)[:, None] * np.eye(POSE)[point.coordinates]
        found.append(Hypothesis(Cause.SENSOR_MOVED, disc, nothing, free * (SHIFT, SHIFT, TURN),
                                covariance, SHIFT, blur=0.0))
    found.append(Hypothesis(Cause.CAMERA_MOVED, 0, nothing, values(
        camera_directions(poses)) * (SHIFT, SHIFT, TURN), covariance, SHIFT, blur=0.0))
    return found


def camera_directions(poses: Array) -> Array:
    """Return how poses (n, 3) are seen displaced by a camera that moved, (n, 3, 3)."""
    found = np.tile(np.eye(POSE), (len(poses), 1, 1))
    found[:, 0, 2], found[:, 1, 2] = poses[:, 1], -poses[:, 0]
    return found
