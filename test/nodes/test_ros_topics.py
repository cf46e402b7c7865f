# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The four nodes on the controllers and the board of somebody else, all over topics."""

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import pytest

from support.ros2_control import Controllers, JOINTS, RADIUS
from support.ros_rig import Rig
from support.ros_valves import REGULATORS, Regulators, VALVES, Valves

BEND = (0.0, 0.0, 0.3)
BOARDS = {Valves: VALVES, Regulators: REGULATORS}
STATES = '/joint_state_broadcaster/joint_states'


@dataclass
class Bench:
    """The nodes, and what they drive."""

    rig: Rig
    controllers: Controllers
    board: Any

    def prepare(self):
        """Say that the arm is straight."""
        self.rig.wait_for(lambda: self.rig.trigger('tendon_actuation/reference').success,
                          'tendons at rest')
        self.rig.wait_for_shape()


@pytest.fixture
def make(rig):
    """Return a maker of an arm, stiff, straight and referenced, on topics."""
    made = []

    def start(kind, command_topic, board, **changes):
        bench = Bench(rig, Controllers(rig.domain, kind), board(rig.domain))
        made.append(bench)
        rig.start_arm(**{
            'tendon_driver': 'ros_topics', 'ros_tendons.joints': JOINTS,
            'ros_tendons.scales': [RADIUS], 'ros_tendons.state_topic': STATES,
            'ros_tendons.command_topic': command_topic, 'ros_tendons.command_type': kind,
            'tendon_speed': 0.04, 'tendon_acceleration': 1.0, 'speed_limit': 0.1,
            'stale_timeout': 8.0, 'ros_tendons.timeout': 2.0, 'ros_jamming.timeout': 1.0,
            'ros_tendons.following_error': 0.02, **BOARDS[board], **changes})
        bench.prepare()
        return bench

    yield start
    rig.end_all()
    for bench in made:
        bench.controllers.close()
        bench.board.close()


def assert_joints_agree(bench):
    """Claim that the joints are where the node reports the tendons, and that they moved."""
    bench.rig.assert_rests()
    assert bench.rig.pulls == pytest.approx(bench.controllers.pulls, abs=1e-6)
    assert abs(bench.rig.pulls[0]) > 1e-3


def test_joint_states_that_stop_end_the_goal_and_nothing_moves_before_resume(make):
    bench = make('positions', '/position_controller/commands', Valves)
    rig, controllers = bench.rig, bench.controllers
    goal = rig.goal_in_motion(BEND)
    controllers.message = lambda message: None
    goal.assert_ended('ABORTED', f'nothing new on {STATES}')
    controllers.message = lambda message: message
    rig.wait_for_status('tendon_actuation', 'stopped', 'the device failed')
    rig.wait_for(lambda: rig.statuses['tendon_actuation'].last.level == DiagnosticStatus.WARN,
                 'a reconnection')
    rests_at = controllers.pulls
    rig.assert_rests()
    assert controllers.pulls == pytest.approx(rests_at, abs=1e-9)
    rig.goal(BEND).assert_rejected('the device failed')
    assert rig.trigger('tendon_actuation/resume').success
    # The same node reports the joints where they were: their zero is still known.
    assert rig.goal_when_heard((0.0, 0.0, 0.1)).result()[0] == 'SUCCEEDED'
    assert_joints_agree(bench)
    rig.assert_never_moved_all_stiff()


def test_pressures_that_stop_end_the_goal_and_nothing_is_switched(make):
    bench = make('trajectory', '/trajectory_controller/joint_trajectory', Regulators,
                 stale_timeout=2.0, jamming_timeout=3.0)
    rig, board = bench.rig, bench.board
    goal = rig.goal_when_heard((0.0, 0.0, -0.2))
    assert goal.result()[0] == 'SUCCEEDED'
    rig.assert_stiff_since(goal)
    rig.assert_stiff_only_by_pressure()
    assert_joints_agree(bench)
    goal = rig.goal_in_motion(BEND)
    board.publishes = False
    goal.assert_ended('ABORTED', 'jamming_valves')
    rig.wait_for(lambda: rig.at_rest, 'rest')
    rig.wait_for(lambda: not any(flag.last.data for flag in rig.stiff), 'no stiffness known')
    evacuated = board.plant.read().evacuated
    board.publishes = True
    rig.wait_for(lambda: rig.statuses['jamming_valves'].last.level == DiagnosticStatus.OK,
                 'the valves back')
    assert board.plant.read().evacuated == evacuated
