# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``study``: compares the reach and strength of arms with different descriptions."""

import argparse
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
import sys
from time import monotonic
from typing import Any

import numpy as np

from soft_continuum.analysis.results import progress, text_table, write_rows
from soft_continuum.analysis.verbs import run_verb
from soft_continuum.arguments import (
    ask,
    DeclinedError,
    given_path,
    one_of,
    Parser,
    whole_number_in,
)
from soft_continuum.study.design import read_study
from soft_continuum.study.running import cluster, Results, run, StudyError, workers_of
from soft_continuum.study.summary import columns, DRAWN, figure, HEAD, Summary, summary, text_row
from soft_continuum.study.work import HELD, QUERIES, Unit

NAME = 'study'
ASK_AFTER = 3600.0  # s: a study that takes longer needs consent
MAX_PROCESSES, MAX_TABLE = 256, 40


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = Parser(NAME, 'Vary a description and tabulate the reach, dexterity, tensions and '
                    'number of softenings of each arm. Resumes where it was interrupted.',
                    '--output')
    parser.add_argument('study', type=given_path, metavar='STUDY.yaml',
                        help='file of the variations, see docs/how_to/compare_designs.md')
    parser.add_argument('--processes', type=whole_number_in(1, MAX_PROCESSES), default=1,
                        metavar='N', help='number of processes on this machine (default: 1)')
    parser.add_argument('--scheduler', default='', metavar='ADDRESS',
                        help='address of a Dask cluster to use instead, such as '
                        'tcp://10.0.0.5:8786')
    parser.add_argument('--yes', action='store_true',
                        help='do not ask before a study of more than an hour')
    parser.set_defaults(output=Path(NAME))
    return run_verb(parser, lambda options: _run(parser, options), argv,
                    'distributed', 'pyarrow', 'matplotlib')


def _run(parser: Parser, options: argparse.Namespace) -> int:
    study = read_study(options.study)
    results = Results(options.output, study)
    todo = results.missing()
    try:
        if todo:
            with cluster(options.processes, options.scheduler) as client:
                _compute(client, results, todo, options.yes)
    except StudyError as error:
        return parser.fail(error)
    except KeyboardInterrupt:
        print(f'\n{options.output}: {len(todo) - len(results.missing())} more units are done; run '
              'the same command to resume', file=sys.stderr)
        raise
    _report(results, options.output)
    return 0


def _compute(client: Any, results: Results, todo: Sequence[Unit], yes: bool) -> None:
    """Compute the units; print the estimated and the actual duration."""
    workers = workers_of(client)
    # From the whole study, because durations differ between arms.
    first = [todo[k] for k in sorted({round(k) for k in np.linspace(
        0, len(todo) - 1, min(len(todo), 4 * workers))})]
    rest = [unit for unit in todo if unit not in set(first)]
    timed: dict[str, list[float]] = {}
    for unit, seconds in run(client, results, first):
        timed.setdefault(unit.kind, []).append(seconds)
    if rest:
        # The median, because the first unit of a process includes what it imports.
        every = [seconds for some in timed.values() for seconds in some]
        estimate = sum(float(np.median(timed.get(unit.kind, every))) for unit in rest) / workers
        print(f'{len(results.study.designs)} designs, {len(rest)} units of work left on {workers} '
              f'processes: about {_duration(estimate)}', file=sys.stderr, flush=True)
        if estimate > ASK_AFTER and not yes:
            _consent()
        began = monotonic()
        busy = sum(took for _, took in progress(run(client, results, rest), 'units', len(rest)))
        wall = monotonic() - began
        print(f'{_duration(wall)} on {workers} processes, busy for '
              f'{100 * busy / (workers * wall):.0f} % of that', file=sys.stderr)


def _consent() -> None:
    if not sys.stdin.isatty():
        raise DeclinedError('a study of more than an hour needs --yes; results so far are kept')
    if ask('Go on? (yes, no)', one_of('yes', 'y', 'no', 'n')) in ('no', 'n'):
        raise DeclinedError('not confirmed; results so far are kept')


def _duration(seconds: float) -> str:
    for size, unit in ((86400.0, 'days'), (3600.0, 'hours'), (60.0, 'minutes')):
        if seconds >= 2.0 * size:
            return f'{seconds / size:.1f} {unit}'
    return f'{seconds:.0f} s'


def _report(results: Results, directory: Path) -> None:
    asked = dict(results.tables(QUERIES))
    found: list[Summary] = [summary(results.study.designs[number], table, asked.get(number))
                            for number, table in results.tables()]
    widest = sorted(found, key=lambda one: -one.reach)
    print(text_table(HEAD, [text_row(one) for one in islice(widest, MAX_TABLE)]))
    if len(found) > MAX_TABLE:
        print(f'and {len(found) - MAX_TABLE} more in designs.csv')
    designs, picture = directory / 'designs.csv', directory / 'study.png'
    table = columns(found)
    write_rows(designs, [list(table), *zip(*table.values(), strict=True)])
    drawn = {one.design.number for one in widest[:DRAWN]}
    tips = {number: np.column_stack([table[axis].to_numpy() for axis in 'xyz'])[
        np.array(table['outcome'].to_pylist()) == HELD]
        for number, table in results.tables(only=drawn)}
    figure(picture, found, [tips[one.design.number] for one in widest[:DRAWN]])
    print('Written: ' + ', '.join(map(str, (designs, *results.join(), picture))))
