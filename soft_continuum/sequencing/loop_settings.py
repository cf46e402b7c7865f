# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How a closed loop is run, and what to do about obstacles that come."""

from dataclasses import dataclass

ON_ANOMALY = GO_ON, PAUSE, ABORT = ('go_on', 'pause', 'abort')
REPLAN = 'replan'
ON_OBSTACLE = (REPLAN, ABORT)


@dataclass(frozen=True)
class LoopSettings:
    """
    When a measurement counts, and how often is corrected.

    settling_time: s after a motion or a switch until the arm rests.  measuring_time: s for which
    it is measured then.  sensor_timeout: s without a measurement, after which there is none.
    max_corrections: of one segment before it is stiffened.  max_passes: over all segments.
    abort_when_lost: end the run when measurements stop; otherwise it goes on as predicted.
    on_anomaly: what to do when measurements say that something is wrong with the arm; one of
    ON_ANOMALY.  tip_tolerance, angle_tolerance: m and rad, of the aim, beyond which is warned of
    what was not reached, and of what drifts while it is held.  correct_drift: set segments again
    then.  release_limit: m by which the tip may move when one of those is softened for that.
    """

    settling_time: float = 1.2
    measuring_time: float = 0.5
    sensor_timeout: float = 3.0
    max_corrections: int = 3
    max_passes: int = 2
    abort_when_lost: bool = True
    on_anomaly: str = GO_ON
    tip_tolerance: float = 2e-3
    angle_tolerance: float = 0.02
    correct_drift: bool = False
    release_limit: float = 0.01
