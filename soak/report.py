# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The report of one part of the soak test."""

from collections.abc import Sequence
from dataclasses import dataclass
import sys

import numpy as np


@dataclass(frozen=True)
class Report:
    """A Markdown text with the figures, and the claims that did not hold."""

    body: str
    failures: tuple[str, ...]


def spread(times: Sequence[float]) -> tuple[str, str, str]:
    """Return median, 99 % and maximum of times (s) in ms."""
    if not times:
        return '-', '-', '-'
    median, percentile, largest = np.percentile(times, [50, 99, 100]) * 1e3
    return f'{median:.0f}', f'{percentile:.0f}', f'{largest:.0f}'


def progress(message: str) -> None:
    """Print progress on stderr."""
    print(f'soak: {message}', file=sys.stderr, flush=True)
