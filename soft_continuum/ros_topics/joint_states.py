# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Pulls of the tendons from the joint states of other nodes, after plausibility checks.

Nothing here waits or depends on ROS: the receiver of the messages passes on their contents.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, Protocol, Self

from soft_continuum.hardware.protocols import describe_pulls, HardwareError
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import ParameterError, spread

PREFIX = 'ros_tendons.'
REST_TIME, REST_BAND = 0.15, 1e-4
"""A tendon rests if it stays within so many m for so many s."""
JUMP, JUMP_SPEED = 2e-3, 2.0
"""Largest step between two states: m, plus this factor times speed_limit."""
COMPARED_TIME, COMPARED_MOTION, MAX_RATIO, MAX_UNLIKE = 0.5, 4e-3, 5.0, 3
"""s and m of motion in which velocities are compared with positions, how they may differ, and how
often in a row they must: one time alone may be noise, or a sender that was kept waiting."""
ZERO_MARGIN, SOUGHT_MARGIN = 0.1, 1.0
"""Plausible excess over pull_limits, as a share of their range: for known zeros, for others."""
SCALE_RANGE = 4e-5, 2.0
"""m of pull per unit of a joint, from a screw of 0.25 mm per turn to a slide with a pulley."""
MAX_LISTED = 8  # joints in a message


class JointStates(Protocol):
    """The used fields of a sensor_msgs/JointState."""

    name: Sequence[str]
    position: Sequence[float]
    velocity: Sequence[float]
    effort: Sequence[float]


@dataclass(frozen=True)
class Joints:
    """
    The joints that pull the tendons, in the order of ``tendons``.

    scales: m of pull per unit of position, negative where the joint pays out as it moves on.
    zeros: position at zero pull, in the unit of the joint.  absolute: whether these stay valid
    when the hardware is switched off.  effort_scales: N of tension per unit of effort, 0 alone:
    none.
    pull_limits: m.  speed_limit: m/s.
    """

    tendons: tuple[str, ...]
    names: tuple[str, ...]
    scales: tuple[float, ...]
    zeros: tuple[float, ...]
    absolute: bool
    effort_scales: tuple[float, ...]
    pull_limits: tuple[float, float]
    speed_limit: float

    def __post_init__(self) -> None:
        """Raise ParameterError for a scale outside of the plausible range."""
        low, high = SCALE_RANGE
        if not all(low <= abs(scale) <= high for scale in self.scales):
            raise ParameterError(
                f'parameter {PREFIX}scales is {list(self.scales)}; allowed: {low:g} to {high:g} m '
                'of pull per rad or m of the joint, or as much below 0; a spool of 10 mm has 0.01')

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Self:
        """Return what checked parameters describe; raises ParameterError."""
        tendons = arm_from_parameters(values).tendon_names
        counted = f'the tendons are {", ".join(tendons)}'

        def each(name: str) -> tuple[Any, ...]:
            return spread(PREFIX + name, values[PREFIX + name], len(tendons), counted)

        names: tuple[str, ...] = values[PREFIX + 'joints']
        names = tendons if names == ('',) else names
        if len(names) != len(tendons) or len(set(names)) < len(names) or not all(names):
            raise ParameterError(f'parameter {PREFIX}joints is {list(names)}; needed: a different '
                                 f'joint for each of {", ".join(tendons)}')
        efforts: tuple[float, ...] = values[PREFIX + 'effort_scales']
        return cls(tendons, names, each('scales'), each('zeros'), values[PREFIX + 'absolute'],
                   efforts if efforts == (0.0,) else each('effort_scales'),
                   values['pull_limits'], values['speed_limit'])

    def pulls(self, positions: Sequence[float], zeros: Sequence[float]) -> tuple[float, ...]:
        """Return the pulls (m) at positions of the joints, with zeros, in their units."""
        return tuple(s * (p - z) for s, p, z in zip(self.scales, positions, zeros, strict=True))

    def positions(self, pulls: Sequence[float], zeros: Sequence[float]) -> tuple[float, ...]:
        """Return the positions of the joints at pulls (m), with zeros, in their units."""
        return tuple(p / s + z for s, p, z in zip(self.scales, pulls, zeros, strict=True))

    @property
    def tension_known(self) -> bool:
        """Whether efforts measure tensions."""
        return self.effort_scales != (0.0,)


