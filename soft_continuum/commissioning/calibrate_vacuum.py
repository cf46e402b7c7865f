# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What ``calibrate vacuum`` says of the segments that it measured, and the parameters."""

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
    RegulatorResponse,
)
from soft_continuum.hardware.jamming_controller import JammingSettings
from soft_continuum.hardware.protocols import RegulatorDriver

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


def regulators(driver: RegulatorDriver, values: Mapping[str, Any], settings: JammingSettings
               ) -> list[str]:
    """Let one segment after the other follow its regulator; return what is not good."""
    settings.check_regulators(driver.max_vacuum)
    segments, results = len(values['arm.segment_lengths']), []
    for segment in range(segments):
        print(f'segment {segment + 1} ...', flush=True)
        results.append(measure_regulator(
            driver, segment, segments, settings, values['soft_vacuum']))
    problems = [assess_regulator(result, settings) for result in results]
    _show_regulators(results, problems, settings.full_vacuum)
    return [f'segment {result.segment + 1} does not follow its regulator'
            for result, problem in zip(results, problems, strict=True) if problem]


def _show_regulators(results: Sequence[RegulatorResponse], problems: Sequence[Sequence[str]],
                     full_vacuum: float) -> None:
    """Print what was measured of regulators, and what is wrong; full_vacuum: Pa."""
    levels = [f'at {level * full_vacuum / 1e3:.0f} kPa off by kPa' for level in LEVELS]
    print(text_table(('segment', 'to full s', 'to soft s', *levels, 'is'), [
        [str(r.segment + 1), *map(_cell, (r.rise, r.fall, *(e / 1e3 for e in r.errors))),
         'not good' if problem else 'good']
        for r, problem in zip(results, problems, strict=True)]))
    for result, problem in zip(results, problems, strict=True):
        for text in problem:
            print(f'segment {result.segment + 1}: {text}')


def simulated(stiff: Sequence[SegmentVacuum]) -> dict[str, float]:
    """Return the parameters of the simulation, which has one number for all segments."""
    return {f'simulated_jamming.{name}': fmean(getattr(r, name) for r in stiff)
            for name in ('ultimate_vacuum', 'evacuation_time', 'venting_time', 'leak_rate')}


def _cell(value: float) -> str:
    return f'{value:.4g}' if isfinite(value) else '-'
