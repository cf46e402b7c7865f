# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The shape of the arm: predicted from motors and valves alone, and estimated once it is measured.

The prediction needs the path from a straight arm to know the shape of a stiff segment.  It
continues beside the estimate, for comparison.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from soft_continuum.estimation.anomalies import Anomaly, AnomalyDetector
from soft_continuum.estimation.estimator import Estimator, HISTORY
from soft_continuum.estimation.measuring import (
    ActuatorState,
    DiscMeasurement,
    Innovation,
    Measurement,
)
from soft_continuum.estimation.unknowns import (
    DEFAULT_ESTIMATION,
    EstimationSettings,
    MAX_OFFSET,
    MAX_RATIO,
    Prior,
)
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.rotations import bending_between, IDENTITY, matrices
from soft_continuum.mechanics.statics import Statics, StaticsError

STRAIGHT_PULLS = 1e-5
"""m: pulls of an arm that is still where it was referenced: those of opposite bends cancel."""
PULL_RESOLUTION = 1e-9  # m: a smaller change of pull changes nothing
MAX_FAILURES = 50  # successive steps that the estimate cannot follow, after which it is reset
FAR_OFF = 30.0  # squared distance over its expected value, of measurements of another shape
BASE_MOVED = 5.6  # standard deviations of a displaced base: the sensor that sees it has moved
MAX_FAR_OFF = 15  # successive ones, after which the estimate is reset


class ShapeError(Exception):
    """The shape is unknown; values: reported values by name, one per tendon."""

    def __init__(self, message: str, **values: Array) -> None:
        """Say why."""
        super().__init__(message)
        self.values = values


class UnknownShapeError(ShapeError):
    """The shape has never been known."""


