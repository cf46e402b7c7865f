# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Measured tensions: selection for the estimate, and comparison with the model."""

from collections.abc import Mapping, Sequence
from math import hypot, inf, isfinite, nan
from typing import Any

from soft_continuum.estimation.measuring import TensionMeasurement
from soft_continuum.hardware.protocols import Accuracy
from soft_continuum.ros.conversions import accuracy_from_ros
from soft_continuum_interfaces.msg import TendonActuationState

PERIOD = 0.1
"""Period of used tensions, s: each costs as much as a pose, and carries less information."""
UNCHECKED_TIME = 2.0
"""Time (s) for which the first tensions wait for their accuracy, published once a second."""
OUTLIER_SIGMA = 3.0  # deviations, beyond which a difference is not what the device does not know
REPORT_DELAY = 2.0  # s for which a difference lasts before it is reported
SLACK = 0.1  # of what the model has: with less, a tendon carries nothing


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
        if abs(time - self._taken) < PERIOD:
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
