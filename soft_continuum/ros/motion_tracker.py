# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What happened to a motion that was sent to tendon_actuation, and why none is possible."""

from soft_continuum_interfaces.msg import MotionRequest, TendonActuationState

NOT_REFERENCED = ('the position of the tendons is not referenced; straighten the arm and call '
                  'tendon_actuation/reference')
"""Why no motion is possible, and what to do."""


def replaced_by(request_id: str) -> str:
    """Return why a motion has ended that another trajectory replaced."""
    return f'replaced by another trajectory ({request_id or "without an id"})'


class MotionTracker:
    """
    Finds the outcome of one motion in the states of tendon_actuation.

    The motion may be sent in parts that share its id.  followed: whether it has been accepted.
    """

    def __init__(self, motion_id: str) -> None:
        """Begin before the motion is accepted."""
        self.id, self.followed = motion_id, False

    def outcome(self, state: TendonActuationState) -> MotionRequest | None:
        """
        Return what tendon_actuation reports on the motion; None while that is not known.

        A followed motion that another trajectory has replaced is ENDED.
        """
        accepted, refused = state.accepted, state.refused
        own = accepted.id == self.id
        # Of a motion that is done, the network may bring a part once more, or late.
        done = own and accepted.status == MotionRequest.DONE
        if refused.id == self.id and not (done and refused.reason == MotionRequest.LATE):
            return refused
        if own:
            self.followed = True
            # A newer part of the same motion may have replaced it: the next state shows that.
            is_replaced = (accepted.status == MotionRequest.ENDED
                           and accepted.reason == MotionRequest.REPLACED)
            return None if is_replaced else accepted
        return MotionRequest(
            id=self.id, status=MotionRequest.ENDED, reason=MotionRequest.REPLACED,
            message=replaced_by(accepted.id)
        ) if self.followed else None
