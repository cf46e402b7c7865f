# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How sequences are run, corrected and planned: the settings, and the parameters that set them."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import pi, radians
from typing import Any, TYPE_CHECKING

from soft_continuum.parameters.parameter import Parameter, ParameterError

if TYPE_CHECKING:  # with it all of mechanics would be loaded
    from soft_continuum.sequencing.reach import ReachSettings

ON_ANOMALY = GO_ON, PAUSE, ABORT = ('go_on', 'pause', 'abort')
REPLAN = 'replan'
ON_OBSTACLE = (REPLAN, ABORT)
DEAD_BAND = 5e-5  # m
LOCK_IN_STDDEV = 0.006  # rad


@dataclass(frozen=True)
class LoopSettings:
    """
    Timing of measurements, and limits of corrections.

    settling_time: s after a motion or a switch until the arm rests.  measuring_time: s for which
    it is then measured.  sensor_timeout: s after which measurements have stopped.
    max_corrections: of one segment before it is stiffened.  max_passes: over all segments.
    abort_when_lost: end the run when measurements stop; otherwise it continues as predicted.
    on_anomaly: reaction to an anomaly of the arm; one of ON_ANOMALY.  tip_tolerance,
    angle_tolerance: m and rad, error or drift of the aim that causes a warning.  correct_drift:
    set segments again after a drift.  release_limit: m by which the tip may move when one of them
    is softened for that.
    """

    settling_time: float = 1.2
    measuring_time: float = 0.5
    sensor_timeout: float = 3.0
    max_corrections: int = 3
    max_passes: int = 2
    abort_when_lost: bool = True
    on_anomaly: str = GO_ON
    tip_tolerance: float = 2e-3
    angle_tolerance: float = 0.02
    correct_drift: bool = False
    release_limit: float = 0.01


