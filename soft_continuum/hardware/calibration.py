# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
How a rig is measured: little, slow tendon motions, and evacuating one segment after the other.

All goes through the driver protocols.  Whatever ends a procedure early, Ctrl-C included, ends its
motion and rests its pump.
"""

from collections.abc import Callable, Sequence
import contextlib
from dataclasses import dataclass
from functools import partial
from math import inf, isfinite, log, nan
from time import monotonic, sleep
from typing import TypeVar

import numpy as np

from soft_continuum.hardware.grbl_link import GrblLink, SOFT_RESET
from soft_continuum.hardware.grbl_setup import find_controller
from soft_continuum.hardware.jamming_controller import JammingSettings, RESPONSE_TIME
from soft_continuum.hardware.protocols import (
    HardwareError,
    JammingDriver,
    TendonDriver,
    TendonReading,
)
from soft_continuum.hardware.serial_ports import open_serial
from soft_continuum.hardware.tendon_controller import TendonLimits

SPEED = 2e-3
"""m/s of every motion here."""
LONGEST_MOVE = 0.01  # m
ARRIVED = 2e-4  # m; a stepper that stops further from where it was sent has failed
STILL = 0.2  # s without motion that count as rest
PATIENCE = 10.0  # s that anything may take longer than it should
POLL = 0.01  # s
INSISTENCE = 3.0  # s for which a reading or a switch is tried again when a reply was missed
MARK_TIME = 1.0  # s for a driver to leave its mark of the reference in the controller
FACTOR = 10.0
"""Most by which steps/mm may be wrong; beyond, the measured value is taken for a slip."""

PLATEAU_TIME, PLATEAU, SHORTEST = 1.0, 0.01, 3.0
"""s over which the vacuum rises by less than this share where it ends, s before that is judged."""
LONGEST_EVACUATION = 30.0  # s
PUMP_STOPS, VENTS = 0.5, 2.0
"""s for the pump to come to rest, and for a soft segment to lose what is left of its vacuum."""
QUICK = 1.0
"""s within which a segment becomes stiff in the arm of the paper."""
SHORTEST_REST = 10.0
"""s that the pump rests between two starts where segments are tight enough."""

Samples = list[tuple[float, float]]
T = TypeVar('T')


class CalibrationError(ValueError):
    """A value that was given, or a motion that was asked for, is not usable; says why."""


class TendonBench:
    """Two tendons that may move a little, slowly, and only while one segment is soft."""

    def __init__(self, tendons: TendonDriver, jamming: JammingDriver, segment: int,
                 limits: TendonLimits, soft_pressure: float) -> None:
        """
        Use opened drivers; nothing is switched or moved yet.

        segment: the one that must be soft (0-based).  soft_pressure: absolute pressure from which
        on it is, Pa.
        """
        self._tendons = tendons
        self._jamming = jamming
        self._segment = segment
        self._limits = limits
        self._soft_pressure = soft_pressure

    @property
    def soft(self) -> bool:
        """Whether the segment is vented, by its valve and by its pressure."""
        reading = insist(self._jamming.read)
        return (not reading.evacuated[self._segment]
                and reading.pressures[self._segment] >= self._soft_pressure)

    def soften(self) -> None:
        """Vent the segment and wait until it is soft; raises HardwareError when it does not."""
        insist(lambda: self._jamming.set_evacuated(self._segment, False))
        deadline = monotonic() + RESPONSE_TIME
        while not self.soft:
            if monotonic() > deadline:
                pressure = insist(self._jamming.read).pressures[self._segment]
                raise HardwareError(
                    f'segment {self._segment + 1} is not soft {RESPONSE_TIME:g} s after it was '
                    f'vented: {pressure:.0f} Pa, needed: {self._soft_pressure:.0f} Pa; check its '
                    'vent, valve and pressure sensor (doctor says more)')
            sleep(POLL)

    def move(self, distances: Sequence[float]) -> TendonReading:
        """
        Pull the right and the left tendon by ``distances`` (m) more; return where they rest.

        Raises CalibrationError for a motion that is not allowed, HardwareError for a segment that
        is not soft any more and for steppers that do not arrive.
        """
        if not all(abs(d) <= LONGEST_MOVE for d in distances):
            raise CalibrationError(
                f'{_mm(distances)} were asked for; allowed: {_mm([LONGEST_MOVE])} to either side '
                'at a time')
        start = self._tendons.read()
        target = (start.pulls[0] + distances[0], start.pulls[1] + distances[1])
        low, high = self._limits.pull_limits
        if min(target) < low or max(target) > high:
            raise CalibrationError(
                f'this leads to pulls of {_mm(target)}; pull_limits: {_mm((low, high))}. Take up '
                'the slack by hand, or give wider pull_limits')
        if not self.soft:
            raise HardwareError(
                f'segment {self._segment + 1} is not soft any more, so nothing is moved; check '
                'that no other program switches the valves')
        duration = max(abs(d) for d in distances) / min(SPEED, self._limits.speed_limit)
        try:
            self._tendons.move(target, duration)
            return self._rest_at(target, duration)
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        """Brake and wait until nothing moves, or a driver that failed says that it cannot tell."""
        with contextlib.suppress(HardwareError):
            self._tendons.stop()
            deadline = monotonic() + PATIENCE
            while self._tendons.read().moving and monotonic() < deadline:
                sleep(POLL)

    def _rest_at(self, target: tuple[float, float], duration: float) -> TendonReading:
        begin = moved = monotonic()
        while True:
            reading, now = self._tendons.read(), monotonic()
            if reading.moving or now - begin < duration:
                moved = now
            if now - moved >= STILL:
                break
            if now - begin > duration + PATIENCE:
                raise HardwareError('the tendons do not come to rest; check the steppers')
            sleep(POLL)
        if max(abs(a - b) for a, b in zip(reading.pulls, target, strict=True)) > ARRIVED:
            raise HardwareError(
                f'the tendons rest at {_mm(reading.pulls)} instead of {_mm(target)}; check the '
                'steppers')
        return reading


def _mm(lengths: Sequence[float]) -> str:
    return ' and '.join(f'{1e3 * x:.2f}' for x in lengths) + ' mm'


def corrected_steps(steps_per_mm: float, commanded: float, measured: float) -> float:
    """
    Return the steps/mm with which ``commanded`` (m) would have been the travel ``measured`` (m).

    Raises CalibrationError when the two differ by more than FACTOR.
    """
    if not (isfinite(measured) and commanded / FACTOR <= measured <= commanded * FACTOR):
        raise CalibrationError(
            f'{_mm([measured])} measured for {_mm([commanded])} commanded; allowed: '
            f'{_mm([commanded / FACTOR])} to {_mm([commanded * FACTOR])}. Give mm; if it is '
            'really so, correct the steps/mm of controller and configuration roughly first')
    return round(steps_per_mm * commanded / measured, 3)  # as many digits as GRBL keeps


def forget_reference(port: str, baud_rate: int) -> None:
    """
    Let a GRBL controller at rest forget its zero, which was only an aid: nothing moves.

    Raises HardwareError when it cannot be reached.
    """
    link = GrblLink(open_serial(port, baud_rate, timeout=0, write_timeout=0.2))
    try:
        find_controller(link)
        link.write(SOFT_RESET)
        find_controller(link)
    finally:
        link.close()


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


def judge(result: SegmentVacuum, settings: JammingSettings) -> tuple[str, ...]:
    """Say what is wrong with a segment or the pump, and what to do; empty when nothing is."""
    if result.time_to_stiff == inf:
        return (f'never stiff: {result.ultimate_vacuum / 1e3:.1f} kPa of vacuum, stiff_vacuum is '
                f'{settings.stiff_vacuum / 1e3:g} kPa; look for a leak, check valve and pump',)
    problems = []
    if result.time_to_stiff > QUICK:
        problems.append(f'slow: {QUICK:g} s is usual; look for narrow or long tubes, a clogged '
                        'filter, a weak pump')
    if result.ultimate_vacuum < settings.pump_stop_vacuum:
        problems.append(
            f'the pump would never rest: it reaches {result.ultimate_vacuum / 1e3:.1f} kPa, '
            f'pump_stop_vacuum is {settings.pump_stop_vacuum / 1e3:g} kPa; lower that or use '
            'another pump')
    rest = settings.pump_stop_vacuum - settings.pump_start_vacuum
    if result.leak_rate * SHORTEST_REST > rest:
        problems.append(
            f'leaks: the pump would start every {rest / result.leak_rate:.1f} s; look for the '
            'leak, and for a pump without a check valve')
    return tuple(problems)


def insist(action: Callable[[], T]) -> T:
    """Return what an action does that may be repeated, in spite of a reply that was missed."""
    deadline = monotonic() + INSISTENCE
    while True:
        try:
            return action()
        except HardwareError:
            if monotonic() > deadline:
                raise
            sleep(POLL)


def rest_all(jamming: JammingDriver, segments: int) -> None:
    """
    Switch the pump off and vent all segments, trying again where the line was disturbed.

    What fails for good does not keep the rest from being switched; then raises HardwareError.
    """
    deadline = monotonic() + PATIENCE
    due: list[Callable[[], None]] = [
        partial(jamming.set_pump, False),
        *(partial(jamming.set_evacuated, segment, False) for segment in range(segments))]
    while due:
        failed = []
        for action in due:
            try:
                action()
            except HardwareError:
                failed.append(action)
                if monotonic() > deadline:
                    raise
        due = failed
        sleep(POLL)


def measure_segment(jamming: JammingDriver, segment: int, segments: int,
                    settings: JammingSettings, soft_vacuum: float,
                    leak_time: float) -> SegmentVacuum:
    """
    Evacuate one segment (0-based) of ``segments``, let the pump rest for ``leak_time`` s, vent it.

    The other segments are vented: a resting pump would connect them.  soft_vacuum: Pa below
    ambient.  Before and after, also when it fails, everything is vented and the pump rests.
    Raises HardwareError when a device fails or a segment cannot be vented.
    """
    def vacuum() -> float:
        value = settings.ambient_pressure - insist(jamming.read).pressures[segment]
        if not isfinite(value):
            raise HardwareError(f'segment {segment + 1}: no pressure; check the wire and the '
                                'supply of its pressure sensor')
        return value

    def vent() -> None:
        jamming.set_evacuated(segment, False)

    stuck = (f'segment {segment + 1} keeps its vacuum though it is vented; check its vent, valve '
             'and pressure sensor')
    try:
        rest_all(jamming, segments)
        _record(vacuum, lambda samples: samples[-1][1] < soft_vacuum, vent, stuck)
        sleep(VENTS)
        insist(lambda: jamming.set_pump(True))
        rise = _record(vacuum, _levelled, lambda: jamming.set_evacuated(segment, True))
        ultimate = rise[-1][1]
        if ultimate < settings.stiff_vacuum:
            return SegmentVacuum(segment, inf, ultimate)
        insist(lambda: jamming.set_pump(False))
        sleep(PUMP_STOPS)
        loss = np.array(_record(vacuum, lambda samples: samples[-1][0] > leak_time))
        held = loss[-1, 1]
        fall = _record(vacuum, lambda samples: samples[-1][1] < 0.2 * held, vent, stuck)
        return SegmentVacuum(
            segment, _reaches(rise, settings.stiff_vacuum), ultimate,
            # Between two levels of an exponential, whatever the delay of the valve.
            (_reaches(rise, 0.8 * ultimate) - _reaches(rise, 0.3 * ultimate)) / log(0.7 / 0.2),
            max(0.0, -float(np.polyfit(loss[:, 0], loss[:, 1], 1)[0])),
            (_falls(fall, 0.3 * held) - _falls(fall, 0.8 * held)) / log(0.8 / 0.3))
    finally:
        rest_all(jamming, segments)


def _record(vacuum: Callable[[], float], enough: Callable[[Samples], bool],
            start: Callable[[], None] = lambda: None, failure: str = '') -> Samples:
    """Return times (s) since ``start`` and vacuum (Pa) until ``enough``, or raise failure."""
    def begin_now() -> float:
        now = monotonic()
        start()
        return now

    begin = insist(begin_now)
    samples: Samples = []
    while not samples or not enough(samples):
        if samples and failure and samples[-1][0] > RESPONSE_TIME:
            raise HardwareError(failure)
        value = vacuum()
        samples.append((monotonic() - begin, value))
        sleep(POLL)
    return samples


def _levelled(samples: Samples) -> bool:
    """Whether an evacuation has come to its end."""
    time, value = samples[-1]
    if time < SHORTEST:
        return False
    before = next(v for t, v in reversed(samples) if t <= time - PLATEAU_TIME)
    return value - before < PLATEAU * abs(value) or time > LONGEST_EVACUATION


def _reaches(samples: Samples, level: float) -> float:
    """Return when (s) samples first reach a level from below, interpolated."""
    previous = samples[0]
    for time, value in samples:
        if value >= level:
            share = (level - previous[1]) / (value - previous[1]) if value > previous[1] else 1.0
            return previous[0] + max(0.0, share) * (time - previous[0])
        previous = time, value
    return inf


def _falls(samples: Samples, level: float) -> float:
    """Return when (s) samples first reach a level from above, interpolated."""
    return _reaches([(time, -value) for time, value in samples], -level)
