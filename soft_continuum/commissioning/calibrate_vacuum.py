# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Output of ``calibrate vacuum``: assessment of the segments, and parameters."""

from collections.abc import Mapping, Sequence
from math import isfinite
from statistics import fmean
from typing import Any

from soft_continuum.analysis.results import text_table
from soft_continuum.commissioning.calibration import SegmentVacuum
from soft_continuum.commissioning.regulator_calibration import (
    assess_regulator,
    LEVELS,
    measure_regulator,
)
from soft_continuum.hardware.jamming_controller import JammingSettings
from soft_continuum.hardware.protocols import RegulatorDriver

HEAD = ('segment', 'to stiff s', 'reaches kPa', 'evacuates s', 'loses Pa/s', 'vents s', 'is')


def show(results: Sequence[SegmentVacuum], problems: Sequence[Sequence[str]]) -> None:
    """Print the measurements and the problems of each segment."""
    _print(HEAD, [(r.time_to_stiff, r.ultimate_vacuum / 1e3, r.evacuation_time, r.leak_rate,
                   r.venting_time) for r in results], problems,
           'evacuates, vents: time constants.')


def regulators(driver: RegulatorDriver, values: Mapping[str, Any], settings: JammingSettings
               ) -> list[str]:
    """Test each segment's regulator in turn; return the problems."""
    settings.check_regulators(driver.max_vacuum)
    segments, results = len(values['arm.segment_lengths']), []
    for segment in range(segments):
        print(f'segment {segment + 1} ...', flush=True)
        results.append(measure_regulator(
            driver, segment, segments, settings, values['soft_vacuum']))
    problems = [assess_regulator(result, settings) for result in results]
    levels = [f'at {level * settings.full_vacuum / 1e3:.0f} kPa off by kPa' for level in LEVELS]
    _print(('segment', 'to full s', 'to soft s', *levels, 'is'),
           [(r.rise, r.fall, *(e / 1e3 for e in r.errors)) for r in results], problems)
    return [f'segment {result.segment + 1} does not follow its regulator'
            for result, problem in zip(results, problems, strict=True) if problem]


def _print(head: Sequence[str], results: Sequence[Sequence[float]],
           problems: Sequence[Sequence[str]], note: str = '') -> None:
    """Print the numbers and the problems of each segment; note: about the columns."""
    print(text_table(head, [
        [str(number), *(f'{value:.4g}' if isfinite(value) else '-' for value in values),
         'not good' if problem else 'good']
        for number, (values, problem) in enumerate(zip(results, problems, strict=True), start=1)]))
    if note:
        print(note)
    for number, problem in enumerate(problems, start=1):
        for text in problem:
            print(f'segment {number}: {text}')


def simulated(stiff: Sequence[SegmentVacuum]) -> dict[str, float]:
    """Return the parameters of the simulation, which has one number for all segments."""
    return {f'simulated_jamming.{name}': fmean(getattr(r, name) for r in stiff)
            for name in ('ultimate_vacuum', 'evacuation_time', 'venting_time', 'leak_rate')}
