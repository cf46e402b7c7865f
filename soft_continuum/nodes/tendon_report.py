# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the thread of control tells the other threads of tendon_actuation."""

from dataclasses import dataclass

from soft_continuum.hardware.protocols import TendonReading
from soft_continuum_interfaces.msg import TendonActuationState


@dataclass(frozen=True)
class Report:
    """
    State after a cycle or a request.

    ended, refused: why the last motion was, for people; empty when a later one was accepted.
    unmeasured: which load cell tells nothing.  reading: the last one, None without one; its pulls
    mean nothing unless it is referenced.  time, start: of it and of the accepted trajectory, s
    (steady).
    """

    state: TendonActuationState
    ended: str
    refused: str
    unmeasured: str
    reading: TendonReading | None
    time: float
    start: float
