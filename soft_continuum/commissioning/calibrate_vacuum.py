# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
``calibrate vacuum``: evacuates one segment at a time, or tests its regulator.

Everything goes through the driver protocols.  If it ends early, also by Ctrl-C, the pump stops and
all segments are vented.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from math import inf, isfinite, log, nan
from statistics import fmean
from typing import Any, TypeVar

import numpy as np

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.drivers import chosen_families
from soft_continuum.hardware.jamming_controller import JammingSettings, RESPONSE_TIME
from soft_continuum.hardware.protocols import HardwareError, JammingDriver, RegulatorDriver
from soft_continuum.lab.analysis.verbs import cell, text_table

TIMEOUT = 10.0  # s that anything may take longer than it should
POLL_INTERVAL = 0.01  # s
RETRY_TIME = 3.0  # s for which a reading or a switch is tried again when a reply was missed
PLATEAU_TIME, PLATEAU_RISE, MIN_EVACUATION_TIME = 1.0, 0.01, 3.0
"""A vacuum that rises by less than this share in so many s has settled; first checked after s."""
MAX_EVACUATION_TIME = 30.0  # s
PUMP_STOP_TIME, VENT_TIME = 0.5, 2.0
"""s for the pump to stop, and for a soft segment to lose the rest of its vacuum."""
USUAL_TIME_TO_STIFF = 1.0  # s, in the arm of the paper
MIN_PUMP_REST = 10.0
"""s between two starts of the pump where segments are tight enough."""
LEVELS = (1 / 3, 2 / 3, 1.0)  # of the full vacuum
SETTLING_TIME = 1.0  # s at a level before its readings count
READINGS = 10
USUAL_RISE = 5.0  # s

T = TypeVar('T')
Samples = list[tuple[float, float]]


@contextmanager
def opened_jamming(values: Mapping[str, Any]) -> Iterator[JammingDriver | RegulatorDriver]:
    """Yield the driver of pump and valves, or of regulators, while it is open."""
    driver: JammingDriver | RegulatorDriver = chosen_families(values)['jamming_driver'].make(
        values, STEADY)
    driver.open()
    try:
        yield driver
    finally:
        driver.close()


def vent(jamming: JammingDriver | RegulatorDriver, segment: int) -> None:
    """Vent a segment (0-based) by its valve or by its regulator."""
    if isinstance(jamming, RegulatorDriver):
        jamming.set_vacuum(segment, 0.0)
    else:
        jamming.set_evacuated(segment, False)


def retry(action: Callable[[], T], clock: Clock = STEADY) -> T:
    """Return the result of an action, repeated after a missed reply."""
    deadline = clock() + RETRY_TIME
    while True:
        try:
            return action()
        except HardwareError:
            if clock() > deadline:
                raise
            clock.sleep(POLL_INTERVAL)


@dataclass(frozen=True)
class SegmentVacuum:
    """
    How a segment (0-based) is evacuated, holds its vacuum, and is vented.

    time_to_stiff: s from switching to stiff_vacuum; inf: never.  ultimate_vacuum: Pa below
    ambient.  evacuation_time, venting_time: time constants, s.  leak_rate: Pa/s while the pump
    rests.  All but the first two are nan for a segment that does not become stiff.
    """

    segment: int
    time_to_stiff: float
    ultimate_vacuum: float
    evacuation_time: float = nan
    leak_rate: float = nan
    venting_time: float = nan


def assess_vacuum(result: SegmentVacuum, settings: JammingSettings) -> tuple[str, ...]:
    """Return faults of a segment or the pump, each with a remedy; empty for none."""
    if result.time_to_stiff == inf:
        return (f'never stiff: {result.ultimate_vacuum / 1e3:.1f} kPa of vacuum, stiff_vacuum is '
                f'{settings.stiff_vacuum / 1e3:g} kPa; look for a leak, check valve and pump',)
    problems = []
    if result.time_to_stiff > USUAL_TIME_TO_STIFF:
        problems.append(f'slow: {USUAL_TIME_TO_STIFF:g} s is usual; look for narrow or long '
                        'tubes, a clogged filter, a weak pump')
    if result.ultimate_vacuum < settings.pump_stop_vacuum:
        problems.append(
            f'the pump would never stop: it reaches {result.ultimate_vacuum / 1e3:.1f} kPa, '
            f'pump_stop_vacuum is {settings.pump_stop_vacuum / 1e3:g} kPa; lower that or use '
            'another pump')
    rest = settings.pump_stop_vacuum - settings.pump_start_vacuum
    if result.leak_rate * MIN_PUMP_REST > rest:
        problems.append(
            f'leaks: the pump would start every {rest / result.leak_rate:.1f} s; look for the '
            'leak, and for a pump without a check valve')
    return tuple(problems)


