# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The interface between a Runner and the arm."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.sequencing.progress import Code


@dataclass(frozen=True)
class Failure:
    """Why a run cannot continue."""

    code: Code
    message: str


@dataclass(frozen=True)
class Observation:
    """
    The state of the arm at one tick.

    pulls: (tendons,) m.  moving: whether a tendon moves or may still move to its set-point.
    stiff: per segment, confirmed by pressure.  vacuum: per segment, Pa below ambient.  regulators:
    whether the vacuum of each segment is held by one, in place of valves.  stopped: why tendon
    motion is stopped.  fault: why the arm cannot be operated, such as a stale node.
    motion_failure: why the last motion was refused or ended early.  stops: total number of stops.
    measured: time of the last measurement, on the clock of the ticks; None for never.  anomaly: of
    the arm, from measurements.  obstructed: obstacle that now blocks the running plan.  departed:
    deviation of the arm from that plan, if too large.  unseen: whether that plan has not yet been
    checked against the present obstacles.  lost_tendons, lost_valves: whether tendon_actuation or
    jamming_valves is stale.  agreed: whether the reported shape has these segments stiff, with the
    vacuums that regulators hold.  pull_tolerances: (tendons,) m, position tolerance of a tendon at
    rest; empty: not reported.
    """

    pulls: tuple[float, ...]
    moving: bool
    stiff: tuple[bool, ...]
    vacuum: tuple[float, ...]
    stopped: str = ''
    fault: str = ''
    motion_failure: Failure | None = None
    stops: int = 0
    measured: float | None = None
    anomaly: str = ''
    obstructed: str = ''
    departed: str = ''
    unseen: bool = False
    regulators: bool = False
    lost_tendons: bool = False
    lost_valves: bool = False
    agreed: bool = True
    pull_tolerances: tuple[float, ...] = ()

    def rests_at(self, pulls: Array, tolerance: float) -> bool:
        """Return whether tendons rest at pulls (m) within ``tolerance`` (m) or their own."""
        off = np.abs(np.subtract(self.pulls, pulls))
        return not self.moving and bool(
            (off <= np.maximum(tolerance, self.pull_tolerances or 0.0)).all())


class ArmPort(Protocol):
    """How a Runner acts on the arm; every call may be repeated without harm."""

    def set_stiff(self, segment: int, stiff: bool) -> None:
        """Request that a segment (0-based) is evacuated or vented."""

    def set_vacuum(self, segment: int, vacuum: float) -> None:
        """Request that the regulator of a segment (0-based) holds a vacuum, Pa below ambient."""

    def follow(self, motion: int, start: float, times: Array, pulls: Array) -> None:
        """
        Request the pulls (k, tendons) m at ``start + times`` s, on the clock of the ticks.

        A motion is sent in pieces, each replacing the one before; ``motion`` numbers the motions.
        """

    def hold(self) -> None:
        """Request that the tendons brake and hold."""
