# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the drivers of four tendons cost: Dynamixel servos and GRBL boards, in turns."""

from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
from math import pi, sin
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory
import time

import numpy as np

from benchmarks.tables import machine, Section
from benchmarks.timing import progress
from soft_continuum.hardware.dynamixel.setup import Spools
from soft_continuum.hardware.dynamixel.tendons import DynamixelTendons
from soft_continuum.hardware.grbl.motion import Motors
from soft_continuum.hardware.grbl.tendons import GrblBoards, GrblTendons
from soft_continuum.hardware.protocols import HardwareError, TendonDriver
from soft_continuum.sim.emulators.dynamixel import BAUD_RATE, SPOOL_RADIUS
from soft_continuum.sim.emulators.grbl import STEPS_PER_MM
from soft_continuum.sim.emulators.tendon_motors import board_links

TENDONS = 'first', 'second', 'third', 'fourth'
RATE = 100.0  # Hz at which tendons are sent set-points and read
AMPLITUDE, PERIOD = 0.008, 3.0  # m, s
LIMITS = -0.06, 0.06  # m
SPEED, ACCELERATION = 0.03, 0.3  # m/s, m/s^2
ROUND = 5.0  # s
ROUNDS = 6
START_TIMEOUT = 60.0  # s
ATTEMPTS = 10  # of a round


def run(quick: bool) -> Section:
    """Measure the drivers in turns; the emulators are other processes."""
    rounds = 1 if quick else ROUNDS
    costs: dict[str, list[float]] = {'dynamixel': [], 'grbl': []}
    with ExitStack() as running:
        folder = Path(running.enter_context(TemporaryDirectory()))
        drivers: dict[str, TendonDriver] = {
            'dynamixel': running.enter_context(_dynamixel(folder)),
            'grbl': running.enter_context(_grbl(folder))}
        for number_of_round in range(rounds):
            for name, driver in drivers.items():
                progress(f'drivers: {name}, round {number_of_round + 1} of {rounds}')
                costs[name].append(_round(driver))
    shares = {name: f'{np.median(each):.1%}' for name, each in costs.items()}
    return Section('benchmarks/performance.md', 'drivers', (
        f'Dynamixel, one sync write and one sync read of 4 servos at {RATE:g} Hz: '
        f'{shares["dynamixel"]} of a core (median). GRBL, two boards, four axes, as fast as they '
        f'take jogs: {shares["grbl"]}. {machine()}'))


def _round(driver: TendonDriver) -> float:
    """Return the share of a round, again after an error: a busy computer delays emulators."""
    for _ in range(ATTEMPTS):
        try:
            driver.open()
            driver.reference()
            time.sleep(0.3)
            return _share(driver)
        except HardwareError as error:
            progress(f'drivers: {error}')
        finally:
            driver.close()
    raise RuntimeError(f'no round of {ATTEMPTS} without an error; the computer is too busy')


def _share(driver: TendonDriver) -> float:
    """Let all tendons swing, read as often; return processor time over time."""
    begin, spent = time.monotonic(), time.process_time()
    due = begin
    while (now := time.monotonic()) < begin + ROUND:
        pull = AMPLITUDE * sin(2.0 * pi * (now - begin) / PERIOD)
        driver.move((pull, -pull, pull, -pull), 1.0 / RATE)
        driver.read()
        due = max(due + 1.0 / RATE, now)
        time.sleep(max(0.0, due - time.monotonic()))
    elapsed = time.monotonic() - begin
    spent = time.process_time() - spent
    driver.stop()
    while driver.read().moving:
        time.sleep(0.05)
    return spent / elapsed


@contextmanager
def _emulator(*arguments: str) -> Iterator[None]:
    process = subprocess.Popen(
        [sys.executable, '-m', 'soft_continuum', 'emulate', *arguments], stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL)
    try:
        link = Path(arguments[arguments.index('--link') + 1])
        deadline = time.monotonic() + START_TIMEOUT
        while not link.is_symlink() and time.monotonic() < deadline:
            time.sleep(0.1)
        yield
    finally:
        process.kill()
        process.wait()


@contextmanager
def _dynamixel(folder: Path) -> Iterator[DynamixelTendons]:
    link, count = folder / 'dynamixel', len(TENDONS)
    with _emulator('dynamixel', '--tendons', str(count), '--link', str(link)):
        yield DynamixelTendons(str(link), BAUD_RATE, Spools(
            TENDONS, tuple(range(1, count + 1)), (SPOOL_RADIUS,) * count, (1.0,) * count,
            (60.0,) * count, (0.0,) * count, SPEED, ACCELERATION, LIMITS), folder / 'zeros.json')


@contextmanager
def _grbl(folder: Path) -> Iterator[GrblBoards]:
    boards = []
    with ExitStack() as running:
        for n, link in enumerate(board_links(folder / 'grbl', len(TENDONS))):
            running.enter_context(_emulator('grbl', '--link', link))
            tendons = TENDONS[2 * n:2 * n + 2]
            boards.append(GrblTendons(link, 115200, Motors(
                tendons=tendons, steps_per_mm=(float(STEPS_PER_MM),) * 2, signs=(1.0, 1.0),
                speed_limit=SPEED, acceleration_limit=ACCELERATION, pull_limits=LIMITS)))
        yield GrblBoards(boards)
