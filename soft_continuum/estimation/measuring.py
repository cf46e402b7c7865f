# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is measured of an arm, and how that changes with what is not known of the arm."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import hypot

import numpy as np
from numpy.typing import NDArray

from soft_continuum.estimation.unknowns import Layout, POSE
from soft_continuum.mechanics.chain import Array, Equilibrium, RigidChain
from soft_continuum.mechanics.joints import wrapped
from soft_continuum.mechanics.sensitivity import Linearisation
from soft_continuum.mechanics.statics import Statics

MAX_VARIANCE = 1.0  # m^2 or rad^2, from which a coordinate counts as not measured
MODEL_ERROR = np.diag([3e-4, 3e-4, 3e-3])**2
"""Covariance of a disc's pose (m, rad) for what no unknown of the model can explain."""
GATES = (15.1, 18.4, 21.1, 23.5, 25.7, 27.9, 29.9, 31.8, 33.7, 35.6, 37.4, 39.1, 40.9)
"""Squared distances of 1 and more values that one in 10,000 exceeds: chi2."""
CARRIES = 3.0  # deviations of a tension, beyond which the tendon is not slack
FORETOLD = 1e-6  # squared distance over its expected value, by which derivatives may be wrong


@dataclass(frozen=True, eq=False)
class Predicted:
    """
    What the statics have at the time of a measurement, and how it changes with the unknowns.

    layout: of the unknowns.  poses: (discs, 3) of the discs' bottoms, m and rad.  tensions:
    (tendons,) N; a slack tendon has the tension below 0 by which it would have to push to become
    so short.  The derivatives cost more, and are found when they are asked for.
    """

    statics: Statics
    layout: Layout
    state: Equilibrium
    sliding: Sequence[int]
    poses: Array
    tensions: Array

    @cached_property
    def pose_rows(self) -> Array:
        """Derivatives of the poses, (discs, 3, size)."""
        return disc_poses(self.statics.chain, self.state.joint_angles,
                          self._rates.joint_angles)[1]

    @property
    def tension_rows(self) -> Array:
        """Derivatives of the tensions, (tendons, size)."""
        return self._rates.tensions

    @cached_property
    def _rates(self) -> 'Rates':
        return rates(self.statics, self.layout, self.state, self.sliding)


@dataclass(frozen=True, eq=False)
class Observation:
    """
    How k measured values depend on the unknowns.

    biases: (k,) where in the unknowns stands what is wrong alike in all such measurements.  rows:
    (k, size) derivatives of what is predicted.  covariance: (k, k) of sensor and model.
    """

    biases: NDArray[np.intp]
    rows: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class DiscMeasurement:
    """
    A measured pose of a disc's bottom.

    disc: 0 at the base.  pose: (x, z, angle), m and rad.  covariance: (3, 3); a variance of
    MAX_VARIANCE or more: not measured.
    """

    disc: int
    pose: Array
    covariance: Array

    @property
    def measures_angle(self) -> bool:
        """Whether the angle is measured."""
        return bool(self.covariance[2, 2] < MAX_VARIANCE)

    @cached_property
    def _known(self) -> NDArray[np.intp]:
        """Coordinates that are measured."""
        return np.flatnonzero(np.diag(self.covariance) < MAX_VARIANCE)

    def away(self, predicted: Predicted, unknowns: Array) -> Array:
        """Return by how much it differs from what is predicted with ``unknowns``, (k,)."""
        away = self.pose - predicted.poses[self.disc] - unknowns[predicted.layout.bias(self.disc)]
        away[2] = wrapped(away[2])
        found: Array = away[self._known]
        return found

    def observation(self, predicted: Predicted) -> Observation:
        """Return how it depends on the unknowns."""
        bias, known = predicted.layout.bias(self.disc), self._known
        rows = predicted.pose_rows[self.disc].copy()
        rows[:, bias] = np.eye(POSE)
        # However good the sensor is, the model is not better than its own error.
        covariance = self.covariance + MODEL_ERROR
        return Observation(bias.start + known, rows[known], covariance[np.ix_(known, known)])


@dataclass(frozen=True)
class TensionMeasurement:
    """
    A measured tension of a tendon at its motor.

    tendon: 0 is the right one.  tension, deviation: N.  relative: deviation in parts of the
    tension, measured or predicted: a cell that is dead is not the most accurate one.
    """

    tendon: int
    tension: float
    deviation: float
    relative: float = 0.0

    def away(self, predicted: Predicted, unknowns: Array) -> Array:
        """Return by how much it differs from what is predicted with ``unknowns``, (1,)."""
        expected = 0.0 if self._slack(predicted) else predicted.tensions[self.tendon]
        bias = unknowns[predicted.layout.tension_bias(self.tendon)]
        return np.array([self.tension - expected - bias])

    def observation(self, predicted: Predicted) -> Observation:
        """Return how it depends on the unknowns."""
        bias = predicted.layout.tension_bias(self.tendon)
        row = predicted.tension_rows[self.tendon].copy()
        if self._slack(predicted):
            row[:] = 0.0
        row[bias] = 1.0
        return Observation(
            np.array([bias]), row[None], np.array([[self._deviation(predicted)**2]]))

    def _slack(self, predicted: Predicted) -> bool:
        """Whether it is slack as predicted: that says nothing of how much."""
        return bool(predicted.tensions[self.tendon] < 0.0
                    and self.tension < CARRIES * self._deviation(predicted))

    def _deviation(self, predicted: Predicted) -> float:
        return hypot(self.deviation, self.relative * max(
            self.tension, predicted.tensions[self.tendon], 0.0))


