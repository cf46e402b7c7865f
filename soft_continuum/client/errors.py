# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What can go wrong between a client and the arm."""

from soft_continuum.client.state import SequenceResult


class ClientError(RuntimeError):
    """Something that was asked of the arm was not done; the message says why, and what to do."""


class NodesMissingError(ClientError):
    """A node that is needed does not run."""


class NoAnswerError(ClientError, TimeoutError):
    """A node runs, but what was waited for did not come in time."""


class RefusedError(ClientError):
    """A node refused; nothing was changed."""


class LostError(ClientError):
    """The shape_sequencer fell silent while it ran a sequence; how that ended is not known."""


class SequenceError(ClientError):
    """A sequence ended before all of its shapes were reached and held; ``result`` says how."""

    def __init__(self, result: SequenceResult) -> None:
        """Keep ``result``."""
        super().__init__(f'{result.outcome}: {result.message}')
        self.result = result
