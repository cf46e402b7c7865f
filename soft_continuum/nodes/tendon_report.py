# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Reports of the control thread to the other threads of tendon_actuation."""

from dataclasses import dataclass

from soft_continuum.hardware.protocols import TendonReading
from soft_continuum_interfaces.msg import TendonActuationState


@dataclass(frozen=True)
class Report:
    """
    State after a cycle or a request.

    ended, refused: why the last motion was, for people; empty once a later one is accepted.
    unmeasured: which load cell is stale or implausible.  reading: the last one or None; its pulls
    are only valid if referenced.  time, start: of the reading and of the accepted trajectory, s
    (steady).
    """

    state: TendonActuationState
    ended: str
    refused: str
    unmeasured: str
    reading: TendonReading | None
    time: float
    start: float
