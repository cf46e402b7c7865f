# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How well the shape is estimated with each kind of sensor, how honestly, and how fast."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
import time
from typing import Any

import cv2
import numpy as np
from scipy.stats import chi2

from benchmarks.lab import Description, Lab
from benchmarks.loop import ANGLE
from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import progress
from soft_continuum.estimation.measuring import ActuatorState, DiscMeasurement, Measurement
from soft_continuum.estimation.sensing.imus import ImuSample, MountedImus
from soft_continuum.estimation.sensing.tare import SensorError
from soft_continuum.estimation.shape import ArmShape, ShapeError
from soft_continuum.estimation.unknowns import estimation_from_parameters
from soft_continuum.mechanics import StaticsError
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.rotations import displacement, IDENTITY
from soft_continuum.nodes.kinematics import MeasuredTensions
from soft_continuum.planning.planner import Planner
from soft_continuum.planning.plans import PlanError, Shape, ShapePlan
from soft_continuum.planning.shape_plans import plans_to
from soft_continuum.ros.description import load_description
from soft_continuum.sim.twin.model_errors import ModelErrors, read_model_errors
from soft_continuum.user_files import description_file

PRESETS = ('typical', 'severe')
SEEDS = 10
SHAPES = 2  # one after the other
SETTLING, HOLDING = 1.0, 2.0  # s after each motion, and until a shape is judged
TICK_STEPS = 10  # time steps of the plant between two tendon_states: 20 ms
PICTURE_TICKS, IMU_TICKS = 10, 5  # between two pictures, and two angles that are used
CAMERA, IMUS, TENSIONS = 'camera', 'IMUs', 'load cells'
CONTENDERS: dict[str, tuple[str, ...]] = {
    'none (prediction)': (), CAMERA: (CAMERA,), IMUS: (IMUS,), TENSIONS: (TENSIONS,),
    f'{CAMERA} and {TENSIONS}': (CAMERA, TENSIONS), f'{IMUS} and {TENSIONS}': (IMUS, TENSIONS)}
HEAD = ('error of the tip, mm: median', '95 %', 'worst', 'NEES',
        'error of the stiffness, %: median', '95 %')


@dataclass(frozen=True, eq=False)
class Tick:
    """What nodes and sensors say at one time; truth: bottom and top of the discs, (8, 3)."""

    commands: ActuatorState
    measured: Mapping[str, Sequence[Measurement]]
    truth: Array
    judged: bool


class RecordedLab(Lab):
    """A rig of which every 20 ms are recorded."""

    def __init__(self, description: Description, given: ModelErrors) -> None:
        """Begin to record as soon as it rests."""
        self.ticks: list[Tick] = []
        self._recording = False
        super().__init__(description, given)
        values: dict[str, Any] = dict(load_description(description_file(), node='disc_sensors'))
        arm = description.arm
        self._imus = MountedImus.of(values, arm)
        self._tilted: dict[int, Array] = {}  # poses
        self._cells = MeasuredTensions(
            arm.tendon_names, load_description(description_file(), node='kinematics'))
        self._sliding = np.zeros(2, dtype=int)
        self._recording = True
        self.wait(1.0)
        for n, pose in self._tilted.items():  # as ~/tare does, but for the mean
            self._imus.mounts[n] = displacement(pose, np.array(IDENTITY))[3:]
        self.ticks.clear()
        self.wait(1.0)

    def advance(self, pulls: Array) -> None:
        """Let one time step pass for each of pulls (steps, 2), m, and record."""
        if not self._recording:
            super().advance(pulls)
            return
        for begin in range(0, len(pulls), TICK_STEPS):
            before = self.pulls
            super().advance(pulls[begin:begin + TICK_STEPS])
            change = self.pulls - before
            self._sliding = np.where(np.abs(change) > 1e-9, np.sign(change), self._sliding)
            self._record()

    def _record(self) -> None:
        names, tilts, none = self.description.arm.tendon_names, [], np.zeros(3)
        for n, motion in enumerate(self.sensors.motions()):
            with suppress(SensorError):  # as in disc_sensors, which reports it and goes on
                found = self._imus.measure(n, ImuSample(
                    self.time, tuple(motion[3:].tolist()), motion[:3]), none, none, self.time)
                if found is not None:
                    self._tilted[n] = found[0]
                    tilts += [DiscMeasurement(n, *found)] if n > 0 else []
        self._cells.put(self.time, dict(zip(names, self.load_cells().tolist(), strict=True)))
        measured: dict[str, Sequence[Measurement]] = {
            TENSIONS: [one for _, each in self._cells.take() for one in each]}
        if len(self.ticks) % IMU_TICKS == 0:
            measured[IMUS] = tilts
        if len(self.ticks) % PICTURE_TICKS == 0:
            measured[CAMERA] = [seen for n, seen in self.look().items() if n > 0]
        self.ticks.append(Tick(
            ActuatorState(self.time, self.pulls.copy(), self.stiff, None,
                          tuple(int(one) for one in self._sliding)),
            measured, self.truth, False))

    def judge(self) -> None:
        """Judge the estimates as they are now."""
        self.ticks[-1] = replace(self.ticks[-1], judged=True)


@dataclass(frozen=True)
class Judged:
    """
    An estimate against the truth.

    tip: m.  nees: squared error of the last disc's pose over its covariance, nan for the
    prediction.  stiffness: relative errors of the segments' factors.
    """

    tip: float
    nees: float
    stiffness: tuple[float, ...]


