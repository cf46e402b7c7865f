# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How far a run is, and how it ended; the terms that the action and every client share."""

from dataclasses import dataclass
from enum import IntEnum, StrEnum


class Phase(StrEnum):
    """What a run is doing; the values of phase in the feedback of RunShapeSequence."""

    PREPARING = 'preparing'
    SOFTENING = 'softening'
    MOVING = 'moving'
    STIFFENING = 'stiffening'
    HOLDING = 'holding'


class Code(IntEnum):
    """How a run ended; the values of error_code in the result of RunShapeSequence."""

    SUCCESSFUL = 0
    PREEMPTED = -1
    CANCELED = -2
    STOPPED = -3
    TIMEOUT = -4
    HARDWARE_FAULT = -5
    MODEL_FAILURE = -6


@dataclass(frozen=True)
class Progress:
    """Where a run is: shape (0-based), segment (1-based, 0: whole arm), phase, part done 0-1."""

    shape_index: int = 0
    shape: str = ''
    segment: int = 0
    phase: Phase = Phase.PREPARING
    fraction: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """How a run ended, and how many shapes were completed."""

    code: Code
    message: str
    shapes_completed: int
