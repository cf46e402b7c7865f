# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What batches of planar and of spatial arms have in common."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics._checks import listed

SMALLEST_PART = 50  # problems that a thread takes at a time

Masks = Sequence[bool] | Sequence[Sequence[bool]] | NDArray[np.bool_]


class Solutions(Sequence[Any]):
    """The states of m problems by index; found: (m,) whether there is one."""

    found: NDArray[np.bool_]
    _state: Callable[[int], Any]

    def __len__(self) -> int:
        """Return the number of problems."""
        return len(self.found)

    def __getitem__(self, index: Any) -> Any:
        """Return one state, or a list of them for a slice; raises LookupError where none is."""
        rows = range(len(self))[index]
        if isinstance(rows, range):
            return [self[i] for i in rows]
        if not self.found[rows]:
            raise LookupError(f'no equilibrium was found for problem {rows}')
        return self._state(rows)


def rows_of(given: Any) -> list[Any]:
    """Return the rows of a list of lists, or one list as the only row."""
    rows = listed(given)
    return rows if rows and isinstance(rows[0], Sequence | np.ndarray) else [given]


def common_count(sizes: Mapping[str, int]) -> int:
    """Return how many problems there are; sizes: by what they are of, 1 counts for all."""
    count = max(sizes.values())
    if any(size not in (1, count) for size in sizes.values()):
        raise ValueError(' and '.join(f'{n} {name}' for name, n in sizes.items() if n != 1)
                         + ' do not go together')
    return count


def in_parts(solve_part: Callable[[int, int], object], count: int) -> None:
    """Call a compiled function for parts of ``count`` problems (first, last), on all cores."""
    workers = len(os.sched_getaffinity(0))
    parts = min(4 * workers, 1 + count // SMALLEST_PART)
    bounds = np.linspace(0, count, parts + 1).astype(int).tolist()
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(solve_part, bounds[:-1], bounds[1:]))
