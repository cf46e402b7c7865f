# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
``calibrate signs``, ``steps`` and ``zero``: small, slow motions while some segments are soft.

Everything goes through the driver protocols.  If a procedure ends early, also by Ctrl-C, its
motion ends.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from functools import partial
from math import isfinite
import sys
from typing import Any

from soft_continuum.commissioning.calibrate_vacuum import (
    opened_jamming,
    POLL_INTERVAL,
    retry,
    TIMEOUT,
    vent,
)
from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.commissioning import Drive
from soft_continuum.hardware.drivers import chosen_families, DriverFamily
from soft_continuum.hardware.grbl.commissioning import DRIVE
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
from soft_continuum.parameters.arguments import ask, confirm, number, one_of
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.parameters.scalars import as_yaml

SPEED = 2e-3
"""Speed of every calibration motion, m/s."""
MAX_STEPS_FACTOR = 10.0
"""Largest error factor of a scale; beyond it the measured value counts as a typing error."""
MAX_MOVE = 0.01  # m
POSITION_TOLERANCE = 2e-4
"""Largest position error at rest, m, unless the driver reports a larger tolerance."""
REST_TIME = 0.2  # s without motion that count as rest
MARK_TIME = 1.0  # s for a driver to mark the reference in the controller
MM = 1e3  # per m
PER_TENDON = 'measured', 'seen', 'take_up'
"""Options with a value for each tendon."""
GUIDE = 'docs/how_to/set_up_a_rig.md'
SIGN_MOVE = 2.0  # mm
MAX_JOG = 2.0  # mm
TAKE_UP = 'dynamixel.take_up_tension'
PULLED_IN, PAID_OUT = 'pulled-in', 'paid-out'
DIRECTIONS = {PULLED_IN: 1.0, PAID_OUT: -1.0}  # sign by what was seen
UNHOOK_REQUEST = (
    'The tendons move by up to {:g} mm, one after the other. To avoid strain, unhook them from '
    'the arm, or pay out that much slack by hand.')


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
        with suppress(HardwareError):
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


@dataclass
class Job:
    """
    The options, the parameters corrected so far, the results and the failures.

    names: of the tendons, as they are typed.  family: of the tendon driver.  own_drive: its
    parameters; None where it has none to correct.
    """

    options: argparse.Namespace
    values: dict[str, Any]
    results: dict[str, tuple[float, ...] | float] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)
    names: tuple[str, ...] = field(init=False)
    family: DriverFamily = field(init=False)
    own_drive: Drive | None = field(init=False)

    def __post_init__(self) -> None:
        """Find these; raises CalibrationError if an option lacks a value, and HardwareError."""
        self.family = chosen_families(self.values)['tendon_driver']
        self.own_drive = self.family.drive
        tendons = arm_from_parameters(self.values).tendon_names
        self.names = tuple(name.removesuffix('_tendon') for name in tendons)
        for option in PER_TENDON:
            given = getattr(self.options, option)
            if given is not None and len(given) != len(self.names):
                raise CalibrationError(
                    f'--{option.replace("_", "-")} has {len(given)} values; needed: one for each '
                    f'of {", ".join(self.names)}')

    @property
    def jamming(self) -> bool:
        """Whether the arm has segments that can be stiffened."""
        return bool(self.values['arm.jamming'])

    def per_tendon(self, name: str) -> tuple[float, ...]:
        """Return a parameter with a value for each tendon; raises CalibrationError."""
        values: tuple[float, ...] = self.values[name]
        if len(values) == 1 and self.drive.shared:
            return values * len(self.names)
        if len(values) != len(self.names):
            raise CalibrationError(f'parameter {name} is {as_yaml(values)}; needed: one value for '
                                   f'each of {", ".join(self.names)}; begin with estimates')
        return values

    @property
    def drive(self) -> Drive:
        """The parameters of the tendon driver; those of grbl where it has none."""
        return self.own_drive or DRIVE

    def one(self, tendon: int, distance: float) -> tuple[float, ...]:
        """Return the distances (m) of all tendons that move only one, by ``distance`` in mm."""
        return tuple(distance / MM if i == tendon else 0.0 for i in range(len(self.names)))


