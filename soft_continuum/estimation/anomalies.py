# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Detection of anomalies from differences between measurements and expectations.

The estimate adapts to all changes.  So a copy of it, from when the arm last rested as expected, is
kept as the reference: it follows motors and valves, but no measurements.  Whenever the arm rests,
measurements are compared with it.  A difference beyond the covariance of the reference has a
cause.  Each cause displaces the discs in its own pattern.  A cause is reported when, twice, it
explains the measurements and is much more likely than all others that do.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from soft_continuum.estimation.discs import camera_moved
from soft_continuum.estimation.estimator import Estimator, OWN_SHARE
from soft_continuum.estimation.hypotheses import (
    Cause,
    hypotheses,
    judge,
    log_likelihood,
    otherwise,
    SENSOR_SCALES,
    Verdict,
)
from soft_continuum.estimation.measuring import (
    ActuatorState,
    DiscMeasurement,
    LinearisationPoint,
    relative_distance,
)
from soft_continuum.estimation.sensing.rigid import mean_pose
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.errors import StaticsError

MOVED = 1e-5  # m of a motor
SETTLING, SWITCHING = 0.6, 1.2  # s after a motion, or after a valve, until the arm rests
WINDOW, LEAST = 0.2, 3  # s, and number, of pictures that are judged together
STILL = 2.0  # deviations by which a resting disc is elsewhere in the next pictures
FOLLOW_PERIOD = 0.1  # s between two steps of the reference in a motion
WORK = 300  # iterations of what others than the reference follow, in one message
RENEWAL = 10.0  # s after which the reference of a resting arm is renewed
EXPECTED = 1.5  # distance up to which measurements are as expected
RATIO, MARGIN = 4.0, 1.0  # log likelihood over nothing being wrong, and over the next cause
LEFT = 3.0  # distance that a cause may leave unexplained
LARGE_SHIFT, LARGE_TURN = 6e-3, 0.12  # m, rad: worth an alarm without a cause
MAX_ATTEMPTS = 6  # at naming one
LEAST_OFFSET = 1.7e-3  # m of a tendon: less is not named
LEAKS = (0.0, 0.1)  # parts of full vacuum that are left in a segment that is not stiff
REPORTED = 10.0  # s for which an anomaly is


@dataclass(frozen=True)
class Anomaly:
    """
    An anomaly, as in Anomaly.msg.

    time: s, of its detection.  segment, disc: as in topic names, 0 for none.  tendon: empty for
    none.  size: m, rad or N, as in the message.
    """

    time: float
    cause: Cause
    segment: int
    disc: int
    tendon: str
    size: float
    message: str


