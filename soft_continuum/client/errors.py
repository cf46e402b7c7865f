# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of the client."""

from typing import TYPE_CHECKING

from soft_continuum.text import printable

if TYPE_CHECKING:
    from soft_continuum.client.state import SequenceResult


class ClientError(RuntimeError):
    """A request was not carried out; the message gives reason and remedy in one line."""

    def __init__(self, message: object = '') -> None:
        """Use a message that may contain received text."""
        super().__init__(printable(message))


class NodesMissingError(ClientError):
    """A required node does not run."""


class NoAnswerError(ClientError, TimeoutError):
    """A node runs, but did not respond in time."""


class RefusedError(ClientError):
    """A node refused a request, or ended it early."""


class MotionEndedError(RefusedError):
    """A motion was accepted and ended early; ``reason`` is a value of MotionRequest.reason."""

    def __init__(self, message: str, reason: int) -> None:
        """Keep ``reason``."""
        super().__init__(message)
        self.reason = reason


class LostError(ClientError):
    """The shape_sequencer stopped reporting; the result of the sequence is unknown."""


class SequenceError(ClientError):
    """A sequence ended before all of its shapes were reached and held; see ``result``."""

    def __init__(self, result: 'SequenceResult') -> None:
        """Keep ``result``."""
        super().__init__(f'{result.outcome}: {result.message}')
        self.result = result
