# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What happened to the trajectories that were sent: the last accepted and the last refused one."""

from soft_continuum_interfaces.msg import MotionRequest


class MotionRequests:
    """Keeps MotionRequest messages of the last accepted and the last refused trajectory."""

    def __init__(self) -> None:
        """Start without any."""
        self.accepted, self.refused = MotionRequest(), MotionRequest()

    @property
    def following(self) -> bool:
        """Whether the accepted trajectory has not come to its end yet."""
        return bool(self.accepted.status == MotionRequest.FOLLOWING)

    def accept(self, request_id: str) -> None:
        """Follow a trajectory from now on."""
        self.accepted = MotionRequest(id=request_id, status=MotionRequest.FOLLOWING)

    def refuse(self, request_id: str, reason: int, message: str) -> None:
        """Refuse a trajectory; the accepted one goes on."""
        self.refused = MotionRequest(
            id=request_id, status=MotionRequest.REFUSED, reason=reason, message=message)

    def end(self, reason: int, message: str) -> None:
        """End the accepted trajectory before its end, if it is still followed."""
        if self.following:
            self.accepted = MotionRequest(id=self.accepted.id, status=MotionRequest.ENDED,
                                          reason=reason, message=message)

    def done(self) -> None:
        """Note that the accepted trajectory, if it is still followed, came to its end."""
        if self.following:
            self.accepted = MotionRequest(id=self.accepted.id, status=MotionRequest.DONE)
