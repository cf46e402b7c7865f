# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tensions along a trajectory, as predicted by the model."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from soft_continuum.hardware.tendon_controller import MotionRefusedError, Reason
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.mechanics.statics import SLACK_ALLOWANCE, Statics

PREDICTION_STEP = 0.002  # m of pull between two predicted states
MAX_STATES = 2000
"""States predicted for one trajectory; one takes some milliseconds."""


@dataclass(frozen=True)
class TensionLimits:
    """
    Limits of predicted tension: of any tendon, and of opposing tendons at once, N.

    Tendons that end at one disc oppose each other if the backbone is between them: their common
    tension bends nothing.
    """

    any_tendon: float
    at_once: float


class TensionPrediction:
    """Predicts tensions along trajectories, and refuses those that exceed the limits."""

    def __init__(self, arm: Arm) -> None:
        """Prepare the model of ``arm``, which is compiled on first use."""
        self._statics: Statics = Statics(arm)
        self._tendons = arm.tendon_names
        self.opposing = arm.opposing_tendons
        """Numbers of the tendons that oppose each other, in groups."""
        self.chain = self._statics.chain

    @staticmethod
    def steps(pulls: Array) -> list[int]:
        """
        Return how many states are predicted between the points of pulls (k, tendons) in m.

        Raises MotionRefusedError when they are more than MAX_STATES.
        """
        moves = np.abs(np.diff(pulls, axis=0)).max(axis=1)
        steps: list[int] = np.maximum(1, np.ceil(moves / PREDICTION_STEP)).astype(int).tolist()
        if sum(steps) > MAX_STATES:
            raise MotionRefusedError(
                Reason.INVALID,
                f'{len(pulls)} points with {moves.sum():.3f} m of pull take {sum(steps)} '
                f'predicted states; allowed: {MAX_STATES}; send it in parts')
        return steps

    def check(self, pulls: Array, shape: Equilibrium, soft: Sequence[bool],
              limits: TensionLimits, revoked: Callable[[], bool]) -> None:
        """
        Refuse pulls (k, tendons) in m that exceed the tension limits or have no equilibrium.

        pulls: including the offsets of the tendons.  shape: best estimate of the initial shape.
        soft: per segment.  Ends early once ``revoked``.  Raises MotionRefusedError.
        """
        state, vacuum = shape, shape.vacuum or None
        if self._statics.chain.arm is not shape.chain.arm:
            self._statics = Statics(shape.chain.arm)
        try:
            for before, after, steps in zip(
                    pulls[:-1], pulls[1:], self.steps(pulls), strict=True):
                sliding = np.sign(after - before).astype(int).tolist()
                for part in np.arange(1, steps + 1) / steps:
                    if revoked():
                        return
                    wanted = before + part * (after - before)
                    state = self._statics.solve(
                        state, wanted - SLACK_ALLOWANCE, soft, vacuum=vacuum, sliding=sliding)
                    self._check(wanted, np.asarray(state.tensions), limits)
        except StaticsError as error:
            raise MotionRefusedError(Reason.TENSION, str(error)) from None

    def _check(self, pulls: Array, tensions: Array, limits: TensionLimits) -> None:
        at_once = max((tensions[which].min() for which in self.opposing), default=0.0)
        if tensions.max() > limits.any_tendon or at_once > limits.at_once:
            predicted = ', '.join(
                f'{name} {pull * 1e3:.2f} mm: {tension:.1f} N' for name, pull, tension
                in zip(self._tendons, pulls, tensions, strict=True))
            raise MotionRefusedError(
                Reason.TENSION,
                f'the motion would need excessive tensions, at {predicted}; tension_limit: '
                f'{limits.any_tendon:g} N, co_contraction_limit (opposing tendons at once): '
                f'{limits.at_once:g} N')
