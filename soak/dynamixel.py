# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Dynamixel servos: every fault many times, stops, and programs killed in motion.

Driver and emulated servos without nodes.  Faults and stops take place in a time of their own, in
which nothing waits for a busy computer; programs are killed in real time.
"""

from collections import deque
from dataclasses import dataclass, field
from itertools import cycle
import os
from pathlib import Path
from random import Random
import signal
from tempfile import TemporaryDirectory
import time

from benchmarks.tables import table
from soak.report import progress, Report, spread
from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.dynamixel.tendons import DynamixelTendons
from soft_continuum.hardware.protocols import HardwareError
from support.servo_rig import (
    BEYOND_TURN,
    FAULTS,
    Outcome,
    rig,
    ServoRig,
    servos,
    somewhere,
    SPEED,
    spools,
    TENDONS,
    trial,
    WrongStateError,
)
from support.servo_stops import (
    FASTEST,
    MAX_STOP_TIME,
    MEDIAN_STOP_TIME,
    REST_DISTANCE,
    REST_SPEED,
    Stop,
    stop_in_motion,
)

TRIALS = 50  # of each fault
MODEL = 'XM430-W350'  # which has to stop in time
STOPS = {MODEL: (1000, FASTEST), 'XL330-M288': (200, FASTEST), 'XC330-T288': (200, FASTEST),
         'XM540-W270': (200, 0.018)}
"""By model, how often it is stopped, and how fast its tendons are moved at most, m/s."""
KILLS = 50
SPEED_MARGIN = 1.1  # of speed_limit over the speed of motions that are stopped
ATTEMPTS = 20  # to connect
MAX_RUN_ON = 1.0  # s that servos may go on after the death of a program


@dataclass
class Outcomes:
    """What followed a fault."""

    each: list[Outcome] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)


def run(share: float) -> Report:
    """Do ``share`` of all trials."""
    faults, wrong = _faults(max(2, round(share * TRIALS)))
    stops, late = _stops(share)
    kills, unsafe = _kills(max(2, round(share * KILLS)))
    return Report('\n\n'.join([faults, stops, kills]), (*wrong, *late, *unsafe))


def _faults(trials: int) -> tuple[str, list[str]]:
    """Try each fault, at rest and in motion."""
    found = {fault.name: Outcomes() for fault in FAULTS}
    for seed, moving in zip(range(trials), cycle((True, False)), strict=False):
        progress(f'{trials - seed} trials of each fault left')
        for fault in FAULTS:
            with TemporaryDirectory() as folder:
                try:
                    found[fault.name].each.append(trial(Path(folder), fault, seed, moving))
                except (WrongStateError, HardwareError) as error:
                    found[fault.name].wrong.append(f'{fault.name}, trial {seed}: {error}')
                    progress(found[fault.name].wrong[-1])
    return _of_faults(found, trials), [text for each in found.values() for text in each.wrong]


def _of_faults(found: dict[str, Outcomes], trials: int) -> str:
    rows = []
    for name, outcomes in found.items():
        noticed = [outcome for outcome in outcomes.each if outcome.noticed]
        median, _, longest = spread([outcome.noticed_after for outcome in noticed])
        ran_on = max((1e3 * outcome.ran_on for outcome in noticed), default=0.0)
        unknown = sum(not outcome.known for outcome in outcomes.each)
        rows.append((name, str(len(noticed)), median, longest, f'{ran_on:.1f}', str(unknown)))
    head = ('fault', 'reported, motion ended', 'after, ms: median', 'longest',
            'tendon went on, mm', 'position declared unknown')
    wrong = sum(len(outcomes.wrong) for outcomes in found.values())
    return (f'{trials} trials of each fault led to {wrong or "no"} wrong states.\n\n'
            f'{table(head, rows)}')


def _stops(share: float) -> tuple[str, list[str]]:
    """Stop servos at random moments of a motion: how long until the last spool rests."""
    rows, late, moved = [], [], 0.0
    for model, (count, fastest) in STOPS.items():
        with TemporaryDirectory() as folder, rig(
                Path(folder), BEYOND_TURN, model=model,
                speed_limit=min(SPEED, SPEED_MARGIN * fastest)) as made:
            stops = _stop(made, max(2, round(share * count)), fastest)
        median, percentile, longest = spread([stop.slow for stop in stops])
        rows.append((model, str(len(stops)), f'8 to {1e3 * fastest:g}', median, percentile,
                     longest))
        if model != MODEL:
            continue
        moved = max(stop.moved for stop in stops)
        if float(median) > 1e3 * MEDIAN_STOP_TIME or float(longest) > 1e3 * MAX_STOP_TIME:
            late.append(f'stops took {median} ms (median) and {longest} ms (longest)')
    head = ('model', 'stops', 'at, mm/s', 'ms: median', '99 %', 'longest')
    return (f'Stops, until every tendon stays slower than {1e3 * REST_SPEED:g} mm/s and within '
            f'{1e3 * REST_DISTANCE:g} mm of rest (allowed for {MODEL}: median '
            f'{1e3 * MEDIAN_STOP_TIME:.0f} ms, longest {1e3 * MAX_STOP_TIME:.0f} ms). In '
            f'the half second after, its tendons moved by {1e3 * moved:.2f} mm.\n\n'
            f'{table(head, rows)}'), late


def _stop(made: ServoRig, trials: int, fastest: float) -> list[Stop]:
    random, stops = Random(1), list[Stop]()
    while len(stops) < trials:
        if len(stops) % 100 == 0:
            progress(f'{trials - len(stops)} stops left')
        if (stop := stop_in_motion(made, random, fastest)) is not None:
            stops.append(stop)
    return stops


def _kills(trials: int) -> tuple[str, list[str]]:
    """Kill a program that drives servos, start another one, in real time."""
    random, ceased, unsafe = Random(1), list[float](), []
    with TemporaryDirectory() as folder, servos(link=Path(folder) / 'port', clock=STEADY
                                                ) as emulator:
        def driver() -> DynamixelTendons:
            return DynamixelTendons(emulator.port, 1000000, spools(pull_limits=BEYOND_TURN),
                                    Path(folder) / 'zeros.json')

        tendons = driver()
        _open(tendons)
        tendons.reference()
        time.sleep(0.3)
        made = ServoRig(emulator, tendons, emulator.pulls, deque())
        for n in range(trials):
            tendons.close()
            child = os.fork()
            if child == 0:
                _drive(driver(), Random(n))
            deadline = time.monotonic() + 20.0
            while not emulator.moving and time.monotonic() < deadline:
                time.sleep(0.005)
            time.sleep(random.uniform(0.0, 0.5))
            os.kill(child, signal.SIGKILL)
            died = time.monotonic()
            os.waitpid(child, 0)
            ceased.append(max(0.0, made.rest() - died))
            _open(tendons)
            made.seen.clear()
            try:
                if not made.check():
                    unsafe.append(f'kill {n}: the position is unknown')
            except WrongStateError as error:
                unsafe.append(f'kill {n}: {error}')
        tendons.close()
    median, _, longest = spread(ceased)
    if max(ceased) > MAX_RUN_ON:
        unsafe.append(f'servos moved for {longest} ms after a kill')
    return (f'{len(ceased)} programs killed (SIGKILL) in motion and started again: at rest after '
            f'{median} ms (median), at most {longest} ms (allowed: {1e3 * MAX_RUN_ON:.0f} ms). '
            f'Positions then known and true: {trials - len(unsafe)} of {trials}.'), unsafe


def _open(driver: DynamixelTendons) -> None:
    """Connect, as a node does: again after an error, which a busy computer may give."""
    for _ in range(ATTEMPTS):
        try:
            return driver.open()
        except HardwareError as error:
            progress(f'opened again: {error}')
            time.sleep(0.5)
    return driver.open()


def _drive(driver: DynamixelTendons, random: Random) -> None:
    """Move to and fro until the process is killed."""
    try:
        _open(driver)
        while True:
            begin, goal = driver.read().pulls, somewhere(random, len(TENDONS))
            for step in range(1, 51):
                driver.move(tuple(a + step / 50 * (b - a)
                                  for a, b in zip(begin, goal, strict=True)), 0.02)
                time.sleep(0.02)
    finally:
        os._exit(1)
