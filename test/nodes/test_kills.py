# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that are killed in the middle of a sequence: what the others do, and the next start."""

import pytest

from soft_continuum_interfaces.action import RunShapeSequence
from support.processes import module_command
from support.ros_rig import ALL, QUICK

Result = RunShapeSequence.Result
BEND = (0.0, 0.0, 0.5)
FULL_PULL = 0.008  # m: some more than BEND needs
SLOW = {'tendon_speed': 0.002, 'stale_timeout': 2.0, 'jamming_timeout': 5.0}


def moving_arm(rig, processes, victim):
    """Return an arm in mid-motion, one of its nodes a process that can be killed."""
    process = processes.node(victim, parameters={**QUICK, **SLOW})
    rig.start(*(name for name in ALL if name != victim), **SLOW)
    rig.wait_until_ready(*ALL)
    return process, rig.goal_in_motion(BEND)


def start_again(rig, name):
    """Start a node that was killed, in this process, and wait for its first words."""
    said = len(rig.statuses[name])
    rig.start(name, ready=False, **SLOW)
    rig.wait_for(lambda: len(rig.statuses[name]) > said, f'words from {name}')


def assert_rests_short(rig):
    rig.come_to_rest()
    assert 0.0 < rig.pulls[0] < FULL_PULL


def test_when_the_sequencer_is_killed_the_motion_ceases_by_itself(rig, processes):
    process, _ = moving_arm(rig, processes, 'shape_sequencer')
    process.kill()
    assert_rests_short(rig)
    rested_at, soft = rig.pulls, rig.soft_segments()
    assert soft == [3]

    start_again(rig, 'shape_sequencer')
    rig.assert_rests(20)  # it moves nothing
    assert (rig.pulls, rig.soft_segments()) == (rested_at, soft)
    rig.wait_for(lambda: rig.statuses['shape_sequencer'].last.message == 'idle', 'idle')

    # The next goal goes on from where the arm is.
    assert rig.set_parameter('shape_sequencer', 'tendon_speed', 0.1).successful
    assert rig.goal_when_heard(BEND).result()[0] == 'SUCCEEDED'
    rig.assert_bends(BEND)
    rig.assert_rests_stiff()
    rig.assert_never_moved_all_stiff()


def test_when_the_valves_are_killed_the_goal_is_aborted_and_the_tendons_rest(rig, processes):
    process, goal = moving_arm(rig, processes, 'jamming_valves')
    process.kill()
    goal.assert_ended('ABORTED', 'jamming_valves', code=Result.HARDWARE_FAULT)
    assert_rests_short(rig)
    rested_at = rig.pulls

    heard = [len(r) for r in rig.stiff]
    start_again(rig, 'jamming_valves')
    rig.wait_for(lambda: all(
        len(r) > before for r, before in zip(rig.stiff, heard, strict=True)), 'stiff or soft')
    rig.assert_rests(20)
    assert rig.pulls == rested_at
    # It says what the pressures say, and switches nothing.
    rig.wait_for_more(rig.pressures[0], 10)
    assert all([flag.data for flag in list(r)[before:]] in ([True], [False], [False, True])
               for r, before in zip(rig.stiff, heard, strict=True))


def test_when_kinematics_is_killed_the_goal_is_aborted_and_its_successor_knows_no_shape(
        rig, processes):
    process, goal = moving_arm(rig, processes, 'kinematics')
    process.kill()
    goal.assert_ended('ABORTED', 'kinematics', code=Result.HARDWARE_FAULT)
    rig.assert_rests_stiff(goal)
    assert_rests_short(rig)

    heard = len(rig.joints)
    start_again(rig, 'kinematics')
    rig.wait_for(lambda: 'unknown' in rig.statuses['kinematics'].last.message, 'no shape')
    rig.assert_rests(20)
    assert len(rig.joints) == heard
    rig.goal(BEND).assert_rejected('kinematics')


def test_servos_whose_node_is_killed_are_known_to_the_next_one_which_sets_the_shape(
        rig, processes, tmp_path, monkeypatch):
    """In real time, behind a pseudo-terminal."""
    monkeypatch.setenv('XDG_STATE_HOME', str(tmp_path / 'state'))
    port, bend = tmp_path / 'servos', (0.0, 0.0, 0.3)
    processes.start(module_command('emulate') + ['dynamixel', '--link', str(port)])
    rig.wait_for(port.exists, 'servos')
    slow = {'tendon_speed': 0.004, 'tendon_acceleration': 0.1, 'speed_limit': 0.03,
            'acceleration_limit': 0.3, 'stale_timeout': 2.0}
    given = {**QUICK, **slow, 'tendon_driver': 'dynamixel', 'dynamixel.port': str(port),
             'dynamixel.tension_limits': [60.0, 60.0]}
    node = processes.node('tendon_actuation', parameters=given)
    rig.start(*(name for name in ALL if name != 'tendon_actuation'), settle_timeout=1.0, **slow)
    rig.wait_until_ready(*ALL)
    rig.wait_for(lambda: 'lost power' in rig.statuses['tendon_actuation'].last.message,
                 'why the position is not referenced')
    rig.stiffen()
    assert rig.trigger('tendon_actuation/reference').success
    rig.wait_for_shape()
    goal = rig.goal_in_motion(bend)
    node.kill()
    goal.assert_ended('ABORTED', 'tendon_actuation', code=Result.HARDWARE_FAULT)
    rig.assert_stiff_since(goal)
    last = rig.pulls

    heard, given['stale_timeout'] = len(rig.tendons), 10.0
    assert rig.set_parameter('shape_sequencer', 'stale_timeout', 10.0).successful
    rig.start('tendon_actuation', ready=False, **given)
    rig.wait_for(lambda: len(rig.tendons) > heard + 20, 'tendon_states')
    states = list(rig.tendons)[heard:]
    # By what was commanded ahead, and the lag of the servo: no turn, and no zero, was lost.
    assert list(states[0].position) == pytest.approx(last, abs=2e-3)
    assert states[0].position[0] > 1e-4
    assert not any(any(m.velocity) for m in states)
    assert list(states[-1].position) == pytest.approx(list(states[0].position), abs=2e-4)
    assert rig.all_stiff

    # No parameter says how near servos come to their goals.
    rig.goal_when_heard(bend).assert_ended('SUCCEEDED')
    told = rig.states['tendon_actuation'].last
    assert list(told.pull_tolerances) == [1e-4, 1e-4]
    # 2 % of the 4.1 N m at which an XM430-W350 stalls, on 10 mm
    assert list(told.tension_stddevs) == pytest.approx([8.2, 8.2])
    assert list(told.tension_relative_stddevs) == [0.3, 0.3]
