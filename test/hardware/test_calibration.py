# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Calibration finds the constants of a plant, and moves tendons only as far as it may.

That of regulators finds how fast and how true they are, and leaves all at 0.
"""

from dataclasses import replace
from math import exp, inf, log, nan
import threading

import pytest

from soft_continuum.commissioning.calibrate_tendons import (
    CalibrationError,
    corrected_steps,
    MAX_MOVE,
    SPEED,
    TendonBench,
)
from soft_continuum.commissioning.calibrate_vacuum import (
    assess_regulator,
    assess_vacuum,
    measure_regulator,
    measure_segment,
    POLL_INTERVAL,
    SegmentVacuum,
)
from soft_continuum.hardware.jamming_controller import JammingSettings
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.simulated_jamming import (
    JammingPlant,
    SimulatedJamming,
    SimulatedRegulators,
)
from soft_continuum.hardware.simulated_tendons import SimulatedTendons
from soft_continuum.hardware.tendon_controller import TendonLimits
from support.virtual_clock import LateClock, VirtualClock

SETTINGS = JammingSettings()
SOFT = 10e3  # Pa of vacuum
TENDONS = ('right_tendon', 'left_tendon')
GOOD = SegmentVacuum(0, 0.3, 94e3, 0.4, 500.0, 0.6)


@pytest.fixture
def time():
    return VirtualClock()


def bench_of(time, tendons=None, initially_stiff=False):
    tendons = tendons or SimulatedTendons(time, TENDONS, 0.03, 0.3, 5e-6)
    jamming = SimulatedJamming(time, 3, JammingPlant(), initially_stiff)
    return tendons, jamming, TendonBench(
        tendons, jamming, [2], TendonLimits(TENDONS, (-0.06, 0.06), 0.03), 101325.0 - SOFT, time)


@pytest.mark.parametrize('plant', [
    JammingPlant(), JammingPlant(ultimate_vacuum=85e3, evacuation_time=2.0, leak_rate=1500.0),
    JammingPlant(evacuation_time=0.2, venting_time=1.5, valve_delay=0.3, leak_rate=0.0)])
def test_the_constants_of_a_plant_are_found(time, plant):
    jamming = SimulatedJamming(time, 2, plant, initially_stiff=True)
    found = measure_segment(jamming, 1, 2, SETTINGS, SOFT, 5.0, time)
    assert found.ultimate_vacuum == pytest.approx(plant.ultimate_vacuum, rel=0.02)
    assert found.evacuation_time == pytest.approx(plant.evacuation_time, rel=0.05)
    assert found.venting_time == pytest.approx(plant.venting_time, rel=0.02)
    assert found.leak_rate == pytest.approx(plant.leak_rate, abs=2.0)


def test_the_time_to_stiff_counts_from_the_command(time):
    quick = JammingPlant(valve_delay=0.0)
    times = [
        measure_segment(SimulatedJamming(time, 1, plant, False), 0, 1, SETTINGS, SOFT,
                        1.0, time).time_to_stiff
        for plant in (quick, replace(quick, valve_delay=0.5))]
    assert times[1] - times[0] == pytest.approx(0.5, abs=0.01)


def test_after_a_test_everything_is_vented_and_the_pump_rests(time):
    jamming = SimulatedJamming(time, 3, JammingPlant(), initially_stiff=True)
    measure_segment(jamming, 0, 3, SETTINGS, SOFT, 1.0, time)
    reading = jamming.read()
    assert reading.evacuated == (False, False, False)
    assert not reading.pump


def test_a_segment_that_cannot_be_vented_is_not_tested(time):
    blocked = SimulatedJamming(time, 1, JammingPlant(venting_time=100.0), True)
    with pytest.raises(HardwareError, match='segment 1 keeps its vacuum after venting'):
        measure_segment(blocked, 0, 1, SETTINGS, SOFT, 1.0, time)


def test_a_segment_that_never_stiffens_has_no_other_figures(time):
    weak = SimulatedJamming(time, 1, JammingPlant(ultimate_vacuum=30e3), False)
    found = measure_segment(weak, 0, 1, SETTINGS, SOFT, 1.0, time)
    assert found.time_to_stiff == inf
    assert 'never stiff: 30' in assess_vacuum(found, SETTINGS)[0]


@pytest.mark.parametrize(('change', 'word'), [
    ({'time_to_stiff': 1.5}, 'slow'), ({'ultimate_vacuum': 75e3}, 'never stop'),
    ({'leak_rate': 4e3}, 'start every 5.0 s'), ({'time_to_stiff': inf}, 'never stiff')])
def test_what_is_wrong_with_a_segment_is_said(change, word):
    assert assess_vacuum(GOOD, SETTINGS) == ()
    problem, = assess_vacuum(replace(GOOD, **change), SETTINGS)
    assert word in problem


def test_steps_per_mm_grow_when_travel_falls_short():
    assert corrected_steps(200.0, 0.005, 0.004) == 250.0
    assert corrected_steps(200.0, 0.005, 0.0051) == pytest.approx(196.0784, abs=1e-3)


@pytest.mark.parametrize('measured', [0.0, -0.005, 0.06, nan, inf])
def test_travel_that_cannot_be_is_refused(measured):
    with pytest.raises(CalibrationError, match='allowed: 0.50 mm to 50.00 mm'):
        corrected_steps(200.0, 0.005, measured)


def test_tendons_move_slowly_and_by_what_was_asked_for(time):
    tendons, _, bench = bench_of(time)
    begin = time()
    assert bench.move((0.004, -0.002)).pulls == pytest.approx((0.004, -0.002), abs=1e-5)
    assert time() - begin >= 0.004 / SPEED
    assert not tendons.read().moving


@pytest.mark.parametrize(('distances', 'reason'), [
    ((2 * MAX_MOVE, 0.0), 'at a time'), ((nan, 0.0), 'at a time'),
    ((0.0, -MAX_MOVE), 'pull_limits')])
def test_a_motion_that_is_not_allowed_moves_nothing(time, distances, reason):
    tendons, _, bench = bench_of(time)
    for _ in range(6):
        bench.move((0.0, -0.99 * MAX_MOVE))
    before = tendons.read().pulls
    with pytest.raises(CalibrationError, match=reason):
        bench.move(distances)
    assert tendons.read().pulls == before


def test_nothing_moves_while_the_segment_is_stiff(time):
    tendons, jamming, bench = bench_of(time, initially_stiff=True)
    with pytest.raises(HardwareError, match='segment 3 is no longer soft'):
        bench.move((0.001, 0.0))
    bench.soften()
    assert jamming.read().evacuated == (True, True, False)
    assert bench.move((0.001, 0.0)).pulls[0] == pytest.approx(0.001, abs=1e-5)


def test_a_motor_need_not_come_nearer_than_its_driver_tells(time):
    _, _, bench = bench_of(time, SimulatedTendons(time, TENDONS, 0.03, 0.3, step=1e-3))
    assert bench.move((0.0044, 0.0)).pulls[0] == pytest.approx(0.004, abs=1e-9)


class ShortSteppers(SimulatedTendons):
    """Steppers that go half the way."""

    stopped = False

    def move(self, pulls, duration):
        super().move((pulls[0] / 2, pulls[1] / 2), duration)

    def stop(self):
        self.stopped = True
        super().stop()


def test_steppers_that_do_not_arrive_are_an_error(time):
    tendons, _, bench = bench_of(time, ShortSteppers(time, TENDONS, 0.03, 0.3, 5e-6))
    with pytest.raises(
            HardwareError, match='right_tendon 2.00 mm, .* instead of right_tendon 4.00'):
        bench.move((0.004, 0.0))
    assert tendons.stopped


class SlowSteppers(SimulatedTendons):
    """Steppers that are seen to move a number of times."""

    looks = inf

    def read(self):
        self.looks -= 1
        reading = super().read()
        return replace(reading, speeds=(1e-3, 0.0)) if self.looks > 0 else reading


def test_a_computer_that_is_late_is_not_taken_for_motors_that_do_not_rest():
    time = LateClock(threading.current_thread().name, lambda timeout: max(1.0 - timeout, 0.0))
    tendons, _, bench = bench_of(time, SlowSteppers(time, TENDONS, 0.03, 0.3, 5e-6))
    tendons.looks = 30
    assert bench.move((0.004, 0.0)).pulls[0] == pytest.approx(0.004, abs=1e-5)


def test_motors_that_do_not_rest_are_an_error(time):
    _, _, bench = bench_of(time, SlowSteppers(time, TENDONS, 0.03, 0.3, 5e-6))
    begin = time()
    with pytest.raises(HardwareError, match='do not come to rest; check the motors'):
        bench.move((0.004, 0.0))
    assert time() - begin < 30.0


# Regulators.

PLANT = JammingPlant()


class Skewed(SimulatedRegulators):
    """Regulators whose sensors show so much of the true vacuum."""

    share = 1.0

    def read(self):
        reading, ambient = super().read(), self._plant.ambient_pressure
        return replace(reading, pressures=tuple(
            ambient - self.share * (ambient - p) for p in reading.pressures))


def measured(share=1.0, plant=PLANT):
    clock = VirtualClock()
    driver = Skewed(clock, 2, plant, True, 90e3, 0.0)
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
