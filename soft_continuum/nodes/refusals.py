# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""When to report refused measurements: single ones occur by chance."""

import re

NUMBER = re.compile(r'[\d.]+')
WEIGHT = 0.1  # of the last measurement in the share that is refused
MANY, FEW = 0.5, 0.2
"""Shares of refused measurements at which the report starts and ends."""


class Refusals:
    """Keeps the share of refused measurements among about the last ten."""

    def __init__(self, what: str) -> None:
        """what: name of the measurement, for people."""
        self.what, self._share, self._text, self._reason = what, 0.0, '', ''

    def note(self, reason: str) -> str:
        """
        Note why a measurement was refused, or '' if it was used; return the report.

        It starts at MANY and ends at FEW; the text only changes with the reason, not with its
        numbers.
        """
        self._share += WEIGHT * (bool(reason) - self._share)
        if self._share < FEW:
            self._text = ''
        elif reason and (self._share > MANY or self._text) and not (
                self._text and NUMBER.sub('', reason) == NUMBER.sub('', self._reason)):
            self._reason = reason
            self._text = f'most measured {self.what} are rejected, the last one because: {reason}'
        return self._text