class AnomalyDetector:
    """Monitors one arm; ``active``: anomalies found in the last REPORTED s."""

    def __init__(self) -> None:
        """Begin without a reference."""
        self.active: tuple[Anomaly, ...] = ()
        self._last: ActuatorState | None = None
        self._stood: Array = np.zeros(0)  # m, pulls since which no motor moved
        self._rests = -np.inf  # s, from which on the arm does
        self.clear()

    def clear(self) -> None:
        """Take the next estimate that agrees with its measurements as the reference."""
        self._reference: Estimator | None = None
        self._window: list[tuple[float, Sequence[DiscMeasurement]]] = []  # since the arm rests
        self._mean: list[DiscMeasurement] = []  # of the window before
        # As if a segment (0-based) were not as stiff, or as soft, as it is reported to be.
        self._others: list[_Other] = []
        self._stiffened: tuple[ActuatorState, Estimator] | None = None  # as it was just before
        self._suspected: Verdict | None = None
        self._attempts = 0
        self._moved = self._changed = False  # since the reference was taken
        self._taken = self._followed = -np.inf

    # What the arm does.

    def follow(self, commands: ActuatorState) -> None:
        """Follow motors and valves."""
        last, self._last = self._last, commands
        time = commands.time
        self.active = tuple(one for one in self.active if time < one.time + REPORTED)
        if last is None:
            self._stood = commands.pulls
        elif commands.stiff != last.stiff:
            # The motion up to now counts for the stiffness up to now.
            self._step(replace(last, time=time))
            if self._reference is not None:
                for segment, (was, now) in enumerate(
                        zip(last.stiff, commands.stiff, strict=True)):
                    if was and not now:
                        self._others += _hypotheses(Cause.NOT_SOFT, segment, self._reference)
                    if now and not was:
                        self._others += _hypotheses(Cause.NOT_STIFF, segment, self._reference)
                        self._stiffened = last, self._reference.copy()
                # Of each the newest: without measurements they are never taken back.
                self._others = list({
                    (one.cause, one.segment, one.vacuum): one for one in self._others}.values())
            self._step(commands)
            self._rests = max(self._rests, time + SWITCHING)
            self._changed = True
        elif np.abs(commands.pulls - self._stood).max() > MOVED:
            self._stood = commands.pulls
            self._rests = max(self._rests, time + SETTLING)
            self._moved = self._changed = True
            if time >= self._followed + FOLLOW_PERIOD:
                self._step(commands)
        self._follow_others()

    def _follow_others(self) -> None:
        """
        Update the alternative estimates, those furthest behind first, up to WORK iterations.

        There are up to three per segment, and softening may take one of them 0.3 s for spatial
        arms: the shape does not wait for all of them.
        """
        work = 0
        while work < WORK:
            behind = max(self._others, key=lambda one: len(one.steps), default=None)
            if behind is None or not behind.steps:
                return
            self._others.remove(behind)
            if behind.follow():
                self._others.append(behind)
            work += behind.estimator.state.iterations

    def _step(self, commands: ActuatorState) -> None:
        """Update the reference, and the alternatives when it is their turn."""
        self._followed = commands.time
        if self._reference is None:
            return
        for one in self._others:
            one.note(commands)
        try:
            self._reference.follow(commands)
        except (StaticsError, np.linalg.LinAlgError):
            self.clear()

    # Measurements.

    def note(self, time: float, discs: Sequence[DiscMeasurement], estimator: Estimator
             ) -> Estimator:
        """
        Process a measurement after the estimator did; return the estimator to continue with.

        If a sensor has moved, that is the reference, which did not follow the moved sensor.
        """
        self._instead = estimator
        self._note(time, discs, estimator)
        return self._instead

    def _note(self, time: float, discs: Sequence[DiscMeasurement], estimator: Estimator) -> None:
        assert self._last is not None
        if time < self._rests or self._last.time < self._rests:
            self._window.clear()
            self._mean = []
            return
        self._window.append((time, discs))
        if len(self._window) < LEAST or time < self._window[0][0] + WINDOW:
            return
        mean, before = _mean([discs for _, discs in self._window]), self._mean
        self._window.clear()
        self._mean = mean
        if not _still(before, mean):
            return
        if self._reference is None:
            point = estimator.expected(mean)
            if relative_distance(
                    point.values, point.covariance(estimator.covariance)) < EXPECTED:
                self.refer_to(estimator, time)
            return
        self._step(self._last)
        self._follow_others()
        if self._reference is not None:
            try:
                self._judge(time, mean, self._reference, estimator)
            except StaticsError:
                self.clear()

    def refer_to(self, estimator: Estimator, time: float) -> None:
        """Set an estimate as the reference; measurements up to ``time`` (s) are as expected."""
        self._reference, self._taken = estimator.copy(), time
        self._others = [one for one in self._others
                        if one.cause is Cause.NOT_SOFT and not self._moved]
        for segment in np.flatnonzero(estimator.state.stiff).tolist():
            self._others += _hypotheses(Cause.NOT_STIFF, segment, estimator)
        assert self._last is not None
        for one in self._others:
            one.note(self._last)
        self._stiffened = None
        self._moved = self._changed = False

    def _judge(self, time: float, discs: Sequence[DiscMeasurement], reference: Estimator,
               estimator: Estimator) -> None:
        assert self._last is not None
        point = reference.expected(discs)
        covariance = point.covariance(reference.covariance)
        if relative_distance(point.values, covariance) < EXPECTED:
            self._suspected, self._attempts = None, 0
            if self._changed or time > self._taken + RENEWAL:
                self.refer_to(estimator, time)
            return
        if any(one.steps for one in self._others):
            return  # until all have followed
        causes = hypotheses(point, self._last, reference, self._moved)
        causes += [otherwise(one.cause, one.segment + 1, point, one.estimator, discs)
                   for one in self._others
                   if one.cause is Cause.NOT_SOFT or self._last.stiff[one.segment]]
        if self._stiffened is not None:
            # What happened before a segment became stiff is held since then.
            then, was = self._stiffened
            before = was.expected(discs)
            became = np.repeat(~np.array(then.stiff) & self._last.stiff, 2)
            locked = point.rows[:, was.layout.held][:, became] * was.prior.lock_in
            before = replace(before, noise=before.noise + locked @ locked.T)
            causes += [one for one in hypotheses(before, then, was, self._moved)
                       if one.cause not in (Cause.SENSOR_MOVED, Cause.CAMERA_MOVED)]
        verdicts = [judge(one) for one in causes]
        found = _clearest(verdicts, log_likelihood(point.values, covariance))
        if found is not None:
            if found.hypothesis.step and abs(found.size) < LEAST_OFFSET:
                self.clear()  # friction and backlash: the estimate adapts
                return
            if self._suspected is not None and _same(self._suspected, found):
                self._name(time, found, point, reference, estimator)
                return
            self._suspected = found
        self._attempts += 1
        if self._attempts == MAX_ATTEMPTS:
            of_shift = point.parts[:, :3].any(axis=1)
            if (np.abs(point.values) > np.where(of_shift, LARGE_SHIFT, LARGE_TURN)).any():
                self.active += (_unknown(time, verdicts, self._moved),)
            self.clear()

    def _name(self, time: float, found: Verdict, point: LinearisationPoint, reference: Estimator,
              estimator: Estimator) -> None:
        one, layout = found.hypothesis, estimator.layout
        cause, rows = _cause(found, self._moved), np.zeros((layout.size, 6))
        if cause is Cause.SENSOR_MOVED:
            rows[layout.bias(one.number)] = np.eye(6)
        elif cause is Cause.CAMERA_MOVED:
            of_discs = slice(layout.bias(0).start, layout.bias(layout.segments).stop)
            rows[of_discs] = camera_moved(point.state).reshape(-1, 6)
        if rows.any():
            self._instead = reference.copy()
            self._instead.loosen(rows * SENSOR_SCALES)
            self._instead.seen, self._instead.updated = estimator.seen.copy(), estimator.updated
        self.active += (_anomaly(time, cause, one.number, found.size, estimator.arm.tendon_names[
            one.number] if one.step else '', len(np.unique(point.discs)) == 1),)
        self.clear()


