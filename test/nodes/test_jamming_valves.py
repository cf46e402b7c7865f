# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
How segments become soft and stiff, and what is said of it.

When a vacuum makes a segment stiff, or the pump runs, is claimed in test/hardware.
"""

from unittest.mock import Mock

from geometry_msgs.msg import Point, Pose
import numpy as np
import pytest
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from soft_continuum.hardware.jamming_controller import JammingController, JammingSettings
from soft_continuum.hardware.protocols import JammingDriver, JammingReading
from soft_continuum.nodes.jamming_valves import JammingControl
from soft_continuum_interfaces.msg import JammingValvesState, KinematicsState, Shape, TipGoal
from soft_continuum_interfaces.srv import SetVacuum
from support.ros_rig import (
    AMBIENT,
    assert_declined,
    LATCHED,
    SEGMENTS,
    STIFF_VACUUM,
    STREAM,
    trajectory,
)


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
    rig.start('jamming_valves', simulated_jamming__initially_stiff=False,
              simulated_jamming__ultimate_vacuum=75e3)  # the pump never rests
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


VACUUMS = (25e3, 80e3, 40e3)


@pytest.fixture
def regulated(rig):
    """Return an arm that lies, with regulators and a law for its jams."""
    rig.start_arm(simulated_jamming__regulators=True, arm__stiffness_ratios=(10.0,),
                  arm__mounting_angle=1.2, arm__bodies_per_segment=4)
    return rig




def wait_until_told(rig):
    rig.wait_for(lambda: list(rig.states['jamming_valves'].last.vacuums) == pytest.approx(VACUUMS),
                 'the vacuums of the goal')


def test_a_goal_with_vacuums_ends_at_its_angles_or_its_tip(regulated):
    angles = [0.3, 0.2, -0.2]
    goal = regulated.goal(Shape(name='held', bending_angles=angles, vacuums=VACUUMS))
    result = goal.assert_ended('SUCCEEDED')
    for segment, wanted in enumerate(VACUUMS, start=1):
        assert vacuum(regulated, segment) == pytest.approx(wanted, abs=3e3)
    wait_until_told(regulated)
    assert list(result.bending_angles) == pytest.approx(angles, abs=0.01)
    regulated.assert_stiff_only_by_pressure()
    place = [0.12, 0.30]  # m
    tip = TipGoal(pose=Pose(position=Point(x=place[0], z=place[1])), kind=TipGoal.POSITION)
    result = regulated.goal(Shape(tips=[tip], vacuums=VACUUMS)).assert_ended('SUCCEEDED')
    there = result.tip.pose.position
    assert [there.x, there.z] == pytest.approx(place, abs=2e-3) and result.tip_error < 2e-3
    wait_until_told(regulated)


def test_the_model_takes_a_partial_vacuum_by_its_law_and_tendons_may_move(regulated):
    states = regulated.record(KinematicsState, 'kinematics/state', STREAM)

    def tip():
        return float(np.sum(states.last.joint_angles))

    regulated.wait_for_more(states)
    stiff = tip()
    for part in (50e3, 20e3):
        assert regulated.call(SetVacuum, 'jamming_valves/segment_1/set_vacuum',
                              vacuum=part).success
        regulated.wait_for(lambda v=part: states.last.vacuum[0] == pytest.approx(v / 80e3), 'v')
        regulated.wait_for_more(states, 3)
        sagged = tip()
        assert abs(sagged) > abs(stiff) + 0.002  # the less vacuum, the more
        stiff = sagged
    assert all(states.last.stiff)  # jammed, though not confirmed stiff
    assert regulated.soft_segments() == [1]
    regulated.send(trajectory([(0.3, (-0.005, 0.004))]))
    regulated.wait_for(lambda: abs(tip() - stiff) > 0.01, 'a bent arm')
    assert regulated.call(SetVacuum, 'jamming_valves/segment_1/set_vacuum', vacuum=0.0).success
    regulated.wait_for(lambda: not states.last.stiff[0], 'a soft segment')


def test_a_goal_is_planned_from_the_full_vacuum_however_late_the_model_has_it(
        regulated, monkeypatch):
    regulated.set_parameter('shape_sequencer', 'settle_timeout', 60.0)
    assert regulated.call(SetVacuum, 'jamming_valves/segment_1/set_vacuum', vacuum=25e3).success
    states = regulated.record(KinematicsState, 'kinematics/state', STREAM)
    regulated.wait_for(
        lambda: states and states.last.vacuum[0] == pytest.approx(25.0 / 80.0), 'a weak jam')
    model, late = regulated.node('kinematics')._vacuum, [True]
    follow, planning, begins = model.follow, regulated.node('shape_sequencer')._planning, []
    plan = planning.plan
    monkeypatch.setattr(model, 'follow', lambda *given: None if late else follow(*given))

    def planned(shapes, first=False):
        if not first:
            begins.append(list(planning._observed.kinematics.vacuum))
        return plan(shapes, first)

    monkeypatch.setattr(planning, 'plan', planned)
    goal = regulated.goal((0.2, 0.1, 0.0)).wait_for_phase('preparing')
    regulated.wait_for(lambda: vacuum(regulated, 1) > 79e3, 'the full vacuum')
    regulated.wait_for_more(states, 20)
    assert not begins
    late.clear()
    assert goal.result()[0] == 'SUCCEEDED'
    assert begins == [[1.0, 1.0, 1.0]]
