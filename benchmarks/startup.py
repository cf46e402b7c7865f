# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How long the mechanics take before the first solve, in processes of their own."""

import os
import subprocess
import sys
import tempfile

import numpy as np

from benchmarks.tables import machine, number, Section
from benchmarks.timing import progress

SCRIPT = """
import sys, time
if 'without' in sys.argv:
    sys.modules['numba'] = None
begin = time.perf_counter()
from soft_continuum.mechanics._kernel import warm_up
warm_up()
print(time.perf_counter() - begin)
"""


def run(quick: bool) -> Section:
    """Time imports and warm-up and return the times."""
    times: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as cache, tempfile.TemporaryDirectory() as empty:
        for name, directory, arguments, fresh in (
                ('first', cache, [], True),
                ('later', cache, [], False),
                ('without numba', empty, ['without'], False)):
            progress(name)
            repetitions = 1 if fresh else 3 if quick else 11
            times[name] = [_start(directory, arguments) for _ in range(repetitions)]
    text = ', '.join(f'{name} {number(float(np.median(found)))} s'
                     for name, found in times.items())
    return Section('benchmarks/performance.md', 'startup',
                   f'Import and `warm_up` of the mechanics by the clock: {text}. {machine()}')


def _start(cache: str, arguments: list[str]) -> float:
    """Return how long a start takes, s; ``cache`` keeps the compiled solver."""
    return float(subprocess.run(
        [sys.executable, '-c', SCRIPT, *arguments], env={**os.environ, 'XDG_CACHE_HOME': cache},
        capture_output=True, text=True, check=True).stdout)
