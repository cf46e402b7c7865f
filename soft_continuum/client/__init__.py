# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A client of a running arm, for scripts and notebooks.

``Arm`` uses the public topics, services and action of the four nodes, like any other client; see
docs/how_to/use_the_python_client.md.
"""

from typing import TYPE_CHECKING

from soft_continuum.client.tip import Tip
from soft_continuum.extras import names_from

if TYPE_CHECKING:
    from soft_continuum.client.arm import Arm
    from soft_continuum.client.errors import (
        ClientError,
        LostError,
        MotionEndedError,
        NoAnswerError,
        NodesMissingError,
        RefusedError,
        SequenceError,
    )
    from soft_continuum.client.estimate import Anomaly, Estimate, LearnedParameter
    from soft_continuum.client.sequence import Held, Plan, PlanStep, RunningSequence
    from soft_continuum.client.state import (
        ArmState,
        NodeReport,
        Pose,
        Progress,
        Reached,
        SequenceResult,
    )

__all__ = [
    'Anomaly',
    'Arm',
    'ArmState',
    'ClientError',
    'Estimate',
    'Held',
    'LearnedParameter',
    'LostError',
    'MotionEndedError',
    'NoAnswerError',
    'NodeReport',
    'NodesMissingError',
    'Plan',
    'PlanStep',
    'Pose',
    'Progress',
    'Reached',
    'RefusedError',
    'RunningSequence',
    'SequenceError',
    'SequenceResult',
    'Tip',
]

# Errors first: a program that only stops the arm loads neither NumPy nor the state classes.
__getattr__ = names_from(__name__, __all__, (
    'errors', 'arm', 'state', 'estimate', 'sequence'))


def __dir__() -> list[str]:
    return [*globals(), *__all__]
