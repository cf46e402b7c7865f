# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
State of motors and valves, measurements of an arm, and their derivatives by the unknowns.

Differences of poses, and their covariances, are shifts along x, y, z (m) and rotation vectors
(rad) in base_link; for motions that a planar arm cannot make they are 0.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import hypot, isfinite, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from soft_continuum.estimation.unknowns import UnknownIndices
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.rotations import displacement, levers, matrices
from soft_continuum.mechanics.sensitivity import Linearisation

MAX_VARIANCE = 1.0  # m^2 or rad^2, from which a coordinate counts as not measured
ALONG_AXIS = 1.0 - 1e-9  # cosine of a direction to an axis that it is along
CARRIES = 3.0  # deviations of a tension, beyond which the tendon is not slack
SHIFT_ERROR, TURN_ERROR = 3e-4, 3e-3  # m, rad: of a disc's pose, of what no unknown can explain
MODEL_ERROR = np.diag(np.repeat([SHIFT_ERROR, TURN_ERROR], 3))**2
"""Covariance (6, 6) of a disc's pose for that."""
LINEARITY_TOLERANCE = 1e-6
"""Squared distance over its expected value, permitted as an error of linearisation."""
MIN_PART = 0.01  # of a jam that the model has


@dataclass(frozen=True, eq=False)
class ActuatorState:
    """
    State of tendons and valves at one time.

    time: s on the clock of the measurements.  pulls: (tendons,) m of the motors.  stiff: per
    segment.  vacuum: fraction of full vacuum per segment, None for full.  sliding: as in
    Statics.solve.  yielding: whether a stiff segment has so little vacuum that the tendons may
    bend it.
    """

    time: float
    pulls: Array
    stiff: tuple[bool, ...]
    vacuum: tuple[float, ...] | None = None
    sliding: tuple[int, ...] = ()
    yielding: bool = False

    @property
    def soft(self) -> list[bool]:
        """Which segments are soft."""
        return [not stiff for stiff in self.stiff]


class JamVacuum:
    """Follows the pressures of the segments whose jams are not rigid; others count as full."""

    def __init__(self, elastic: Sequence[bool], parameters: Mapping[str, Any]) -> None:
        """Begin with the full vacuum; parameters: those of kinematics."""
        self._elastic, self._parameters = elastic, parameters
        self._parts = [1.0] * len(elastic)

    def follow(self, segment: int, pressure: float, setpoints: Sequence[float]) -> None:
        """
        Take the pressure (absolute, Pa) of a segment (0-based).

        setpoints: of regulators, Pa below ambient; of valves empty.  After arrival the set-point
        counts, not the pressure: otherwise sensor noise would weaken and strengthen the jam, and
        the arm would creep in the model.
        """
        vacuum = self._parameters['ambient_pressure'] - pressure
        if not isfinite(vacuum):
            return
        wanted = setpoints[segment] if setpoints else nan
        followed = abs(vacuum - wanted) <= self._parameters['vacuum_tolerance']
        full = self._parameters['full_vacuum']
        part = wanted / full if followed else round(vacuum / full, 2)
        self._parts[segment] = min(1.0, max(MIN_PART, part))

    @property
    def parts(self) -> tuple[float, ...] | None:
        """Parts of the full vacuum, per segment; None if every jam is rigid."""
        return tuple(self._parts) if any(self._elastic) else None


@dataclass(frozen=True, eq=False)
class Rates:
    """
    Derivatives of an equilibrium by n unknowns.

    poses: (discs, 6, n), of the discs' bottoms.  bending: (2 * segments, n) rad.  tensions:
    (tendons, n) N.
    """

    poses: Array
    bending: Array
    tensions: Array


@dataclass(frozen=True, eq=False)
class Predicted:
    """
    Values of the statics at the time of a measurement, and their derivatives by the unknowns.

    statics, state: of the arm.  layout: of the unknowns.  poses: (discs, 7) of the discs' bottoms.
    tensions: (tendons,) N; negative for a slack tendon: the push that would close its slack.
    The derivatives cost more, and are computed on demand.
    """

    statics: Any
    layout: UnknownIndices
    state: Any
    sliding: Sequence[int]
    poses: Array
    tensions: Array

    @cached_property
    def rates(self) -> Rates:
        """Derivatives by the unknowns."""
        return rates(self.statics, self.layout, self.state, self.sliding)


