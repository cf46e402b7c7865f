# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A segment is stiff when its pressure says so, and the pump runs no more than it has to."""

from math import inf, nan

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from soft_continuum.hardware.jamming_controller import (
    JammingController,
    JammingSettings,
    REFILL_TIME,
    RESPONSE_TIME,
)
from soft_continuum.hardware.protocols import HardwareError, JammingReading
from soft_continuum.hardware.simulated_jamming import (
    JammingPlant,
    SimulatedJamming,
    SimulatedRegulators,
)
from support.virtual_clock import ToldClock

SETTINGS = JammingSettings()
AMBIENT = SETTINGS.ambient_pressure
STIFF, RELEASE = SETTINGS.stiff_vacuum, SETTINGS.release_vacuum
START, STOP = SETTINGS.pump_start_vacuum, SETTINGS.pump_stop_vacuum
ORDER = ('release_vacuum', 'stiff_vacuum', 'pump_start_vacuum', 'pump_stop_vacuum')


class ScriptedJamming:
    """A driver whose sensors read what a test says."""

    def __init__(self, *vacuum):
        self.vacuum = list(vacuum)
        self.evacuated = [True] * len(vacuum)
        self.switched = []

    def read(self):
        return JammingReading(
            tuple(AMBIENT - v for v in self.vacuum), tuple(self.evacuated), self.pump)

    def set_evacuated(self, segment, evacuated):
        self.evacuated[segment] = evacuated

    def set_pump(self, running):
        self.pump = running
        self.switched.append(running)


class ScriptedRegulators:
    """Regulators whose sensors read what a test says."""

    max_vacuum = 90e3

    def __init__(self, *vacuum):
        self.vacuum = list(vacuum)
        self.told = list(vacuum)

    def open(self):
        """Nothing to connect."""

    def close(self):
        """Nothing to disconnect."""

    def read(self):
        return JammingReading.of_regulators(
            tuple(AMBIENT - v for v in self.vacuum), tuple(self.told))

    def set_vacuum(self, segment, vacuum):
        self.told[segment] = vacuum


def scripted(*vacuum, pump=False, kind=ScriptedJamming):
    """A scripted driver and its controller, on a clock that goes on only when told."""
    driver, clock = kind(*vacuum), ToldClock()
    driver.pump = pump
    return clock, driver, JammingController(driver, len(vacuum), SETTINGS, clock)


def regulated(*vacuum):
    """Regulators that have followed their set-points, and their controller."""
    clock, driver, controller = scripted(*vacuum, kind=ScriptedRegulators)
    controller.update()
    return clock, driver, controller


def after(clock, controller, seconds):
    """The faults after some time."""
    clock.now += seconds
    controller.update()
    return controller.faults


def simulated(initially_stiff, segments=3, plant=None):
    clock = ToldClock()
    driver = SimulatedJamming(clock, segments, plant or JammingPlant(), initially_stiff)
    return clock, driver, JammingController(driver, segments, SETTINGS, clock)


def stiff_at(controller, driver, *vacuum):
    """The flag of the first segment after readings of its vacuum, one after the other."""
    flags = []
    for value in vacuum:
        driver.vacuum[0] = value
        controller.update()
        flags.append(controller.stiff[0])
    return flags


def test_a_rig_found_evacuated_is_stiff_after_the_first_reading_and_not_before():
    _, _, controller = simulated(initially_stiff=True)
    assert controller.stiff == [False, False, False]
    with pytest.raises(HardwareError, match='not been read'):
        _ = controller.reading
    controller.update()
    assert controller.stiff == [True, True, True]


def test_a_rig_found_soft_is_not_evacuated_unasked():
    clock, driver, controller = simulated(initially_stiff=False)
    for _ in range(20):
        controller.update()
        clock.now += 0.5
    assert controller.stiff == [False, False, False]
    assert not driver.read().pump and not any(driver.read().evacuated)


