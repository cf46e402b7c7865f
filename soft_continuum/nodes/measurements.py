# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What kinematics takes from sensors: poses of the discs, and tensions."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import hypot, inf, isfinite, nan
import re
from time import monotonic
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped

from soft_continuum.estimation.measuring import DiscMeasurement, TensionMeasurement
from soft_continuum.hardware.protocols import Accuracy
from soft_continuum.mechanics.arm import Arm
from soft_continuum.ros.conversions import (
    accuracy_from_ros,
    measured_pose_from_ros,
    seconds,
)
from soft_continuum.ros.entries import SENSOR, subscribe
from soft_continuum.ros.names import MEASURED_POSE
from soft_continuum_interfaces.msg import TendonActuationState

SYNC_WINDOW = 0.02  # s for which a pose waits for those of the other discs
MAX_WAITING = 20
"""Number of times with pending poses; beyond it, as in a burst, the oldest are dropped."""
MAX_RATE = 60.0
"""Rate at which poses are used: each takes some milliseconds."""
MAX_AT_ONCE = 4.0
"""Burst of times, as from several cameras."""
ANOTHER = 1e-6  # s by which the same time counts as another: the disc is seen by another camera
TENSION_INTERVAL = 0.1
"""Period of used tensions, s: each costs as much as a pose, and carries less information."""
UNCHECKED_TIME = 2.0
"""Time (s) for which the first tensions wait for their accuracy, published once a second."""
OUTLIER_SIGMA = 3.0  # deviations, beyond which a difference is not what the device does not know
REPORT_DELAY = 2.0  # s for which a difference lasts before it is reported
SLACK = 0.1  # of what the model has: with less, a tendon carries nothing
NUMBER = re.compile(r'[\d.]+')
REFUSAL_WEIGHT = 0.1  # of the last measurement in the share that is refused
MANY_REFUSED, FEW_REFUSED = 0.5, 0.2
"""Shares of refused measurements at which the report starts and ends."""


class MeasuredPoses:
    """
    Collects disc_N/measured_pose of all discs.

    The base does not move: its pose shows whether the camera moved, but not the arm.
    """

    def __init__(self, node: Any, arm: Arm, frame: str, on_pose: Callable[[], None]) -> None:
        """
        Subscribe for ``node``; frame: required frame of poses.

        on_pose: called when poses are pending or were refused.
        """
        self._frame, self._axes, self._on_any = frame, arm.pose_axes, on_pose
        self._waiting: dict[float, tuple[float, dict[int, DiscMeasurement]]] = {}
        self._taken = -1.0  # s, the stamp that was used last
        self._allowed = MAX_AT_ONCE  # times that may be used now
        self.refused = ''
        """Why a pose was refused since this was last read."""
        for disc in range(len(arm.discs)):
            subscribe(node, PoseWithCovarianceStamped, MEASURED_POSE.format(disc),
                      partial(self._on_pose, disc), SENSOR)

    def _on_pose(self, disc: int, message: PoseWithCovarianceStamped) -> None:
        self._on_any()
        try:
            pose, covariance = measured_pose_from_ros(message, self._axes, self._frame)
        except ValueError as error:
            self.refused = f'{MEASURED_POSE.format(disc)} has {error}'
            return
        stamp = seconds(message.header.stamp)
        while disc in self._waiting.get(stamp, (0.0, {}))[1]:
            stamp += ANOTHER
        _, discs = self._waiting.setdefault(stamp, (monotonic(), {}))
        discs[disc] = DiscMeasurement(disc, pose, covariance)
        while len(self._waiting) > MAX_WAITING:
            del self._waiting[next(iter(self._waiting))]

    @property
    def waits(self) -> bool:
        """Whether poses are pending for ``take``."""
        return bool(self._waiting)

    def take(self) -> list[tuple[float, list[DiscMeasurement]]]:
        """Return the measurements that are complete: times in s, and their poses."""
        now = monotonic()
        ready = [stamp for stamp, (came, _) in self._waiting.items() if now - came >= SYNC_WINDOW]
        found = []
        for stamp in sorted(ready):
            _, discs = self._waiting.pop(stamp)
            if not any(discs):
                continue
            self._allowed = min(
                MAX_AT_ONCE, self._allowed + abs(stamp - self._taken) * MAX_RATE)
            self._taken = stamp
            if self._allowed >= 1.0:
                self._allowed -= 1.0
                found.append((stamp, list(discs.values())))
        return found


