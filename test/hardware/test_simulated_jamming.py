# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated segments lose and gain air as first-order plants with delayed valves."""

from math import exp

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from soft_continuum.hardware.simulated_jamming import (
    JammingPlant,
    SimulatedJamming,
    SimulatedRegulators,
)
from support.virtual_clock import ToldClock

PLANT = JammingPlant()
AMBIENT, ULTIMATE = PLANT.ambient_pressure, PLANT.ultimate_vacuum
SEGMENTS = 3


def rig(initially_stiff=True, plant=PLANT):
    clock = ToldClock()
    return clock, SimulatedJamming(clock, SEGMENTS, plant, initially_stiff)


def vacuum_after(clock, jamming, seconds, segment=0):
    clock.now += seconds
    return AMBIENT - jamming.read().pressures[segment]


def regulators(initially_stiff=False):
    clock = ToldClock()
    return clock, SimulatedRegulators(clock, SEGMENTS, PLANT, initially_stiff, 90e3, 500.0)


@pytest.mark.parametrize('stiff', [True, False])
def test_a_rig_starts_stiff_or_soft_and_opening_and_closing_switch_nothing(stiff):
    _, jamming = rig(stiff)
    before = jamming.read()
    assert before.pressures == (AMBIENT - ULTIMATE * stiff,) * SEGMENTS
    assert before.evacuated == (stiff,) * SEGMENTS and before.pump is stiff
    jamming.open()
    jamming.close()
    assert jamming.read() == before


@pytest.mark.parametrize('constants', [0.5, 1.0, 3.0])
@pytest.mark.parametrize('stiff', [True, False])
def test_air_follows_its_time_constant_after_the_delay_of_the_valve(stiff, constants):
    clock, jamming = rig(stiff)
    jamming.set_pump(True)
    jamming.set_evacuated(0, not stiff)
    before = vacuum_after(clock, jamming, 0.0)
    assert vacuum_after(clock, jamming, 0.99 * PLANT.valve_delay) == pytest.approx(before)
    jamming.set_evacuated(0, not stiff)  # asked again: the delay does not start again
    constant = PLANT.venting_time if stiff else PLANT.evacuation_time
    time = 0.01 * PLANT.valve_delay + constants * constant
    left = exp(-constants)
    assert vacuum_after(clock, jamming, time) == pytest.approx(
        ULTIMATE * (left if stiff else 1 - left))


def test_a_valve_that_is_switched_back_before_it_moved_changes_nothing():
    clock, jamming = rig(initially_stiff=False)
    jamming.set_pump(True)
    jamming.set_evacuated(0, True)
    assert vacuum_after(clock, jamming, 0.3 * PLANT.valve_delay) == 0.0
    jamming.set_evacuated(0, False)
    assert vacuum_after(clock, jamming, PLANT.valve_delay) == 0.0


def test_a_valve_is_read_back_at_once_and_vents_its_segment_alone():
    clock, jamming = rig()
    jamming.set_evacuated(1, False)
    assert jamming.read().evacuated == (True, False, True)
    clock.now += 5.0
    first, second, third = jamming.read().pressures
    assert first == third == pytest.approx(AMBIENT - ULTIMATE)
    assert second == pytest.approx(AMBIENT, rel=1e-3)


def test_an_evacuated_segment_leaks_down_to_ambient_until_the_pump_brings_it_back():
    clock, jamming = rig()
    jamming.set_pump(False)
    assert vacuum_after(clock, jamming, 10.0) == pytest.approx(ULTIMATE - 10 * PLANT.leak_rate)
    assert vacuum_after(clock, jamming, 2 * ULTIMATE / PLANT.leak_rate) == 0.0
    jamming.set_pump(True)
    assert vacuum_after(clock, jamming, 20.0) == pytest.approx(ULTIMATE)


def test_an_open_valve_evacuates_nothing_while_the_pump_rests():
    clock, jamming = rig(initially_stiff=False)
    jamming.set_evacuated(0, True)
    assert vacuum_after(clock, jamming, 10.0) == 0.0


commands = st.one_of(
    st.tuples(st.just('set_evacuated'), st.integers(0, SEGMENTS - 1), st.booleans()),
    st.tuples(st.just('set_pump'), st.booleans()))
scripts = st.lists(st.tuples(commands, st.floats(0.0, 3.0)), max_size=8)


@settings(max_examples=60)
@given(scripts, st.booleans(), st.lists(st.floats(0.001, 1.0), max_size=20))
def test_pressures_are_continuous_possible_and_the_same_however_finely_time_is_ticked(
        script, stiff, parts):
    readings = []
    for finely in (False, True):
        clock, jamming = rig(stiff)
        for (name, *arguments), duration in script:
            before = jamming.read().pressures
            getattr(jamming, name)(*arguments)
            assert jamming.read().pressures == before
            start = clock.now
            for part in parts if finely else ():
                clock.now = min(clock.now + part * duration / 5, start + duration)
                jamming.read()
            clock.now = start + duration
            for pressure in jamming.read().pressures:
                assert AMBIENT - ULTIMATE - 1e-6 <= pressure <= AMBIENT + 1e-6
        readings.append(jamming.read())
    coarse, fine = readings
    assert fine.pressures == pytest.approx(coarse.pressures, abs=1e-3)
    assert (fine.evacuated, fine.pump) == (coarse.evacuated, coarse.pump)


@settings(max_examples=50)
@given(st.lists(st.tuples(st.floats(0.0, 90e3), st.floats(0.0, 3.0)), min_size=1, max_size=6))
def test_a_regulator_comes_within_its_dead_band_from_either_side_and_stays(script):
    clock, air = regulators()
    for wanted, part in script:
        air.set_vacuum(1, wanted)
        assert air.read().vacuums[1] == wanted
        before = vacuum_after(clock, air, 0.0, 1)
        between = vacuum_after(clock, air, part, 1)
        assert min(before, wanted) - 501.0 <= between <= max(before, wanted) + 501.0
        clock.now += 10.0 * PLANT.venting_time
        assert vacuum_after(clock, air, 0.0, 1) == pytest.approx(wanted, abs=501.0)
    assert air.read().pressures[0] == AMBIENT  # another segment


def test_a_regulator_moves_as_fast_as_a_pump_evacuates_and_a_valve_vents():
    clock, air = regulators()
    air.set_vacuum(0, 90e3)
    assert vacuum_after(clock, air, 0.2) == pytest.approx(
        ULTIMATE * (1 - exp(-0.2 / PLANT.evacuation_time)))
    begin = vacuum_after(clock, air, 20.0)
    air.set_vacuum(0, 0.0)
    assert vacuum_after(clock, air, 0.3) == pytest.approx(begin * exp(-0.3 / PLANT.venting_time))


def test_opening_and_closing_regulators_leaves_their_set_points():
    _, air = regulators(initially_stiff=True)
    before = air.read()
    air.open()
    air.close()
    assert air.read() == before and before.vacuums == (air.max_vacuum,) * SEGMENTS
