# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The shape of the arm, from its statics and from measurements, by an extended Kalman filter.

The statics are the model: the shape is the equilibrium of the estimated arm.  The bias common to
all measurements of a disc (how its tag is mounted) is estimated as well: otherwise a hundred
images would count as ten times better than one.
"""

from collections import deque
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
import scipy

from soft_continuum.estimation.measuring import (
    ActuatorState,
    DiscMeasurement,
    Innovation,
    LinearisationPoint,
    Measurement,
    MODEL_ERROR,
    pose_error,
    predicted,
    rates,
    relative_distance,
)
from soft_continuum.estimation.unknowns import (
    arm_with,
    Drift,
    first_covariance,
    first_values,
    indices_of,
    limited,
    Prior,
    UnknownIndices,
)
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.laws import LawError
from soft_continuum.mechanics.statics import Statics, StaticsError

HISTORY = 2.0  # s for which pulls are kept: a measurement may be that late
LAG = 0.15  # s by which a moving arm is behind its statics
RESTING = 2e-5  # m by which it is behind, up to which tensions are those of the statics
FORGOTTEN = 10.0  # s without a disc that was measured, until one does without it
VENTING = 2.0  # s after a change of stiffness for which the vacuum shows in the tensions
SWITCHING = 1.0  # s after a change of stiffness for which the shape is between two models
OWN_SHARE = 0.1  # of a sensor's variance that is new in each measurement
MAX_PAST = 2000  # pulls that are kept, if time stands still
OUTLIER = 1e-4  # chance of a measurement that is right, and not used
PERSISTENT = 2  # measurements beyond the gate in turn, after which the arm has changed
REOPENED = 2.0  # times what they are at first: offsets and held shapes then
LINEAR = 2.0  # distance of a measurement up to which one Newton step is enough
MAX_STEPS, STEP_PARTS = 3, (1.0, 0.4, 0.15)
MIN_RELATIVE_GAIN = 0.05  # of what is left: a step that gains less is the last
MINUTE, CENTIMETRE = 60.0, 0.01


class Estimator:
    """The estimate of one arm.  Times are in s on the clock of the measurement stamps."""

    def __init__(self, arm: Arm, state: Any, prior: Prior, drift: Drift) -> None:
        """Begin with a shape, with the uncertainty of the prior."""
        self.layout, self.prior = indices_of(arm), prior
        self._described, self._drift = arm, drift
        self.values = first_values(arm, self.layout, prior)
        self._first = first_covariance(arm, self.layout, prior)
        self.covariance = self._first.copy()
        self.statics: Any = _statics_with(arm, self.layout, self.values, state)
        self.state: Any = replace(state, chain=self.statics.chain)
        for s, stiff in enumerate(state.stiff):
            if not stiff:
                self._clear_held(s)
        self._past: deque[ActuatorState] = deque(maxlen=MAX_PAST)
        self._speeds = np.zeros(self.layout.tendons)  # m/s, that the shape has not settled from
        self._switched = -np.inf  # when the stiffness changed
        self._change = np.zeros((len(arm.discs), 6))  # of it, then
        biases = self.layout.size - self.layout.model
        self._bias_variances, self._displaced = np.zeros((2, biases))  # the latter for good
        self._beyond = 0  # measurements of discs in turn beyond the gate
        self.updated: float | None = None
        """When a measurement was last used, s."""
        self.seen = np.full(len(arm.discs), -np.inf)
        """When each disc was last measured, (discs,) s."""

    @property
    def arm(self) -> Any:
        """The arm with the estimated parameters."""
        return self.statics.chain.arm

    @property
    def offsets(self) -> Array:
        """Pull of each tendon beyond the reported motor position, (tendons,), m."""
        return np.asarray(self.values[self.layout.offset])

    @property
    def measured(self) -> float | None:
        """
        Oldest of the last measurement times of the discs, s; None without measurements.

        Discs last measured FORGOTTEN s before another are ignored.
        """
        moving, newest = self.seen[1:], float(self.seen[1:].max())
        return None if newest == -np.inf else float(moving[moving >= newest - FORGOTTEN].min())

    def hidden(self, since: float) -> list[int]:
        """Return the discs that are missing from measurements since a time (s)."""
        moving, newest = self.seen[1:], float(self.seen[1:].max())
        hidden = (moving <= since) & (moving >= newest - FORGOTTEN) & (newest > since)
        return [int(disc) for disc in np.flatnonzero(hidden) + 1]

    def copy(self) -> 'Estimator':
        """Return an independent copy."""
        other = copy(self)
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray | deque):
                setattr(other, name, copy(value))
        return other

    # Motion of the arm.

    def follow(self, commands: ActuatorState) -> None:
        """Follow the tendons and valves; on StaticsError the estimate is unchanged."""
        before = self._past[-1] if self._past else commands
        switched, start = commands.stiff != self.state.stiff, self.state
        state = self.statics.solve(
            start, commands.pulls + self.offsets, commands.soft, vacuum=commands.vacuum,
            sliding=commands.sliding)
        if switched:
            self._switch(commands.stiff, commands.time)
        self.state = state
        self._change = pose_error(state, start) if switched else self._change
        self._note(commands, before)
        self._drift_by(max(0.0, commands.time - before.time),
                       np.abs(commands.pulls - before.pulls))

    def _note(self, now: ActuatorState, before: ActuatorState) -> None:
        elapsed = now.time - before.time
        if elapsed > 0.0:
            fading = np.exp(-elapsed / LAG)
            self._speeds = np.maximum(np.abs(now.pulls - before.pulls) / elapsed,
                                      self._speeds * fading)
        self._past.append(now)
        while self._past[0].time < now.time - HISTORY and len(self._past) > 1:
            self._past.popleft()

    def _switch(self, stiff: tuple[bool, ...], time: float) -> None:
        """Transfer the uncertainty of the shape to the jams that now hold it."""
        layout = self.layout
        rows = rates(self.statics, layout, self.state).bending
        change = np.eye(layout.size)
        for s, (was, now) in enumerate(zip(self.state.stiff, stiff, strict=True)):
            if now and not was:
                change[layout.held_by(s)] = rows[layout.held_by(s)]
        self.covariance = change @ self.covariance @ change.T
        for s, (was, now) in enumerate(zip(self.state.stiff, stiff, strict=True)):
            if now and not was:
                held = np.arange(layout.size)[layout.held_by(s)][self._described.bending_axes[s]]
                self.covariance[held, held] += self.prior.lock_in**2
            elif was and not now:
                self._clear_held(s)
        self._switched = time

    def _clear_held(self, segment: int) -> None:
        held = self.layout.held_by(segment)
        self.covariance[held] = self.covariance[:, held] = 0.0

    def _stiff(self) -> NDArray[np.bool_]:
        """Return for each of ``layout.held`` whether its segment is stiff and bends about it."""
        stiff = np.array(self.state.stiff)[:, None]
        held: NDArray[np.bool_] = (stiff & self._described.bending_axes).ravel()
        return held

    def _drift_by(self, elapsed: float, moved: Array) -> None:
        drift, layout = self._drift, self.layout
        variances = np.zeros(layout.size)
        variances[layout.stiffness] = drift.stiffness**2 * elapsed / MINUTE
        variances[layout.ratio] = drift.ratio**2 * elapsed / MINUTE
        variances[layout.payload] = drift.payload**2 * elapsed / MINUTE
        variances[layout.offset] = (drift.offset**2 * elapsed / MINUTE
                                    + drift.offset_motion**2 * moved / CENTIMETRE)
        variances[layout.held] = self._stiff() * (
            drift.held**2 * elapsed / MINUTE + drift.held_motion**2 * moved.max() / CENTIMETRE)
        self.covariance[np.diag_indices(layout.size)] += variances
        self._renew_biases(float(np.exp(-moved.max() / CENTIMETRE)))
        # What nothing tells is not known worse than before anything was measured.
        rows = np.arange(layout.held.stop, layout.model)
        ratio = np.diag(self.covariance)[rows] / np.maximum(np.diag(self._first)[rows], 1e-30)
        for row in rows[ratio > 1.0]:
            shrink = np.sqrt(self._first[row, row] / self.covariance[row, row])
            self.covariance[row] *= shrink
            self.covariance[:, row] *= shrink

    def _renew_biases(self, kept: float) -> None:
        """
        Increase the uncertainty of the biases: they differ in another shape.

        They include unmodelled errors, which depend on the shape.
        """
        biases = self.layout.biases
        self.values[biases] *= kept
        self.covariance[biases] *= kept
        self.covariance[:, biases] *= kept
        rows = np.arange(biases.start, biases.stop)
        self.covariance[rows, rows] += (1.0 - kept**2) * self._bias_variances

    # Measurements.

    def ready(self, time: float) -> str:
        """Return why a measurement of that time cannot be used; empty when it can."""
        if not self._past or time > self._past[-1].time + LAG:
            return 'it is from the future'
        if time < self._past[0].time:
            return f'it is more than {HISTORY:g} s old'
        return ''

    def switching(self, time: float) -> bool:
        """Whether a segment was changing stiffness then, so measurements are unreliable."""
        return time < self._switched + SWITCHING

    def measure(self, time: float, measurements: Sequence[Measurement], trusted: bool = True
                ) -> Innovation | None:
        """
        Use poses, tensions or both, measured at ``time``; return None if they cannot be used.

        trusted: whether they may change the estimate; else only the residual is returned.

        On StaticsError the estimate is unchanged.
        """
        if not self._shows_tensions(time):
            measurements = [one for one in measurements if isinstance(one, DiscMeasurement)]
        if self.ready(time) or self.switching(time) or not measurements:
            return None
        past = min(self._past, key=lambda one: abs(one.time - time))
        point = self._linearised(np.zeros(self.layout.size), past, measurements)
        covariance = point.covariance(self.covariance)
        distance = relative_distance(point.values, covariance)
        seen = any(isinstance(one, DiscMeasurement) for one in measurements)
        used = trusted and self._trusted(distance, len(point.values), seen)
        innovation = Innovation(point.values, covariance, distance, used)
        if used:
            told = np.full(self.layout.size, float(seen))
            told[self.layout.observable_from_tension] = 1.0
            self._take(self._best(point, past, measurements, distance, told), past, told)
            self.updated = max(time, self.updated or time)
            for one in measurements:
                if isinstance(one, DiscMeasurement):
                    self.seen[one.disc] = max(time, self.seen[one.disc])
        return innovation

    def expected(self, discs: Sequence[DiscMeasurement]) -> LinearisationPoint:
        """Return measured less predicted values for the arm at rest."""
        return self._linearised(np.zeros(self.layout.size), self._past[-1], discs)

    def _shows_tensions(self, time: float) -> bool:
        """
        Whether tensions follow the statics: at rest, long after a change of stiffness.

        Only while a segment is soft: a stiff arm has locked-in tensions.
        """
        return (float(self._speeds.max()) * LAG < RESTING and not all(self.state.stiff)
                and time >= self._switched + VENTING)

    def _best(self, point: LinearisationPoint, past: ActuatorState,
              measurements: Sequence[Measurement], distance: float, told: Array
              ) -> LinearisationPoint:
        """
        Return the most likely change: by one Newton step, or several if one is not enough.

        Where a tendon becomes taut or slack the shape is strongly nonlinear, so each step is
        shortened until the residual decreases.  told: (size,) 1 for the unknowns that may
        change, 0 for those of which only the uncertainty counts (Schmidt).
        """
        spread = self.covariance
        weights, cost = np.zeros(self.layout.size), point.misfit
        for _ in range(1 if distance < LINEAR else MAX_STEPS):
            wanted: Array = point.rows.T @ np.linalg.solve(
                point.covariance(spread), point.values + point.rows @ point.change)
            for part in STEP_PARTS:
                tried = weights + part * (wanted - weights)
                try:
                    there = self._linearised(told * (spread @ tried), past, measurements, point)
                except StaticsError:
                    continue
                if there.misfit + tried @ spread @ tried < cost:
                    break
            else:
                return point
            gained = cost - there.misfit - float(tried @ spread @ tried)
            foretold = there.rows is point.rows
            point, weights, cost = there, tried, cost - gained
            if foretold or gained < MIN_RELATIVE_GAIN * cost:
                break
        return point

    def _take(self, point: LinearisationPoint, past: ActuatorState, told: Array) -> None:
        """Apply a change of the unknowns at the present pulls; raises StaticsError."""
        now, start = self._past[-1], point.start
        self.state = point.state if past is now else point.statics.solve(
            start, now.pulls + point.unknowns[self.layout.offset],
            [not s for s in start.stiff], vacuum=start.vacuum or None, sliding=now.sliding)
        self.values, self.statics = point.unknowns, point.statics
        gain = told[:, None] * np.linalg.solve(point.covariance(self.covariance),
                                               point.rows @ self.covariance).T
        left = np.eye(self.layout.size) - gain @ point.rows
        self.covariance = left @ self.covariance @ left.T + gain @ point.noise @ gain.T

    def loosen(self, directions: Array) -> None:
        """
        Increase the covariance by independent errors of unit standard deviation.

        directions: (size, n), change of the unknowns per error.
        """
        more = directions @ directions.T
        self.covariance = self.covariance + more
        self._displaced += np.diag(more)[self.layout.model:]

    def _trusted(self, distance: float, size: int, seen: bool) -> bool:
        """
        Whether a measurement is used: outliers of discs are if successive ones agree.

        seen: whether it is of discs.  Tensions alone cannot reset the shape.
        """
        if distance * size <= scipy.special.chdtri(size, OUTLIER):
            self._beyond *= not seen
            return True
        self._beyond += seen
        if not seen or self._beyond < PERSISTENT:
            return False
        self._reopen()
        return True

    def _reopen(self) -> None:
        """Reset the uncertainty of offsets and held shapes: the arm has changed."""
        self._beyond = 0
        layout, first = self.layout, np.diag(self._first)
        variances = np.zeros(layout.size)
        variances[layout.held] = self._stiff() * np.maximum(
            first[layout.held], self.prior.lock_in**2)
        variances[layout.offset] = first[layout.offset]
        self.covariance[np.diag_indices(layout.size)] += REOPENED**2 * variances

    def _linearised(self, change: Array, past: ActuatorState, measurements: Sequence[Measurement],
                    before: LinearisationPoint | None = None) -> LinearisationPoint:
        """
        Return predicted measurements for changed unknowns; raises StaticsError.

        Reuses the derivatives of ``before`` where valid: new ones cost as much as all the rest.
        """
        layout, state = self.layout, self.state
        unknowns = limited(self.values + change, layout)
        unknowns[layout.held] = 0.0  # it is in the held angles
        statics, start, there = self.statics, state, state
        changed = bool(change.any())
        if changed:
            statics = _statics_with(self._described, layout, unknowns, state)
            held = change[layout.held] * self._stiff()
            start = state.with_held(statics.chain, held.reshape(-1, 2))
        if changed or past is not self._past[-1]:
            there = statics.solve(start, past.pulls + unknowns[layout.offset],
                                  [not s for s in state.stiff], vacuum=state.vacuum or None,
                                  sliding=past.sliding)
        expected = predicted(statics, layout, there, past.sliding)
        values = np.concatenate([one.away(expected, unknowns) for one in measurements])
        if before is not None and before.jacobian_valid(change, there, values):
            return replace(before, change=change, unknowns=unknowns, statics=statics,
                           start=start, state=there, values=values)
        found = [one.observation(expected) for one in measurements]
        for one in found:
            self._expect_biases(one.biases, one.variances)
        jacobian = np.concatenate([one.rows for one in found])
        noise, end = np.zeros((len(jacobian),) * 2), 0
        for one in found:
            begin, end = end, end + len(one.rows)
            noise[begin:end, begin:end] = OWN_SHARE * one.covariance
        # A moving arm lags its statics as if its tendons lagged.
        late = jacobian[:, layout.offset] * (self._speeds * LAG)
        discs = np.repeat([one.disc for one in found], [len(one.rows) for one in found])
        return LinearisationPoint(change, unknowns, statics, start, there, discs,
                                  np.concatenate([one.parts for one in found]), values, jacobian,
                                  noise + late @ late.T)

    def _expect_biases(self, biases: NDArray[np.intp], variances: Array) -> None:
        """Use the stated accuracy of a sensor as the bias of all its measurements."""
        for row, variance in zip(biases, (1.0 - OWN_SHARE) * variances, strict=True):
            if self.covariance[row, row] == 0.0:
                self.covariance[row, row] = variance
            self._bias_variances[row - self.layout.model] = (
                variance + self._displaced[row - self.layout.model])

    # Results.

    def stddevs(self) -> Array:
        """Return the standard deviations of the unknowns, (size,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    def determined(self) -> Array:
        """Whether the data improve on the prior of each of ``layout.parameters``."""
        known = np.diag(self.covariance) < 0.5 * np.diag(self._first)
        return np.asarray(known[self.layout.parameters])

    def pose_covariances(self) -> Array:
        """Return the covariances of the poses of all discs, base first, (discs, 6, 6)."""
        rows = rates(self.statics, self.layout, self.state).poses
        axes = self._described.pose_axes
        found: Array = (rows @ self.covariance @ rows.transpose(0, 2, 1)
                        + MODEL_ERROR * np.outer(axes, axes))
        if self._past and self.switching(self._past[-1].time):
            found += self._change[:, :, None] * self._change[:, None, :]
        return found


def _statics_with(arm: Arm, layout: UnknownIndices, values: Array, state: Any) -> Any:
    """
    Return the statics of arm_with.

    Raises StaticsError, with ``state``, where a soft segment would be stiffer than the measured
    law of its stiff state.
    """
    try:
        return Statics(arm_with(arm, layout, values))
    except LawError as error:
        raise StaticsError(str(error), state) from None
