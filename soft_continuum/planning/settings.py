# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How sequences are run, corrected and planned: the settings, and the parameters that set them."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, pi, radians
from typing import Any

from soft_continuum.parameters.parameter import (
    Parameter,
    ParameterError,
    setting,
    setting_parameters,
    settings_from,
)

ON_ANOMALY = GO_ON, PAUSE, ABORT = ('go_on', 'pause', 'abort')
REPLAN = 'replan'
ON_OBSTACLE = (REPLAN, ABORT)
DEAD_BAND = 5e-5  # m
LOCK_IN_STDDEV = 0.006  # rad


@dataclass(frozen=True)
class MotionLimits:
    """
    Limits of planned motions.

    pull_limits: m.  tension_limit: N.  antagonist_slack: m left in a tendon that does not carry
    the arm.  speed, acceleration: of the fastest tendon, m/s and m/s^2.
    """

    pull_limits: tuple[float, float] = (-0.06, 0.06)
    tension_limit: float = 60.0
    antagonist_slack: float = 0.0005
    speed: float = 0.015
    acceleration: float = 0.1


@dataclass(frozen=True)
class LoopSettings:
    """When measurements are used, and the number of corrections, by parameters ``loop.*``."""

    settling_time: float = setting(
        1.2, 'time for the arm to come to rest after a motion or a change of stiffness', 0.0, 60.0,
        unit='s')
    measuring_time: float = setting(
        0.5, 'time over which the arm at rest is measured', 0.0, 60.0, unit='s')
    sensor_timeout: float = setting(
        3.0, 'age at which a measurement is stale', 0.1, 60.0, unit='s')
    max_corrections: int = setting(
        3, 'maximum number of corrections of one segment before it is stiffened', 0, 20)
    max_passes: int = setting(
        2, 'maximum number of passes over all segments; later segments and passes correct the '
        'shifts that stiffening causes', 1, 10)
    abort_when_lost: bool = setting(
        True, 'end the sequence when measurements stop during it; otherwise it continues open '
        'loop')
    on_anomaly: str = setting(
        GO_ON, 'reaction of a sequence to an anomaly that kinematics reports: go on, abort, or '
        'pause at rest until this parameter is changed or the goal is canceled',
        choices=ON_ANOMALY)
    tip_tolerance: float = setting(
        2e-3, 'aim on the tip: error of the tip, or drift from its position when first held, '
        'above which the status warns', 1e-4, 1.0, unit='m')
    angle_tolerance: float = setting(
        0.02, 'aim on angles: error of bending angles, or drift from their values when first '
        'held, above which the status warns', 1e-3, 1.0, unit='rad')
    correct_drift: bool = setting(
        False, 'set segments again when a held shape drifts by more than loop.tip_tolerance or '
        'loop.angle_tolerance')
    release_limit: float = setting(
        0.01, 'tip displacement above which a loaded segment is not softened to correct drift',
        0.0, 1.0, unit='m')


@dataclass(frozen=True)
class RunnerSettings:
    """
    Deadlines and tolerances.

    jamming_timeout, settle_timeout: s.  settle_tolerance: m, or more if a tendon positions less
    accurately.  soft_vacuum: Pa below ambient up to which a segment is soft. full_vacuum: Pa that
    regulators hold in a stiff segment.  vacuum_tolerance: Pa that a vacuum may differ from the
    set-point of its regulator.  horizon: s of motion sent ahead; the tendons stop this long after
    the sequencer ended.  retry: s between repeated requests.  jamming: whether segments are
    switched.  piece_period: s between two pieces of a motion, each of which tendon_actuation has
    to check.  on_obstacle: what to do when an obstacle blocks a motion; one of ON_OBSTACLE.
    max_replans: number of times that one shape is planned again.
    """

    jamming_timeout: float = 10.0
    settle_timeout: float = 5.0
    settle_tolerance: float = 2e-5
    soft_vacuum: float = 10e3
    full_vacuum: float = 80e3
    vacuum_tolerance: float = 3e3
    horizon: float = 0.5
    retry: float = 2.0
    jamming: bool = True
    piece_period: float = 0.0
    on_obstacle: str = REPLAN
    max_replans: int = 3


