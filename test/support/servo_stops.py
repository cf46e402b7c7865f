# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Stops of a driver on emulated Dynamixel servos: how long until every tendon rests."""

from dataclasses import dataclass
from random import Random

from soft_continuum.sim.emulators.dynamixel import DynamixelEmulator
from support.servo_rig import ServoRig, somewhere, WrongStateError

MAX_STOP_TIME, MEDIAN_STOP_TIME = 0.15, 0.1  # s
REST_SPEED, REST_DISTANCE = 5e-4, 1e-4  # m/s, m: as the driver confirms a stop, and arrives
SLOWEST, FASTEST = 0.008, 0.028  # m/s
STOP_STEP, STANDING_TIME, MAX_WATCH = 0.002, 0.1, 20.0  # s


@dataclass(frozen=True)
class Rest:
    """
    How long it took until spools came to rest, s.

    slow: until every spool stays below REST_SPEED and within REST_DISTANCE of where it rests.
    pulls: where they rest, m since the beginning.
    """

    slow: float
    pulls: tuple[float, ...]


@dataclass(frozen=True)
class Stop(Rest):
    """How long a stop took; moved: m by which a tendon is elsewhere 0.5 s later."""

    moved: float


def stop_in_motion(made: ServoRig, random: Random, fastest: float = FASTEST) -> Stop | None:
    """
    Stop a motion; return how long that took, or None if it had ended before.

    fastest: speed that the motion may have, m/s.
    """
    driver, emulator = made.driver, made.emulator
    clock, speed = emulator.clock, random.uniform(SLOWEST, fastest)
    begin, goal = driver.read().pulls, somewhere(random, len(emulator.servos))
    duration = max(abs(a - b) for a, b in zip(begin, goal, strict=True)) / speed
    start = clock()
    end = start + min(random.uniform(0.1, 0.8), 0.9 * duration)
    while clock() < end:
        part = (clock() - start + 0.02) / duration
        driver.move(tuple(a + part * (b - a) for a, b in zip(begin, goal, strict=True)), 0.02)
        clock.sleep(0.02)
        made.check()
    clock.sleep(random.uniform(0.0, 0.02))
    if not emulator.moving:
        return None
    requested = clock()
    driver.stop()
    rest = watch_rest(emulator, requested)
    made.wait(0.5 - STANDING_TIME)
    made.rest()
    moved = max(abs(a - b) for a, b in zip(emulator.pulls, rest.pulls, strict=True))
    made.check()
    return Stop(**vars(rest), moved=moved)


def watch_rest(emulator: DynamixelEmulator, since: float) -> Rest:
    """Return how long after ``since`` (s), which was just now, spools rest that turn."""
    clock, times, pulls, speeds = emulator.clock, [], [], []

    def seen() -> tuple[tuple[float, ...], float]:
        motors = [servo.motor for servo in emulator.servos]
        return (tuple(motor.pull for motor in motors),
                max(abs(motor.speed) * motor.tendon.radius for motor in motors))

    standing = since
    while clock() - standing < STANDING_TIME:
        clock.sleep(STOP_STEP)
        at, speed = emulator.read(seen)
        times.append(clock())
        pulls.append(at)
        speeds.append(speed)
        if speed:
            standing = clock()
        if clock() - since > MAX_WATCH:
            raise WrongStateError(f'the spools never rest: {speed} m/s')

    def moves(i: int) -> bool:
        away = max(abs(a - b) for a, b in zip(pulls[i], pulls[-1], strict=True))
        return away > REST_DISTANCE or speeds[i] > REST_SPEED

    return Rest(max((time - since for i, time in enumerate(times) if moves(i)), default=0.0),
                pulls[-1])
