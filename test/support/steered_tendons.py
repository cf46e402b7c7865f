# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The control of the tendons, on simulated ones, with a clock of its own."""

from unittest.mock import Mock

import numpy as np
import pytest

from soft_continuum.hardware.simulated_tendons import SimulatedTendons
from soft_continuum.hardware.tendon_controller import TendonController, TendonLimits
from soft_continuum.nodes import tendon_control
from soft_continuum.nodes.tendon_control import Report, Request, TendonControl

PERIOD = 0.02  # s
TENDONS = ('right_tendon', 'left_tendon')
TIMES = np.linspace(0.0, 1.0, 11)
PATH = np.stack([0.02 * TIMES, -0.02 * TIMES**2], axis=1)
"""Far from the straight line between its ends."""


class Steered:
    """A TendonControl on simulated tendons, with a clock of its own."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        self.reported: list[tuple[float, tuple[float, ...]]] = []
        """When a reading was reported, s, and its pulls, m."""
        monkeypatch.setattr(tendon_control, 'STEADY', lambda: self.now)
        arm = Mock(stiffness=None)
        arm.motion_interlock.return_value = None
        driver = SimulatedTendons(lambda: self.now, TENDONS, 1.0, 100.0, 1e-6)
        self.controller = TendonController(
            driver, TendonLimits(TENDONS, (-0.06, 0.06), 0.1))
        self.control = TendonControl(
            TENDONS, arm, PERIOD, lambda: 0.0, lambda: 60.0, self._report, Mock())
        self.control.attach(self.controller)
        self.control.activate()
        self.start = self.now  # of the motion, as its sender has it
        self.pulls = [self.controller.reading.pulls]

    def _report(self, report: Report) -> None:
        if report.reading is not None:
            self.reported.append((report.time, tuple(report.reading.pulls)))

    def send(self, begin: float, end: float, motion: str = 'a motion') -> None:
        """Send the part of the motion between two times (s)."""
        part = (begin - 1e-9 <= TIMES) & (end + 1e-9 >= TIMES)
        self.control.follow(Request(
            motion, TIMES[part], PATH[part], self.start, self.control.revocations, 1), None)

    def go_on(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            self.control.cycle(0.0)
            self.pulls.append(self.controller.reading.pulls)

    def assert_path_kept(self) -> None:
        """Claim that the tendons went the whole way, never far from the path."""
        right, left = np.array(self.pulls).T
        assert (right[-1], left[-1]) == pytest.approx(PATH[-1], abs=1e-5)
        assert left == pytest.approx(np.interp(right, *PATH.T), abs=3e-4)