class JointWatch:
    """
    Checks joint states, and raises HardwareError for implausible ones.

    positions: of the joints, in their units; None before the first state and after an implausible
    one.  zeros: positions at zero pull.  known: whether that is the straight arm.
    """

    def __init__(self, joints: Joints) -> None:
        """Begin without a state."""
        self.joints = joints
        self.positions: tuple[float, ...] | None = None
        self.zeros, self.known = joints.zeros, joints.absolute
        self.tensions: tuple[float, ...] | None = None
        self._stamp = 0.0  # of the last state, s
        self._window: deque[tuple[float, tuple[float, ...]]] = deque()
        """Time received (s) and positions since REST_TIME ago, and the last before that."""
        self._begin: tuple[float, tuple[float, ...]] | None = None
        """Stamp and positions since which velocities are compared with positions."""
        self._travelled = [0.0] * len(joints.tendons)  # m since then, by the velocities
        self._unlike = [0] * len(joints.tendons)  # how often in a row they differed too much

    @property
    def pulls(self) -> tuple[float, ...]:
        """Pulls of the last state, m."""
        assert self.positions is not None
        return self.joints.pulls(self.positions, self.zeros)

    def take(self, state: JointStates, stamp: float, now: float, missed: bool) -> None:
        """
        Take a state that was sent at ``stamp``, later than those before, and received ``now``.

        Both are s, on clocks of their own.  missed: whether others since the last one were lost.
        Raises HardwareError.
        """
        try:
            self._take(state, stamp, now, missed)
        except HardwareError:
            self.positions = None
            raise

    def _take(self, state: JointStates, stamp: float, now: float, missed: bool) -> None:
        joints = self.joints
        index = self._index(state)
        positions = self._of(state.position, index, 'position', state)
        if positions is None or not all(map(isfinite, positions)):
            raise HardwareError(
                f'joint states have the positions {_listed(positions or ())} for '
                f'{", ".join(joints.names)}; is the hardware active?')
        self._check_step(positions, stamp)
        self._check_range(positions)
        speeds = self._scaled(self._of(state.velocity, index, 'velocity', state), joints.scales)
        if speeds is None or missed or self._begin is None:
            self._begin, self._travelled = (stamp, positions), [0.0] * len(positions)
        else:
            self._compare(self._begin, positions, speeds, stamp)
        if joints.tension_known:
            self.tensions = self._scaled(self._of(state.effort, index, 'effort', state),
                                         joints.effort_scales)
            if self.tensions is None:
                raise HardwareError('joint states have no effort, or nan; set '
                                    f'{PREFIX}effort_scales to 0.0 where tension is not measured')
        self.positions, self._stamp = positions, stamp
        self._window.append((now, positions))
        while len(self._window) > 2 and self._window[1][0] <= now - REST_TIME:
            self._window.popleft()

    def _index(self, state: JointStates) -> list[int]:
        """Return where the joints are in a state."""
        names = list(state.name)
        wrong = [name for name in self.joints.names if names.count(name) != 1]
        if wrong:
            raise HardwareError(
                f'joint states must have {", ".join(wrong)} exactly once; they have '
                f'{_listed(names)}; correct {PREFIX}joints')
        return [names.index(name) for name in self.joints.names]

    def _of(self, values: Sequence[float], index: Sequence[int], field: str, state: JointStates
            ) -> tuple[float, ...] | None:
        """Return the values of the joints, None where the field is empty."""
        if not len(values):
            return None
        if len(values) != len(state.name):
            raise HardwareError(f'joint states have {len(values)} values in {field} and '
                                f'{len(state.name)} names')
        return tuple(float(values[i]) for i in index)

    def _scaled(self, values: tuple[float, ...] | None, scales: tuple[float, ...]
                ) -> tuple[float, ...] | None:
        if values is None or not all(map(isfinite, values)):
            return None  # ros2_control has nan for values that the hardware does not report
        return tuple(s * v for s, v in zip(scales, values, strict=True))

    def _check_step(self, positions: tuple[float, ...], stamp: float) -> None:
        if self.positions is None:
            return
        allowed = JUMP + JUMP_SPEED * self.joints.speed_limit * (stamp - self._stamp)
        steps = self.joints.pulls(positions, self.positions)
        for name, step in zip(self.joints.tendons, steps, strict=True):
            if abs(step) > allowed:
                raise HardwareError(
                    f'{name} jumped by {1e3 * step:.1f} mm in {stamp - self._stamp:.3f} s; '
                    f'speed_limit is {1e3 * self.joints.speed_limit:g} mm/s: its joint has lost '
                    f'its position, or reports in another unit than its commands ({PREFIX}scales)')

    def _check_range(self, positions: tuple[float, ...]) -> None:
        joints = self.joints
        pulls = joints.pulls(positions, self.zeros if self.known else joints.zeros)
        low, high = joints.pull_limits
        margin = (ZERO_MARGIN if self.known else SOUGHT_MARGIN) * (high - low)
        for tendon, name, position, pull in zip(joints.tendons, joints.names, positions, pulls,
                                                strict=True):
            if not low - margin <= pull <= high + margin:
                raise HardwareError(
                    f'{name} reports {position:.4g}, a pull of {1e3 * pull:.1f} mm for {tendon}; '
                    f'pull_limits: {1e3 * low:g} to {1e3 * high:g} mm; check the unit (rad, m) '
                    f'and {PREFIX}scales, and set {PREFIX}zeros to what the joints report when '
                    'the arm is straight')

    def _compare(self, begin: tuple[float, tuple[float, ...]], positions: tuple[float, ...],
                 speeds: tuple[float, ...], stamp: float) -> None:
        """Compare travel by velocities with travel by positions; some nodes report zeros."""
        passed = stamp - self._stamp
        self._travelled = [t + v * passed for t, v in zip(self._travelled, speeds, strict=True)]
        if stamp - begin[0] < COMPARED_TIME:
            return
        for i, (moved, travelled) in enumerate(zip(
                self.joints.pulls(positions, begin[1]), self._travelled, strict=True)):
            if max(abs(moved), abs(travelled)) < COMPARED_MOTION or not travelled:
                continue
            unlike = not 1.0 / MAX_RATIO < travelled / (moved or REST_BAND) < MAX_RATIO
            self._unlike[i] = (self._unlike[i] + 1) * unlike
            if self._unlike[i] == MAX_UNLIKE:
                raise HardwareError(
                    f'{self.joints.tendons[i]} moved by {1e3 * moved:.2f} mm in '
                    f'{stamp - begin[0]:.1f} s, but by {1e3 * travelled:.2f} mm according to the '
                    'velocities; give both in one unit, or leave velocity empty where it is not '
                    'measured')
        self._begin, self._travelled = (stamp, positions), [0.0] * len(positions)

    @property
    def received(self) -> float:
        """Time at which the last state was received, s."""
        return self._window[-1][0]

    @property
    def watched(self) -> bool:
        """Whether states of REST_TIME were received, enough to detect rest."""
        return bool(self._window) and self._window[-1][0] - self._window[0][0] >= REST_TIME

    def rests(self, since: float) -> bool:
        """Return whether no joint moved in states of REST_TIME, all after ``since`` (s)."""
        if not self._window:
            return False
        last = self._window[-1][0]  # without new states rest is unknown
        if last - since < REST_TIME or not self.watched:
            return False
        columns = zip(*(positions for _, positions in self._window), strict=True)
        return all(abs(scale) * (max(column) - min(column)) <= REST_BAND
                   for scale, column in zip(self.joints.scales, columns, strict=True))

    def speeds(self) -> tuple[float, ...]:
        """Return the speeds of tendons that do not all rest, m/s: never all of them zero."""
        (first, old), (last, new) = self._window[0], self._window[-1]
        speeds = tuple(way / max(last - first, REST_TIME) for way in self.joints.pulls(new, old))
        if not any(speeds):  # not at rest, even if no joint has moved yet
            return (REST_BAND / REST_TIME,) * len(new)
        return speeds

    def describe(self) -> str:
        """Return where the tendons are, for people."""
        return describe_pulls(self.joints.tendons, self.pulls)


def _listed(items: Sequence[object]) -> str:
    shown = ', '.join(f'{item:.4g}' if isinstance(item, float) else str(item)[:40]
                      for item in items[:MAX_LISTED])
    return (shown or 'none') + (f' and {len(items) - MAX_LISTED} more'
                                if len(items) > MAX_LISTED else '')