@dataclass(frozen=True, eq=False)
class _Other:
    """
    The estimate of an arm with a segment that is not as stiff, or as soft, as reported.

    segment: 0-based.  vacuum: remaining in it, as a fraction of full vacuum.  steps: of motors and
    valves that it has not followed yet.
    """

    cause: Cause
    segment: int
    vacuum: float
    estimator: Estimator
    steps: deque[ActuatorState] = field(default_factory=deque)

    def note(self, commands: ActuatorState) -> None:
        """Queue a step to follow; for each stiffness the last step is enough."""
        if self.steps and self.steps[-1].stiff == commands.stiff:
            self.steps.pop()
        self.steps.append(commands)

    def follow(self) -> bool:
        """Follow the next step; return whether such an arm exists."""
        commands = self.steps.popleft()
        stiff = list(commands.stiff)
        vacuum = list(commands.vacuum or (1.0,) * len(stiff))
        if self.cause is Cause.NOT_SOFT or self.vacuum == 0.0:
            stiff[self.segment] = self.vacuum > 0.0
        vacuum[self.segment] = min(vacuum[self.segment], self.vacuum)
        try:
            self.estimator.follow(replace(commands, stiff=tuple(stiff), vacuum=tuple(vacuum)))
        except (StaticsError, np.linalg.LinAlgError):
            return False
        return True


def _hypotheses(cause: Cause, segment: int, estimator: Estimator) -> list[_Other]:
    """Return what a segment would be that did not become soft, or a stiff one that leaks."""
    return [_Other(cause, segment, left, estimator.copy())
            for left in (LEAKS if cause is Cause.NOT_STIFF else (1.0,))]


def _mean(windows: Sequence[Sequence[DiscMeasurement]]) -> list[DiscMeasurement]:
    """Return the mean of each disc; the covariance is that of one measurement."""
    found: dict[int, list[DiscMeasurement]] = {}
    for discs in windows:
        for one in discs:
            found.setdefault(one.disc, []).append(one)
    for each in found.values():
        each[-1] = replace(each[-1], pose=mean_pose([one.pose for one in each]))
    return [each[-1] for _, each in sorted(found.items())]


