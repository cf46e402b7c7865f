# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
How segments become soft and stiff, and what is said of it.

When a vacuum makes a segment stiff, or the pump runs, is claimed in test/hardware.
"""

from unittest.mock import Mock

import pytest
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from soft_continuum.hardware.jamming_controller import JammingController, JammingSettings
from soft_continuum.hardware.protocols import JammingDriver, JammingReading
from soft_continuum.nodes.jamming_valves import JammingControl
from soft_continuum_interfaces.msg import JammingValvesState
from soft_continuum_interfaces.srv import SetVacuum
from support.ros_rig import AMBIENT, assert_declined, LATCHED, SEGMENTS, STIFF_VACUUM


@pytest.fixture(scope='module')
def shared_valves(module_rig):
    """Return the valves alone, for one test after the other."""
    module_rig.start('jamming_valves')
    return module_rig


@pytest.fixture
def valves(shared_valves):
    """Return the valves, all segments stiff."""
    shared_valves.stiffen()
    return shared_valves


def vacuum(rig, segment):
    return AMBIENT - float(rig.pressures[segment - 1].last.fluid_pressure)


def test_each_segment_becomes_soft_and_stiff_again(valves):
    for segment in (1, 2, 3):
        valves.soften(segment)
        assert valves.soft_segments() == [segment]
        assert valves.set_stiff(segment, True).success
        valves.wait_for(lambda s=segment: vacuum(valves, s) > STIFF_VACUUM, 'vacuum')
        assert valves.all_stiff


def test_all_segments_are_switched_at_once(valves):
    for stiff in (False, True):
        answer = valves.call(SetBool, 'jamming_valves/set_all_stiff', data=stiff)
        assert answer.success
        assert all(f'segment {n}' in answer.message for n in (1, 2, 3))
        valves.wait_for(lambda s=stiff: all(r.last.data == s for r in valves.stiff), 'all')


def test_there_are_exactly_as_many_services_as_segments(valves):
    names = {name for name, _ in valves.observer.get_service_names_and_types_by_node(
        'jamming_valves', valves.namespace) if 'stiff' in name}
    prefix = f'{valves.namespace}/jamming_valves'
    assert names == {f'{prefix}/set_all_stiff', *(
        f'{prefix}/segment_{n}/set_stiff' for n in range(1, SEGMENTS + 1))}


def test_a_segment_is_never_said_to_be_stiff_before_its_pressure_says_so(rig):
    # Slow enough to be seen on the way.
    rig.start('jamming_valves', simulated_jamming__evacuation_time=0.3,
              simulated_jamming__valve_delay=0.05)
    for segment in (1, 2, 1):
        rig.soften(segment)
        rig.set_stiff(segment, True)
    rig.wait_for_more(rig.pressures[0])
    rig.assert_stiff_only_by_pressure()
    assert sum(m.data for m in rig.stiff[0]) == 3


def test_a_late_joiner_is_told_which_segments_are_stiff(valves):
    valves.set_stiff(2, False)
    late = [valves.record(Bool, f'segment_{n}/stiff', LATCHED) for n in (1, 2, 3)]
    valves.wait_for(lambda: all(map(len, late)), 'the latched state')
    assert [r.last.data for r in late] == [True, False, True]
    assert [len(r) for r in late] == [1, 1, 1]


def test_pressures_are_absolute_pascals_of_each_segment(valves):
    valves.soften(1)
    valves.wait_for(lambda: abs(vacuum(valves, 1)) < 100.0, 'ambient pressure')
    for number, recording in enumerate(valves.pressures, start=1):
        assert recording.last.header.frame_id == f'segment_{number}'
        assert recording.last.header.stamp.sec > 0
        assert 0.0 < recording.last.fluid_pressure <= AMBIENT
    for segment in (2, 3):
        assert 50e3 < vacuum(valves, segment) < 95e3


@pytest.mark.parametrize('away', [('deactivate',), ('deactivate', 'cleanup')])
def test_a_node_that_is_not_active_switches_nothing(valves, away):
    valves.transitions('jamming_valves', *away)
    for service in ('segment_1/set_stiff', 'set_all_stiff'):
        assert_declined(valves.call(SetBool, f'jamming_valves/{service}', data=False),
                        'not active')
    valves.transitions('jamming_valves', *('configure', 'activate')[2 - len(away):])
    valves.wait_for_more(valves.pressures[0])
    assert valves.all_stiff


def test_deactivating_leaves_a_soft_segment_soft(valves):
    valves.soften(2)
    valves.transitions('jamming_valves', 'deactivate', 'activate')
    valves.wait_for_more(valves.pressures[1])
    assert valves.soft_segments() == [2]
    assert vacuum(valves, 2) < 5e3


def test_a_transition_that_is_not_valid_now_is_answered_and_changes_nothing(valves):
    for name in ('configure', 'activate', 'cleanup'):
        assert not valves.transition('jamming_valves', name)
        assert valves.lifecycle_state('jamming_valves') == 'active'
    assert valves.set_stiff(1, False).success


def test_a_soft_rig_starts_soft_and_is_left_so(rig):
    rig.start('jamming_valves', simulated_jamming__initially_stiff=False)
    rig.wait_for_more(rig.pressures[0])
    assert rig.soft_segments() == [1, 2, 3]
    assert all(len(r) == 1 for r in rig.stiff)
    rig.wait_for_status('jamming_valves', 'pump', 'off')
    assert rig.set_stiff(1, True).success
    rig.wait_for_status('jamming_valves', 'pump', 'on')


def set_vacuum(rig, segment, vacuum):
    return rig.call(SetVacuum, f'jamming_valves/segment_{segment}/set_vacuum', vacuum=vacuum)


def test_a_regulator_holds_a_vacuum_between_soft_and_stiff(rig):
    rig.start('jamming_valves', simulated_jamming__regulators=True,
              arm__stiffness_ratios=(10.0, 10.0, 0.0))
    rig.wait_for(lambda: rig.all_stiff, 'a stiff arm')
    assert set_vacuum(rig, 2, 30e3).success
    rig.wait_for(lambda: abs(vacuum(rig, 2) - 30e3) < 1e3, 'the vacuum')
    assert rig.soft_segments() == [2]
    rig.wait_for(lambda: list(rig.states['jamming_valves'].last.vacuums) == pytest.approx(
        [90e3, 30e3, 90e3]), 'what the regulators were told')
    for wrong in (float('nan'), -1.0, 91e3):
        answer = set_vacuum(rig, 2, wrong)
        assert not answer.success and '0 to 90000 Pa' in answer.message
    answer = set_vacuum(rig, 3, 30e3)  # whose jam is rigid
    assert not answer.success and 'arm.stiffness_ratios' in answer.message
    assert rig.set_stiff(2, True).success
    rig.wait_for(lambda: rig.all_stiff, 'a stiff arm')
    rig.wait_for(lambda: list(rig.states['jamming_valves'].last.vacuums) == pytest.approx(
        [90e3, 80e3, 90e3]), 'the vacuum of a stiff segment')
    assert set_vacuum(rig, 3, 0.0).success
    rig.assert_stiff_only_by_pressure()


def test_valves_refuse_a_vacuum_between(valves):
    answer = set_vacuum(valves, 2, 0.0)
    assert not answer.success and 'valves' in answer.message
    assert valves.all_stiff and not valves.states['jamming_valves'].last.vacuums


def test_what_was_read_before_the_node_was_deactivated_is_not_reported_again():
    reports = []
    driver = Mock(spec=JammingDriver)
    driver.read.return_value = JammingReading((20e3,), (True,), True)
    control = JammingControl(1, reports.append)
    control.attach(JammingController(driver, 1, JammingSettings()))
    control.activate()
    control.cycle(0.0)
    assert list(reports[-1].state.stiffness) == [JammingValvesState.STIFF]
    control.deactivate()
    control.activate()
    control.command(lambda _: None)
    assert not reports[-1].state.connected
    assert list(reports[-1].state.stiffness) == [JammingValvesState.UNKNOWN]
    control.cycle(0.0)
    assert list(control.snapshot().state.stiffness) == [JammingValvesState.STIFF]
