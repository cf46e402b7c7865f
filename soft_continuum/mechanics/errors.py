# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Errors that the statics raise when they find no equilibrium."""

from typing import Any


class StaticsError(RuntimeError):
    """
    No equilibrium was found.

    ``state`` is the last accepted equilibrium on the path, planar or spatial.
    """

    def __init__(self, message: str, state: Any) -> None:
        """Keep the state at which the search ended."""
        super().__init__(message)
        self.state = state


class OverconstrainedError(StaticsError):
    """The tendons are pulled in farther than any shape of the soft segments allows."""