class MeasuredTensions:
    """
    Takes effort of tendon_states, which is only present if tensions are measured.

    Its accuracy is in tendon_actuation/state if the device reports it, otherwise in parameters.
    """

    def __init__(self, tendons: Sequence[str], parameters: Mapping[str, Any]) -> None:
        """tendons: their names.  parameters: of kinematics."""
        self._tendons, self._parameters = tendons, parameters
        self._check = TensionCheck(tendons)
        self._accuracy: Accuracy | None = None
        self._first, self._unchecked_time = inf, 0.0  # s, of the first; see UNCHECKED_TIME
        self._waiting: tuple[float, list[TensionMeasurement]] | None = None
        self._taken = -inf

    def expect_accuracy(self) -> None:
        """Make the first tensions wait for their accuracy, given to ``receive``."""
        self._unchecked_time = UNCHECKED_TIME

    def receive(self, state: TendonActuationState) -> None:
        """Store the accuracy of tensions; raises ValueError, and keeps the earlier one."""
        if state.connected:  # its last accuracy remains valid after a reconnection
            self._accuracy = accuracy_from_ros(state, self._tendons)

    def _stddevs(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return deviations near 0 (N), and shares of the tension, of every tendon."""
        told, count = self._accuracy or Accuracy(), len(self._tendons)
        return (told.tension_stddevs
                or (self._parameters['estimation.tension_stddev'],) * count,
                told.tension_relative_stddevs
                or (self._parameters['estimation.tension_relative_stddev'],) * count)

    def put(self, time: float, tensions: Mapping[str, float]) -> None:
        """Store tensions (N, by tendon) measured at ``time`` (s), if they are due."""
        if abs(time - self._taken) < TENSION_INTERVAL:
            return
        self._first = min(self._first, time)
        if self._accuracy is None and time - self._first < self._unchecked_time:
            return
        found = [TensionMeasurement(t, tensions[name], stddev, relative)
                 for t, (name, stddev, relative) in enumerate(
                     zip(self._tendons, *self._stddevs(), strict=True))
                 if isfinite(tensions.get(name, inf))]
        if found:
            self._waiting, self._taken = (time, found), time

    def take(self) -> list[tuple[float, list[TensionMeasurement]]]:
        """Return the pending tensions, with times in s."""
        found = [] if self._waiting is None else [self._waiting]
        self._waiting = None
        return found

    def problem(self, now: float, tensions: Mapping[str, float], model: Sequence[float]) -> str:
        """Return which tensions (N, by tendon) contradict the model; see TensionCheck."""
        return self._check.problem(now, tensions, model, self._tolerances(tensions, model))

    def _tolerances(self, tensions: Mapping[str, float], model: Sequence[float]) -> list[float]:
        """
        Return tension_tolerance, or what the device does not know if that is more, N.

        Shares are of the lower tension: a tendon that is caught must not excuse itself.
        """
        least = self._parameters['tension_tolerance']
        if self._accuracy is None or not self._accuracy.tension_stddevs:
            return [least] * len(self._tendons)
        return [max(least, OUTLIER_SIGMA * hypot(
                    stddev, relative * min(tensions.get(name, 0.0), own)))
                for name, own, stddev, relative in zip(
                    self._tendons, model, *self._stddevs(), strict=True)]


class TensionCheck:
    """Finds tendons whose measured tension has long differed from the model."""

    def __init__(self, tendons: Sequence[str]) -> None:
        """tendons: their names."""
        self._tendons = tendons
        self._since: dict[str, float] = {}  # s, of those that differ
        self._said: dict[str, str] = {}

    def problem(self, now: float, measured: Mapping[str, float], model: Sequence[float],
                tolerances: Sequence[float]) -> str:
        """
        Return the problem, empty for none; the text only changes with the cause.

        now: s.  measured: N, by tendon, those that are.  model: N, one per tendon, nan where
        nothing determines it.  tolerances: N, one per tendon.
        """
        for name, expected, tolerance in zip(self._tendons, model, tolerances, strict=True):
            seen = measured.get(name, nan)
            if not abs(seen - expected) > tolerance:  # also what is not known
                self._since.pop(name, None)
                self._said.pop(name, None)
            elif now - self._since.setdefault(name, now) > REPORT_DELAY:
                cause = _cause(seen, expected, tolerance)
                if cause not in self._said.get(name, ''):
                    self._said[name] = (f'the tension of {name} is {seen:.1f} N, by the model '
                                        f'{expected:.1f} N; {cause}')
        return '; '.join(self._said.values())


def _cause(seen: float, expected: float, tolerance: float) -> str:
    if seen < -tolerance:
        return 'a tendon cannot push: is the sign or the zero of its load cell wrong?'
    if seen < SLACK * expected:
        return 'it is slack: off its guide, torn, or did its motor lose steps?'
    return 'friction, contact, another payload or stiffness, or a wrong zero of the load cell?'


class Refusals:
    """Keeps the share of refused measurements among about the last ten."""

    def __init__(self, what: str) -> None:
        """what: name of the measurement, for people."""
        self.what, self._share, self._text, self._reason = what, 0.0, '', ''

    def note(self, reason: str) -> str:
        """
        Note why a measurement was refused, or '' if it was used; return the report.

        It starts at MANY_REFUSED and ends at FEW_REFUSED; the text only changes with the reason,
        not with its numbers.
        """
        self._share += REFUSAL_WEIGHT * (bool(reason) - self._share)
        if self._share < FEW_REFUSED:
            self._text = ''
        elif reason and (self._share > MANY_REFUSED or self._text) and not (
                self._text and NUMBER.sub('', reason) == NUMBER.sub('', self._reason)):
            self._reason = reason
            self._text = f'most measured {self.what} are rejected, the last one because: {reason}'
        return self._text
