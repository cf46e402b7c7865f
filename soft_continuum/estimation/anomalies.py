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
from contextlib import suppress
from dataclasses import dataclass, field, replace
from enum import auto, Enum
from math import log, pi
from typing import Any

import numpy as np
import scipy

from soft_continuum.estimation.estimator import Estimator, OWN_SHARE
from soft_continuum.estimation.measuring import (
    ActuatorState,
    bent_evenly,
    camera_moved,
    DiscMeasurement,
    LinearisationPoint,
    pose_error,
    predicted,
    relative_distance,
)
from soft_continuum.estimation.unknowns import UnknownIndices
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.rotations import mean_pose
from soft_continuum.mechanics.sensitivity import Linearisation
from soft_continuum.mechanics.statics import Statics, StaticsError

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
                        self._others += _others(Cause.NOT_SOFT, segment, self._reference)
                    if now and not was:
                        self._others += _others(Cause.NOT_STIFF, segment, self._reference)
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
            self._others += _others(Cause.NOT_STIFF, segment, estimator)
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


def _others(cause: Cause, segment: int, estimator: Estimator) -> list[_Other]:
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


# Fault hypotheses: the displacements that they predict, and their likelihoods.

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
