# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A servo in a closed loop with a plant that is not its model; time is simulated.

Between them are the controller and the simulated steppers of tendon_actuation.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import exp
from typing import Protocol

import numpy as np

from benchmarks.paper import only
from soft_continuum.hardware.simulated_tendons import SimulatedTendons
from soft_continuum.hardware.tendon_controller import TendonController, TendonLimits
from soft_continuum.mechanics import (
    Arm,
    Equilibrium,
    Statics,
    StaticsError,
)
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.plane.chain import PlaneChain
from soft_continuum.sequencing.servo import AngleServo, ServoSettings
from soft_continuum.sim.twin.model_errors import ModelErrors
from soft_continuum.sim.twin.plant import Plant, TIME_STEP

CONTROL_PERIOD = 0.02  # s, of tendon_actuation
LATENCY = 0.01  # s from the servo to tendon_actuation, and from the target to the servo
TARGET_PERIOD = 0.05  # s between two targets
MEASURING_PERIOD = 1.0 / 15.0  # s between two pictures of a camera
SOFTENING = 1.0  # s


class Simulated(Protocol):
    """An arm of which one segment is soft."""

    @property
    def joint_angles(self) -> Array:
        """Joint angles (joints,), rad."""

    def pull(self, pulls: Array, duration: float) -> None:
        """Let the tendons go to ``pulls`` (m) in ``duration`` s."""


class StaticPlant:
    """
    Another Statics: pulls through a friction dead band, and the shape with a first-order lag.

    arm: of the plant.  dead_band: m of pull.  lag: s.
    """

    def __init__(self, arm: Arm, segment: int, dead_band: float, lag: float) -> None:
        """Begin straight."""
        self._statics, self._soft = Statics(arm), only(segment, len(arm.segments))
        self._dead_band, self._lag = dead_band, lag
        self._state = self._statics.chain.straight()
        self._pulls = np.zeros(2)
        self.joint_angles = self._state.joint_angles
        self.unsolved = 0
        """How often the tendons were too short for any shape: a real one would stretch."""

    def pull(self, pulls: Array, duration: float) -> None:
        """Let the tendons go to ``pulls`` (m) in ``duration`` s."""
        self._pulls = np.clip(self._pulls, pulls - self._dead_band, pulls + self._dead_band)
        try:
            self._state = self._statics.solve(self._state, self._pulls, self._soft)
        except StaticsError:
            self.unsolved += 1
        away = self._state.joint_angles - self.joint_angles
        self.joint_angles = self.joint_angles + away * (1.0 - exp(-duration / self._lag))


class TwinPlant:
    """The MuJoCo twin, with one segment that was softened."""

    def __init__(self, arm: Arm, given: ModelErrors, segment: int) -> None:
        """Soften the segment and wait."""
        self._plant = Plant(arm, given)
        self._pulls = np.zeros(2)
        stiff = np.ones(len(arm.segments))
        self._vacuum = stiff
        self.pull(self._pulls, SOFTENING)
        self._vacuum = 1.0 - np.array(only(segment, len(arm.segments)), dtype=float)
        self.pull(self._pulls, SOFTENING)

    @property
    def joint_angles(self) -> Array:
        """Joint angles (joints,), rad."""
        return self._plant.joint_angles

    def pull(self, pulls: Array, duration: float) -> None:
        """Let the tendons go to ``pulls`` (m) in ``duration`` s."""
        steps = round(duration / TIME_STEP)
        for i in range(steps):
            self._plant.step(self._pulls + (i + 1) / steps * (pulls - self._pulls), self._vacuum)
        self._pulls = np.array(pulls)


@dataclass(frozen=True)
class Measuring:
    """
    How the arm is measured.

    delay: s.  stamp_error: s of that delay of which the stamp does not tell.  deviation: rad, of
    the bending angle of each segment.  period: s.
    """

    delay: float = 0.1
    stamp_error: float = 0.0
    stddev: float = 0.0
    period: float = MEASURING_PERIOD


@dataclass(frozen=True, eq=False)
class Record:
    """Times (k,) s, targets and true bending angles (k,) rad, pulls (k, tendons) m."""

    times: Array
    targets: Array
    angles: Array
    pulls: Array

    def error(self, after: float) -> Array:
        """Return target less angle, from ``after`` s on, rad."""
        errors: Array = (self.targets - self.angles)[self.times >= after]
        return errors


def follow(arm: Arm, plant: Simulated, segment: int, target: Callable[[float], float],
           duration: float, measuring: Measuring | None, settings: ServoSettings) -> Record:
    """
    Follow ``target`` (rad, of the time in s) for ``duration`` s.

    arm: the model of the servo.  measuring: None for an arm that is only predicted.  Raises
    MotionRefusedError when a piece is not one that tendon_actuation would follow.
    """
    chain, now = PlaneChain(arm), 0.0
    tendons = TendonController(
        SimulatedTendons(lambda: now, arm.tendon_names, 0.03, 0.3, 5e-6),
        TendonLimits(arm.tendon_names, settings.limits.pull_limits, 0.03))
    random = np.random.default_rng(1)
    past: list[tuple[float, Array]] = [(0.0, plant.joint_angles)]
    stiff = tuple(not soft for soft in only(segment, len(arm.segments)))

    def state(joint_angles: Array) -> Equilibrium:
        return replace(chain.state(joint_angles), stiff=stiff)

    servo = AngleServo(Statics(arm), settings, state(
        plant.joint_angles if measuring else np.zeros(chain.bodies)), segment)
    next_target = next_piece = next_picture = 0.0
    pieces: list[tuple[float, Array, Array]] = []
    rows = []
    for step in range(round(duration / CONTROL_PERIOD)):
        now = step * CONTROL_PERIOD
        if now >= next_target:
            servo.set_angle(target(now - LATENCY), now)
            next_target += TARGET_PERIOD
        if measuring is not None and now >= next_picture:
            next_picture += measuring.period
            taken = max(0.0, now - measuring.delay)
            seen = next(angles for time, angles in reversed(past) if time <= taken + 1e-9)
            noise = random.normal(0.0, measuring.stddev / chain.joints_per_segment**0.5,
                                  chain.bodies)
            stamp = taken + measuring.stamp_error
            servo.observe(state(seen + noise), stamp, stamp, now)
        for sent, times, pulls in [piece for piece in pieces if piece[0] <= now]:
            tendons.accept(times, pulls, now, sent)
        pieces = [piece for piece in pieces if piece[0] > now]
        if now >= next_piece:
            next_piece += settings.period
            piece = servo.advance(now, np.array(tendons.reading.pulls))
            if piece is not None:
                pieces.append((now + LATENCY, piece.start + piece.times, piece.pulls))
        reading = tendons.update(now, CONTROL_PERIOD)
        rows.append((now, target(now), float(
            chain.bending_angles(plant.joint_angles)[segment]), *reading.pulls))
        plant.pull(np.array(reading.pulls), CONTROL_PERIOD)
        past.append((now + CONTROL_PERIOD, plant.joint_angles))
        past = past[-200:]
    table = np.array(rows)
    return Record(table[:, 0], table[:, 1], table[:, 2], table[:, 3:])
