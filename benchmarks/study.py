# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A study of a million statics solves on one process and two, and on two that are killed."""

import os
from pathlib import Path
import signal
from tempfile import TemporaryDirectory
from threading import Event, Thread
from time import monotonic
from typing import Any

from benchmarks.tables import machine, Section, table
from benchmarks.timing import progress
from soft_continuum.lab.study.design import read_study, Study
from soft_continuum.lab.study.running import cluster, Results
from soft_continuum.lab.study.running import run_units as compute

SOLVES, QUICK_SOLVES = 1_000_000, 20_000
SOLVES_PER_SHAPE = 2.0  # on average: one to three segments of the paper's arm are bent
DESIGNS = 10
KILLED_EVERY = 10.0  # s
STUDY = """
vary:
  arm.mounting_angle: [0.0, 3.14159265]
  arm.payload: {{from: 0.0, to: 0.04, steps: 5}}
shapes: {shapes}
"""


def run(quick: bool) -> Section:
    """Measure; the section is of the page about performance."""
    solves = QUICK_SOLVES if quick else SOLVES
    with TemporaryDirectory() as directory:
        path = Path(directory) / 'study.yaml'
        path.write_text(STUDY.format(shapes=round(solves / SOLVES_PER_SHAPE / DESIGNS)),
                        encoding='utf-8')
        study = read_study(path)
        cases = [measured(study, Path(directory) / name, processes, killed)
                 for name, processes, killed in (
                     ('one', 1, False), ('two', 2, False), ('killed', 2, True))]
    wall, rows, _, count = cases[0]
    names = ('1 process', '2 processes', '2 processes, one killed every 10 s')
    same = all(case[1] == rows for case in cases)
    body = '\n\n'.join([
        f"{len(study.designs)} designs of the paper's arm with {study.shapes:,} shapes each: "
        f'{count:,} solves. All runs wrote {"the same" if same else "DIFFERENT"} files. '
        + machine(),
        table(('', 'wall clock, s', 'speed-up', 'workers killed'),
              [[name, f'{case[0]:.1f}', f'{wall / case[0]:.2f}', str(case[2])]
               for name, case in zip(names, cases, strict=True)])])
    return Section('benchmarks/performance.md', 'study', body)


def measured(study: Study, directory: Path, processes: int, killed: bool
             ) -> tuple[float, list[bytes], int, int]:
    """Return wall clock time (s), the result, workers killed, bendings solved."""
    results = Results(directory, study)
    todo, deaths, ended = results.missing(), 0, Event()
    with cluster(processes) as client:
        client.run(loaded)  # what a worker imports is no part of its work

        def kill() -> None:
            nonlocal deaths
            while not ended.wait(KILLED_EVERY):
                os.kill(min(client.run(os.getpid).values()), signal.SIGKILL)
                deaths += 1

        killer = Thread(target=kill, daemon=True)
        if killed:
            killer.start()
        began = monotonic()
        for _ in compute(client, results, todo):
            pass
        wall = monotonic() - began
        ended.set()
        if killed:
            killer.join()
    progress(f'study: {processes} processes, {deaths} killed: {wall:.1f} s')
    count = sum(sum(part['solves'].to_pylist()) for _, part in results.tables())
    return wall, [path.read_bytes() for path in results.join()], deaths, count


def loaded() -> Any:
    """Load in a worker what units need."""
    from soft_continuum.lab.study import running
    from soft_continuum.mechanics._kernel import warm_up
    warm_up()
    return running.__name__