@contextmanager
def _bench(job: Job, text: str, sets_zero: bool = False
           ) -> Iterator[tuple[TendonBench, TendonDriver]]:
    """
    Soften segments and open the steppers; afterwards clear a provisional zero.

    For each tendon, the segment below its end is softened.
    """
    # The user takes up slack.
    values, arm = job.values | {TAKE_UP: 0.0}, arm_from_parameters(job.values)
    soft = sorted({end - 1 for end in arm.tendon_ends}) if job.jamming else []
    if soft and values['jamming_driver'] == 'simulated':
        text += (' The valves are simulated (jamming_driver): make sure by hand that a segment '
                 'is soft.')
    vented = ' '.join(f'Segment {segment + 1} is vented and becomes soft.' for segment in soft)
    confirm(f'{vented} {text} Ctrl-C stops.'.lstrip(), job.options.yes)
    tendons: TendonDriver = job.family.make(values, STEADY)
    if tendons.reference_moves:
        raise CalibrationError(
            'the tendons are homed (grbl.homed_pulls), which calibrate does not do: remove '
            f'grbl.homed_pulls from the files and set $22=0 during calibration, see {GUIDE}')
    with opened_jamming(values) if soft else nullcontext() as jamming:
        bench = TendonBench(
            tendons, jamming, soft,
            TendonLimits(arm.tendon_names, values['pull_limits'], values['speed_limit']),
            values['ambient_pressure'] - values['soft_vacuum'])
        tendons.open()
        provisional = False
        try:
            bench.soften()
            # Tendons need a zero to move: the present position serves meanwhile.
            provisional = not tendons.read().referenced
            if provisional:
                tendons.reference()
            yield bench, tendons
            provisional = provisional and not sets_zero
        finally:
            tendons.close()
            if provisional:
                _clear_zero(job)


def _clear_zero(job: Job) -> None:
    try:
        job.family.clear_zero(job.values)
    except (HardwareError, ParameterError) as error:
        print('The tendon device may still hold a provisional zero: power-cycle it before '
              f'anything else ({error})', file=sys.stderr)


def _must_ask(job: Job, why: str, option: str, note: str = '') -> None:
    """Raise CalibrationError if --yes is given although an answer is needed."""
    if job.options.yes:
        raise CalibrationError(
            f'{why}: give {option} {" ".join(job.names).upper()}{note}, or leave out --yes')


def signs(job: Job) -> None:
    """Find the direction in which each stepper pulls."""
    seen = job.options.seen
    if seen is None:
        _must_ask(job, 'somebody must watch the tendons', '--seen')
        seen = []
        with _bench(job, UNHOOK_REQUEST.format(SIGN_MOVE)) as (bench, _):
            for tendon, name in enumerate(job.names):
                answer = 'again'
                while answer == 'again':
                    print(f'The {name} tendon moves ...', flush=True)
                    bench.move(job.one(tendon, SIGN_MOVE))
                    answer = ask(
                        f'Was the {name} tendon pulled in, or paid out? '
                        f'({PULLED_IN}, {PAID_OUT}, again)',
                        one_of(*DIRECTIONS, 'again'))
                    bench.move(job.one(tendon, -SIGN_MOVE))
                seen.append(answer)
    name = job.drive.signs
    signs = tuple(sign * DIRECTIONS[answer]
                  for sign, answer in zip(job.per_tendon(name), seen, strict=True))
    _take(job, name, signs)