@pytest.mark.parametrize('kind', [ScriptedJamming, ScriptedRegulators])
def test_a_segment_is_stiff_from_the_stiff_vacuum_on_down_to_the_release_vacuum(kind):
    _, driver, controller = scripted(80e3, kind=kind)
    flags = stiff_at(controller, driver, 0.0, STIFF - 1.0, STIFF, RELEASE, STIFF - 1.0,
                     RELEASE - 1.0, STIFF - 1.0, RELEASE + 1.0, STIFF)
    assert flags == [False, False, True, True, True, False, False, False, True]


@pytest.mark.parametrize(('kind', 'soften'), [
    (ScriptedJamming, lambda controller: controller.set_stiff(1, False)),
    (ScriptedRegulators, lambda controller: controller.set_stiff(1, False)),
    (ScriptedRegulators, lambda controller: controller.set_vacuum(1, 30e3))])
def test_a_segment_is_soft_as_soon_as_it_is_asked_to_be(kind, soften):
    _, _, controller = scripted(80e3, 80e3, kind=kind)
    controller.update()
    soften(controller)
    assert controller.stiff == [True, False]
    controller.update()
    assert controller.stiff == [True, False]  # though its vacuum is still high


def test_a_segment_is_not_stiff_because_it_was_asked_to_be_or_because_its_sensor_says_so():
    _, driver, controller = scripted(0.0, 90e3)
    driver.evacuated = [False, False]
    controller.set_stiff(0, True)
    assert controller.stiff == [False, False]
    controller.update()  # the valve of the second one does not open
    assert controller.stiff == [False, False]


@pytest.mark.parametrize('broken', [nan, inf, -inf])
def test_a_broken_sensor_is_a_fault_and_never_stiff_and_does_not_touch_the_other_segments(broken):
    _, driver, controller = scripted(0.0, 90e3)
    flags, faults = [], []
    for vacuum in (broken, 90e3, broken, RELEASE + 1.0):
        flags += stiff_at(controller, driver, vacuum)
        faults.append(controller.faults)
    assert flags == [False, True, False, False] and controller.stiff[1]
    for (first, second), wrong in zip(faults, (True, False, True, False), strict=True):
        assert second == '' and bool(first) is wrong
        assert not wrong or ('segment 1' in first and 'wire' in first)


def test_the_pump_keeps_running_for_a_segment_whose_sensor_is_broken():
    _, driver, controller = scripted(90e3, nan)
    controller.update()
    controller.update()
    assert driver.pump and driver.switched == [True]


def test_the_pump_starts_below_one_vacuum_and_rests_above_another():
    _, driver, controller = scripted(STOP, pump=True)
    for vacuum in (STOP, STOP - 1.0, START, START - 1.0, START, STOP - 1.0, STOP):
        driver.vacuum[0] = vacuum
        controller.update()
    assert driver.switched == [False, True, False]


@pytest.mark.parametrize(('vacuum', 'vented', 'before', 'after'), [
    ((90e3, START - 1.0, 90e3), (), False, True),
    ((90e3, STOP - 1.0, 90e3), (), True, True),
    ((90e3, 0.0, 90e3), (1,), True, False),
    ((50e3, 50e3), (0, 1), True, False)],
    ids=['weakest starts it', 'all must have enough to end it', 'vented one does not count',
         'rests when all are vented'])
def test_the_pump_runs_for_the_weakest_evacuated_segment(vacuum, vented, before, after):
    _, driver, controller = scripted(*vacuum, pump=before)
    for segment in vented:
        controller.set_stiff(segment, False)
    controller.update()
    assert driver.pump is after


def test_an_unattended_stiff_arm_stays_stiff_while_the_pump_mostly_rests():
    clock, _, controller = simulated(initially_stiff=True)
    pumping = []
    for _ in range(4000):
        reading = controller.update()
        pumping.append(reading.pump)
        assert all(controller.stiff)
        assert min(AMBIENT - p for p in reading.pressures) >= START - 100.0
        clock.now += 0.1
    starts = sum(b and not a for a, b in zip(pumping, pumping[1:], strict=False))
    assert 2 <= starts <= 20  # it does start, and does not chatter
    assert sum(pumping) < 0.1 * len(pumping)