def _still(before: Sequence[DiscMeasurement], now: Sequence[DiscMeasurement]) -> bool:
    """Whether the same discs are unmoved, by the independent noise of each image."""
    return bool(before) and [one.disc for one in before] == [one.disc for one in now] and all(
        bool((one.differs(other) < STILL * np.sqrt(OWN_SHARE)).all())
        for one, other in zip(before, now, strict=True))


def _clearest(verdicts: Sequence[Verdict], nothing: float) -> Verdict | None:
    """
    Return the verdict that explains the measurements, if much more likely than all others.

    nothing: log likelihood without any fault.
    """
    explain = sorted((one for one in verdicts if one.left < LEFT),
                     key=lambda one: one.likelihood, reverse=True)
    if not explain or explain[0].likelihood - nothing < RATIO:
        return None
    best = explain[0]
    clear = all(_same(one, best) or best.likelihood - one.likelihood > (
        MARGIN if one.left < LEFT else 0.0) for one in verdicts)
    return best if clear else None


def _same(one: Verdict, other: Verdict) -> bool:
    """Whether two verdicts name the same cause; the disc of a load is ignored."""
    return one.hypothesis.cause is other.hypothesis.cause and (
        one.hypothesis.number == other.hypothesis.number
        or one.hypothesis.cause is Cause.LOAD)


def _cause(found: Verdict, moved: bool) -> Cause:
    """Return the cause to report; moved: whether a motor has."""
    cause = found.hypothesis.cause
    return Cause.STEPS_LOST if cause is Cause.TENDON_SLIPPED and (
        moved or found.size < 0.0) else cause


def _unknown(time: float, verdicts: Sequence[Verdict], moved: bool) -> Anomaly:
    """Return an anomaly that names the causes about as likely as the most likely one."""
    explain = [one for one in verdicts if one.left < LEFT]
    best = max((one.likelihood for one in explain), default=0.0)
    causes = dict.fromkeys(_cause(one, moved).name for one in explain
                           if one.likelihood > best - MARGIN)
    found = _anomaly(time, Cause.UNKNOWN, 0, 0.0, '')
    return replace(found, message='the measurements do not fit the arm; it may be '
                   + ' or '.join(causes)) if causes else found


def _anomaly(time: float, cause: Cause, number: int, size: float, tendon: str,
             alone: bool = False) -> Anomaly:
    """Return the anomaly; size of a tendon: m longer.  alone: only one disc is measured."""
    segment = number if cause in (Cause.NOT_STIFF, Cause.NOT_SOFT) else 0
    disc = number if cause in (Cause.LOAD, Cause.SENSOR_MOVED) else 0
    length, way = f'{abs(size) * 1e3:.1f} mm', 'longer' if size > 0.0 else 'shorter'
    message = {
        Cause.UNKNOWN: 'the measurements do not fit the arm, and no known cause explains them; '
                       'inspect the arm and its sensors',
        Cause.TENDON_SLIPPED: f'{tendon} is {length} longer than its motor reports: it slipped '
                              'in its clamp or left a guide; check both, and set its zero again',
        Cause.STEPS_LOST: f'{tendon} is {length} {way} than its motor reports since a motion: the '
                          'motor lost steps, or the tendon slipped; set its zero again',
        Cause.NOT_STIFF: f'segment {segment} is reported stiff but gives way; check its vacuum '
                         'for leaks',
        Cause.NOT_SOFT: f'segment {segment} is reported soft but does not bend; check that its '
                        'valve vents',
        Cause.LOAD: f'a force of about {size:.1f} N near disc {disc} acts on the arm and is not '
                    'in its description; check for contact, or describe the payload',
        Cause.SENSOR_MOVED: f'the sensor of disc {disc} has moved on it by {length}; fix it, '
                            'straighten the arm and tare' + (
                                '. No other disc is measured: the camera or tracker may have '
                                'moved instead' if alone else ''),
        Cause.CAMERA_MOVED: f'all discs appear displaced together, at the base by {length}: the '
                            'camera or its reference has moved; fix it, straighten the arm and '
                            'tare',
    }[cause]
    return Anomaly(time, cause, segment, disc, tendon, size, message)