@dataclass(frozen=True)
class RunnerSettings:
    """
    Deadlines and tolerances.

    jamming_timeout, settle_timeout: s.  settle_tolerance: m, or more if a tendon cannot reach it.
    soft_vacuum: Pa below ambient up to which a segment is soft.
    full_vacuum: Pa, that regulators hold in a stiff segment.  vacuum_tolerance: Pa, of a vacuum
    from its set-point.  horizon: s of motion sent ahead, after which the tendons stop if the
    sequencer ends.  retry: s between repeated requests.  jamming: whether segments are switched.
    piece_period: s between two pieces of a motion, each of which tendon_actuation validates.
    on_obstacle: reaction to an obstacle in the way; one of ON_OBSTACLE.  max_replans: of one
    shape.
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


LOOP_PARAMETERS = (
    Parameter('closed_loop', True, 'correct every segment by measurements, as long as there are '
              'any', read_only=False),
    Parameter('loop.settling_time', LoopSettings.settling_time, 'time after a motion, or a change '
              'of stiffness, until the arm rests', 0.0, 60.0, read_only=False, unit='s'),
    Parameter('loop.measuring_time', LoopSettings.measuring_time,
              'time for which the arm is measured then', 0.0, 60.0, read_only=False, unit='s'),
    Parameter('loop.sensor_timeout', LoopSettings.sensor_timeout,
              'time without a measurement after which there is none', 0.1, 60.0, read_only=False,
              unit='s'),
    Parameter('loop.max_corrections', LoopSettings.max_corrections,
              'corrections of one segment before it is stiffened', 0, 20, read_only=False),
    Parameter('loop.max_passes', LoopSettings.max_passes, 'how often a shape is gone through: '
              'later segments, and more passes, make up for what stiffening shifted', 1, 10,
              read_only=False),
    Parameter('loop.abort_when_lost', LoopSettings.abort_when_lost, 'end the sequence when '
              'measurements stop in the middle of it; otherwise it goes on as predicted',
              read_only=False),
    Parameter('loop.on_anomaly', LoopSettings.on_anomaly, 'what a sequence does when kinematics '
              'reports that something is wrong with the arm: go on, abort, or pause, at rest, '
              'until this parameter is changed or the goal canceled', choices=ON_ANOMALY,
              read_only=False),
    Parameter('loop.tip_tolerance', LoopSettings.tip_tolerance, 'distance of the tip, when that '
              'is the aim, from where it should be or was when it was first held, beyond which '
              'the status warns', 1e-4, 1.0, read_only=False, unit='m'),
    Parameter('loop.angle_tolerance', LoopSettings.angle_tolerance, 'the same of bending angles',
              1e-3, 1.0, read_only=False, unit='rad'),
    Parameter('loop.correct_drift', LoopSettings.correct_drift, 'set segments again when a shape '
              'drifts by more than that while it is held', read_only=False),
    Parameter('loop.release_limit', LoopSettings.release_limit, 'a segment that carries so much '
              'that softening it would move the tip farther is never softened to correct a drift',
              0.0, 1.0, read_only=False, unit='m'),
    Parameter('loop.dead_band', DEAD_BAND, 'a correction that moves no tendon by more is not '
              'sent: friction does not let it through', 0.0, 0.01, read_only=False, unit='m'),
    Parameter('loop.lock_in_stddev', LOCK_IN_STDDEV,
              'standard deviation of the angle by which a segment bends when it is stiffened: '
              'what setting it again cannot better', 0.0, 0.2, read_only=False, unit='rad'),
)
REACH_PARAMETERS = (
    Parameter('reach.position_tolerance', 1e-3, 'how far the tip may be from its '
              'goal, where the goal does not tell', 1e-5, 0.5, read_only=False, unit='m'),
    Parameter('reach.angle_tolerance', radians(2.0), 'how far the tip may be turned from its '
              'goal, where the goal does not tell', 1e-4, pi, read_only=False, unit='rad'),
    Parameter('reach.states', 10_000, 'how many states of the arm are judged in search of a '
              'better plan to a goal of the tip; before a goal is accepted the first one counts',
              10, 100_000_000, read_only=False),
    Parameter('reach.time_limit', 120.0, 'when a search ends at the latest, however slow the '
              'machine is; it says so then', 0.1, 600.0, read_only=False, unit='s'),
    Parameter('reach.max_softenings', 6, 'most softenings of one plan '
              'to a goal of the tip', 1, 50, read_only=False),
    Parameter('reach.weights', (0.0,), 'what a softening, a second and a newton of tension cost; '
              '0.0 alone: fewest softenings, then least time, then least tension', 0.0, 1e6),
    Parameter('reach.seed', 0, 'of what is drawn at random; the same seed has '
              'the same plan on every machine, unless reach.time_limit ends the search', 0,
              1_000_000, read_only=False),
    Parameter('reach.softening_time', 4.0, 'how long it takes to soften a segment and to stiffen '
              'it again, as plans compare their time', 0.0, 600.0, read_only=False, unit='s'),
    Parameter('reach.max_deviation', 0.02, 'how far the arm may be from its plan before it is '
              'planned again; near an obstacle less, but never less than obstacles.margin', 1e-3,
              1.0, read_only=False, unit='m'),
    Parameter('reach.max_replans', 3, 'how often a shape is planned again on its way before the '
              'goal ends', 0, 100, read_only=False),
    Parameter('obstacles.margin', 0.005, 'distance that the arm keeps from '
              'obstacles', 0.0, 1.0, read_only=False, unit='m'),
    Parameter('obstacles.on_change', REPLAN, 'what a sequence does when an obstacle comes into '
              'the way of a motion: stop it and plan again, or abort; counts from the next goal '
              'on',
              choices=ON_OBSTACLE,
              read_only=False),
)


def loop_from_parameters(parameters: Mapping[str, Any]) -> LoopSettings:
    """Return the settings in parameters ``loop.*``."""
    return LoopSettings(**{
        field.name: parameters[f'loop.{field.name}'] for field in fields(LoopSettings)})


def reach_from_parameters(values: Mapping[str, Any]) -> 'ReachSettings':
    """Return the settings of plans by tip; raises ParameterError for invalid weights."""
    from soft_continuum.sequencing.reach import ReachSettings
    weights = tuple(values['reach.weights'])
    if len(weights) not in (1, 3) or (len(weights) == 1) != (not any(weights)):
        raise ParameterError(
            f'parameter reach.weights is {list(weights)}; needed: three numbers, what a '
            'softening, a second and a newton cost, one above 0; or 0.0 alone')
    return ReachSettings(
        margin=values['obstacles.margin'],
        lock_in=values['loop.lock_in_stddev'] if values['arm.jamming'] else 0.0,
        softening_time=values['reach.softening_time'], states=values['reach.states'],
        time_limit=values['reach.time_limit'],
        max_softenings=values['reach.max_softenings'],
        weights=None if len(weights) == 1 else weights,
        seed=values['reach.seed'])
