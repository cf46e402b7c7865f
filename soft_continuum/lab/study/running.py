# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The work of a study: units of random shapes or queries, their computation and their results.

The result of a unit depends on seed, design and unit alone, so a study is reproducible on any
machine and in any order of units.  Dask computes them, on this machine or a cluster.  Every unit
is a separate Parquet file below ``parts``, written atomically: an interrupted study resumes, and a
worker that dies loses only its current unit.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
import json
import logging
from math import inf, nan
from pathlib import Path
import signal
from time import perf_counter
from typing import Any

import numpy as np

from soft_continuum import version
from soft_continuum.lab.analysis.verbs import ResultError
from soft_continuum.lab.study.design import Design, Study
from soft_continuum.mechanics import Arm, set_shape, Statics, StaticsError
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.directions import bending_towards, hinged
from soft_continuum.planning.obstacles import CollisionScene
from soft_continuum.planning.planner import Planner, PlanSettings
from soft_continuum.planning.plans import Shape, TipGoal
from soft_continuum.planning.settings import reach_from_parameters
from soft_continuum.planning.shape_plans import plan_shapes
from soft_continuum.text import write_whole, written_whole

SHAPES, QUERIES = 'shapes', 'queries'
"""Kinds of work."""
UNIT_TIME = 0.5
"""Approximate time for the shapes of one unit, s; more for spatial arms that often fall."""
HELD, TENSION, TRAVEL, TOUCHES, FALLS = 'held', 'tension', 'travel', 'touches', 'falls'
"""Outcomes of a shape; beyond a limit of the rig; nearer to an obstacle than the margin; no
tendons hold it."""
DRAWS = 30  # random shapes tried to find one that the arm holds
FOUND, NOT_FOUND, NONE = 'found', 'not found', 'none'
"""Outcomes of a query; NONE: no random shape was held and clear, so there was no goal."""
OF_TIP = ('x', 'y', 'z', 'pointing_x', 'pointing_y', 'pointing_z', 'tension', 'pull')


@dataclass(frozen=True)
class Unit:
    """Some shapes, or one query, of a design, by number."""

    kind: str
    design: int
    first: int
    count: int

    @property
    def name(self) -> str:
        """Its name, in the order of design and number."""
        return f'{self.kind}-{self.design:06d}-{self.first:08d}'


def work_units(study: Study) -> list[Unit]:
    """Return the work of a study, in order."""
    found = []
    for design in study.designs:
        size = round(UNIT_TIME / design.arm.bend_time)
        found += [Unit(SHAPES, design.number, first, min(size, study.shapes - first))
                  for first in range(0, study.shapes, size)]
        found += [Unit(QUERIES, design.number, number, 1) for number in range(study.queries)]
    return found


def compute(design: Design, unit: Unit, seed: int) -> tuple[dict[str, list[Any]], float]:
    """Return the rows of a unit as columns, and the computing time (s)."""
    began = perf_counter()
    rows = (shapes(design, unit.first, unit.count, seed) if unit.kind == SHAPES
            else [query(design, unit.first, seed)])
    return {name: [row[name] for row in rows] for name in rows[0]}, perf_counter() - began


def shapes(design: Design, first: int, count: int, seed: int) -> list[dict[str, Any]]:
    """
    Return the rows of some shapes of a design, from a number on.

    Columns: design, shape; softenings; solves; bent_1, ... commanded bending of each segment (rad;
    for spatial arms about x, and turned_1, ... about y); outcome; x, y, z (m) and direction of the
    tip (unit vector); tension, the largest (N); pull, the largest (m); nan for none.
    """
    arm, statics = design.arm, Statics(design.arm)
    draw = np.random.default_rng([seed, design.number, first, 0])
    jamming = bool(design.values['arm.jamming'])
    around = CollisionScene(arm, design.obstacles)
    rows = []
    for shape in range(first, first + count):
        bending = drawn(arm, draw, jamming)
        state = state_with_bending(statics, bending, jamming)
        soft = int(bending.any(axis=1).sum())
        row: dict[str, Any] = {
            'design': design.number, 'shape': shape, 'softenings': soft if jamming else 0,
            'solves': soft if jamming and state is not None else 1}
        for s, (about, axes) in enumerate(zip(bending, arm.bending_axes, strict=True), start=1):
            row |= {f'{name}_{s}': float(value) for name, value in zip(
                ('bent', 'turned'), about[axes], strict=False)}
        numbers = [nan] * len(OF_TIP) if state is None else np.concatenate([
            state.poses[-1, :3], state.rotations[-1][:, 2],
            [np.max(state.tensions), np.abs(state.pulls).max()]]).tolist()
        rows.append(row | {'outcome': outcome_of(state, design.values, around)}
                    | dict(zip(OF_TIP, numbers, strict=True)))
    return rows


