# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of plans by tip and among obstacles."""

from collections.abc import Mapping
from math import pi, radians
from typing import Any, TYPE_CHECKING

from soft_continuum.parameters.parameter import Parameter, ParameterError
from soft_continuum.sequencing.loop_settings import ON_OBSTACLE, REPLAN

if TYPE_CHECKING:  # with it all of mechanics would be loaded
    from soft_continuum.sequencing.reach import ReachSettings

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
    Parameter('reach.departure', 0.02, 'how far the arm may be from its plan before it is planned '
              'again; near an obstacle less, but never less than obstacles.margin', 1e-3, 1.0,
              read_only=False, unit='m'),
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


def reach_from_parameters(values: Mapping[str, Any]) -> 'ReachSettings':
    """Return the settings of plans by tip; raises ParameterError for weights that are none."""
    from soft_continuum.sequencing.reach import ReachSettings
    weights = tuple(values['reach.weights'])
    if len(weights) not in (1, 3) or (len(weights) == 1) != (not any(weights)):
        raise ParameterError(
            f'parameter reach.weights is {list(weights)}; needed: three numbers, what a '
            'softening, a second and a newton cost, one above 0; or 0.0 alone')
    return ReachSettings(
        margin=values['obstacles.margin'],
        lock_in=values['loop.lock_in_deviation'] if values['arm.jamming'] else 0.0,
        softening_time=values['reach.softening_time'], states=values['reach.states'],
        time_limit=values['reach.time_limit'],
        max_softenings=values['reach.max_softenings'],
        weights=None if len(weights) == 1 else weights,
        seed=values['reach.seed'])