@dataclass(frozen=True, eq=False)
class LinearMeasurement:
    """
    Dependence of k measured values on the unknowns.

    disc: its number; beyond the discs for tensions.  parts: (k, 6), the component of a pose
    difference for each value.  biases: (m,), indices in the unknowns of the biases of such
    measurements.  variances: (m,) of the biases, as reported by the sensor.  rows: (k, size)
    derivatives of the predicted values.  covariance: (k, k) of sensor and model.
    """

    disc: int
    parts: Array
    biases: NDArray[np.intp]
    variances: Array
    rows: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class DiscMeasurement:
    """
    A measured pose of a disc's bottom.

    disc: 0 at the base.  pose: (7,), position (m) and quaternion x, y, z, w.  covariance: (6, 6)
    of shift (m) and rotation vector; a variance of MAX_VARIANCE or more means not measured, as for
    motions out of the plane of a planar arm.  One unmeasured turn may be about any direction, such
    as the vertical of a tilted base.
    """

    disc: int
    pose: Array
    covariance: Array

    @cached_property
    def known(self) -> NDArray[np.bool_]:
        """Which coordinates are measured."""
        found: NDArray[np.bool_] = np.diag(self.covariance) < MAX_VARIANCE
        return found

    @cached_property
    def about(self) -> Array | None:
        """Direction (3,) about which alone the turn of the disc is not measured."""
        variances, directions = np.linalg.eigh(self.covariance[3:, 3:])
        if np.count_nonzero(variances >= MAX_VARIANCE) != 1:
            return None
        found: Array = directions[:, -1]
        return found

    @cached_property
    def parts(self) -> Array:
        """The measured components of a pose difference, (k, 6)."""
        if self.about is None or np.abs(self.about).max() > ALONG_AXIS:
            return np.eye(6)[self.known]
        across = np.zeros((2, 6))
        across[:, 3:] = np.linalg.eigh(self.covariance[3:, 3:])[1][:, :2].T
        return np.concatenate([np.eye(6)[:3][self.known[:3]], across])

    def away(self, predicted: Predicted, unknowns: Array) -> Array:
        """Return measured less predicted values for ``unknowns``, (k,)."""
        bias = unknowns[predicted.layout.bias(self.disc)]
        return np.asarray(self.parts @ (displacement(
            self.pose, predicted.poses[self.disc], self.about) - bias))

    def differs(self, other: 'DiscMeasurement') -> Array:
        """Return the difference from another pose of the disc in standard deviations, (k,)."""
        away = self.parts @ displacement(self.pose, other.pose, self.about)
        return np.asarray(np.abs(away) / np.sqrt(np.diag(self._covariance_of(self.covariance))))

    def observation(self, predicted: Predicted) -> LinearMeasurement:
        """Return how it depends on the unknowns."""
        layout, parts = predicted.layout, self.parts
        bias, rows = layout.bias(self.disc), predicted.rates.poses[self.disc].copy()
        rows[:, bias] = np.eye(6)
        # Even for an exact sensor, the model keeps its own error.
        covariance = self._covariance_of(self.covariance + MODEL_ERROR)
        touched = np.flatnonzero(parts.any(axis=0))
        variances = np.where(parts[:, touched] != 0.0, np.diag(covariance)[:, None], 0.0)
        return LinearMeasurement(self.disc, parts, bias.start + touched,
                                 variances.max(axis=0, initial=0.0), parts @ rows, covariance)

    def _covariance_of(self, poses: Array) -> Array:
        """Return the covariance of the measured components, from that of a pose."""
        found: Array = self.parts @ poses @ self.parts.T
        return found


@dataclass(frozen=True)
class TensionMeasurement:
    """
    A measured tension of a tendon at its motor.

    tendon: 0 is the right one.  tension, deviation: N.  relative: deviation relative to the
    tension, measured or predicted, so that a dead load cell is not the most accurate one.
    """

    tendon: int
    tension: float
    stddev: float
    relative: float = 0.0

    def away(self, predicted: Predicted, unknowns: Array) -> Array:
        """Return measured less predicted tension for ``unknowns``, (1,)."""
        expected = 0.0 if self._slack(predicted) else predicted.tensions[self.tendon]
        bias = unknowns[predicted.layout.tension_bias(self.tendon)]
        return np.array([self.tension - expected - bias])

    def observation(self, predicted: Predicted) -> LinearMeasurement:
        """Return how it depends on the unknowns."""
        bias = predicted.layout.tension_bias(self.tendon)
        row = predicted.rates.tensions[self.tendon].copy()
        if self._slack(predicted):
            row[:] = 0.0
        row[bias] = 1.0
        variance, layout = self._stddev(predicted)**2, predicted.layout
        return LinearMeasurement(
            layout.segments + 1, np.zeros((1, 6)), np.array([bias]),
            np.array([variance]), row[None], np.array([[variance]]))

    def _slack(self, predicted: Predicted) -> bool:
        """Whether it is slack as predicted: then the measurement does not give the slack."""
        return bool(predicted.tensions[self.tendon] < 0.0
                    and self.tension < CARRIES * self._stddev(predicted))

    def _stddev(self, predicted: Predicted) -> float:
        return hypot(self.stddev, self.relative * max(
            self.tension, predicted.tensions[self.tendon], 0.0))


Measurement = DiscMeasurement | TensionMeasurement


