# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What can go wrong between a client and the arm."""

from typing import TYPE_CHECKING

from soft_continuum.text import printable

if TYPE_CHECKING:
    from soft_continuum.client.state import SequenceResult


class ClientError(RuntimeError):
    """A request was not carried out; the message says why, and what to do, in one line."""

    def __init__(self, message: object = '') -> None:
        """Take a message of which parts may come from others."""
        super().__init__(printable(message))


class NodesMissingError(ClientError):
    """A node that is needed does not run."""


class NoAnswerError(ClientError, TimeoutError):
    """A node runs, but what was waited for did not come in time."""


class RefusedError(ClientError):
    """A node refused a request, or ended it early."""


class MotionEndedError(RefusedError):
    """A motion was accepted and ended early; ``reason`` is a value of MotionRequest.reason."""

    def __init__(self, message: str, reason: int) -> None:
        """Keep ``reason``."""
        super().__init__(message)
        self.reason = reason


class LostError(ClientError):
    """Nothing more was received of the shape_sequencer; how the sequence ended is not known."""


class SequenceError(ClientError):
    """A sequence ended before all of its shapes were reached and held; ``result`` says how."""

    def __init__(self, result: 'SequenceResult') -> None:
        """Keep ``result``."""
        super().__init__(f'{result.outcome}: {result.message}')
        self.result = result
