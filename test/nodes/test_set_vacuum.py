# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An arm whose regulators hold segments between soft and stiff, as ROS sees it."""

from geometry_msgs.msg import Point, Pose
import numpy as np
import pytest

from soft_continuum_interfaces.msg import KinematicsState, Shape, TipGoal
from soft_continuum_interfaces.srv import SetVacuum
from support.ros_rig import AMBIENT, STREAM, trajectory

VACUUMS = (25e3, 80e3, 40e3)


@pytest.fixture
def regulated(rig):
    """Return an arm that lies, with regulators and a law for its jams."""
    rig.start_arm(simulated_jamming__regulators=True, arm__stiffness_ratios=(10.0,),
                  arm__mounting_angle=1.2, arm__bodies_per_segment=4)
    return rig


def vacuum(rig, segment):
    return AMBIENT - float(rig.pressures[segment - 1].last.fluid_pressure)


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
