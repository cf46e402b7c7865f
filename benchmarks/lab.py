# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A simulated rig without ROS: the twin's plant, driven in simulated time as the nodes drive a rig.

The jams follow the suite's own control of valves and pump; the discs are measured in pictures of
the twin's cameras; the truth is what the plant knows.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.sight import Sight
from soft_continuum.estimation.measuring import DiscMeasurement
from soft_continuum.estimation.sensing.layout import layout_of
from soft_continuum.hardware.jamming_controller import JammingController, JammingSettings
from soft_continuum.hardware.simulated_jamming import JammingPlant, SimulatedJamming
from soft_continuum.mechanics import Arm
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.rotations import (
    bending_between,
    matrices,
    mean_pose,
    planar_pose,
    UNKNOWN,
)
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.planning.planner import PlanSettings
from soft_continuum.ros.description import load_description
from soft_continuum.ros.parameter_table import jamming_settings
from soft_continuum.sim.twin.model_errors import ModelErrors
from soft_continuum.sim.twin.plant import Plant, Sensors, TIME_STEP
from soft_continuum.user_files import description_file

CAMERA, TWO_CAMERAS, TRUTH, NOTHING = 'camera', 'two cameras', 'truth', 'none'
"""What measures the discs."""
PICTURE_PERIOD = 0.2  # s
TRIES = 10  # pictures until all discs that move were seen in one
TARE_PICTURES = 6  # within a second, as the camera node averages them
TRUTH_DEVIATION = 1e-6  # m and rad
VACUUM_STEPS = 5  # time steps between two looks at the vacuum
TENSION_STEPS = 10  # time steps over which a tension is averaged: 20 ms, as load cells do
START = 1.0  # s until the arm rests at the beginning
SAME_PULL = 2e-5  # m


class LabError(RuntimeError):
    """A rig that does not do what was asked of it; the message says what."""


@dataclass(frozen=True)
class Description:
    """
    What the nodes know of arm and rig, from the description file.

    arm: planar or spatial.  layout: of its tags.  jams: whether segments can
    become stiff.  settings: of plans.  jamming: thresholds.  speed_limit: of a tendon, m/s.
    soft_vacuum: Pa up to which a segment is soft.  timeout: s in which a segment becomes soft or
    stiff.  period: s between two readings of the pressures.
    """

    arm: Any
    layout: Any
    jams: bool
    settings: PlanSettings
    jamming: JammingSettings
    speed_limit: float
    soft_vacuum: float
    timeout: float
    period: float

    @classmethod
    def read(cls, *paths: Path) -> 'Description':
        """Return that of description files: without one, of that of the paper's arm."""
        values: dict[str, Any] = dict(load_description(*paths or [description_file()]))
        arm = arm_from_parameters(values)
        return cls(arm, layout_of(values), values['arm.jamming'], PlanSettings.of(values),
                   jamming_settings(values), values['speed_limit'], values['soft_vacuum'],
                   values['jamming_timeout'], 1.0 / values['jamming_rate'])