Measurement = DiscMeasurement | TensionMeasurement


@dataclass(frozen=True, eq=False)
class Point:
    """
    What would be measured after a change of the unknowns.

    change, unknowns: (size,).  statics, start: of the arm that has them, and the state from which
    to follow it.  state: at the time of the measurement.  discs, coordinates: (k,) of which disc
    each value is, and which coordinate of its pose; tensions are beyond the discs.  values: (k,)
    measured less predicted.  rows: (k, size) derivatives of what is predicted.  noise: (k, k).
    """

    change: Array
    unknowns: Array
    statics: Statics
    start: Equilibrium
    state: Equilibrium
    discs: NDArray[np.int64]
    coordinates: NDArray[np.int64]
    values: Array
    rows: Array
    noise: Array

    def covariance(self, unknowns: Array) -> Array:
        """Return that of ``values``, given that of the unknowns."""
        return np.asarray(self.rows @ unknowns @ self.rows.T + self.noise)

    @property
    def misfit(self) -> float:
        """What is left, by its noise."""
        return float(self.values @ np.linalg.solve(self.noise, self.values))

    def foretells(self, change: Array, state: Equilibrium, values: Array) -> bool:
        """Whether its derivatives hold for another change: they foretell the values there."""
        wrong = self.values - self.rows @ (change - self.change) - values
        return state.taut == self.state.taut and relative_distance(wrong, self.noise) < FORETOLD


@dataclass(frozen=True, eq=False)
class Innovation:
    """
    What measurements differed by from what was predicted.

    values: (k,) m and rad.  covariance: (k, k).  distance: squared Mahalanobis distance over its
    expected value k.  used: whether they changed the estimate.
    """

    values: Array
    covariance: Array
    distance: float
    used: bool


def relative_distance(values: Array, covariance: Array) -> float:
    """Return the squared Mahalanobis distance of values (k,) from 0 over its expected value k."""
    return float(values @ np.linalg.solve(covariance, values)) / len(values)


@dataclass(frozen=True, eq=False)
class Rates:
    """
    How an equilibrium changes with the unknowns.

    joint_angles: (joints, size) rad.  tensions: (tendons, size) N, of a slack tendon those of
    Predicted.
    """

    joint_angles: Array
    tensions: Array


def rates(statics: Statics, layout: Layout, state: Equilibrium,
          sliding: Sequence[int] = (0, 0)) -> Rates:
    """Return how a state of an arm whose tendons give changes with the unknowns."""
    found, arm = Linearisation(statics, state, sliding).all(), statics.chain.arm
    # Of the logarithms; a measured law has no factor, and no ratio.
    scales = np.ones(layout.model)
    scales[layout.stiffness] = [s.bending_stiffness for s in arm.segments]
    scales[layout.ratio] = [0.0 if s.jam.law is not None else s.jam.ratio for s in arm.segments]
    joints = np.zeros((state.joint_angles.size, layout.size))
    tensions, paths = np.zeros((2, layout.tendons, layout.size))
    joints[:, :layout.model] = found.joint_angles * scales
    tensions[:, :layout.model] = found.tensions * scales
    paths[:, :layout.model] = found.paths * scales
    paths[:, layout.offset] += np.eye(layout.tendons)
    slack = ~np.array(state.taut)
    tensions[slack] = paths[slack] / statics.compliance[slack, None]
    return Rates(joints, tensions)


def predicted(statics: Statics, layout: Layout, state: Equilibrium,
              sliding: Sequence[int] = (0, 0)) -> Predicted:
    """Return what would be measured of a state of an arm whose tendons give."""
    tensions = np.where(state.taut, state.tensions, -state.slack / statics.compliance)
    return Predicted(statics, layout, state, sliding, state.points[::2], tensions)


def disc_poses(chain: RigidChain, angles: Array, joints: Array) -> tuple[Array, Array]:
    """
    Return the poses of the discs' bottoms and their derivatives.

    angles: (joints,) rad.  joints: (joints, n) their derivatives.  Returns (discs, 3), x, z in m
    and angle in rad, and (discs, 3, n).
    """
    theta, turned = np.cumsum(angles), np.cumsum(joints, axis=0)
    below = chain.body_lengths * (np.arange(chain.joints) < chain.last_joint[:, None])
    poses = chain.points(angles)[::2]
    rows = np.zeros((len(poses), POSE, joints.shape[1]))
    rows[1:, 0] = (below * np.cos(theta)) @ turned
    rows[1:, 1] = (below * -np.sin(theta)) @ turned
    rows[1:, 2] = turned[chain.last_joint]
    return poses, rows
