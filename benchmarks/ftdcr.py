# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A model against real arms: where the tips of FTDCR v4 and v6 were measured, and computed."""

from pathlib import Path
import time

from matplotlib.figure import Figure
import numpy as np

from benchmarks.measured import (
    aligned,
    IDENTIFIED,
    IDENTIFIED_V6,
    MEMORYLESS,
    read,
    Recording,
    repeats,
    rms,
    SINGLES,
    SINGLES_V6,
    V4,
    V6,
)
from benchmarks.tables import DOCUMENTS, machine, number, Section, table
from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics.arm import Array

IMAGES = DOCUMENTS / 'images'
PATTERNS = {'same': 'all segments bend one way', 'scurve': 'they form an S',
            'spiral': 'each bends another way'}
QUICK = 30  # poses


def run(quick: bool) -> Section:
    """Measure; the section is of the page about the measured arm."""
    _kernel.functions()  # loaded before anything is timed
    train, val = (read(name).part(0, QUICK if quick else None) for name in ('train', 'val'))
    single, pairs = train.part(0, V4.single), train if quick else train.part(V4.single)
    process = time.process_time()
    known = IDENTIFIED.stddevs(train)
    process = time.process_time() - process
    test = IDENTIFIED.stddevs(val)
    without = MEMORYLESS.stddevs(train)
    rows = [_row('one segment moves', 'two segments move', SINGLES.stddevs(single),
                 SINGLES.stddevs(pairs)), _row('`train.csv`', '`val.csv`', known, test),
            _row('`train.csv`, without friction', '`val.csv`', without,
                 MEMORYLESS.stddevs(val)), *_second(quick)]
    head = ('identified on', 'tested on', 'poses', 'RMSE where identified, mm',
            '**RMSE of the test, mm**', 'worst', 'RMSE, frame as identified')
    if not quick:
        _draw(val, test, IMAGES / 'measured_arm.svg')
        _draw_errors({'train.csv, identified': known, 'val.csv, test': test},
                     IMAGES / 'measured_arm_errors.svg')
    cost = f'{len(known):,} poses take {number(process)} s of processor time.'
    return Section('benchmarks/measured_arm.md', 'ftdcr', '\n\n'.join([
        machine(), table(head, rows), _by_pattern(val, test),
        _repeatability(train, {'of measured tips': train.tips, 'of errors': known,
                               'of errors without friction': without}), cost]))


def _second(quick: bool) -> list[tuple[str, ...]]:
    """Return the rows of FTDCR v6, and draw its test."""
    train, val = (read(name, V6).part(0, QUICK if quick else None) for name in ('train', 'val'))
    pairs = train if quick else train.part(V6.single)
    test = IDENTIFIED_V6.stddevs(val)
    if not quick:
        _draw(val, test, IMAGES / 'measured_arm_v6.svg')
    return [
        _row('v6, one segment moves', 'two segments move',
             SINGLES_V6.stddevs(train.part(0, V6.single)), SINGLES_V6.stddevs(pairs)),
        _row('v6, `train.csv`', 'v6, `val.csv`', IDENTIFIED_V6.stddevs(train), test)]


def _row(known: str, other: str, at: Array, test: Array) -> tuple[str, ...]:
    errors = 1e3 * np.linalg.norm(aligned(test), axis=1)
    return (known, other, str(len(test)), number(1e3 * rms(aligned(at))),
            f'**{number(1e3 * rms(aligned(test)))}**', number(float(errors.max())),
            number(1e3 * rms(test - at.mean(axis=0))))


def _repeatability(train: Recording, positions: dict[str, Array]) -> str:
    """Return how far poses with the same pulls lie apart, for (n, 3) m of each pose."""
    head, rows = ('pulls differ by less than, mm',), []
    for within in (1e-4, 2e-4, 3e-4):
        first, second = repeats(train, within)
        if len(first):
            rows.append((number(1e3 * within, 1), f'{len(first):,}', *(
                number(1e3 * rms(each[first] - each[second]) / 2**0.5)
                for each in positions.values())))
    return table((*head, 'pairs', *(f'scatter {what}, mm' for what in positions)), rows)


def _by_pattern(val: Recording, test: Array) -> str:
    """Return the errors in each kind of motion of the test."""
    parts = []
    for kind, text in PATTERNS.items():
        chosen = np.array([kind in pattern for pattern in val.patterns])
        if chosen.any():
            parts.append(f'{number(1e3 * rms(aligned(test)[chosen]))} mm where {text}')
    return f'RMSE in `val.csv`: {", ".join(parts)}.'


def _draw(recording: Recording, stddevs: Array, path: Path) -> None:
    """Draw measured and computed tips from above and from the side."""
    measured = 1e3 * recording.tips
    computed = measured - 1e3 * aligned(stddevs)
    figure = Figure(figsize=(9.0, 4.6), layout='constrained')
    for axes, (i, j) in zip(figure.subplots(1, 2), ((0, 1), (0, 2)), strict=True):
        between = np.stack([measured, computed, np.full_like(measured, np.nan)], 1).reshape(-1, 3)
        axes.plot(between[:, i], between[:, j], color='0.75', linewidth=0.7)
        axes.plot(measured[:, i], measured[:, j], '.', color='0.15', markersize=3,
                  label='measured')
        axes.plot(computed[:, i], computed[:, j], '.', color='tab:orange', markersize=3,
                  label='computed')
        axes.set_aspect('equal')
        axes.set_xlabel('xyz'[i] + ' in mm')
        axes.set_ylabel('xyz'[j] + ' in mm')
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    figure.savefig(path)


def _draw_errors(stddevs: dict[str, Array], path: Path) -> None:
    """Draw the error of each pose of recordings, one after the other."""
    figure = Figure(figsize=(9.0, 3.2), layout='constrained')
    axes, begin = figure.subplots(), 0
    for (name, found), colour in zip(stddevs.items(), ('0.5', 'tab:orange'), strict=True):
        axes.plot(begin + np.arange(len(found)), 1e3 * np.linalg.norm(aligned(found), axis=1),
                  color=colour, linewidth=0.8,
                  label=f'{name}: RMSE {number(1e3 * rms(aligned(found)))} mm')
        begin += len(found)
    axes.set_xlabel('pose')
    axes.set_ylabel('error of the tip in mm')
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    figure.savefig(path)
