# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the view knows of the arm: the latest of everything that was heard, in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan
from time import monotonic

from soft_continuum.mechanics.arm import Arm

LOST = 3.0  # s: each node says something once a second
ENDED = 2.0  # s: a running sequence tells its progress at 20 Hz


@dataclass(frozen=True)
class Description:
    """
    What the running nodes were started with.

    shapes: bending angles (rad) by name.  ambient_pressure: Pa.  tension_limit: N.
    """

    arm: Arm
    shapes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    ambient_pressure: float = 101325.0
    tension_limit: float = 60.0


@dataclass(frozen=True)
class Report:
    """What a node says of itself: level 0, 1 or 2, words and values; when it was heard, s."""

    level: int
    message: str
    values: Mapping[str, str]
    time: float

    @property
    def age(self) -> float:
        """Seconds since the node was heard."""
        return monotonic() - self.time


@dataclass(frozen=True)
class Progress:
    """A running sequence: the shape that is set, 0-based; segment from 1, or 0 for the arm."""

    index: int
    shape: str
    segment: int
    phase: str
    fraction: float
    time: float


@dataclass(frozen=True)
class Notice:
    """Something to be read: ``refused`` when an action had no effect."""

    number: int
    clock: str
    title: str
    text: str
    refused: bool


@dataclass
class ArmState:
    """
    The arm as it was last heard of.

    joint_angles: rad.  pulls: m.  tensions: N, nan where the model does not determine them.
    stiff, vacuum (Pa): of each segment.  Tendons are in the order right, left.  target: points
    (x, z) m along the shape that a sequence goes to.
    """

    joint_angles: tuple[float, ...] = ()
    pulls: tuple[float, float] = (nan, nan)
    moving: bool = False
    tensions: tuple[float, float] = (nan, nan)
    stiff: list[bool | None] = field(default_factory=list)
    vacuum: list[float] = field(default_factory=list)
    reports: dict[str, Report] = field(default_factory=dict)
    progress: Progress | None = None
    target: tuple[tuple[float, float], ...] = ()

    def hears(self, node: str) -> bool:
        """Whether a node was heard lately."""
        return node in self.reports and self.reports[node].age < LOST

    def value(self, node: str, key: str) -> str:
        """Return one value of a node's status; empty if it does not say it."""
        return self.reports[node].values.get(key, '') if node in self.reports else ''

    @property
    def running(self) -> Progress | None:
        """The progress of the sequence that runs, whoever started it."""
        progress = self.progress
        return progress if progress and monotonic() < progress.time + ENDED else None

    @property
    def flags(self) -> list[bool | None]:
        """Which segments are stiff; None for those of which nothing is heard any more."""
        return self.stiff if self.hears('jamming_valves') else [None] * len(self.stiff)

    @property
    def soft(self) -> list[int]:
        """Numbers of the soft segments, from 1."""
        return [n for n, stiff in enumerate(self.flags, start=1) if stiff is False]
