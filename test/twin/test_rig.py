# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The plant in real time on a computer that is late."""

import pytest

from soft_continuum.parameters.files import load_arm
from soft_continuum.twin.model_errors import read_model_errors
from soft_continuum.twin.plant import TIME_STEP
from soft_continuum.twin.rig import MAX_LATENESS, PERIOD, TwinRig
from soft_continuum.user_files import description_file

PAUSE, ROUNDS = 0.5, 40


class LateClock:
    """The computer stands still for PAUSE before the first look at the boards."""

    def __init__(self):
        self.now, self.times = 0.0, []

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        self.times.append(self.rig.plant.time)
        self.now += seconds if len(self.times) > 1 else PAUSE
        self.rig._closing = len(self.times) == ROUNDS


def test_a_late_plant_makes_up_for_it_and_keeps_its_sensors_waiting_for_20_ms_only():
    clock = LateClock()
    clock.rig = rig = TwinRig(
        load_arm(description_file()),
        read_model_errors(description_file().with_name('twin.yaml'), 'ideal'), clock=clock)
    rig._run()
    passed = [b - a for a, b in zip(clock.times, clock.times[1:], strict=False)]
    assert max(passed) == pytest.approx(0.02)
    assert rig.lost == pytest.approx(PAUSE - MAX_LATENESS)
    assert rig.plant.time == pytest.approx(clock.now - rig.lost, abs=TIME_STEP + PERIOD)
