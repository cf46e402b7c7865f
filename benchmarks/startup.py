# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How long the mechanics take before the first solve, in processes of their own."""

import json
import os
import subprocess
import sys
import tempfile

import numpy as np

from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import progress
from soft_continuum.ros.names import NODES

SCRIPT = """
import json, sys, time
if 'without' in sys.argv:
    sys.modules['numba'] = None
begin = time.perf_counter()
import numpy
packages = time.perf_counter()
import soft_continuum.mechanics
imported = time.perf_counter()
from soft_continuum.mechanics.statics import warm_up
warm_up()
print(json.dumps([packages - begin, imported - packages, time.perf_counter() - imported]))
"""

NODE_SCRIPT = """
import sys, time
begin = time.process_time()
from soft_continuum.nodes.runtime import node_class
node_class(sys.argv[1])
print(time.process_time() - begin)
"""


def run(quick: bool) -> Section:
    """Time imports and warm-up and return the table."""
    times: dict[str, list[list[float]]] = {}
    with tempfile.TemporaryDirectory() as cache, tempfile.TemporaryDirectory() as empty:
        for name, directory, arguments, fresh in (
                ('first start ever', cache, [], True),
                ('every later start', cache, [], False),
                ('without numba', empty, ['without'], False)):
            progress(name)
            repetitions = 1 if fresh else 3 if quick else 11
            times[name] = [_start(directory, arguments) for _ in range(repetitions)]
    rows = [[name, *(number(v) for v in np.median(samples, axis=0)),
             number(float(np.median(np.sum(samples, axis=1))))] for name, samples in times.items()]
    head = ['s', 'numpy', 'import of the mechanics', 'warm_up', 'together']
    imports = [[name, number(float(np.median(
        [float(_run(NODE_SCRIPT, name)) for _ in range(3 if quick else 11)])))] for name in NODES]
    return Section('benchmarks/performance.md', 'startup', '\n'.join([
        machine(), '', table(head, rows), '', table(['node', 'import, s'], imports)]))


def _start(cache: str, arguments: list[str]) -> list[float]:
    """Return how long the parts of a start take, s; ``cache`` keeps the compiled solver."""
    return list(json.loads(_run(SCRIPT, *arguments, XDG_CACHE_HOME=cache)))


def _run(script: str, *arguments: str, **environment: str) -> str:
    """Return what a script prints, in a process of its own."""
    return subprocess.run([sys.executable, '-c', script, *arguments],
                          env={**os.environ, **environment}, capture_output=True, text=True,
                          check=True).stdout
