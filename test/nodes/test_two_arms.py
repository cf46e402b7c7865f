# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Two arms on one machine."""

from collections.abc import Callable
from pathlib import Path
import signal

from soft_continuum.user_files import description_file
from soft_continuum_interfaces.action import RunShapeSequence
from support.processes import assert_ended_in_peace, module_command, Processes
from support.ros_rig import ALL, Rig

SHAPES = {'left': (0.0, 0.4, 0.2), 'right': (0.0, -0.3, 0.5)}


def test_two_arms_run_different_shapes_at_the_same_time(make_rig: Callable[..., Rig]) -> None:
    rigs = {name: make_rig(namespace=f'/{name}') for name in SHAPES}
    for rig in rigs.values():
        rig.start_arm(tendon_speed=0.03, simulated_jamming__evacuation_time=0.2)
    goals = {name: rig.goal(SHAPES[name], hold=60.0) for name, rig in rigs.items()}
    for goal in goals.values():
        goal.wait_for_phase('holding')
    for name, rig in rigs.items():
        assert not goals[name].ended, f'{name} was alone'
        rig.assert_bends(SHAPES[name])
        goals[name].cancel()
        assert goals[name].result()[0] == 'CANCELED'
        rig.assert_only_one_was_soft()
        rig.assert_never_moved_all_stiff()


def test_a_stop_of_one_arm_leaves_the_other_one_running(make_rig: Callable[..., Rig]) -> None:
    rigs = {name: make_rig(namespace=f'/{name}') for name in SHAPES}
    for rig in rigs.values():
        rig.start_arm(tendon_speed=0.02)
    # The left one does not end before it is stopped.
    goals = {name: rig.goal(SHAPES[name], hold=60.0 * (name == 'left'))
             for name, rig in rigs.items()}
    for goal in goals.values():
        goal.wait_for_phase('moving')
    assert rigs['left'].trigger('tendon_actuation/stop').success
    assert goals['left'].result()[1].error_code == RunShapeSequence.Result.STOPPED
    assert goals['right'].result()[0] == 'SUCCEEDED'
    rigs['right'].assert_bends(SHAPES['right'])
    rigs['left'].assert_rests()


def test_the_four_nodes_come_up_under_a_namespace(
        make_rig: Callable[..., Rig], processes: Processes, tmp_path: Path) -> None:
    patient = tmp_path / 'patient.yaml'
    patient.write_text('/**:\n  ros__parameters:\n    stale_timeout: 10.0\n')
    rig = make_rig(namespace='/lab/left')
    up = processes.start([
        *module_command('up'), '--namespace', '/lab/left/',
        '--params-file', str(description_file()), '--params-file', str(patient)])
    rig.wait_until_ready(*ALL)
    nodes = {f'{rig.namespace}/{name}' for name in (*ALL, 'observer')}
    rig.wait_for(lambda: nodes == {f'{space.rstrip("/")}/{name}' for name, space in
                                   rig.observer.get_node_names_and_namespaces()},
                 'the four nodes and no other in the graph')
    assert rig.goal_when_heard((0.0, 0.0, 0.1)).result()[0] == 'SUCCEEDED'
    # Two arms share one TF tree.
    assert rig.segment_poses.last.header.frame_id == 'lab/left/base_link'
    up.send(signal.SIGTERM)  # in test_twin.py it is SIGINT
    assert_ended_in_peace(up)
