# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shared by the verbs: the arm, one-line errors, and results: files, tables and figures."""

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
import csv
from datetime import datetime
from math import isfinite
import os
from pathlib import Path
import sys
from time import monotonic
from typing import TYPE_CHECKING, TypeVar

from tqdm import tqdm

from soft_continuum import version
from soft_continuum.client import ClientError, NodesMissingError
from soft_continuum.estimation.sensing.lens import LensError
from soft_continuum.estimation.sensing.pictures import SourceError
from soft_continuum.extras import require
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.lab.analysis.delimited import MeasurementError
from soft_continuum.mechanics import Arm, ArmError, LawError, StaticsError
from soft_continuum.parameters.arguments import (
    DeclinedError,
    DONE,
    FAILED,
    FOR_ANALYSIS,
    given_path,
    INTERRUPTED,
    NO_NODES,
    Parser,
    WRONG_USAGE,
)
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import ParameterError, Value
from soft_continuum.planning.obstacles import ObstacleError
from soft_continuum.planning.plans import PlanError
from soft_continuum.ros.description import load_description
from soft_continuum.text import MAX_NAME, printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

T = TypeVar('T')
PROGRESS_PERIOD = 5.0  # s
DPI = 120


class ResultError(RuntimeError):
    """A result cannot be written; the message says where and what to do."""

BAD_INPUT = (MeasurementError, ResultError, ParameterError, ArmError, LawError, StaticsError,
             LensError, SourceError, ObstacleError, PlanError)


def shapes_parser(name: str, description: str, known: str) -> Parser:
    """Return the parser of a verb on measured shapes; known: columns that pulls may have."""
    parser = Parser(name, description, *FOR_ANALYSIS, '--decimal')
    parser.add_argument('points', type=given_path,
                        help='CSV file: shape, point, x, z; for spatial arms also y')
    parser.add_argument('pulls', type=given_path,
                        help=f'CSV file: shape, segment, right, left and, if known, {known}; for '
                        'spatial arms one column for each tendon name; without jamming no segment '
                        'column')
    return parser


def origin(verb: str, simulated: bool, measured: str) -> str:
    """Return the title of a file from a running arm; measured: what it has unless simulated."""
    return (f'{"SIMULATED arm (twin), not a measurement" if simulated else measured}; '
            f'soft_continuum {verb} {version()} on '
            f'{datetime.now().astimezone().isoformat(timespec="seconds")}')


def described_arm(options: argparse.Namespace) -> tuple[dict[str, Value], Arm]:
    """Return the parameters and the arm of ``--params-file``; raises ParameterError."""
    values = load_description(*options.params_file, namespace=options.namespace)
    return values, arm_from_parameters(values)


def run_verb(parser: Parser, run: Callable[[argparse.Namespace], int | None],
             argv: Sequence[str] | None, *needs: str) -> int:
    """
    Run a verb with its options; return its exit status, with an error as one line.

    needs: modules that it imports late; a missing one raises ImportError at once.
    """
    options = parser.parse_args(argv)
    for module in needs:
        require(module)
    try:
        return run(options) or DONE
    except BAD_INPUT as error:
        return parser.fail(error, WRONG_USAGE)
    except (ClientError, DeclinedError, HardwareError) as error:
        return parser.fail(error, NO_NODES if isinstance(error, NodesMissingError) else FAILED)
    except BrokenPipeError:
        raise
    except OSError as error:
        place = error.filename or getattr(options, 'output', 'the result')
        return parser.fail(f'{place}: cannot be written: {error.strerror}; choose another place',
                           WRONG_USAGE)
    except KeyboardInterrupt:
        print(file=sys.stderr)
        return parser.fail('interrupted', INTERRUPTED)


# Results.


def reserve_outputs(directory: str | Path, names: Sequence[str], force: bool) -> tuple[Path, ...]:
    """
    Return the paths of results in a directory, which is created if it does not exist.

    Raises ResultError if one of them exists and may not be overwritten: before any work is done,
    and before any of them is written.
    """
    folder = Path(directory)
    paths = tuple(folder / name for name in names)
    there = [path for path in paths if os.path.lexists(path)]  # also a link that leads nowhere
    if there and not force:
        raise ResultError(f'{there[0]} exists; add --force to overwrite it, or choose another '
                          'directory with --output')
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultError(f'{folder}: cannot be made: {error.strerror}; choose another directory '
                          'with --output') from None
    return paths


def write_rows(path: Path, rows: Iterable[Sequence[object]]) -> None:
    """Write rows, the header first, as CSV; raises OSError."""
    with path.open('w', encoding='utf-8', newline='') as file:
        csv.writer(file, lineterminator='\n').writerows(rows)


def progress(items: Iterable[T], what: str, count: int | None = None) -> Iterator[T]:
    """
    Yield the items and show progress: by a bar, or by occasional lines in a pipe.

    count: number of items without a length.
    """
    total = count if count is not None else len(items)  # type: ignore[arg-type]
    if sys.stderr.isatty():
        yield from tqdm(items, what, total, leave=False)
        return
    shown = monotonic()
    for number, item in enumerate(items):
        if monotonic() - shown >= PROGRESS_PERIOD:
            shown = monotonic()
            print(f'{what}: {number} of {total}', file=sys.stderr, flush=True)
        yield item


def cell(value: float, unit: str = '', digits: str = '.2g') -> str:
    """Return a number for a table; - for nan and infinite ones."""
    return f'{value:{digits}}{unit}' if isfinite(value) else '-'


def text_table(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Return a table for the screen; all columns after ``left`` are aligned to the right."""
    cells = [[printable(cell, MAX_NAME) for cell in row] for row in (head, *rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(head))]
    lines = ['  '.join(cell.ljust(width) if k < left else cell.rjust(width)
                       for k, (cell, width) in enumerate(zip(row, widths, strict=True)))
             for row in cells]
    lines.insert(1, '  '.join('-' * width for width in widths))
    return '\n'.join(line.rstrip() for line in lines)


# Figures.


def new_figure(width: float, height: float) -> 'Figure':
    """Return an empty figure (inches); the first one loads matplotlib, which takes 0.5 s."""
    from matplotlib.figure import Figure
    return Figure(figsize=(width, height), layout='constrained')


def new_panels(rows: int, columns: int, width: float, height: float,
               part: 'SubFigure | None' = None, projection: str | None = None
               ) -> 'tuple[Figure, list[Axes]]':
    """
    Return a figure (inches) and its panels, row by row; flat ones have equal scale, axes in mm.

    part: subfigure to draw into, instead of a new figure.  projection: from projection_of.
    """
    figure, flat = new_figure(width, height), projection is None
    panels = (part or figure).subplots(rows, columns, squeeze=False, sharex=flat, sharey=flat,
                                       subplot_kw={'projection': projection}).ravel()
    if not flat:
        return figure, list(panels)
    for axes in panels:
        axes.set(aspect='equal', xlabel='x in mm')
        axes.grid(alpha=0.3)
    for axes in panels[::columns]:
        axes.set_ylabel('z in mm')
    return figure, list(panels)


def finish_panels(path: str | Path, figure: 'Figure', legend_columns: int) -> None:
    """Write a figure with the legend of its first panel below all panels."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', frameon=False,
                  ncols=min(len(labels), legend_columns))
    figure.savefig(path, dpi=DPI)
