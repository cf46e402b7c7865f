# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Estimates from measurements: the source of the shape, parameters, anomalies."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, sqrt

from soft_continuum.ros.ros_time import FRESH

MAX_SHOWN = 1e6  # in SI units; also not what is not a number


@dataclass(frozen=True)
class LearnedParameter:
    """
    An estimated quantity of the arm.

    name, value and deviation (standard, in the unit of the value): as in EstimatedParameter.msg.
    determined: whether measurements improve on the prior.  problem: why the value is not
    plausible, '' if it is.
    """

    name: str
    value: float
    stddev: float
    determined: bool
    problem: str = ''

    @property
    def kind(self) -> str:
        """Name without segment or tendon: stiffness_factor, stiff_ratio, offset or payload."""
        return next((kind for kind in ('stiffness_factor', 'stiff_ratio', 'offset')
                     if self.name.startswith(f'{kind}_')), self.name)

    @property
    def of(self) -> str:
        """The segment (its number) or tendon (its name) it belongs to, '' for none."""
        return self.name[len(self.kind) + 1:]

    @property
    def segment(self) -> int | None:
        """Number of the segment it belongs to, from 1; None for no segment."""
        is_number = self.kind in ('stiffness_factor', 'stiff_ratio') and self.of.isdecimal()
        return int(self.of) if is_number and len(self.of) < 4 else None


@dataclass(frozen=True)
class Anomaly:
    """
    A deviation of the measurements from the described arm.

    cause: a constant of Anomaly.msg as text, such as 'tendon slipped'.  segment, disc: as in topic
    names, 0 for none.  tendon: its name, '' for none.  size: in SI units.  message: a text with
    the remedy.
    """

    cause: str
    segment: int
    disc: int
    tendon: str
    size: float
    message: str


@dataclass(frozen=True)
class Estimate:
    """
    The source of the shape of the arm, and its accuracy.

    measured: whether measurements have corrected the shape; otherwise it is the model's
    prediction.  age: s since the last measurement used, None for none.  angle_stddevs: rad,
    standard deviations of the bending of each segment.  tip_covariance: of the pose of the tip, 36
    numbers as in geometry_msgs/PoseWithCovariance.  Both are empty without measurements.
    predicted_tip_error: m between the tip and its open-loop prediction, None if unknown.
    """

    measured: bool
    age: float | None = None
    angle_stddevs: tuple[float, ...] = ()
    tip_covariance: tuple[float, ...] = ()
    predicted_tip_error: float | None = None
    parameters: tuple[LearnedParameter, ...] = ()
    anomalies: tuple[Anomaly, ...] = ()

    @property
    def fresh(self) -> bool:
        """Whether it is measured now; otherwise it is predicted, if only temporarily."""
        return self.measured and (self.age is None or self.age <= FRESH)

    @property
    def tip_stddev(self) -> float | None:
        """Standard deviation of the position of the tip, m; None without measurements."""
        return position_stddev(self.tip_covariance)


def position_stddev(covariance: Sequence[float]) -> float | None:
    """Return the standard deviation (m) of a position from a tip_covariance, or None."""
    variances = covariance[:15:7]
    if len(covariance) != 36 or not all(map(isfinite, variances)) or not sum(variances) > 0.0:
        return None
    return sqrt(sum(variances))


# Texts.


@dataclass(frozen=True)
class ParameterText:
    """Text of a parameter: label, value, deviation, and the unit of both."""

    label: str
    value: str
    stddev: str
    unit: str

    def amount(self) -> str:
        """Return value and deviation with the unit."""
        return f'{self.value} +- {self.stddev} {self.unit}'.rstrip()


def parameter_text(parameter: LearnedParameter) -> ParameterText:
    """Return the text of a parameter; an unknown one keeps its name, without a unit."""
    kind, of = parameter.kind, parameter.of
    label, scale, unit = {
        'stiffness_factor': (f'stiffness factor, segment {of}', 1.0, ''),
        'stiff_ratio': (f'K, segment {of}', 1.0, ''),
        'offset': (f'offset, {of}', 1e3, 'mm'),
        'payload': ('payload', 1e3, 'g'),
    }.get(kind, (parameter.name, 1.0, ''))

    def number(value: float, form: str) -> str:
        return f'{scale * value:{form}}' if abs(value) < MAX_SHOWN else '?'

    return ParameterText(label, number(parameter.value, '+.2f' if kind == 'offset' else '.3g'),
                         number(parameter.stddev, '.2g'), unit)


def millimetres(value: float) -> str:
    """Return m in mm, without the unit; a question mark for implausible lengths."""
    return f'{1e3 * value:.1f}' if abs(value) < MAX_SHOWN else '?'


def anomaly_text(anomaly: Anomaly) -> str:
    """Return an anomaly in one line: cause, location, remedy."""
    concerns = [anomaly.tendon, f'segment {anomaly.segment}' if anomaly.segment else '',
                f'disc {anomaly.disc}' if anomaly.disc else '']
    cause = 'the measurements do not fit the arm' if anomaly.cause == 'unknown' else anomaly.cause
    where = ', '.join(filter(None, concerns))
    return f'{cause}{f" ({where})" if where else ""}' + (
        f': {anomaly.message}' if anomaly.message else '')


def age_text(age: float | None) -> str:
    """Return the age of the last measurement as text that does not change constantly."""
    if age is None:
        return 'never measured'
    if age < 1.0:
        return 'measured just now'
    return (f'last measured {age:.0f} s ago' if age < 120.0
            else f'last measured {age / 60.0:.0f} min ago')