def test_softening_and_stiffening_takes_as_long_as_the_air_needs():
    clock, _, controller = simulated(initially_stiff=True)
    controller.update()
    controller.set_stiff(1, False)
    clock.now += 3.0
    controller.update()
    controller.set_stiff(1, True)
    flags = []
    for _ in range(10):
        clock.now += 0.1
        controller.update()
        flags.append(controller.stiff[1])
    # The pump rested up to the first reading; then 0.4 s ln(94 / (94 - 50)) = 0.30 s.
    assert flags == [False] * 4 + [True] * 6


def test_while_the_device_is_lost_which_is_reported_nothing_counts_as_stiff():
    _, driver, controller = scripted(90e3, 90e3)
    read = driver.read

    def lost():
        raise HardwareError('unplugged')

    for _ in range(2):  # before the first reading, and after one
        driver.read = lost
        with pytest.raises(HardwareError, match='unplugged'):
            controller.update()
        assert controller.stiff == [False, False]
        driver.read = read
        controller.update()
        assert controller.stiff == [True, True]


def test_a_segment_is_not_stiff_after_a_venting_that_failed_half_way():
    _, driver, controller = scripted(90e3, 90e3)
    controller.update()

    def unanswered(segment, evacuated):
        raise HardwareError('no answer')  # though the valve may have moved

    driver.set_evacuated = unanswered
    with pytest.raises(HardwareError, match='no answer'):
        controller.set_stiff(1, False)
    assert controller.stiff == [True, False]


# Pressures that do not follow.


def test_a_segment_that_keeps_its_vacuum_though_vented_is_a_fault():
    clock, driver, controller = scripted(90e3, 90e3)
    controller.set_stiff(1, False)
    controller.update()
    assert after(clock, controller, 0.99 * RESPONSE_TIME) == ('', '')
    faults = after(clock, controller, 0.02 * RESPONSE_TIME)
    assert faults[0] == '' and 'segment 2' in faults[1] and '90.0 kPa' in faults[1]
    assert 'sensor' in faults[1] and 'valve' in faults[1]


def test_a_segment_that_gets_no_vacuum_from_the_running_pump_is_a_fault():
    clock, driver, controller = scripted(90e3, 20e3)
    for _ in range(2):
        controller.update()
    assert driver.pump
    assert after(clock, controller, 0.99 * RESPONSE_TIME) == ('', '')
    faults = after(clock, controller, 0.02 * RESPONSE_TIME)
    assert faults[0] == '' and 'segment 2' in faults[1] and '20.0 kPa' in faults[1]
    assert all(word in faults[1] for word in ('leaks', 'valve', 'sensor', 'pump'))
    driver.vacuum[1] = 90e3
    assert after(clock, controller, 0.1) == ('', '')
    assert controller.stiff == [True, True]


def test_the_time_to_follow_starts_again_with_every_switching():
    clock, _, controller = scripted(0.0)
    controller.set_stiff(0, True)
    controller.update()
    for _ in range(5):
        assert after(clock, controller, 0.6 * RESPONSE_TIME) == ('',)
        controller.set_stiff(0, False)
        assert after(clock, controller, 0.6 * RESPONSE_TIME) == ('',)
        controller.set_stiff(0, True)
        controller.update()


def test_a_rig_that_works_has_no_faults_in_an_hour_of_switching():
    clock, _, controller = simulated(initially_stiff=True)
    for turn in range(360):
        controller.set_stiff(turn % 3, turn % 2 == 0)
        for _ in range(20):
            assert after(clock, controller, 0.5) == ('',) * 3


