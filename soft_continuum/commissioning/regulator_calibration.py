# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Measurements of ``calibrate vacuum`` on a vacuum regulator: its speed and its accuracy."""

from dataclasses import dataclass
from functools import partial
from math import inf
from statistics import fmean

from soft_continuum.commissioning.calibration import measured_vacuum, POLL_INTERVAL, retry
from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.jamming_controller import JammingSettings, RESPONSE_TIME
from soft_continuum.hardware.protocols import RegulatorDriver

LEVELS = (1 / 3, 2 / 3, 1.0)  # of the full vacuum
SETTLING_TIME = 1.0  # s at a level before its readings count
READINGS = 10
USUAL_RISE = 5.0  # s


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
