# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The deadlines and tolerances of a run."""

from dataclasses import dataclass

from soft_continuum.sequencing.loop_settings import REPLAN

LOST = 2.0
"""Of the tolerance of a vacuum that was reached: so far off it is lost."""
SETTLED = 0.3, 300.0
"""s for which vacuums may change by so many Pa at most, for a shape that is held with them."""


@dataclass(frozen=True)
class RunnerSettings:
    """
    Deadlines and tolerances.

    jamming_timeout, settle_timeout: s.  settle_tolerance: m, or more where a tendon
    cannot come so near.  soft_vacuum: Pa below ambient up to which a segment is soft.
    full_vacuum: Pa, that regulators hold in a stiff segment.  vacuum_tolerance: Pa by which a
    vacuum may differ from what its regulator is told.  horizon: s of motion sent ahead; the
    tendons stop by themselves that soon after the sequencer ended.  retry: s between repeated
    requests.  jamming: whether segments are switched.  piece_period: s between two pieces of a
    motion, each of which tendon_actuation has to judge.  on_obstacle: what to do about an obstacle
    that comes into the way; one of ON_OBSTACLE.  max_replans: plans of one shape that are made
    again.
    """

    jamming_timeout: float = 10.0
    settle_timeout: float = 5.0
    settle_tolerance: float = 2e-5
    soft_vacuum: float = 10e3
    full_vacuum: float = 80e3
    vacuum_tolerance: float = 3e3
    horizon: float = 0.5
    retry: float = 2.0
    jamming: bool = True
    piece_period: float = 0.0
    on_obstacle: str = REPLAN
    max_replans: int = 3