@dataclass(frozen=True, eq=False)
class LinearisationPoint:
    """
    Predicted measurements after a change of the unknowns.

    change, unknowns: (size,).  statics, start: of the arm with these unknowns, and its initial
    state.  state: at the time of the measurement.  discs: (k,) disc of each value; tensions are
    beyond the discs.  parts: (k, 6), component of a pose difference.  values: (k,) measured less
    predicted.  rows: (k, size) derivatives of predicted values.  noise: (k, k).
    """

    change: Array
    unknowns: Array
    statics: Any
    start: Any
    state: Any
    discs: NDArray[np.int64]
    parts: Array
    values: Array
    rows: Array
    noise: Array

    def covariance(self, unknowns: Array) -> Array:
        """Return the covariance of ``values``, given that of the unknowns."""
        return np.asarray(self.rows @ unknowns @ self.rows.T + self.noise)

    def measured(self, of_discs: Array) -> Array:
        """Return the measured components of pose differences (discs, 6, ...), (k, ...)."""
        found: Array = np.einsum('kp,kp...->k...', self.parts, of_discs[self.discs])
        return found

    @property
    def misfit(self) -> float:
        """The residual relative to its noise."""
        return float(self.values @ np.linalg.solve(self.noise, self.values))

    def jacobian_valid(self, change: Array, state: Any, values: Array) -> bool:
        """Whether its derivatives are valid for another change: they predict the values there."""
        wrong = self.values - self.rows @ (change - self.change) - values
        return state.taut == self.state.taut and (
            relative_distance(wrong, self.noise) < LINEARITY_TOLERANCE)


@dataclass(frozen=True, eq=False)
class Innovation:
    """
    Difference of measurements from predictions.

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


def rates(statics: Any, layout: UnknownIndices, state: Any,
          sliding: Sequence[int] = ()) -> Rates:
    """
    Return the derivatives of a state by the unknowns, (..., size); its tendons must be elastic.

    The tensions of slack tendons are those of Predicted.
    """
    # Of the logarithms; a measured law has no ratio.
    scales = np.ones(layout.model)
    scales[layout.ratio] = [0.0 if s.jam.law is not None else s.jam.ratio
                            for s in statics.chain.arm.segments]
    found = Linearisation(statics, state, sliding).all()

    def with_biases(rows: Array) -> Array:
        padded = np.zeros((*rows.shape[:-1], layout.size))
        padded[..., :layout.model] = rows * scales
        return padded

    poses, bending, tensions, paths = map(with_biases, (
        found.poses, found.bending.reshape(-1, layout.model), found.tensions, found.paths))
    paths[:, layout.offset] += np.eye(layout.tendons)
    slack = ~np.array(state.taut)
    tensions[slack] = paths[slack] / statics.compliance[slack, None]
    return Rates(poses, bending, tensions)


def predicted(statics: Any, layout: UnknownIndices, state: Any,
              sliding: Sequence[int] = ()) -> Predicted:
    """Return the predicted measurements of a state; its tendons must be elastic."""
    tensions = np.where(state.taut, state.tensions, -state.slack / statics.compliance)
    return Predicted(statics, layout, state, sliding, state.poses[::2], tensions)


# Motion of the discs.

def pose_error(state: Any, other: Any) -> Array:
    """Return the displacement of the discs' bottoms from another state, (discs, 6)."""
    return np.array([displacement(now, then) for now, then in zip(
        state.poses[::2], other.poses[::2], strict=True)])


def bent_evenly(state: Any) -> Array:
    """
    Return the motion of the discs per rad of even bending, (discs, 6, 2 * segments).

    Bending is about x and y of the body below each joint, where segments bend about them.
    """
    chain = state.chain
    axes = np.concatenate([np.eye(3)[None], state.rotations[:-1]])[:, :, :2]
    discs, joints = state.poses[::2, :3], state.backbone[:-1]
    found = np.zeros((chain.segments + 1, 6, chain.segments, 2))
    moments = np.cross(axes, joints[:, :, None], axis=1)
    turns, offsets = (each.reshape(chain.segments, -1, 3, 2).sum(axis=1)
                      for each in (axes, moments))
    for segment, (turn, offset) in enumerate(zip(turns, offsets, strict=True)):
        above = slice(segment + 1, None)
        found[above, :3, segment] = np.cross(turn[None], discs[above, :, None], axis=1) - offset
        found[above, 3:, segment] = turn
    found *= chain.arm.bending_axes / chain.joints_per_segment
    return found.reshape(len(discs), 6, -1)


def camera_moved(state: Any) -> Array:
    """Return the apparent motion of the discs for motions of the camera, (discs, 6, 6)."""
    return levers(state.poses[::2, :3])


def angle_stddevs(state: Any, covariances: Array) -> Array:
    """
    Return the standard deviations (segments,), rad, of the turns of all discs but the base.

    They combine x and y of the disc below.  covariances: (discs, 6, 6).
    """
    below = matrices(state.poses[:-2:2, 3:])
    inside = below.transpose(0, 2, 1) @ covariances[1:, 3:, 3:] @ below
    return np.asarray(np.sqrt(np.trace(inside[:, :2, :2], axis1=1, axis2=2)))
