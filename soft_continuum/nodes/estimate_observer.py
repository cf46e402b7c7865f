# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arm as servo observes it: ArmObserver with the times of shape and measurements."""

from dataclasses import dataclass
from typing import Any

from soft_continuum.hardware.clock import STEADY
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.nodes.arm_observer import ArmObserver
from soft_continuum_interfaces.msg import KinematicsState


@dataclass(frozen=True)
class Estimate:
    """A shape of the arm, its time, and the time of the last measurement, s (steady) or None."""

    shape: Equilibrium
    time: float
    measured_time: float | None


class EstimateObserver(ArmObserver):
    """ArmObserver with the times of shape and measurements."""

    def __init__(self, node: Any, *arguments: Any) -> None:
        """Subscribe."""
        self.estimate: Estimate | None = None
        super().__init__(node, *arguments)

    def _on_shape(self, message: KinematicsState) -> None:
        before = self._reported
        super()._on_shape(message)
        if self._reported is None or self._reported is before:
            return
        now = STEADY()
        time, measured = self._ros_time.steady(message.stamp), self.measured
        self.estimate = Estimate(self._reported[0], now if time is None else min(time, now),
                                 None if measured is None else min(measured, now))