@pytest.mark.parametrize('vented', [0.4, 4.0, RESPONSE_TIME])
def test_a_sensor_that_did_not_notice_a_venting_is_not_believed_before_it_showed_one(vented):
    clock, driver, controller = scripted(80e3)
    controller.update()
    assert controller.stiff == [True]
    controller.set_stiff(0, False)
    controller.update()
    after(clock, controller, vented)
    controller.set_stiff(0, True)
    for _ in range(3):
        controller.update()
        assert controller.stiff == [False] and 'stuck' in controller.faults[0]
        clock.now += RESPONSE_TIME
    driver.vacuum[0] = RELEASE - 1.0  # it does move
    assert after(clock, controller, 0.1) == ('',)
    assert controller.stiff == [False]
    driver.vacuum[0] = 70e3
    assert after(clock, controller, 0.1) == ('',)
    assert controller.stiff == [True]


def test_a_segment_that_is_evacuated_again_before_it_became_soft_is_stiff_by_its_pressure():
    clock, driver, controller = scripted(80e3)
    controller.update()
    for vented, vacuum in ((0.05, 75e3), (0.4, 70e3)):
        controller.set_stiff(0, False)
        controller.update()
        clock.now += vented
        driver.vacuum[0] = vacuum
        controller.update()
        controller.set_stiff(0, True)
        controller.update()
        assert controller.stiff == [True]


@pytest.mark.parametrize(
    ('vented', 'read'), [(0.0, True), (0.1, True), (0.1, False), (2.0, False)])
def test_a_venting_too_short_for_the_sensor_to_show_is_made_up_for_by_the_pump(vented, read):
    clock, driver, controller = scripted(90e3)
    controller.update()
    for _ in range(2):
        controller.set_stiff(0, False)
        if read:
            controller.update()
        clock.now += vented
        controller.set_stiff(0, True)
        controller.update()
        for _ in range(29):
            assert controller.stiff == [False] and driver.pump
            clock.now += 0.1
            controller.update()
        clock.now += 0.3
        controller.update()
        assert controller.stiff == [True] and controller.faults == ('',)
        clock.now += 0.1
        controller.update()
        assert not driver.pump


def test_a_stuck_sensor_is_found_by_quick_toggles_as_by_one_slow_one():
    clock, driver, controller = scripted(80e3)
    controller.update()
    for _ in range(4):
        controller.set_stiff(0, False)
        controller.update()
        clock.now += 0.1
        controller.set_stiff(0, True)
        controller.update()
        assert controller.stiff == [False]
    assert 'stuck' in controller.faults[0]
    clock.now += 2 * REFILL_TIME
    controller.update()
    assert controller.stiff == [False]


def test_a_sensor_that_was_stuck_before_the_start_is_not_believed():
    clock, driver, controller = scripted(85e3)
    driver.evacuated[0] = False  # it is vented, and shows nothing of it
    for _ in range(30):
        clock.now += 0.1
        controller.update()
        assert controller.stiff == [False]
    controller.set_stiff(0, True)
    for _ in range(3):
        clock.now += 0.05
        controller.update()
        assert controller.stiff == [False]
    assert 'stuck' in controller.faults[0]


# Settings, and whatever is switched.

thresholds = st.lists(st.floats(1e3, 101e3), min_size=4, max_size=4)


@given(thresholds)
def test_thresholds_out_of_order_are_refused_and_named(values):
    given_order = dict(zip(ORDER, values, strict=True))
    if all(a < b for a, b in zip(values, values[1:], strict=False)):
        assert JammingSettings(**given_order)
        return
    with pytest.raises(ValueError, match='must be below') as refused:
        JammingSettings(**given_order)
    assert sum(name in str(refused.value) for name in ORDER) == 2


@pytest.mark.parametrize('name', ORDER)
def test_a_threshold_that_is_not_a_number_is_refused(name):
    with pytest.raises(ValueError, match=name):
        JammingSettings(**{name: nan})


commands = st.lists(st.tuples(st.integers(0, 2), st.booleans(), st.floats(0.0, 2.0)), max_size=15)


