# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The state machines that run plans, with and without measurements; the servo; without ROS.

Here: aims, phases, progress and outcome of a run, in terms of the action and its clients.
"""

from dataclasses import dataclass
from enum import auto, Enum, StrEnum

AIMS = ('angles', 'tip')
"""The controlled quantity; the values of aim in the goal of RunShapeSequence, from 0."""


class Phase(StrEnum):
    """Phases of a run; the values of phase in the feedback of RunShapeSequence."""

    PREPARING = 'preparing'
    SOFTENING = 'softening'
    MOVING = 'moving'
    MEASURING = 'measuring'
    STIFFENING = 'stiffening'
    RELAXING = 'relaxing'
    HOLDING = 'holding'
    PAUSED = 'paused'


class Code(Enum):
    """How a run ended; names as of error_code in the result of RunShapeSequence."""

    SUCCESSFUL = auto()
    PREEMPTED = auto()
    CANCELED = auto()
    STOPPED = auto()
    TIMEOUT = auto()
    HARDWARE_FAULT = auto()
    MODEL_FAILURE = auto()
    OBSTRUCTED = auto()
    CLOCK_JUMPED = auto()


@dataclass(frozen=True)
class Progress:
    """
    Where a run is: shape (0-based), segment (1-based, 0: whole arm), phase, part done 0-1.

    correction: of the running segment, from 1; 0: none.  error: of the running shape by the last
    measurement, None without measurements: m of the tip for the aim 'tip', rad of the worst
    segment for 'angles'; aim: '' if unknown.
    """

    shape_index: int = 0
    shape: str = ''
    segment: int = 0
    phase: Phase = Phase.PREPARING
    fraction: float = 0.0
    correction: int = 0
    error: float | None = None
    aim: str = ''


@dataclass(frozen=True)
class Outcome:
    """
    How a run ended, and how many shapes were completed.

    measured: whether the last shape was set by measurements.  lost: whether measurements stopped
    before.  corrections, replans: their numbers.
    """

    code: Code
    message: str
    shapes_completed: int
    measured: bool = False
    corrections: int = 0
    replans: int = 0
    lost: bool = False
