# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Two arms on one machine."""

from soft_continuum_interfaces.action import RunShapeSequence

SHAPES = {'left': (0.0, 0.4, 0.2), 'right': (0.0, -0.3, 0.5)}


def test_two_arms_run_different_shapes_at_the_same_time_and_a_stop_is_of_one_alone(make_rig):
    rigs = {name: make_rig(namespace=f'/{name}') for name in SHAPES}
    for rig in rigs.values():
        rig.start_arm(tendon_speed=0.03, simulated_jamming__evacuation_time=0.2)
    left, right = rigs.values()
    goals = {name: rig.goal(SHAPES[name], hold=600.0) for name, rig in rigs.items()}
    for goal in goals.values():
        goal.wait_for_phase('moving')
    assert left.trigger('tendon_actuation/stop').success
    assert goals['left'].result()[1].error_code == RunShapeSequence.Result.STOPPED
    left.come_to_rest()
    goals['right'].wait_for_phase('holding')
    assert left.trigger('tendon_actuation/resume').success
    assert left.goal_when_heard(SHAPES['left']).result()[0] == 'SUCCEEDED'
    assert not goals['right'].ended
    for name, rig in rigs.items():
        rig.assert_bends(SHAPES[name])
        rig.assert_only_one_was_soft()
        rig.assert_never_moved_all_stiff()
    goals['right'].cancel()
    assert goals['right'].result()[0] == 'CANCELED'
