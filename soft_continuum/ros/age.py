# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How long ago something was last received."""

from math import inf
from time import monotonic


class Age:
    """Time since something was last received, by a clock that nobody sets."""

    def __init__(self) -> None:
        """Start as never received."""
        self._received = -inf

    def refresh(self) -> None:
        """Note that it was received now."""
        self._received = monotonic()

    def forget(self) -> None:
        """Count as never received, until it is received again."""
        self._received = -inf

    @property
    def seconds(self) -> float:
        """Seconds since it was received; infinite before the first time."""
        return monotonic() - self._received
