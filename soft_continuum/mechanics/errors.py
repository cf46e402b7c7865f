# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the statics raise when there is no equilibrium to return."""

from typing import Any


class StaticsError(RuntimeError):
    """
    No equilibrium was found.

    ``state`` is the last equilibrium on the path, planar or spatial; nothing beyond it was
    accepted.
    """

    def __init__(self, message: str, state: Any) -> None:
        """Keep the state at which the search ended."""
        super().__init__(message)
        self.state = state


class OverconstrainedError(StaticsError):
    """The tendons are pulled in further than any shape of the soft segments allows."""
