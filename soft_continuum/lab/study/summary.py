# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
``study``: summaries and figures from the rows of designs.

Tips are counted in cells of a grid, so that values grow with the number of shapes until every
reachable cell is found: compare designs with equal numbers of shapes.
"""

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from itertools import islice
from math import nan
from pathlib import Path
import sys
from time import monotonic
from typing import Any

import numpy as np

from soft_continuum.lab.analysis.verbs import (
    cell,
    DPI,
    new_figure,
    new_panels,
    progress,
    run_verb,
    text_table,
    write_rows,
)
from soft_continuum.lab.study.design import Design, read_study, varied_text
from soft_continuum.lab.study.running import (
    cluster,
    FALLS,
    FOUND,
    HELD,
    NONE,
    QUERIES,
    Results,
    run_units,
    StudyError,
    Unit,
    workers_of,
)
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.parameters.arguments import (
    ask,
    DeclinedError,
    given_path,
    one_of,
    Parser,
    whole_number_in,
)

CELLS = 25
"""Cells along the length of the arm."""
SECTORS = 12
"""Distinct tip directions: evenly around, or the corners of an icosahedron for spatial arms."""
DRAWN = 4
"""Number of designs whose tips are drawn: those of the largest reach."""
GOLDEN = (1.0 + 5.0**0.5) / 2.0
CORNERS = np.array([v for a in (-1.0, 1.0) for b in (-GOLDEN, GOLDEN)
                    for v in ((0.0, a, b), (a, b, 0.0), (b, 0.0, a))])
AROUND = np.array([(np.sin(turn), 0.0, np.cos(turn))
                   for turn in 2.0 * np.pi * (np.arange(SECTORS) + 0.5) / SECTORS])
NAME = 'study'
ASK_AFTER = 3600.0  # s: a study that takes longer needs consent
MAX_PROCESSES, MAX_TABLE = 256, 40


@dataclass(frozen=True)
class Summary:
    """
    Reach of one design, and its cost.

    shapes: number tried.  held: fraction that tendons hold within all limits.  falls: fraction
    that none holds.  reach: area (m^2) or volume (m^3) of the cells with a tip.  dexterity: mean
    fraction of the directions that occur in such a cell.  tension, worst_tension: N, median and
    largest of held shapes.  softenings: mean, over the cells, of the fewest needed; 0 without
    jamming.  success: fraction of solved queries; plan_softenings: their mean; nan without.
    """

    design: Design
    shapes: int
    held: float
    falls: float
    reach: float
    dexterity: float
    tension: float
    worst_tension: float
    softenings: float
    success: float
    plan_softenings: float


def summary(design: Design, table: Any, asked: Any = None) -> Summary:
    """Return the summary of the rows (pyarrow) of a design; asked: those of its queries."""
    arm = design.arm
    outcome = np.array(table['outcome'].to_pylist())
    held = outcome == HELD
    tips, pointing = (np.column_stack([table[f'{name}{axis}'].to_numpy() for axis in 'xyz'])[held]
                      for name in ('', 'pointing_'))
    tension = np.append(table['tension'].to_numpy()[held], [] if held.any() else [nan])
    cells = np.floor(tips / cell_size(arm)).astype(int)
    found, cell = np.unique(cells, axis=0, return_inverse=True)
    cell = cell.ravel()
    seen = np.zeros((len(found), SECTORS), dtype=bool)
    turns = arm.pose_axes[3:].sum()
    seen[cell, np.argmax(pointing @ (CORNERS if turns > 1 else AROUND).T, axis=1)] = True
    fewest = np.full(len(found), np.inf)
    np.minimum.at(fewest, cell, table['softenings'].to_numpy()[held])
    answered, queries, softenings = 0, 0, nan
    if asked is not None:
        of_query = np.array(asked['outcome'].to_pylist())
        answered, queries = (of_query == FOUND).sum(), (of_query != NONE).sum()
        softenings = asked['softenings'].to_numpy()[of_query == FOUND].mean() if answered else nan
    return Summary(
        design, len(outcome), float(held.mean()), float((outcome == FALLS).mean()),
        len(found) * cell_size(arm)**len(arm.axes), float(seen.mean()) if len(found) else 0.0,
        float(np.median(tension)), float(tension.max()),
        float(fewest.mean()) if len(found) else nan,
        float(answered / queries) if queries else nan, float(softenings))


def cell_size(arm: Arm) -> float:
    """Return the side (m) of the cells in which tips are counted."""
    return float(arm.length) / CELLS


HEAD = ('design', 'held %', 'falls %', 'reach', 'dexterity %', 'tension N', 'worst N',
        'softenings', 'planned %', 'by')


def text_row(one: Summary) -> list[str]:
    """Return the row of a design for the table on the screen."""
    count = len(one.design.arm.axes)
    return [f'{one.design.number + 1}: {varied_text(one.design.varied)}',
            f'{100 * one.held:.1f}', f'{100 * one.falls:.1f}',
            f'{1e2**count * one.reach:.0f} cm{count}', f'{100 * one.dexterity:.1f}',
            f'{one.tension:.1f}', f'{one.worst_tension:.1f}', f'{one.softenings:.2f}',
            cell(100.0 * one.success, digits='.0f'), cell(one.plan_softenings, digits='.2f')]


def columns(found: Sequence[Summary]) -> dict[str, list[Any]]:
    """Return all summaries as a table in SI units; varied lists are texts."""
    rows: dict[str, list[Any]] = {'design': [one.design.number for one in found]}
    for name in dict.fromkeys(name for one in found for name in one.design.varied):
        values = [one.design.varied[name] for one in found]
        rows[name] = [str(list(v)) if isinstance(v, tuple) else v for v in values]
    return rows | {field.name: [getattr(one, field.name) for one in found]
                   for field in fields(Summary)[1:]}


def figure(path: Path, found: Sequence[Summary], tips: Iterable[Array]) -> None:
    """
    Write a figure: tips of the designs with the largest reach, and reach, dexterity and tension.

    tips: (m, 3) of the designs that are drawn, m, in the order of decreasing reach.
    """
    widest = sorted(found, key=lambda one: -one.reach)[:DRAWN]
    picture = new_figure(11.0, 7.0)
    above, below = picture.subfigures(2, 1, squeeze=False).ravel()
    panels = new_panels(1, len(widest), 11.0, 3.5, above)[1]
    for axes, one, points in zip(panels, widest, tips, strict=False):
        axes.plot(1e3 * points[:, 0], 1e3 * points[:, 2], '.', color='0.2', markersize=2.0)
        axes.set_title(f'design {one.design.number + 1}')
    sizes = [len(one.design.arm.axes) for one in found]
    for axes, (values, label) in zip(below.subplots(1, 4), (
            ([1e2**size * one.reach for size, one in zip(sizes, found, strict=True)],
             f'reach in {"cm2" if max(sizes) == 2 else "cm3 (or cm2)"}'),
            ([100.0 * one.dexterity for one in found], 'dexterity in %'),
            ([one.worst_tension for one in found], 'largest tension in N'),
            ([100.0 * one.held for one in found], 'shapes held in %')), strict=True):
        axes.plot([one.design.number + 1 for one in found], values, 'o-', color='0.2',
                  markersize=3.0)
        axes.set(xlabel='design', ylabel=label)
        axes.grid(alpha=0.3)
    picture.savefig(path, dpi=DPI)


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
    for unit, seconds in run_units(client, results, first):
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
        busy = sum(took for _, took in progress(
            run_units(client, results, rest), 'units', len(rest)))
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