@dataclass(frozen=True)
class ReachSettings:
    """
    Limits, costs and budget of plans, by parameters ``reach.*``.

    margin: m that the arm stays away from every obstacle.  lock_in: rad by which a segment may
    bend when it is stiffened, which needs extra clearance.
    """

    states: int = setting(
        10_000, 'number of states of the arm evaluated in the search for a better plan to a tip '
        'goal; the first plan found is enough to accept the goal', 10, 100_000_000,
        read_only=False)
    time_limit: float = setting(
        120.0, 'maximum duration of a search, however slow the machine is; a search that reaches '
        'it reports so', 0.1, 600.0, read_only=False, unit='s')
    max_softenings: int = setting(
        6, 'maximum number of softenings in a plan to a tip goal', 1, 50, read_only=False)
    weights: tuple[float, ...] = setting(
        (0.0,), 'costs of a softening, a second and a newton of tension; 0.0 alone: fewest '
        'softenings, then least time, then least tension', 0.0, 1e6)
    seed: int = setting(
        0, 'seed of the random search; the same seed gives the same plan on every machine, unless '
        'reach.time_limit ends the search', 0, 1_000_000, read_only=False)
    softening_time: float = setting(
        4.0, 'time to soften a segment and stiffen it again, as assumed when plans are compared',
        0.0, 600.0, read_only=False, unit='s')
    margin: float = 0.005
    lock_in: float = LOCK_IN_STDDEV

    def __post_init__(self) -> None:
        """Refuse invalid numbers; raises ParameterError."""
        for name, low in (('margin', 0.0), ('lock_in', 0.0), ('softening_time', 0.0),
                          ('states', 0), ('time_limit', 0.0), ('max_softenings', 1)):
            value = getattr(self, name)
            if not value >= low or (name != 'time_limit' and not isfinite(value)):
                raise ParameterError(f'{name} is {value}; allowed: {low:g} and more')
        weights = self.weights
        if not (len(weights) == 3 and any(weights) or tuple(weights) == (0.0,)) or not all(
                isfinite(weight) and weight >= 0.0 for weight in weights):
            raise ParameterError(
                f'parameter reach.weights is {list(weights)}; needed: three numbers, the costs of '
                'a softening, a second and a newton, none below 0 and one above; or 0.0 alone')


LOOP_PARAMETERS = (
    Parameter('closed_loop', True, 'correct every segment with measurements while they are '
              'available', read_only=False),
    *setting_parameters(LoopSettings, 'loop', read_only=False),
    Parameter('loop.dead_band', DEAD_BAND, 'corrections that move every tendon by less are not '
              'sent: friction absorbs them', 0.0, 0.01, read_only=False, unit='m'),
    Parameter('loop.lock_in_stddev', LOCK_IN_STDDEV,
              'standard deviation of the angle that a segment bends when it is stiffened; '
              'repeating cannot improve on it', 0.0, 0.2, read_only=False, unit='rad'),
)
REACH_PARAMETERS = (
    Parameter('reach.position_tolerance', 1e-3, 'position tolerance of tip goals that give none',
              1e-5, 0.5, read_only=False, unit='m'),
    Parameter('reach.angle_tolerance', radians(2.0), 'orientation tolerance of tip goals that '
              'give none', 1e-4, pi, read_only=False, unit='rad'),
    *setting_parameters(ReachSettings, 'reach'),
    Parameter('reach.max_deviation', 0.02, 'deviation of the arm from its plan above which it is '
              'planned again; smaller near obstacles, but never below obstacles.margin', 1e-3,
              1.0, read_only=False, unit='m'),
    Parameter('reach.max_replans', 3, 'maximum number of times that a shape is planned again '
              'during its motion before the goal is aborted', 0, 100, read_only=False),
    Parameter('obstacles.margin', ReachSettings.margin, 'minimum distance of the arm from '
              'obstacles', 0.0, 1.0, read_only=False, unit='m'),
    Parameter('obstacles.on_change', REPLAN, 'reaction of a sequence to an obstacle that blocks '
              'its motion: stop and plan again, or abort; changes apply from the next goal',
              choices=ON_OBSTACLE,
              read_only=False),
)


def loop_from_parameters(parameters: Mapping[str, Any]) -> LoopSettings:
    """Return the settings from parameters ``loop.*``."""
    return settings_from(LoopSettings, 'loop', parameters)


def reach_from_parameters(values: Mapping[str, Any]) -> ReachSettings:
    """Return the settings for planning to tip goals; raises ParameterError for invalid weights."""
    return settings_from(
        ReachSettings, 'reach', values, margin=values['obstacles.margin'],
        lock_in=values['loop.lock_in_stddev'] if values['arm.jamming'] else 0.0)