@settings(max_examples=60)
@given(commands, st.booleans())
def test_a_segment_is_never_stiff_before_its_pressure_says_so_and_can_always_become_stiff(
        script, initially_stiff):
    clock, driver, controller = simulated(initially_stiff)
    before = list(controller.stiff)
    for segment, stiff, duration in script:
        controller.set_stiff(segment, stiff)
        assert all(was or not now for was, now in zip(before, controller.stiff, strict=True))
        before = list(controller.stiff)
        clock.now += duration
        reading = controller.update()
        for i, flag in enumerate(controller.stiff):
            vacuum = AMBIENT - reading.pressures[i]
            assert not flag or reading.evacuated[i]
            assert not flag or vacuum >= (RELEASE if before[i] else STIFF)
        before = list(controller.stiff)
    for segment in range(3):
        controller.set_stiff(segment, True)
    for _ in range(10):
        after(clock, controller, 0.5)
    assert all(controller.stiff)


# Regulators.


@settings(max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 1), st.floats(0.0, 90e3), st.floats(0.0, 2.0)),
                min_size=1, max_size=12))
def test_whatever_is_set_a_segment_is_stiff_only_with_a_vacuum_that_makes_it_so(script):
    clock = ToldClock()
    driver = SimulatedRegulators(clock, 2, JammingPlant(), True, 90e3, 500.0)
    controller = JammingController(driver, 2, SETTINGS, clock)
    for segment, vacuum, duration in script:
        controller.set_vacuum(segment, vacuum)
        for _ in range(4):
            clock.now += duration / 4
            reading = controller.update()
            for stiff, pressure, told in zip(
                    controller.stiff, reading.pressures, reading.vacuums, strict=True):
                assert not stiff or (AMBIENT - pressure >= RELEASE and told >= RELEASE)
    clock.now += 30.0
    controller.update()
    assert controller.faults == ('', '')


def test_stiff_and_soft_are_the_full_vacuum_and_none():
    _, driver, controller = regulated(20e3, 20e3)
    controller.set_stiff(0, True)
    controller.set_stiff(1, False)
    assert driver.told == [SETTINGS.full_vacuum, 0.0]


@pytest.mark.parametrize('vacuum', [nan, inf, -1.0, 90.1e3])
def test_a_vacuum_that_no_regulator_holds_is_refused_and_changes_nothing(vacuum):
    _, driver, controller = regulated(80e3)
    with pytest.raises(ValueError, match='allowed: 0 to 90000 Pa'):
        controller.set_vacuum(0, vacuum)
    assert driver.told == [80e3] and controller.stiff == [True]


@pytest.mark.parametrize(('told', 'stays'), [(30e3, 80e3), (80e3, 30e3), (0.0, 20e3)])
def test_a_pressure_that_does_not_follow_its_regulator_is_a_fault(told, stays):
    clock, driver, controller = regulated(stays, 60e3)
    controller.set_vacuum(0, told)
    assert after(clock, controller, 0.1) == ('', '')
    first, second = after(clock, controller, RESPONSE_TIME)
    assert f'set to {told / 1e3:.1f} kPa' in first and not second
    driver.vacuum[0] = told
    assert after(clock, controller, 0.1) == ('', '')


def test_a_broken_sensor_of_a_regulated_segment_is_a_fault_and_not_stiff():
    clock, driver, controller = regulated(80e3)
    driver.vacuum[0] = nan
    assert 'no pressure' in after(clock, controller, 0.1)[0]
    assert controller.stiff == [False]


def test_a_frozen_sensor_that_missed_a_venting_makes_no_segment_stiff():
    clock, driver, controller = regulated(80e3)
    controller.set_vacuum(0, 0.0)
    for _ in range(5):
        after(clock, controller, 0.2)
    controller.set_vacuum(0, 80e3)
    assert after(clock, controller, 0.1)[0]
    assert after(clock, controller, 5.0)[0]
    assert controller.stiff == [False]


def test_regulators_that_cannot_make_a_segment_stiff_are_refused():
    with pytest.raises(HardwareError, match='full_vacuum'):
        SETTINGS.check_regulators(70e3)
    with pytest.raises(HardwareError, match='stiff_vacuum'):
        JammingSettings(full_vacuum=51e3).check_regulators(90e3)
