# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Calibration of tendons: small, slow motions while some segments are soft.

Everything goes through the driver protocols.  If a procedure ends early, also by Ctrl-C, its
motion ends.
"""

from collections.abc import Callable, Sequence
import contextlib
from functools import partial
from math import isfinite
from typing import TypeVar

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.commissioning import Drive
from soft_continuum.hardware.jamming_controller import RESPONSE_TIME
from soft_continuum.hardware.protocols import (
    describe_pulls,
    HardwareError,
    JammingDriver,
    RegulatorDriver,
    TendonDriver,
    TendonReading,
)
from soft_continuum.hardware.tendon_controller import TendonLimits
from soft_continuum.parameters.parameter import ParameterError

SPEED = 2e-3
"""Speed of every calibration motion, m/s."""
MAX_STEPS_FACTOR = 10.0
"""Largest error factor of a scale; beyond it the measured value counts as a typing error."""
MAX_MOVE = 0.01  # m
POSITION_TOLERANCE = 2e-4
"""Largest position error at rest, m, unless the driver reports a larger tolerance."""
REST_TIME = 0.2  # s without motion that count as rest
TIMEOUT = 10.0  # s that anything may take longer than it should
POLL_INTERVAL = 0.01  # s
RETRY_TIME = 3.0  # s for which a reading or a switch is tried again when a reply was missed
MARK_TIME = 1.0  # s for a driver to mark the reference in the controller


T = TypeVar('T')


class CalibrationError(ParameterError):
    """A value or motion that was requested is not usable; the message names the reason."""


class TendonBench:
    """Tendons that may only make short, slow motions, while some segments are soft."""

    def __init__(self, tendons: TendonDriver, jamming: JammingDriver | RegulatorDriver | None,
                 segments: Sequence[int], limits: TendonLimits, soft_pressure: float,
                 clock: Clock = STEADY) -> None:
        """
        Use opened drivers; nothing is switched or moved yet.

        segments: those that must be soft (0-based), none of an arm without ``jamming``.
        soft_pressure: absolute pressure from which on they are, Pa.
        """
        self._tendons = tendons
        self._jamming = jamming
        self._segments = tuple(segments)
        self._limits = limits
        self._soft_pressure = soft_pressure
        self._clock = clock

    @property
    def stiff(self) -> tuple[int, ...]:
        """Which of the segments are not vented, by their valves or by their pressures."""
        if self._jamming is None:
            return ()
        reading = retry(self._jamming.read, self._clock)
        return tuple(segment for segment in self._segments if reading.evacuated[segment]
                     or not reading.pressures[segment] >= self._soft_pressure)

    def soften(self) -> None:
        """Vent the segments and wait until they are soft; raises HardwareError if they are not."""
        jamming = self._jamming
        if jamming is None:
            return
        for segment in self._segments:
            retry(partial(vent, jamming, segment), self._clock)
        deadline = self._clock() + RESPONSE_TIME
        late = False  # before they were looked at, not after
        while stiff := self.stiff:
            if late:
                pressure = retry(jamming.read, self._clock).pressures[stiff[0]]
                raise HardwareError(
                    f'segment {stiff[0] + 1} is not soft {RESPONSE_TIME:g} s after it was '
                    f'vented: {pressure:.0f} Pa, needed: {self._soft_pressure:.0f} Pa; check its '
                    'vent, valve and pressure sensor (doctor checks them)')
            self._clock.sleep(POLL_INTERVAL)
            late = self._clock() > deadline

    def move(self, distances: Sequence[float]) -> TendonReading:
        """
        Pull each tendon by ``distances`` (m) more; return where they rest.

        Raises CalibrationError for a motion that is not allowed, HardwareError for a segment that
        is no longer soft and for steppers that do not arrive.
        """
        tendons = self._limits.tendons
        if not all(abs(d) <= MAX_MOVE for d in distances):
            raise CalibrationError(
                f'requested: {describe_pulls(tendons, distances)}; allowed: {_mm([MAX_MOVE])} in '
                'either direction at a time')
        start = self._tendons.read()
        target = tuple(a + b for a, b in zip(start.pulls, distances, strict=True))
        low, high = self._limits.pull_limits
        if min(target) < low or max(target) > high:
            raise CalibrationError(
                f'this leads to pulls of {describe_pulls(tendons, target)}; pull_limits: '
                f'{_mm((low, high))}. '
                'Take up the slack by hand, or give wider pull_limits')
        if stiff := self.stiff:
            raise HardwareError(
                f'segment {stiff[0] + 1} is no longer soft, so nothing is moved; check '
                'that no other program switches the valves')
        duration = max(abs(d) for d in distances) / min(SPEED, self._limits.speed_limit)
        try:
            self._tendons.move(target, duration)
            return self._rest_at(target, duration)
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        """Brake and wait until nothing moves, or the driver fails."""
        with contextlib.suppress(HardwareError):
            self._tendons.stop()
            deadline = self._clock() + TIMEOUT
            while self._tendons.read().moving and self._clock() < deadline:
                self._clock.sleep(POLL_INTERVAL)

    def _rest_at(self, target: tuple[float, ...], duration: float) -> TendonReading:
        begin = moved = self._clock()
        patience = duration + TIMEOUT  # of which a computer that is late uses up no more
        while True:
            reading, now = self._tendons.read(), self._clock()
            if reading.moving or now - begin < duration:
                moved = now
            if now - moved >= REST_TIME:
                break
            if patience <= 0.0:
                raise HardwareError('the tendons do not come to rest; check the motors')
            self._clock.sleep(POLL_INTERVAL)
            patience -= POLL_INTERVAL
        errors = (abs(a - b) for a, b in zip(reading.pulls, target, strict=True))
        if max(errors) > max((POSITION_TOLERANCE, *reading.accuracy.pull_tolerances)):
            tendons = self._limits.tendons
            raise HardwareError(
                f'the tendons rest at {describe_pulls(tendons, reading.pulls)} instead of '
                f'{describe_pulls(tendons, target)}; check the motors')
        return reading


def _mm(lengths: Sequence[float]) -> str:
    return ' and '.join(f'{1e3 * x:.2f}' for x in lengths) + ' mm'


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


def corrected_steps(steps_per_mm: float, commanded: float, measured: float) -> float:
    """
    Return the steps/mm with which ``commanded`` (m) would have been the travel ``measured`` (m).

    Raises CalibrationError when the two differ by more than MAX_STEPS_FACTOR.
    """
    low, high = commanded / MAX_STEPS_FACTOR, commanded * MAX_STEPS_FACTOR
    if not (isfinite(measured) and low <= measured <= high):
        raise CalibrationError(
            f'{1e3 * measured:.2f} mm measured for {1e3 * commanded:.2f} mm commanded; allowed: '
            f'{1e3 * low:.2f} mm to {1e3 * high:.2f} mm. Give mm; if the value is right, first '
            'correct the scale roughly in the parameter file')
    return round(steps_per_mm * commanded / measured, 3)  # as many digits as GRBL keeps


def corrected_scale(drive: Drive, scale: float, commanded: float, measured: float) -> float:
    """Return the scale with which ``commanded`` (m) would have been ``measured`` (m)."""
    if drive.inverse:  # the radius of a spool, m
        corrected_steps(1.0, commanded, measured)  # raises for what cannot be
        return float(f'{scale * measured / commanded:.6g}')
    return corrected_steps(scale, commanded, measured)
