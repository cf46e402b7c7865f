# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Computes the units of a study with Dask, on this machine or a cluster, and stores each result.

Every unit is a separate Parquet file below ``parts``, written atomically: an interrupted study
resumes, and a worker that dies loses only its current unit.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
import json
import logging
from pathlib import Path
import signal
from typing import Any

from soft_continuum import version
from soft_continuum.lab.analysis.verbs import ResultError
from soft_continuum.lab.study.design import Study
from soft_continuum.lab.study.work import compute, QUERIES, SHAPES, Unit, work_units
from soft_continuum.text import write_whole, written_whole

PARTS, ABOUT = 'parts', 'study.json'
WINDOW = 4  # units that each worker has waiting
CONNECT_TIMEOUT = 10.0  # s
MAX_LOST = 100  # times that a unit is given to another worker after one that had it died
WORKERS_TIMEOUT = 60.0  # s for the first worker to be there


class StudyError(RuntimeError):
    """A study cannot be computed; the message says why and what to do."""


def _dask() -> Any:
    import distributed
    return distributed


class Results:
    """The directory of one study: its results and its definition."""

    def __init__(self, directory: Path, study: Study) -> None:
        """Resume or begin a study in a directory; raises ResultError if it has another one."""
        self._directory, self.study = directory, study
        self._parts = directory / PARTS
        about = directory / ABOUT
        try:
            self._parts.mkdir(parents=True, exist_ok=True)
            if about.exists():
                known = json.loads(about.read_text(encoding='utf-8')).get('fingerprint')
                if known != study.fingerprint:
                    raise ResultError(
                        f'{about} is of another study, or of this one before a change; '
                        'choose another directory with --output, or remove that one')
            else:
                write_whole(about, json.dumps({
                    'fingerprint': study.fingerprint, 'designs': len(study.designs),
                    'shapes': study.shapes, 'queries': study.queries,
                    'seed': study.seed}, indent=2))
        except (OSError, ValueError) as error:
            raise ResultError(f'{about}: cannot be used: {error}; choose another directory with '
                              '--output') from None

    def missing(self) -> list[Unit]:
        """Return the remaining units, in order."""
        there = set(self._parts.iterdir())
        return [unit for unit in work_units(self.study) if self._part(unit) not in there]

    def keep(self, unit: Unit, rows: dict[str, list[Any]]) -> None:
        """Write the result of a unit."""
        import pyarrow as pa
        import pyarrow.parquet as pq
        with written_whole(self._part(unit)) as path:
            pq.write_table(pa.table(rows), path)

    def tables(self, kind: str = SHAPES, only: Collection[int] | None = None
               ) -> Iterator[tuple[int, Any]]:
        """
        Yield number and table (pyarrow) of each design, with the results so far.

        only: numbers of the designs to read; None for all.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq
        for number, paths in self._paths(kind).items():
            if only is None or number in only:
                yield number, pa.concat_tables([pq.read_table(path) for path in paths])

    def _part(self, unit: Unit) -> Path:
        return self._parts / f'{unit.name}.parquet'

    def _paths(self, kind: str) -> dict[int, list[Path]]:
        """Return the parts of each design that were computed, in order."""
        there = set(self._parts.iterdir())
        found: dict[int, list[Path]] = {}
        for unit in work_units(self.study):
            if unit.kind == kind and self._part(unit) in there:
                found.setdefault(unit.design, []).append(self._part(unit))
        return found

    def join(self) -> list[Path]:
        """
        Write all rows, sorted by design and number, to one file per kind; return the paths.

        Each kind needs at least one result.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq
        joined = []
        for kind in (SHAPES, QUERIES) if self.study.queries else (SHAPES,):
            path = self._directory / f'{kind}.parquet'
            # Arms may differ in their number of segments: missing columns are null.
            schema = pa.unify_schemas(
                [pq.read_schema(first) for first, *_ in self._paths(kind).values()])
            with written_whole(path) as partial, pq.ParquetWriter(partial, schema) as writer:
                for _, table in self.tables(kind):
                    writer.write_table(pa.concat_tables(
                        [schema.empty_table(), table], promote_options='default'))
            joined.append(path)
        return joined


@contextmanager
def cluster(processes: int, address: str = '') -> Iterator[Any]:
    """
    Yield a client of Dask: for a scheduler at an address, or with processes of this machine.

    Raises StudyError without an answer, or if workers have another version of this package.
    """
    distributed = _dask()
    import dask

    class Deaf(distributed.WorkerPlugin):  # type: ignore[misc,name-defined]
        """Workers ignore Ctrl-C, which the process that started them handles."""

        name = 'deaf to interrupts'

        def setup(self, worker: Any) -> None:
            signal.signal(signal.SIGINT, signal.SIG_IGN)

    with dask.config.set({'distributed.scheduler.allowed-failures': MAX_LOST,
                          'distributed.comm.timeouts.connect': f'{CONNECT_TIMEOUT}s',
                          'distributed.logging.distributed': 'critical'}):
        if not address:
            with (distributed.LocalCluster(
                    n_workers=processes, threads_per_worker=1, dashboard_address='127.0.0.1:0',
                    host='127.0.0.1', silence_logs=logging.CRITICAL) as local,
                  distributed.Client(local) as client):
                client.register_plugin(Deaf())
                yield client
            return
        try:
            client = distributed.Client(address, timeout=CONNECT_TIMEOUT)
        except (OSError, ValueError, TimeoutError) as error:
            raise StudyError(f'no scheduler answers at {address}: {error}; start one with '
                             '`dask scheduler`, and workers with `dask worker ADDRESS`') from None
        with client:
            try:
                client.wait_for_workers(1, timeout=WORKERS_TIMEOUT)
            except TimeoutError:
                raise StudyError(f'the scheduler at {address} has no workers; start some with '
                                 f'`dask worker {address}`') from None
            try:
                theirs = client.run(version)
            except ImportError as error:
                raise StudyError(f'the workers have no {error.name}; install '
                                 'soft_continuum[study] where they run') from None
            if other := sorted(worker for worker, found in theirs.items() if found != version()):
                raise StudyError(f'another version of soft_continuum runs on {", ".join(other)}; '
                                 'install the same everywhere: otherwise results depend on the '
                                 'worker')
            yield client


def workers_of(client: Any) -> int:
    """Return the number of units computed in parallel."""
    return max(1, sum(int(threads) for threads in client.nthreads().values()))


def run_units(client: Any, results: Results, todo: Sequence[Unit]) -> Iterator[tuple[Unit, float]]:
    """
    Compute and store units; yield each with its computing time (s).

    A unit whose worker died is given to another one.  Raises StudyError when units repeatedly
    kill workers.
    """
    distributed = _dask()
    left, lost = iter(todo), Counter[Unit]()
    waiting = distributed.as_completed()
    running: dict[Any, Unit] = {}

    def submit(unit: Unit) -> None:
        future = client.submit(compute, results.study.designs[unit.design], unit,
                               results.study.seed, pure=False)
        running[future] = unit
        waiting.add(future)

    for unit in islice(left, WINDOW * workers_of(client)):
        submit(unit)
    for future in waiting:
        unit = running.pop(future)
        try:
            rows, took = future.result()
        except distributed.KilledWorker:
            lost[unit] += 1
            if lost[unit] > MAX_LOST:
                raise StudyError(f'every worker that computed unit {unit.name} died; have they '
                                 'enough memory?') from None
            submit(unit)
            continue
        results.keep(unit, rows)
        yield unit, took
        if following := next(left, None):
            submit(following)
