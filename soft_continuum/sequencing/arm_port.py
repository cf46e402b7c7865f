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
    whether the vacuum of each segment is held by one, in place of valves.  stopped:
    why tendon motion is stopped.  fault: why the arm cannot be operated, such as a stale node.
    motion_failure: why the motion that was sent last was refused or ended early.  stops: how often
    motion was stopped, ever.  measured: when the arm was last measured, on the clock of the ticks;
    None for never.  anomaly: what the measurements say is wrong with the arm.  obstructed: which
    obstacle is now in the way of the plan that is followed.  departed: how far the arm is from
    that plan, once it is too far.  unseen: whether that plan has not been compared yet with the
    obstacles that there are since it was made.  lost_tendons, lost_valves: whether nothing more
    is heard of what moves the tendons, or switches the segments.  agreed: whether the shape that
    is reported is of an arm with these segments stiff, by the vacuums that regulators hold.
    pull_tolerances: (tendons,) m, how far from where it was sent a tendon may come to rest; empty:
    its device does not tell.
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
        """Return whether tendons rest at pulls (m), as near as ``tolerance`` (m) or they can."""
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
