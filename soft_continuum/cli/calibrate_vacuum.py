# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What ``calibrate vacuum`` says of the segments that it measured, and the parameters."""

from collections.abc import Sequence
from math import isfinite
from statistics import fmean

from soft_continuum.analysis.results import text_table
from soft_continuum.hardware.calibration import SegmentVacuum

HEAD = ('segment', 'to stiff s', 'reaches kPa', 'evacuates s', 'loses Pa/s', 'vents s', 'is')


def show(results: Sequence[SegmentVacuum], problems: Sequence[Sequence[str]]) -> None:
    """Print what was measured, and what is wrong with each segment."""
    print(text_table(HEAD, [
        [str(r.segment + 1), *map(_cell, (r.time_to_stiff, r.ultimate_vacuum / 1e3,
                                          r.evacuation_time, r.leak_rate, r.venting_time)),
         'not good' if problem else 'good']
        for r, problem in zip(results, problems, strict=True)]))
    print('evacuates, vents: time constants.')
    for result, problem in zip(results, problems, strict=True):
        for text in problem:
            print(f'segment {result.segment + 1}: {text}')


def simulated(stiff: Sequence[SegmentVacuum]) -> dict[str, float]:
    """Return the parameters of the simulation, which has one number for all segments."""
    return {f'simulated_jamming.{name}': fmean(getattr(r, name) for r in stiff)
            for name in ('ultimate_vacuum', 'evacuation_time', 'venting_time', 'leak_rate')}


def _cell(value: float) -> str:
    return f'{value:.4g}' if isfinite(value) else '-'