class Lab:
    """
    A rig with one arm; it begins straight, all segments that can be stiff, all tendons at 0.

    Time passes in ``switch``, ``follow``, ``wait``, ``advance`` and ``measure`` only.  pulls:
    (tendons,) m, where the motors stand.  largest_tension: N, true, averaged over 20 ms.
    violations: what exceeded a limit, at most one entry of each kind for one call.
    """

    def __init__(self, description: Description, differences: ModelErrors,
                 sensor: str = CAMERA, tared: bool = True) -> None:
        """
        Put up the rig.

        sensor: CAMERA, TWO_CAMERAS of a spatial arm, TRUTH or NOTHING.  tared: whether the camera
        takes the arm as it is in the beginning as straight; that of a spatial one always does.
        """
        if sensor not in (CAMERA, TWO_CAMERAS, TRUTH, NOTHING):
            raise ValueError(f'sensor is {sensor!r}; allowed: {CAMERA}, {TWO_CAMERAS}, {TRUTH}, '
                             f'{NOTHING}')
        self.description, self.differences = description, differences
        self.plant = Plant(description.arm, differences)
        tendons = len(description.arm.tendon_names)
        self.pulls = np.zeros(tendons)
        self.pictures = 0
        self.largest_tension = 0.0
        self.violations: list[str] = []
        self._segments = len(description.arm.segments)
        self._jamming = SimulatedJamming(
            lambda: self.time, self._segments, JammingPlant(),
            initially_stiff=description.jams)
        self._jams = JammingController(
            self._jamming, self._segments, description.jamming, lambda: self.time)
        self._pressures = np.zeros(self._segments)
        self._updated = -np.inf
        self._steps = 0
        self._tensions = np.zeros(tendons)  # sum of those not yet averaged
        self._sensor = sensor
        self._sight: Sight | None = None
        self.sensors = Sensors(self.plant)
        self._straight: list[tuple[Array, float]] = []  # discs, and when, to be tared on
        self._read()
        self.wait(START)
        if not description.arm.planar:
            self._straight = [(self.plant.poses[::2], self.time)] * TARE_PICTURES
        elif tared and sensor == CAMERA:
            for _ in range(TARE_PICTURES):
                self.wait(PICTURE_PERIOD)
                self._straight.append((self.plant.poses[::2], self.time))

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self.plant.time

    @property
    def stiff(self) -> tuple[bool, ...]:
        """Whether each segment is known to be stiff, by its pressure."""
        return tuple(self._jams.stiff)

    @property
    def vacuum(self) -> Array:
        """Vacuum of each segment, (segments,), parts of what the pump can reach."""
        parts: Array = self.vacuum_pascals / JammingPlant.ultimate_vacuum
        return parts

    @property
    def truth(self) -> Array:
        """Poses of bottom and top of every disc as they really are, (2 * discs, 7)."""
        return self.plant.poses

    @property
    def tip(self) -> Array:
        """The true pose of the tip, (7,)."""
        tip: Array = self.truth[-1]
        return tip

    @property
    def bending(self) -> Array:
        """The true bending about x and y of the disc below, (segments, 2), rad."""
        return bending_between(matrices(self.truth[::2, 3:]))

    @property
    def tensions(self) -> Array:
        """The true tensions at this instant, (tendons,) N."""
        return self.plant.tensions

    # What moves.

    def wait(self, duration: float) -> None:
        """Let time pass, s."""
        self.advance(np.repeat(self.pulls[None], round(duration / TIME_STEP), axis=0))

    def switch(self, segment: int, stiff: bool) -> None:
        """
        Soften or stiffen a segment (0-based), and wait until its vacuum says that it is.

        Raises LabError when that takes longer than jamming_timeout.
        """
        self.request(segment, stiff)
        deadline = self.time + self.description.timeout
        while self._jams.stiff[segment] != stiff or (
                not stiff and self.vacuum_pascals[segment] > self.description.soft_vacuum):
            if self.time > deadline:
                raise LabError(f'segment {segment + 1} did not become '
                               f'{"stiff" if stiff else "soft"}')
            self.wait(self.description.period)

    def request(self, segment: int, stiff: bool) -> None:
        """Begin to soften or stiffen a segment (0-based)."""
        self._jams.set_stiff(segment, stiff)

    def follow(self, times: Array, pulls: Array) -> None:
        """
        Move the motors along pulls (k, tendons) m at ``times`` (k,) s from now.

        They must begin where the motors stand: raises ValueError.
        """
        if np.abs(pulls[0] - self.pulls).max() > SAME_PULL:
            raise ValueError(f'the motion begins at {pulls[0]} m; the motors are at {self.pulls}')
        low, high = self.description.settings.pull_limits
        if pulls.min() < low or pulls.max() > high:
            self.violations.append(f'pulls from {pulls.min():.4f} to {pulls.max():.4f} m')
        if len(times) > 1:
            speed = float((np.abs(np.diff(pulls, axis=0)).max(axis=1) / np.diff(times)).max())
            if speed > 1.001 * self.description.speed_limit:
                self.violations.append(f'a tendon speed of {speed:.4f} m/s')
        steps = np.arange(1, max(1, round(times[-1] / TIME_STEP)) + 1) * TIME_STEP
        self.advance(np.stack([np.interp(steps, times, tendon) for tendon in pulls.T], axis=1))

    def advance(self, pulls: Array) -> None:
        """Let one time step pass for each of pulls (steps, tendons), m, of the motors."""
        largest = 0.0
        for row in pulls:
            if self._steps % VACUUM_STEPS == 0:
                self._read()
            self.plant.step(row, self._parts)
            self._tensions += self.plant.tensions
            self._steps += 1
            if self._steps % TENSION_STEPS == 0:
                largest = max(largest, float(self._tensions.max()) / TENSION_STEPS)
                self._tensions[:] = 0.0
        if len(pulls):
            self.pulls = pulls[-1].copy()
        self.largest_tension = max(self.largest_tension, largest)
        if largest > self.description.settings.tension_limit:
            self.violations.append(f'a tension of {largest:.1f} N')

    def _read(self) -> None:
        """Read the pressures, as often as the node does, and let pump and valves follow."""
        if self.time - self._updated >= self.description.period - 1e-9:
            self._jams.update()
            self._updated = self.time
        self._pressures = np.array(self._jamming.read().pressures)
        self._parts = self.vacuum if self.description.jams else np.zeros(self._segments)

    @property
    def vacuum_pascals(self) -> Array:
        """Vacuum of each segment, (segments,), Pa below ambient."""
        vacuum: Array = self.description.jamming.ambient_pressure - self._pressures
        return vacuum

    # What is measured.

    def measure(self, pictures: int = 1) -> dict[int, DiscMeasurement]:
        """
        Return the discs that were measured, by number; the mean of some pictures, 0.2 s apart.

        The covariance is that of one picture: most errors are the same in all.
        """
        if self._sensor == NOTHING:
            return {}
        seen: dict[int, list[DiscMeasurement]] = {}
        for _ in range(pictures):
            self.wait(PICTURE_PERIOD)
            for n, disc in self.look().items():
                seen.setdefault(n, []).append(disc)
        return {n: replace(discs[-1], pose=mean_pose([d.pose for d in discs]))
                for n, discs in seen.items()}

    def measure_all(self, pictures: int = 1) -> dict[int, DiscMeasurement]:
        """
        Measure until every disc above the base is seen: some pictures miss one.

        Raises LabError when that takes too many pictures.
        """
        last = len(self.description.arm.discs)
        for _ in range(TRIES):
            measured = self.measure(pictures)
            if all(n in measured for n in range(1, last)):
                return measured
        raise LabError(f'a disc is not seen in {TRIES * pictures} pictures')

    def load_cells(self) -> Array:
        """Return what load cells show of the tensions now, (tendons,) N."""
        return self.sensors.tensions()

    def look(self) -> dict[int, DiscMeasurement]:
        """Return the discs as they are measured now."""
        discs = self.truth[::2]
        if self._sensor == TRUTH:
            covariance = known(self.plant.arm, TRUTH_DEVIATION * np.ones(6))
            return {n: DiscMeasurement(n, pose, covariance) for n, pose in enumerate(discs)}
        if self._sight is None:  # drawn only now: not every contender looks
            self._sight = Sight(self.description.layout, self.differences, self._straight,
                                1 + (self._sensor == TWO_CAMERAS))
        self.pictures += 1
        return {n: DiscMeasurement(n, *seen)
                for n, seen in self._sight.discs(discs, self.time).items()}


def known(arm: Arm, deviations: Array) -> Array:
    """Return a covariance (6, 6) of deviations (6,), m and rad, about the axes of an arm alone."""
    return np.diag(np.where(arm.pose_axes, deviations**2, UNKNOWN))


def angles_of(arm: Arm, measured: Mapping[int, DiscMeasurement]) -> Array:
    """
    Return the angles of a planar arm, (segments,) rad; KeyError for a disc that is not seen.

    That of the base need not be: it stands still.
    """
    return np.diff([0.0, *(planar_pose(measured[n].pose)[2] for n in range(1, len(arm.discs)))])
