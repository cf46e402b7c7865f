# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arm as servo observes it: besides what ArmObserver has, the times of its shape."""

from dataclasses import dataclass
from typing import Any

from soft_continuum.hardware.clock import STEADY
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.nodes.arm_observer import ArmObserver
from soft_continuum_interfaces.msg import KinematicsState


@dataclass(frozen=True)
class Estimate:
    """A shape of the arm, when it had it, and when it was measured last, s (steady) or None."""

    shape: Equilibrium
    time: float
    measured_time: float | None


class EstimateObserver(ArmObserver):
    """The arm as ArmObserver has it, and the times of its shape."""

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