def run(quick: bool) -> Section:
    """Measure; the section is of the page about estimation."""
    cv2.setNumThreads(1)
    description = Description.read()
    seeds, shapes, parts = range(1 if quick else SEEDS), 1 if quick else SHAPES, []
    costs: list[tuple[float, float]] = []
    for preset in PRESETS[:1] if quick else PRESETS:
        given = read_model_errors(description_file().with_name('twin.yaml'), preset)
        results: dict[str, list[list[Judged]]] = {name: [] for name in CONTENDERS}
        for seed in seeds:
            ticks = recorded(description, replace(given, seed=seed), shapes)
            for name, sensors in CONTENDERS.items():
                results[name].append(replayed(description, given, ticks, sensors, costs))
            progress(f'estimate: {preset}, seed {seed}, tip: ' + '; '.join(
                f'{name} {" ".join(f"{one.tip * 1e3:.2f}" for one in each[-1])} mm'
                for name, each in results.items()))
        parts.append(table((f'`{preset}`: sensors', *HEAD), [
            _row(name, each) for name, each in results.items()]))
    low, high = (chi2.ppf(p, 3 * len(seeds)) / len(seeds) for p in (0.025, 0.975))
    measures, follows = np.array(costs).T * 1e3
    body = '\n\n'.join([
        f'Simulated: {len(seeds)} rigs of each preset, each set to {shapes} random shapes of up '
        f'to {np.degrees(ANGLE):.0f}° per segment in open loop, and judged after {HOLDING:g} s at '
        'rest. Camera 5 Hz, IMUs and load cells 10 Hz. NEES is the mean of the last disc: a '
        'consistent covariance gives 3 on average, and 95 % of such means lie between '
        f'{low:.1f} and {high:.1f}. ' + machine(), *parts,
        f'Processor time: a measurement of three discs takes {np.nanmedian(measures):.2f} ms '
        f'(median; 99 %: {np.nanquantile(measures, 0.99):.2f} ms), following the tendons '
        f'{np.nanmedian(follows):.2f} ms ({np.nanquantile(follows, 0.99):.2f} ms).'])
    return Section('benchmarks/estimation.md', 'estimate', body)


def recorded(description: Description, given: ModelErrors, shapes: int) -> Sequence[Tick]:
    """Set a rig to random shapes, and return what happened."""
    lab = RecordedLab(description, given)
    for plan in _plans(description, given.seed, shapes):
        for move in plan.moves:
            lab.switch(move.segment, False)
            lab.follow(move.times, move.pulls + lab.pulls - move.pulls[0])
            lab.wait(SETTLING)
            lab.switch(move.segment, True)
        lab.wait(HOLDING)
        lab.judge()
    return lab.ticks


def _plans(description: Description, seed: int, shapes: int) -> Sequence[ShapePlan]:
    random = np.random.default_rng([seed, 15])
    planner = Planner(description.arm, description.settings)
    while True:
        angles = random.uniform(-ANGLE, ANGLE, (shapes, len(description.arm.segments)))
        try:
            return plans_to(planner, [
                Shape(f'shape {n}', tuple(each.tolist())) for n, each in enumerate(angles)])
        except PlanError:
            continue


def replayed(description: Description, given: ModelErrors, ticks: Sequence[Tick],
             sensors: Sequence[str], costs: list[tuple[float, float]]) -> list[Judged]:
    """Let an estimate follow a recording with some of its sensors; costs: s of each step."""
    settings = estimation_from_parameters(load_description(description_file(), node='kinematics'))
    shape, found = ArmShape(description.arm, 5e-4, settings), []
    for tick in ticks:
        begin = time.thread_time()
        with suppress(ShapeError, StaticsError):  # kinematics reports it and goes on
            shape.follow(tick.commands)
        followed = time.thread_time()
        for sensor in sensors:
            measured = tick.measured.get(sensor)
            if not measured:
                continue
            try:
                used = shape.measure(tick.commands.time, measured)
            except StaticsError:
                continue
            if sensors == (CAMERA,) and used is not None and len(used.values) == 9:
                costs.append((time.thread_time() - followed, followed - begin))
        if tick.judged:
            found.append(_judged(shape, given, tick.truth))
    return found


def _judged(shape: ArmShape, given: ModelErrors, truth: Array) -> Judged:
    assert shape.state is not None
    tip = float(np.linalg.norm(shape.state.backbone[-1] - truth[-1, :3]))
    estimate = shape.estimate
    if estimate is None:
        return Judged(tip, np.nan, ())
    axes = estimate.arm.pose_axes
    away = displacement(shape.state.poses[-2], truth[-2])[axes]
    factors = np.exp(estimate.values[estimate.layout.stiffness])
    covariance = estimate.pose_covariances()[-1][np.ix_(axes, axes)]
    return Judged(tip, float(away @ np.linalg.solve(covariance, away)),
                  tuple((factors / given.stiffness_factors - 1.0).tolist()))


def _row(name: str, runs: Sequence[Sequence[Judged]]) -> tuple[str, ...]:
    tips = np.array([one.tip for each in runs for one in each])
    spread = np.array([np.median(tips), np.quantile(tips, 0.95), tips.max()])
    nees = np.mean([each[-1].nees for each in runs])
    off = np.abs([error for each in runs for error in each[-1].stiffness]) * 100.0
    return (name, *(number(value) for value in spread * 1e3),
            *((number(float(nees)), number(float(np.median(off))),
               number(float(np.quantile(off, 0.95)))) if off.size else ('-',) * 3))
