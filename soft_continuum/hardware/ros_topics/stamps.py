# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Which messages of another node are new, and which come too late to be believed."""

from math import inf

from soft_continuum.hardware.protocols import HardwareError

CLOCK_DRIFT = 1e-3
"""s per s by which two clocks may run apart."""


class Stamps:
    """
    The stamps of one sender, whose clock need not agree with this one.

    What is delayed shows by a stamp that is older than those of other messages were when they
    came; what is repeated, or comes in the wrong order, by a stamp that is not newer.
    """

    def __init__(self, timeout: float) -> None:
        """Begin without a message; timeout: s by which one may come later than others."""
        self.timeout = timeout
        self._last, self._delay, self._received = -inf, inf, -inf  # s

    def newer(self, stamp: float, now: float) -> bool:
        """
        Return whether a message is newer than all before; stamp: s of its sender, now: s here.

        Raises HardwareError when it comes too late.
        """
        if stamp <= self._last:
            return False
        if self._received > -inf:
            self._delay += CLOCK_DRIFT * (now - self._received)
        self._delay = min(self._delay, now - stamp)
        self._last, self._received = stamp, now
        if (late := now - stamp - self._delay) > self.timeout:
            raise HardwareError(
                f'it came {late:.2f} s later than others; allowed: {self.timeout:g} s; the '
                'network or its sender is too slow')
        return True