class ArmShape:
    """Tracks the shape of one arm."""

    def __init__(self, arm: Arm, straight_tolerance: float,
                 settings: EstimationSettings = DEFAULT_ESTIMATION) -> None:
        """
        Begin without knowing the shape.

        straight_tolerance: m, permitted shortness of the tendons of a stiff arm.
        """
        self.settings = settings
        self.statics: Any = Statics(arm)
        self.estimator: Estimator | None = None
        self.unpredicted: Exception | None = None
        """Why the model alone has no shape."""
        self._path: Any = None  # what it had last
        self._watch = AnomalyDetector()
        self._tolerance = straight_tolerance
        self._arm = arm
        self._commands: ActuatorState | None = None
        self._solved: tuple[object, ...] = ()
        self._stood: Array | None = None
        """(tendons,) m: largest pulls since all segments are stiff."""
        self._failures = self._far_off = 0
        self._base: dict[bytes, DiscMeasurement] = {}  # as seen first, by which coordinates are
        self._measured: Array | None = None  # when each disc last was, (discs,) s
        self.lost_bent = ''
        """Bending of the arm when its shape was lost, as text; empty if it was not."""

    @property
    def state(self) -> Any:
        """
        The shape: the estimate, or without any measurement the last prediction.

        A State; None if unknown.
        """
        return self._path if self.estimate is None else self.estimate.state

    @property
    def predicted(self) -> Any:
        """The shape predicted from motors and valves alone; None if the model finds none."""
        return self._path if self.unpredicted is None else None

    @property
    def estimate(self) -> Estimator | None:
        """The estimate, once a measurement has been used."""
        found = self.estimator
        return None if found is None or found.updated is None else found

    @property
    def anomalies(self) -> tuple[Anomaly, ...]:
        """Present anomalies of the arm, from measurements."""
        return self._watch.active

    # Motors and valves.

    def follow(self, commands: ActuatorState) -> None:
        """
        Update the shape; raises ShapeError when it is unknown.

        Raises StaticsError when the model has no equilibrium; the shape is then unchanged.
        """
        if self._commands is not None and commands.time < self._commands.time - HISTORY:
            self._clear_estimate()  # the clock was set back: nothing of it can be compared
        before, self._commands = self._commands, commands
        self._watch.follow(commands)
        self._predict(commands, before or commands)
        if self.estimator is not None and self.estimate is None:
            try:  # it has no measurements yet and is not required
                self.estimator.follow(commands)
            except StaticsError:
                self.estimator = None
        elif self.estimator is not None:
            self._follow_estimate(self.estimator, commands)
        if self.unpredicted is not None and (
                self.estimate is None or self.estimate.measured is None):
            raise self.unpredicted.with_traceback(None)

    def _follow_estimate(self, estimator: Estimator, commands: ActuatorState) -> None:
        try:
            estimator.follow(commands)
        except StaticsError:
            self._failures += 1
            if self._failures >= MAX_FAILURES:
                self._begin_anew()
            raise
        self._failures = 0

    def _begin_anew(self) -> None:
        """Forget the estimate: the next measurement of all discs begins another."""
        self._clear_estimate()
        self._begin_prediction(None)

    def lose(self, bent: str) -> None:
        """Forget the shape: pulls that follow count from another zero.  bent: see lost_bent."""
        self._commands, self.lost_bent = None, bent or self.lost_bent
        self._begin_anew()

    def _begin_prediction(self, state: Any) -> None:
        self._path, self.unpredicted, self._solved, self._stood = state, None, (), None

    def _clear_estimate(self) -> None:
        self.estimator, self._measured, self._watch = None, None, AnomalyDetector()
        if self._commands is not None:
            self._watch.follow(self._commands)
        self._failures = self._far_off = 0

    def _predict(self, commands: ActuatorState, before: ActuatorState) -> None:
        """Update the prediction from its last state, or record why it fails."""
        if self.unpredicted is not None and any(
                now and not was for was, now in zip(before.stiff, commands.stiff, strict=True)):
            self._begin_prediction(None)  # what is held now was not predicted
        if (self._path is None and not self.lost_bent
                and np.abs(commands.pulls).max() <= STRAIGHT_PULLS):
            self._begin_prediction(self.statics.chain.straight())
        if self._path is None:
            self.unpredicted = UnknownShapeError('the shape is unknown: ' + (
                f'when the tendons lost their position, {self.lost_bent}' if self.lost_bent else
                'the tendons were pulled before this node started, or a segment was stiffened '
                'where the model found no shape'))
            return
        key = (*np.round(commands.pulls / PULL_RESOLUTION), *commands.stiff,
               *(commands.vacuum or ()))
        if key == self._solved:
            return
        self._solved = key
        try:
            self._path, self.unpredicted = self._followed(self._path, commands), None
        except (ShapeError, StaticsError) as error:
            self.unpredicted = error

    def _followed(self, start: Any, commands: ActuatorState) -> Any:
        """Return the state followed from ``start``; raises ShapeError and StaticsError."""
        pulls = commands.pulls
        if commands.yielding or not all(commands.stiff):
            self._stood = None
        else:
            stood = self.statics.commanded_pulls(start)  # with what tendons are stretched by
            if self.statics.compliance.any():  # also after they were slackened
                self._stood = stood = np.maximum(stood, stood if self._stood is None
                                                 else self._stood)
            short = pulls - stood
            if short.max() > self._tolerance:
                raise ShapeError('the tendons do not fit the stiff arm: its shape is unknown',
                                 short=short)
            # A locked arm does not yield to the last step of a stepper.
            pulls = np.minimum(pulls, stood)
        return self.statics.solve_eased(
            start, pulls, commands.soft, vacuum=commands.vacuum, sliding=commands.sliding)

    def set_straight(self) -> None:
        """Set the shape to straight."""
        self._begin_at(self.statics.chain.straight())

    def set_soft(self, pulls: Array) -> None:
        """Set the shape that the pulls give with every segment soft; raises StaticsError."""
        self._begin_at(self.statics.solve(
            self.statics.chain.straight(), pulls, [True] * self.statics.chain.segments))

    def _begin_at(self, state: Any) -> None:
        """Set the shape, and assume sensors at their described positions."""
        self.lost_bent = ''
        self._base.clear()
        self._clear_estimate()
        self._begin_prediction(state)

    # Measurements.

    def measure(self, time: float, measurements: Sequence[Measurement]) -> Innovation | None:
        """
        Use measurements from ``time``; None if not used, with the reason from ``refusal``.

        On StaticsError the shape is unchanged.
        """
        commands = self._commands
        if commands is None or not self.settings.enabled:
            return None
        discs = [one for one in measurements if isinstance(one, DiscMeasurement)]
        base_stands = all(map(self._stands, discs))
        seen = base_stands and any(one.disc > 0 for one in discs)
        # Tensions tell nothing of jams, which are as described until a disc is measured.
        prior = self.settings.prior if seen else replace(
            self.settings.prior, rigid_ratio=MAX_RATIO)
        if self.estimator is None or (seen and self.estimator.prior != prior):
            found = self._first_estimator(time, discs if base_stands else [], commands, prior)
            if found is not None:  # otherwise that of the tensions goes on
                self.estimator = found
                self._watch.refer_to(found, time)
        if self.estimator is None:
            return None
        innovation = self.estimator.measure(time, measurements, base_stands)
        self._measured = self.estimator.seen
        if innovation is not None and discs:
            try:
                self.estimator = self._watch.note(time, discs, self.estimator)
            except (StaticsError, np.linalg.LinAlgError):
                self._watch.clear()
            far_off = innovation.distance > FAR_OFF and base_stands
            self._far_off = self._far_off + 1 if far_off else 0
            if self._far_off >= MAX_FAR_OFF and (there := self._seen(discs, commands)) is not None:
                self._far_off = 0
                self.estimator = self._estimator(there, commands, prior)
        return innovation

    def _stands(self, disc: DiscMeasurement) -> bool:
        """Whether a disc is not the base, or is at its first measured pose."""
        if disc.disc > 0:
            return True
        first = self._base.setdefault(disc.known.tobytes(), disc)
        return bool((disc.differs(first) < BASE_MOVED).all())

    def refusal(self, time: float) -> str:
        """Return why a measurement of that time cannot be used; empty when it can."""
        if self._commands is None:
            return 'tendons and valves are not known yet'
        if self.estimator is None and self._path is None:
            return 'the shape is unknown until every disc is measured at once'
        return '' if self.estimator is None else self.estimator.ready(time)

    def _first_estimator(self, time: float, discs: Sequence[DiscMeasurement],
                         commands: ActuatorState, prior: Prior) -> Estimator | None:
        if self._path is not None:
            return self._estimator(self._path, commands, prior)
        seen = self._seen(discs, commands)
        if seen is None:
            return None
        self._measured, self.lost_bent = np.full(len(self._arm.discs), time), ''
        return self._estimator(seen, commands, prior)

    def _estimator(self, start: Any, commands: ActuatorState, prior: Prior) -> Estimator:
        estimator = Estimator(self._arm, start, prior, self.settings.drift)
        if self._measured is not None:
            estimator.seen = self._measured.copy()
            estimator.updated = estimator.measured
        stretch = self.statics.compliance * np.nan_to_num(start.tensions)
        slack = np.asarray(start.pulls) + stretch - commands.pulls
        estimator.values[estimator.layout.offset] = np.clip(slack, -MAX_OFFSET, 0.0)
        estimator.follow(commands)
        return estimator

    def _seen(self, discs: Sequence[DiscMeasurement], commands: ActuatorState) -> Any:
        """Return the evenly bent shape that fits all measured discs; None unless all are."""
        chain, axes = self.statics.chain, self._arm.pose_axes[3:]
        poses = {one.disc: one.pose for one in discs if one.known[3:][axes].all()}
        numbers = range(1, chain.segments + 1)
        if not all(n in poses for n in numbers):
            return None
        turned = matrices(np.array([IDENTITY, *(poses[n] for n in numbers)])[:, 3:])
        seen = chain.uniform(bending_between(turned) * self._arm.bending_axes)
        return chain.state_of(seen.coordinates, seen.held_coordinates, seen.stiff,
                              commands.vacuum or ())
