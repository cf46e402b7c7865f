# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Plans for arms in space: each segment bends straight to its goal, with the least tensions.

Between where a segment is and its goal, bending is a straight line of rotation vectors.  For every
point on it the model, under gravity, gives the pulls with the least tensions; tendons that do not
carry follow with a little slack, as in the plane.  Without jamming all segments are soft and go to
their goals at once.
"""

from collections.abc import Callable, Sequence
from math import ceil

import numpy as np

from soft_continuum.mechanics.chain import Array, SLACK
from soft_continuum.mechanics.spatial.arm import SpatialArm
from soft_continuum.mechanics.spatial.chain import SpatialEquilibrium
from soft_continuum.mechanics.spatial.inverse import BendingFit, pulls_that_hold
from soft_continuum.mechanics.spatial.statics import SpatialStatics
from soft_continuum.mechanics.statics import SLACK_ALLOWANCE
from soft_continuum.sequencing.planner import (
    Move,
    PlanError,
    PlanSettings,
    ShapePlanner,
)

LEAN = 0.1  # rad that a segment may lean over when it becomes soft, until its tendons hold it


class SpatialPlanner(ShapePlanner):
    """Plans shapes for one spatial arm."""

    statics: SpatialStatics

    def __init__(self, arm: SpatialArm, settings: PlanSettings,
                 abandoned: Callable[[], bool] = lambda: False,
                 offsets: Sequence[float] | None = None) -> None:
        """Prepare the model of ``arm``; the others are those of ShapePlanner."""
        super().__init__(arm, settings, abandoned, offsets)
        self.statics = SpatialStatics(arm)

    def move(self, state: SpatialEquilibrium, start: Array, segment: int, goal: Array
             ) -> tuple[Move, SpatialEquilibrium]:
        """Plan one segment, or WHOLE_ARM, as ShapePlanner."""
        soft = self._soft(segment)
        bent = self.softened(state, start, segment)
        if bent.jumped and np.abs(bent.bending - state.bending).max() > LEAN:
            raise PlanError('when it becomes soft, the arm goes over to another shape: its '
                            'tendons do not hold it; pull them in, or straighten the arm by '
                            '`soft_continuum home`')
        present, tension = bent.bending, float(bent.tensions.max())
        chosen = self.statics.chain.arm.bending_axes & np.array(soft)[:, None]
        change = np.where(chosen, goal - present, np.nan)
        most = np.linalg.norm(np.nan_to_num(change), axis=1).max()
        steps = max(1, ceil(most / self.settings.angle_step))
        points = [start]
        for part in np.arange(1, steps + 1) / steps:
            self.check_wanted()
            fit = pulls_that_hold(self.statics, bent, present + part * change, soft)
            bent = fit.state
            tension = max(tension, float(bent.tensions.max()))
            points.append(self._with_slack(fit))
        pulls = np.array(points)
        self.check_limits(pulls, tension)
        end = self.held(bent, pulls[-1], segment)
        times, pulls = self._timed(pulls)
        angle = float(np.linalg.norm(goal, axis=1)[soft].max())
        return Move(segment, angle, times, pulls, tension), end

    def bent(self, state: SpatialEquilibrium, segment: int, goal: Array) -> SpatialEquilibrium:
        """Return the state at the end of a move as ShapePlanner."""
        soft = self._soft(segment)
        wanted = np.where(np.array(soft)[:, None], goal, np.nan)
        return pulls_that_hold(self.statics, state, wanted, soft).state

    def _with_slack(self, fit: BendingFit) -> Array:
        """Return the pulls of the motors, with slack in the tendons that do not carry."""
        carries = fit.pulls != SLACK
        # Where none carries, all hold the arm, but as just taut as motors are they fight.
        slack = self.settings.antagonist_slack if carries.any() else SLACK_ALLOWANCE
        pulls: Array = np.where(carries, fit.pulls, fit.state.pulls - slack) - self._offsets
        return pulls
