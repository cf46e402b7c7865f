# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How well IMUs alone tell the shape of an arm in space, upright and tilted."""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from benchmarks.contenders import Goal, open_loop
from benchmarks.lab import Description, Lab, NOTHING
from benchmarks.loop import HOLDING, random_goal
from benchmarks.spatial_loop import ARM
from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import progress
from soft_continuum.estimation.measuring import ActuatorState, DiscMeasurement
from soft_continuum.estimation.sensing.imus import ImuSample, MountedImus
from soft_continuum.estimation.sensing.tare import SensorError
from soft_continuum.estimation.shape import ArmShape, ShapeError
from soft_continuum.mechanics import StaticsError
from soft_continuum.mechanics.arm import Array
from soft_continuum.ros.description import load_description
from soft_continuum.sim.twin.model_errors import ModelErrors, read_model_errors
from soft_continuum.sim.twin.plant import TIME_STEP
from soft_continuum.user_files import description_file

PRESETS = ('typical', 'severe')
SEEDS = 5
MOUNTINGS = {'upright': 0.0, 'tilted by 45°': np.pi / 4.0, 'lying': np.pi / 2.0}  # about y
TICK, IMU_TICKS = 0.02, 5  # s; from one measurement to the next
TICK_STEPS = round(TICK / TIME_STEP)
HEAD = ('median error of the tip, mm', 'predicted', 'with IMUs', 'better with IMUs')


class TiltedLab(Lab):
    """A rig whose estimate follows it by its IMUs alone."""

    def __init__(self, description: Description, given: ModelErrors) -> None:
        """Begin straight, and tare the IMUs there."""
        self._following = False
        super().__init__(description, given, NOTHING)
        arm = description.arm
        values = load_description(description_file().with_name(ARM), node='disc_sensors')
        self._imus, self._ticks = MountedImus.of(values, arm), 0
        self.shape = ArmShape(arm, 5e-4)
        self._following = True
        self.wait(1.2)
        for n in range(len(arm.discs)):
            with suppress(SensorError):  # of a bias beyond 10 % of g most samples are refused
                if (mount := self._imus.straight(n, self.time)) is not None:
                    self._imus.mounts[n] = mount
        self.shape.set_straight()

    def advance(self, pulls: Array) -> None:
        """Let one time step pass for each of pulls (steps, tendons), m."""
        if not self._following:
            super().advance(pulls)
            return
        for begin in range(0, len(pulls), TICK_STEPS):
            super().advance(pulls[begin:begin + TICK_STEPS])
            self._follow()

    def _follow(self) -> None:
        with suppress(ShapeError, StaticsError):  # kinematics reports it and goes on
            self.shape.follow(ActuatorState(self.time, self.pulls.copy(), self.stiff, None,
                                            (0,) * len(self.pulls)))
        seen, none = [], np.zeros(3)
        for n, motion in enumerate(self.sensors.motions()):
            with suppress(SensorError):
                found = self._imus.measure(n, ImuSample(
                    self.time, tuple(motion[3:].tolist()), motion[:3]), none, none, self.time)
                if found is not None and n > 0:
                    seen.append(DiscMeasurement(n, *found))
        self._ticks += 1
        if seen and self._ticks % IMU_TICKS == 0:
            with suppress(StaticsError):
                self.shape.measure(self.time, seen)


def run(quick: bool) -> Section:
    """Measure; the section is of the page about estimation."""
    described, rows = Description.read(description_file().with_name(ARM)), []
    seeds = range(1 if quick else SEEDS)
    for name, mounting in MOUNTINGS.items():
        gravity = 9.80665 * np.array([np.sin(mounting), 0.0, -np.cos(mounting)])
        description = replace(described, arm=replace(
            described.arm, gravity=tuple(gravity.tolist())))
        for preset in PRESETS:
            given = read_model_errors(description_file().with_name('twin.yaml'), preset)
            errors = np.array([_errors(description, replace(given, seed=seed))
                               for seed in seeds]) * 1e3
            better = np.count_nonzero(errors[:, 1] < errors[:, 0])
            rows.append((f'{name}, `{preset}`', *(
                number(float(v)) for v in np.median(errors, axis=0)),
                f'{better} of {len(errors)}'))
    body = '\n\n'.join([
        f'Simulated: rigs of `config/{ARM}`, each set to a random shape of up to 34° per segment '
        f'in open loop, and judged after {HOLDING:g} s at rest. IMUs: 10 Hz. ' + machine(),
        table(HEAD, rows)])
    return Section('benchmarks/estimation.md', 'spatial_imus', body)


def _errors(description: Description, given: ModelErrors) -> tuple[float, float]:
    """Return by how much the tips of prediction and estimate are off, m."""
    goal: Goal = random_goal(description, given.seed)
    lab = TiltedLab(description, given)
    open_loop(lab, goal, description.arm)
    lab.wait(HOLDING)
    tips = [np.linalg.norm(state.backbone[-1] - lab.tip[:3])
            for state in (lab.shape.predicted, lab.shape.state)]
    progress(f'spatial_imus: seed {given.seed}: prediction {tips[0] * 1e3:.2f} mm, '
             f'IMUs {tips[1] * 1e3:.2f} mm')
    return float(tips[0]), float(tips[1])
