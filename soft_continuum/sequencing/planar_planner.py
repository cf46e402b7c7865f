# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans for planar arms: one tendon carries a segment to its goal, the others follow."""

from collections.abc import Callable, Sequence
from math import ceil

import numpy as np

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Array, Equilibrium
from soft_continuum.mechanics.statics import Statics
from soft_continuum.sequencing.planner import Move, PlanSettings, ShapePlanner


class Planner(ShapePlanner):
    """Plans shapes for one planar arm, whose segments jam."""

    statics: Statics

    def __init__(self, arm: Arm, settings: PlanSettings,
                 abandoned: Callable[[], bool] = lambda: False,
                 offsets: Sequence[float] | None = None) -> None:
        """Prepare the model of ``arm``; the others are those of ShapePlanner."""
        super().__init__(arm, settings, abandoned, offsets)
        self.statics = Statics(arm)

    def move(self, state: Equilibrium, start: Array, segment: int, goal: Array
             ) -> tuple[Move, Equilibrium]:
        """Plan one segment as ShapePlanner."""
        angle = float(goal[segment, 1])
        vacuum = state.vacuum or None  # of the jams that stay stiff
        softened = self.softened(state, start, segment)
        present = softened.bending_angles[segment]
        steps = max(1, ceil(abs(angle - present) / self.settings.angle_step))
        # One tendon is pulled in, the other paid out: the side that the segment turns to.
        turn = int(np.sign(angle - present))
        sliding = (turn, -turn)
        points, tension = [start], float(softened.tensions.max())
        bent = softened
        for target in np.linspace(present, angle, steps + 1)[1:]:
            self.check_wanted()
            bent = self.statics.bend(
                bent, segment, float(target), vacuum=vacuum, sliding=sliding)
            tension = max(tension, float(bent.tensions.max()))
            points.append(self._with_slack(bent, sliding))
        pulls = np.array(points)
        self.check_limits(pulls, tension)
        end = self.held(bent, pulls[-1], segment, sliding)
        times, pulls = self._timed(pulls)
        return Move(segment, angle, times, pulls, tension, sliding), end

    def bent(self, state: Equilibrium, segment: int, goal: Array) -> Equilibrium:
        """Return the state at the end of a move as ShapePlanner."""
        angle = float(goal[segment, 1])
        turn = int(np.sign(angle - state.bending_angles[segment]))
        return self.statics.bend(state, segment, angle, vacuum=state.vacuum or None,
                                 sliding=(turn, -turn))

    def _with_slack(self, bent: Equilibrium, sliding: Sequence[int]) -> Array:
        """Return the pulls of a bent state with slack in the tendons that do not carry it."""
        pulls = self.statics.commanded_pulls(bent, sliding) - self._offsets
        if bent.tensions.max() > 0.0:  # where none carries, all hold the arm
            others = np.arange(len(pulls)) != np.argmax(bent.tensions)
            pulls[others] -= self.settings.antagonist_slack
        return pulls
