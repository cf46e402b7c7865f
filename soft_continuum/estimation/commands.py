# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""State of motors and valves."""

from dataclasses import dataclass

from soft_continuum.mechanics.arm import Array


@dataclass(frozen=True, eq=False)
class ActuatorState:
    """
    State of tendons and valves at one time.

    time: s on the clock of the measurements.  pulls: (tendons,) m of the motors.  stiff: per
    segment.  vacuum: fraction of full vacuum per segment, None for full.  sliding: as in
    Statics.solve.  yielding: whether a stiff segment has so little vacuum that the tendons may
    bend it.
    """

    time: float
    pulls: Array
    stiff: tuple[bool, ...]
    vacuum: tuple[float, ...] | None = None
    sliding: tuple[int, ...] = ()
    yielding: bool = False

    @property
    def soft(self) -> list[bool]:
        """Which segments are soft."""
        return [not stiff for stiff in self.stiff]