def measured_vacuum(driver: JammingDriver | RegulatorDriver, segment: int,
                    settings: JammingSettings, clock: Clock) -> float:
    """Return the vacuum of a segment (0-based), Pa; HardwareError where its sensor is broken."""
    value = settings.ambient_pressure - retry(driver.read, clock).pressures[segment]
    if not isfinite(value):
        raise HardwareError(f'segment {segment + 1}: no pressure; check the wire and the '
                            'supply of its pressure sensor')
    return value


def rest_all(jamming: JammingDriver, segments: int, clock: Clock = STEADY) -> None:
    """
    Switch the pump off and vent all segments, trying again where the line was disturbed.

    A lasting failure does not prevent the other switches; HardwareError is raised at the end.
    """
    deadline = clock() + TIMEOUT
    due: list[Callable[[], None]] = [
        partial(jamming.set_pump, False),
        *(partial(jamming.set_evacuated, segment, False) for segment in range(segments))]
    while due:
        for action in due[:]:
            try:
                action()
                due.remove(action)
            except HardwareError:
                if clock() > deadline:
                    raise
        clock.sleep(POLL_INTERVAL)


def measure_segment(jamming: JammingDriver, segment: int, segments: int,
                    settings: JammingSettings, soft_vacuum: float,
                    leak_time: float, clock: Clock = STEADY) -> SegmentVacuum:
    """
    Evacuate one segment (0-based) of ``segments``, let the pump rest for ``leak_time`` s, vent it.

    The other segments are vented: a resting pump would connect them.  soft_vacuum: Pa below
    ambient.  Before and after, also when it fails, everything is vented and the pump rests.
    Raises HardwareError when a device fails or a segment cannot be vented.
    """
    def vacuum() -> float:
        return measured_vacuum(jamming, segment, settings, clock)

    def vent() -> None:
        jamming.set_evacuated(segment, False)

    stuck = (f'segment {segment + 1} keeps its vacuum after venting; check its vent, valve and '
             'pressure sensor')
    try:
        rest_all(jamming, segments, clock)
        _record(clock, vacuum, lambda samples: samples[-1][1] < soft_vacuum, vent, stuck)
        clock.sleep(VENT_TIME)
        retry(lambda: jamming.set_pump(True), clock)
        rise = _record(clock, vacuum, _has_levelled, lambda: jamming.set_evacuated(segment, True))
        ultimate = rise[-1][1]
        if ultimate < settings.stiff_vacuum:
            return SegmentVacuum(segment, inf, ultimate)
        retry(lambda: jamming.set_pump(False), clock)
        clock.sleep(PUMP_STOP_TIME)
        loss = np.array(_record(clock, vacuum, lambda samples: samples[-1][0] > leak_time))
        held = loss[-1, 1]
        fall = [(time, -value) for time, value in _record(
            clock, vacuum, lambda samples: samples[-1][1] < 0.2 * held, vent, stuck)]
        return SegmentVacuum(
            segment, _reaches(rise, settings.stiff_vacuum), ultimate,
            # Between two levels of an exponential, whatever the delay of the valve.
            (_reaches(rise, 0.8 * ultimate) - _reaches(rise, 0.3 * ultimate)) / log(0.7 / 0.2),
            max(0.0, -float(np.polyfit(loss[:, 0], loss[:, 1], 1)[0])),
            (_reaches(fall, -0.3 * held) - _reaches(fall, -0.8 * held)) / log(0.8 / 0.3))
    finally:
        rest_all(jamming, segments, clock)


def _record(clock: Clock, vacuum: Callable[[], float], enough: Callable[[Samples], bool],
            start: Callable[[], None] = lambda: None, failure: str = '') -> Samples:
    """Return times (s) since ``start`` and vacuum (Pa) until ``enough``, or raise failure."""
    def begin_now() -> float:
        now = clock()
        start()
        return now

    begin = retry(begin_now, clock)
    samples: Samples = []
    while not samples or not enough(samples):
        if samples and failure and samples[-1][0] > RESPONSE_TIME:
            raise HardwareError(failure)
        value = vacuum()
        samples.append((clock() - begin, value))
        clock.sleep(POLL_INTERVAL)
    return samples


def _has_levelled(samples: Samples) -> bool:
    """Whether an evacuation has come to its end."""
    time, value = samples[-1]
    if time < MIN_EVACUATION_TIME:
        return False
    before = next(v for t, v in reversed(samples) if t <= time - PLATEAU_TIME)
    return value - before < PLATEAU_RISE * abs(value) or time > MAX_EVACUATION_TIME


def _reaches(samples: Samples, level: float) -> float:
    """Return when (s) samples first reach a level from below, interpolated; inf: never."""
    times, values = np.transpose(samples)
    if values.max() < level:
        return inf
    reached = int(np.argmax(values >= level))
    around = [max(0, reached - 1), reached]
    return float(np.interp(level, values[around], times[around]))