def steps(job: Job) -> None:
    """Compare commanded with measured travel."""
    distance = job.options.distance or 5.0
    travels = job.options.measured
    if travels is None:
        _must_ask(job, 'travel must be measured', '--measured')
        travels = []
        with _bench(job, f'{UNHOOK_REQUEST.format(distance)} Have a caliper or ruler ready and '
                    'a mark on each tendon.') as (bench, _):
            for tendon, name in enumerate(job.names):
                confirm(f'The {name} tendon: note where its mark is.', job.options.yes)
                print(f'The {name} tendon is pulled in by {distance:g} mm ...', flush=True)
                bench.move(job.one(tendon, distance))
                travels.append(ask(
                    f'By how many mm was the {name} tendon really pulled in?',
                    lambda text: _travel(text, distance)))
                bench.move(job.one(tendon, -distance))
    name = job.drive.scale
    before = job.per_tendon(name)
    scales = tuple(corrected_scale(job.drive, old, distance / MM, travel / MM)
                   for old, travel in zip(before, travels, strict=True))
    _take(job, name, scales)
    if job.own_drive and job.drive.scale_moves_zero and scales != tuple(before):
        _clear_zero(job)
        print('The scale has changed: the zero must be set again.')


def _travel(text: str, distance: float) -> float:
    travel = number(text, 0.01, 1000.0, 'mm')
    corrected_steps(1.0, distance / MM, travel / MM)
    return travel


def _take(job: Job, name: str, values: tuple[float, ...]) -> None:
    """Keep a result if the rig uses the driver it belongs to."""
    print(f'{name}: {as_yaml(values)} ({", ".join(job.names)}); it was '
          f'{as_yaml(job.values[name])}')
    job.values[name] = values
    if job.own_drive:
        job.results[name] = values
    else:
        print(f'This is not kept: tendon_driver is {job.values["tendon_driver"]}.')


def zero(job: Job) -> None:
    """Take up the slack of all tendons, then set the zero at the straight arm."""
    take_up = job.options.take_up
    if take_up is None:
        _must_ask(job, 'somebody must look at the slack', '--take-up', ' (0: just taut)')
    with _bench(job, 'The arm is straight and all tendons are hooked in, slack or just taut.',
                sets_zero=True) as (bench, tendons):
        if take_up is None:
            _jog(bench, job)
            confirm('All tendons are just taut, and the arm is straight.', job.options.yes)
        else:
            bench.move(tuple(distance / MM for distance in take_up))
        tendons.reference()
        STEADY.sleep(MARK_TIME)
    print('The straight arm is zero.')
    if parameter := job.drive.zeros:
        _take(job, parameter, tuple(tendons.zeros))  # type: ignore[attr-defined]
        print('If the joints keep their position when switched off, set '
              f'{parameter.partition(".")[0]}.absolute: true; the arm is then referenced at every '
              'start. Otherwise start the nodes and, with the arm straight and all tendons just '
              'taut, type soft_continuum reference.')
        return
    tendons.open()  # as the node will
    try:
        kept = tendons.read().referenced
    finally:
        tendons.close()
    print('The controller keeps it: start the nodes.' if kept else
          f'The controller does not keep it, because opening its port resets it ({GUIDE}): start '
          'the nodes and, with the arm straight and all tendons just taut, type soft_continuum '
          'reference.')


def _jog(bench: TendonBench, job: Job) -> None:
    names = job.names
    print(f'Type a tendon ({", ".join(names)}, or its first letters) and how many mm to pull it '
          f'in, up to {MAX_JOG:g}; negative pays out.\nFor example: {names[0]} 0.5. Type done '
          'when all are just taut.')
    while True:
        distances = ask('TENDON MM, or done:', partial(_jog_distances, job))
        if distances is None:
            return
        try:
            reading = bench.move(distances)
        except CalibrationError as error:
            print(error, flush=True)
            continue
        print(', '.join(f'{name} {MM * pull:.2f} mm'
                        for name, pull in zip(names, reading.pulls, strict=True)), flush=True)


def _jog_distances(job: Job, text: str) -> tuple[float, ...] | None:
    """Return the distances (m) of a typed line; None for the end."""
    if text == 'done':
        return None
    tendon, _, distance = text.partition(' ')
    found = [i for i, name in enumerate(job.names) if name == tendon] or [
        i for i, name in enumerate(job.names) if tendon and name.startswith(tendon)]
    if len(found) != 1:
        raise CalibrationError(
            f'{text!r} was typed; allowed: {" MM, ".join(job.names)} MM, done')
    return job.one(found[0], number(distance, -MAX_JOG, MAX_JOG, 'mm'))
