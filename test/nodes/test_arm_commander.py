# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Only what happened to the sequencer's own motion ends its goal, with the reason it was given."""

from unittest.mock import Mock

import numpy as np
import pytest

from soft_continuum.nodes.arm_commander import ArmCommander, SET_STIFF
from soft_continuum.ros.description import load_arm
from soft_continuum.sequencing import Code
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import MotionRequest, TendonActuationState

ARM = load_arm(description_file())
REASONS = {
    MotionRequest.STIFFNESS_UNKNOWN: Code.HARDWARE_FAULT,
    MotionRequest.DEVICE: Code.HARDWARE_FAULT,
    MotionRequest.INVALID: Code.HARDWARE_FAULT,
    MotionRequest.TENSION: Code.MODEL_FAILURE,
    MotionRequest.STOPPED: Code.STOPPED,
    MotionRequest.LATE: Code.TIMEOUT,
}


def new_commander():
    node = Mock()
    node.get_clock().now().nanoseconds = 0
    return ArmCommander(node, ARM)


@pytest.fixture
def commander():
    """Return a commander that has sent a motion."""
    commander = new_commander()
    commander.begin()
    follow(commander, 1)
    return commander


def follow(commander, motion):
    """Send a piece of a motion; return its id."""
    commander.follow(motion, 100.0, np.array([0.5]), np.array([[0.001, -0.002]]))
    return str(commander._trajectory.publish.call_args.args[0].id)


def accepted(request_id, status=MotionRequest.FOLLOWING, reason=MotionRequest.NO_REASON):
    """Return a state with the last request that was accepted."""
    return TendonActuationState(accepted=MotionRequest(
        id=request_id, status=status, reason=reason, message='the reason'))


def refused(request_id, reason):
    """Return a state with the last request that was refused."""
    return TendonActuationState(refused=MotionRequest(
        id=request_id, status=MotionRequest.REFUSED, reason=reason, message='the reason'))


def failure(commander, *states):
    """Return how a motion has failed of which these states say how it goes on."""
    for state in states:
        commander.on_tendon_state(state)
    return commander.motion_failure.message if commander.motion_failure else ''


@pytest.mark.parametrize(('reason', 'code'), REASONS.items())
def test_the_reason_of_a_refusal_decides_how_the_goal_ends_until_a_new_motion(
        commander, reason, code):
    refusal = failure(commander, refused(follow(commander, 1), reason))
    assert refusal == 'the tendon motion was refused: the reason'
    assert commander.motion_failure.code is code
    follow(commander, 2)
    assert commander.motion_failure is None


def test_an_end_counts_although_the_next_piece_is_followed(commander):
    own = follow(commander, 1)
    assert failure(commander, accepted(own), accepted(
        own, MotionRequest.ENDED, MotionRequest.STIFFNESS_UNKNOWN), accepted(own)
    ) == 'the tendon motion was ended: the reason'


def test_pieces_of_one_motion_replace_each_other_without_ending_it(commander):
    own = follow(commander, 1)
    assert follow(commander, 1) == own
    assert not failure(
        commander, accepted(own), accepted(own, MotionRequest.ENDED, MotionRequest.REPLACED),
        accepted(own), accepted(own, MotionRequest.DONE))


def test_what_happened_to_requests_of_others_and_earlier_ones_is_ignored(commander):
    earlier = follow(commander, 1)
    own = follow(commander, 2)
    assert own != earlier
    assert not failure(
        commander, refused('client/7', MotionRequest.TENSION),
        accepted('client/7', MotionRequest.ENDED, MotionRequest.HELD),
        refused(earlier, MotionRequest.INVALID), accepted(own))
    assert 'client/7' in failure(commander, accepted('client/7'))  # which has replaced it


def test_a_piece_that_the_network_brings_when_the_motion_is_done_is_no_failure(commander):
    own = follow(commander, 1)
    state = refused(own, MotionRequest.LATE)
    state.accepted = accepted(own, MotionRequest.DONE).accepted
    commander.on_tendon_state(state)
    assert commander.motion_failure is None
    state.accepted.status = MotionRequest.FOLLOWING
    commander.on_tendon_state(state)
    assert commander.motion_failure is not None


def test_what_was_not_answered_is_withdrawn_when_a_run_ends(commander):
    node, clients = commander._node, [Mock() for _ in ARM.segments]
    commander._clients = {(SET_STIFF, n): client for n, client in enumerate(clients)}
    for client, done in zip(clients, (True, False), strict=False):
        client.call_async.return_value.done.return_value = done
    commander.set_stiff(0, True)
    commander.set_stiff(1, False)
    commander.end()
    node.destroy_client.assert_called_once_with(clients[1])
    assert commander._clients[SET_STIFF, 0] is clients[0]
    assert commander._clients[SET_STIFF, 1] is not clients[1]
    commander.end()
    node.destroy_client.assert_called_once()


def test_no_two_processes_and_no_two_runs_use_the_same_id():
    ids = set()
    for _ in range(2):
        commander = new_commander()
        for _ in range(2):
            commander.begin()
            ids |= {follow(commander, motion) for motion in (1, 2)}
    assert len(ids) == 8