@dataclass(frozen=True)
class RegulatorResponse:
    """
    How a segment (0-based) follows its regulator.

    rise, fall: s from 0 to near the full vacuum, and from there to soft; inf: never.  errors: at
    each of LEVELS, measured vacuum minus set-point, Pa.
    """

    segment: int
    rise: float
    fall: float
    errors: tuple[float, ...]


def measure_regulator(driver: RegulatorDriver, segment: int, segments: int,
                      settings: JammingSettings, soft_vacuum: float, clock: Clock = STEADY
                      ) -> RegulatorResponse:
    """
    Give one segment (0-based) of ``segments`` the full vacuum, then less, then none.

    soft_vacuum: Pa.  Before and after, also when it fails, all are set to 0.  Raises HardwareError
    when a device fails.
    """
    def vacuum() -> float:
        return measured_vacuum(driver, segment, settings, clock)

    def arrival(told: float, near: float) -> float:
        """Return the time until a vacuum is so close (Pa) to its set-point; inf: never."""
        begin = clock()
        retry(partial(driver.set_vacuum, segment, told), clock)
        while abs(vacuum() - told) > near:
            if clock() > begin + RESPONSE_TIME:
                return inf
            clock.sleep(POLL_INTERVAL)
        return clock() - begin

    def error(told: float) -> float:
        clock.sleep(SETTLING_TIME)
        found = []
        for _ in range(READINGS):
            found.append(vacuum() - told)
            clock.sleep(POLL_INTERVAL)
        return fmean(found)

    try:
        release_all(driver, segments, clock)
        arrival(0.0, soft_vacuum)
        full = settings.full_vacuum
        rise, errors = arrival(full, settings.vacuum_tolerance), [error(full)]
        for level in reversed(LEVELS[:-1]):
            arrival(level * full, settings.vacuum_tolerance)
            errors.append(error(level * full))
        arrival(full, settings.vacuum_tolerance)
        return RegulatorResponse(
            segment, rise, arrival(0.0, soft_vacuum), tuple(reversed(errors)))
    finally:
        release_all(driver, segments, clock)


def release_all(driver: RegulatorDriver, segments: int, clock: Clock = STEADY) -> None:
    """Set every regulator to 0, with retries if the line is disturbed."""
    for segment in range(segments):
        retry(partial(driver.set_vacuum, segment, 0.0), clock)


def assess_regulator(result: RegulatorResponse, settings: JammingSettings) -> tuple[str, ...]:
    """Return faults of a regulator, each with a remedy; empty for none."""
    problems = []
    if result.fall == inf:
        problems.append('never soft: the regulator does not vent, its vent is blocked, or the '
                        'pressure sensor is stuck')
    if settings.full_vacuum + result.errors[-1] < settings.stiff_vacuum:
        problems.append('never stiff: look for a leak, and for the supply of the regulators')
    elif result.rise > USUAL_RISE:
        problems.append(f'slow: {USUAL_RISE:g} s is usual; look for narrow or long tubes, and for '
                        'a weak supply')
    worst = max(result.errors, key=abs)
    if not abs(worst) <= settings.vacuum_tolerance:
        problems.append(
            f'{worst / 1e3:+.1f} kPa off its set-point; vacuum_tolerance: '
            f'{settings.vacuum_tolerance / 1e3:g} kPa; compare modbus.output_range, '
            'modbus.output_vacuums and modbus.vacuum_at_20_ma with both devices')
    return tuple(problems)


def segments(driver: JammingDriver, count: int, settings: JammingSettings, soft_vacuum: float,
             leak_time: float) -> tuple[list[str], dict[str, float]]:
    """Measure and print each segment in turn; return the problems and parameters."""
    found = []
    for segment in range(count):
        print(f'segment {segment + 1} ...', flush=True)
        found.append(measure_segment(driver, segment, count, settings, soft_vacuum, leak_time))
    head = 'segment', 'to stiff s', 'reaches kPa', 'evacuates s', 'loses Pa/s', 'vents s', 'is'
    _print(head, [(r.time_to_stiff, r.ultimate_vacuum / 1e3, r.evacuation_time, r.leak_rate,
                   r.venting_time) for r in found],
           [assess_vacuum(result, settings) for result in found],
           'evacuates, vents: time constants.')
    stiff = [r for r in found if isfinite(r.time_to_stiff)]
    # The simulation has one number for all segments.
    return [f'segment {r.segment + 1} does not become stiff' for r in found if r not in stiff], {
        f'simulated_jamming.{name}': fmean(getattr(r, name) for r in stiff)
        for name in ('ultimate_vacuum', 'evacuation_time', 'venting_time', 'leak_rate') if stiff}


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
        [str(number), *(cell(value, digits='.4g') for value in values),
         'not good' if problem else 'good']
        for number, (values, problem) in enumerate(zip(results, problems, strict=True), start=1)]))
    if note:
        print(note)
    for number, problem in enumerate(problems, start=1):
        for text in problem:
            print(f'segment {number}: {text}')