def query(design: Design, number: int, seed: int) -> dict[str, Any]:
    """
    Return the row of a query of a design: a tip that it can reach, and a plan from straight to it.

    The goal is the tip of a random shape that the arm holds, clear of obstacles.  A search ends
    after reach.states, not after a time, so the result is the same on every machine.

    Columns: design, query, x, y, z of the goal (m); outcome; softenings, duration (s), tension
    (N), clearance (m) and tip_error (m) of the first plan, nan for none.
    """
    draw = np.random.default_rng([seed, design.number, number, 1])
    arm = design.arm
    values: Mapping[str, Any] = design.values
    around, statics = CollisionScene(arm, design.obstacles), Statics(arm)
    settings = replace(reach_from_parameters(values), time_limit=inf, seed=number)
    jamming = bool(values['arm.jamming'])
    row: dict[str, Any] = {'design': design.number, 'query': number, 'x': nan, 'y': nan, 'z': nan,
                           'outcome': NONE, 'softenings': 0, 'duration': nan, 'tension': nan,
                           'clearance': nan, 'tip_error': nan}
    tried = (state_with_bending(statics, drawn(arm, draw, jamming), jamming) for _ in range(DRAWS))
    state = next((one for one in tried if outcome_of(one, values, around) == HELD), None)
    if state is None:
        return row
    goal = TipGoal(state.poses[-1, :3], position_tolerance=values['reach.position_tolerance'])
    row |= dict(zip('xyz', goal.position.tolist(), strict=True)) | {'outcome': NOT_FOUND}
    planner = Planner(arm, PlanSettings.of(values))
    first, = plan_shapes(planner, planner.statics.chain.straight(),
                         (0.0,) * len(arm.tendon_names), [Shape('goal', (), tips=(goal,))],
                         around, settings, first=True)
    return row if first.why else row | {
        'outcome': FOUND, 'softenings': first.softenings if jamming else 0,
        'duration': first.duration, 'tension': first.tension, 'clearance': first.clearance[0],
        'tip_error': first.tip_error}


def drawn(arm: Arm, draw: np.random.Generator, jamming: bool) -> Array:
    """Return random bending within the limits for some or all segments."""
    count = len(arm.segments)
    chosen = np.ones(count, dtype=bool)
    if jamming:  # with fewer softenings a smaller set is reached
        chosen[draw.permutation(count)[draw.integers(1, count + 1):]] = False
    if hinged(arm):
        sizes = arm.bending_angle_limits * draw.uniform(-1.0, 1.0, count)
        bending = np.column_stack([sizes, sizes])
    else:
        # Even over the disc of rotation vectors.
        sizes = arm.bending_angle_limits * np.sqrt(draw.random(count))
        ways = draw.uniform(-np.pi, np.pi, count)
        bending = sizes[:, None] * bending_towards(ways)
    return np.where(arm.bending_axes & chosen[:, None], bending, 0.0)


def state_with_bending(statics: Any, bending: Array, jamming: bool) -> Any:
    """Return the state with a bending; None where no tendons hold it."""
    try:
        return set_shape(statics, bending, jamming=jamming)
    except StaticsError:
        return None


def outcome_of(state: Any, values: Mapping[str, Any], around: CollisionScene) -> str:
    """Return the outcome of a shape; state: None where no tendons hold it."""
    if state is None:
        return FALLS
    low, high = values['pull_limits']
    if np.max(state.tensions) > values['tension_limit']:
        return TENSION
    if np.min(state.pulls) < low or np.max(state.pulls) > high:
        return TRAVEL
    near = around.clearance(state).distance
    return TOUCHES if near < values['obstacles.margin'] else HELD


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
