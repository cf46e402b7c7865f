# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What measurements say of the arm: the source of its shape, what was learned, what is wrong."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, sqrt

from soft_continuum.ros.ros_time import FRESH

MAX_SHOWN = 1e6  # in SI units; also not what is not a number


@dataclass(frozen=True)
class LearnedParameter:
    """
    One quantity of the arm that is estimated from measurements.

    name, value and deviation (standard, in the unit of the value): as in EstimatedParameter.msg.
    determined: whether measurements tell more of it than was known before.  problem: why the value
    is not plausible, '' when it is.
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
        """Which segment (its number) or tendon (its name) it belongs to, '' for none."""
        return self.name[len(self.kind) + 1:]

    @property
    def segment(self) -> int | None:
        """Number of the segment it belongs to, from 1; None for no segment."""
        is_number = self.kind in ('stiffness_factor', 'stiff_ratio') and self.of.isdecimal()
        return int(self.of) if is_number and len(self.of) < 4 else None


@dataclass(frozen=True)
class Anomaly:
    """
    What the measurements say that no arm as described would do.

    cause: a name in Anomaly.msg in words, such as 'tendon slipped'.  segment, disc: as in topic
    names, 0 for none.  tendon: its name, '' for none.  size: in SI units.  message: for people,
    with what to do.
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
    Where the shape of the arm comes from, and how well it is known.

    measured: whether measurements have corrected the shape; else it is the model's prediction.
    age: s since the last measurement that was used, None if there was none.  angle_stddevs:
    rad, standard, of the bending of each segment.  tip_covariance: of the pose of the tip, 36
    numbers as in geometry_msgs/PoseWithCovariance.  Both are empty while nothing is measured.
    predicted_tip_error: m between the tip and where the model alone has it, None while that is
    not known.
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
        """Whether it is measured now; else it is predicted, if only since it was measured."""
        return self.measured and (self.age is None or self.age <= FRESH)

    @property
    def tip_stddev(self) -> float | None:
        """Standard deviation of the position of the tip, m; None while nothing is measured."""
        return position_stddev(self.tip_covariance)


def position_stddev(covariance: Sequence[float]) -> float | None:
    """Return the deviation (m) of a position by a tip_covariance; None of none."""
    variances = covariance[:15:7]
    if len(covariance) != 36 or not all(map(isfinite, variances)) or not sum(variances) > 0.0:
        return None
    return sqrt(sum(variances))


# In words.


@dataclass(frozen=True)
class ParameterText:
    """How a parameter reads: what it is, its value, its deviation, and the unit of both."""

    label: str
    value: str
    stddev: str
    unit: str

    def amount(self, between: str = '+-') -> str:
        """Return value and deviation with the unit."""
        return f'{self.value} {between} {self.stddev} {self.unit}'.rstrip()


def parameter_text(parameter: LearnedParameter) -> ParameterText:
    """Return how a parameter reads; one that is not known here keeps its name, without a unit."""
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
    """Return m in mm, without the unit; a question mark for what is no length of an arm."""
    return f'{1e3 * value:.1f}' if abs(value) < MAX_SHOWN else '?'


def anomaly_text(anomaly: Anomaly) -> str:
    """Return an anomaly in one line: the cause, what it concerns, what to do."""
    concerns = [anomaly.tendon, f'segment {anomaly.segment}' if anomaly.segment else '',
                f'disc {anomaly.disc}' if anomaly.disc else '']
    cause = 'the measurements do not fit the arm' if anomaly.cause == 'unknown' else anomaly.cause
    where = ', '.join(filter(None, concerns))
    return f'{cause}{f" ({where})" if where else ""}' + (
        f': {anomaly.message}' if anomaly.message else '')


def age_text(age: float | None) -> str:
    """Return how old the last measurement is, in words that do not change ten times a second."""
    if age is None:
        return 'never measured'
    if age < 1.0:
        return 'measured just now'
    return (f'last measured {age:.0f} s ago' if age < 120.0
            else f'last measured {age / 60.0:.0f} min ago')
