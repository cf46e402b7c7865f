# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The calibration of regulators finds how fast and how true they are, and leaves all at 0."""

from dataclasses import replace
from math import exp, inf, log

import pytest

from soft_continuum.hardware.calibration import POLL_INTERVAL
from soft_continuum.hardware.jamming_controller import JammingSettings
from soft_continuum.hardware.regulator_calibration import assess_regulator, measure_regulator
from soft_continuum.hardware.simulated_jamming import JammingPlant, SimulatedRegulators
from support.virtual_clock import VirtualClock

SETTINGS, SOFT, PLANT = JammingSettings(), 10e3, JammingPlant()


class Skewed(SimulatedRegulators):
    """Regulators whose sensors show so much of the true vacuum."""

    share = 1.0

    def read(self):
        reading, ambient = super().read(), self._plant.ambient_pressure
        return replace(reading, pressures=tuple(
            ambient - self.share * (ambient - p) for p in reading.pressures))


def measured(share=1.0, plant=PLANT):
    clock = VirtualClock()
    driver = Skewed(clock, 2, plant, True, dead_band=0.0)
    driver.share = share
    result = measure_regulator(driver, 1, 2, SETTINGS, SOFT, clock)
    assert driver.read().vacuums == (0.0, 0.0)
    return result


def test_a_true_regulator_is_good_and_as_fast_as_it_is():
    result = measured()
    assert result.errors == pytest.approx((0.0, 0.0, 0.0), abs=1.0)
    near = SETTINGS.full_vacuum - SETTINGS.vacuum_tolerance
    begin = SOFT * exp(-POLL_INTERVAL / PLANT.venting_time)  # where it was taken to be soft
    least, most = (PLANT.evacuation_time * log(
        (PLANT.ultimate_vacuum - v) / (PLANT.ultimate_vacuum - near)) for v in (begin, 0.0))
    assert 0.5 * least < result.rise <= most + 2 * POLL_INTERVAL
    fastest, slowest = (PLANT.venting_time * log(v / SOFT) for v in (near, SETTINGS.full_vacuum))
    assert fastest <= result.fall <= slowest + 2 * POLL_INTERVAL
    assert not assess_regulator(result, SETTINGS)


def test_a_sensor_with_another_range_is_found_at_every_level():
    result = measured(share=0.9)
    assert result.errors == pytest.approx((-80e3 / 30, -80e3 / 15, -8e3), abs=50.0)
    assert any('-8.0 kPa off' in text for text in assess_regulator(result, SETTINGS))


def test_a_supply_that_is_too_weak_is_found():
    result = measured(plant=JammingPlant(ultimate_vacuum=45e3))
    assert result.rise == inf
    assert any('never stiff' in text for text in assess_regulator(result, SETTINGS))
