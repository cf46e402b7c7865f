# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""State of the last accepted and the last refused trajectory."""

from dataclasses import dataclass

from soft_continuum.hardware.tendon_controller import Reason
from soft_continuum.mechanics.arm import Array
from soft_continuum_interfaces.msg import MotionRequest

MAX_POINTS = 1000
"""Largest number of points of a trajectory."""


@dataclass(frozen=True)
class Request:
    """
    A trajectory to be validated.

    times: (k,) s from its start.  pulls: (k, tendons) m.  start: s (steady), None for as soon as
    it is accepted.  revocation: number of revocations when it was received.  stamp: ns of ROS
    time, the start as it was sent; 0 for none.
    """

    id: str
    times: Array
    pulls: Array
    start: float | None
    revocation: int
    stamp: int = 0


class MotionRequests:
    """Keeps MotionRequest messages of the last accepted and the last refused trajectory."""

    def __init__(self) -> None:
        """Start without any."""
        self.accepted, self.refused = MotionRequest(), MotionRequest()
        self.start = 0.0  # of the accepted one, s (steady)

    @property
    def following(self) -> bool:
        """Whether the accepted trajectory has not ended yet."""
        return bool(self.accepted.status == MotionRequest.FOLLOWING)

    def accept(self, request_id: str, start: float) -> None:
        """Follow a trajectory, whose times count from ``start``, s (steady)."""
        self.start = start
        self.accepted = MotionRequest(id=request_id, status=MotionRequest.FOLLOWING)

    def refuse(self, request_id: str, reason: Reason, message: str) -> None:
        """Refuse a trajectory; the accepted one goes on."""
        self.refused = MotionRequest(
            id=request_id, status=MotionRequest.REFUSED,
            reason=getattr(MotionRequest, reason.name), message=message)

    def end(self, reason: Reason, message: str) -> None:
        """End the accepted trajectory before its end, if it is still followed."""
        if self.following:
            self.accepted = MotionRequest(id=self.accepted.id, status=MotionRequest.ENDED,
                                          reason=getattr(MotionRequest, reason.name),
                                          message=message)

    def done(self) -> None:
        """Note that the accepted trajectory, if it is still followed, came to its end."""
        if self.following:
            self.accepted = MotionRequest(id=self.accepted.id, status=MotionRequest.DONE)
