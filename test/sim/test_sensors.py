# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Load cells and IMUs show what the arm does, with the errors of the preset and no others."""

from dataclasses import replace

import numpy as np
import pytest

from soft_continuum.mechanics.arm import mounted, STANDARD_GRAVITY
from soft_continuum.ros.description import load_arm
from soft_continuum.sim.twin.model_errors import read_model_errors
from soft_continuum.sim.twin.plant import Sensors, TIME_STEP
from soft_continuum.sim.twin.rig import MAX_LATENESS, PERIOD, TwinRig
from soft_continuum.user_files import description_file
from support.plants import ARM, FREE, only, plant, points_of, run, SOFT, STIFF

PULLS = np.array([0.012, -0.05])


@pytest.mark.parametrize('mounting', [2.0, -1.0])
def test_at_rest_the_specific_force_tells_the_angle_of_every_disc(mounting):
    found = plant(replace(ARM, gravity=mounted(mounting)))
    pulls = run(found, np.zeros(2), np.zeros(2), only(1), 0.5)
    run(found, pulls, PULLS, only(1), 3.0)
    motions = Sensors(found).motions()
    from_upright = mounting + points_of(found)[::2, 2]
    assert np.ptp(from_upright) > 0.3
    # z along the disc, x to the side towards which a positive angle carries it
    assert motions[:, 3] == pytest.approx(-STANDARD_GRAVITY * np.sin(from_upright), abs=0.005)
    assert motions[:, 5] == pytest.approx(STANDARD_GRAVITY * np.cos(from_upright), abs=0.005)
    assert motions[:, [0, 1, 2, 4]] == pytest.approx(0.0, abs=1e-3)


def test_in_motion_the_imus_show_how_the_discs_move():
    found = plant(replace(ARM, gravity=mounted(1.0)))
    run(found, np.zeros(2), PULLS, only(2), 1.0)
    run(found, PULLS, FREE, STIFF, 0.1)
    sensors, points, motions = Sensors(found), [], []
    for _ in range(100):
        found.step(FREE, SOFT)
        points.append(points_of(found)[::2])
        motions.append(sensors.motions())
    points, motions = np.array(points), np.array(motions)
    speeds = np.diff(points, axis=0) / TIME_STEP
    assert np.abs(motions[1:-1, :, 1]).max() > 1.0  # rad/s
    # Positions go with the speed that they have after a step.
    assert motions[1:, :, 1] == pytest.approx(speeds[:, :, 2], abs=1e-6)
    accelerations = np.diff(speeds[:, :, :2], axis=0) / TIME_STEP
    angles = points[1:-1, :, 2]
    right = np.stack([np.cos(angles), -np.sin(angles)], axis=-1)
    up = np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    gravity = STANDARD_GRAVITY * np.array([np.sin(1.0), -np.cos(1.0)])
    assert np.abs(accelerations).max() > 5.0
    for axis, place in ((right, 3), (up, 5)):
        force = ((accelerations - gravity) * axis).sum(axis=-1)
        assert motions[1:-1, :, place] == pytest.approx(force, abs=0.5)


def test_load_cells_show_the_tensions_with_noise_zero_and_scale():
    found = plant(load_cell_zero=0.5, load_cell_scale=0.05)
    slack = Sensors(found).tensions()
    assert np.abs(slack).max() > 0.05 and found.tensions == pytest.approx(0.0)
    run(found, np.zeros(2), PULLS, only(1), 2.0)
    shown = Sensors(found).tensions()
    assert shown[1] == slack[1]
    scale = (shown[0] - slack[0]) / found.tensions[0]
    assert 0.8 < scale < 1.2 and scale != pytest.approx(1.0, abs=1e-4)
    ideal = plant()
    run(ideal, np.zeros(2), PULLS, only(1), 0.5)
    assert ideal.tensions[0] > 1.0
    assert np.array_equal(Sensors(ideal).tensions(), ideal.tensions)


def test_noise_and_bias_are_as_large_as_the_preset_says():
    found = plant(ARM.without_gravity(), tension_noise=0.2, accelerometer_noise=0.1,
                  accelerometer_bias=0.4, gyro_noise=0.003, gyro_bias=0.05)
    sensors = Sensors(found)
    cells = np.array([sensors.tensions() for _ in range(2000)])
    motions = np.array([sensors.motions() for _ in range(2000)])
    assert cells.std(axis=0) == pytest.approx(0.2, rel=0.1)
    for columns, noise, bias in ((slice(0, 3), 0.003, 0.05), (slice(3, 6), 0.1, 0.4)):
        values = motions[:, :, columns]
        assert values.std(axis=0) == pytest.approx(noise, rel=0.1)
        means = values.mean(axis=0)
        assert 0.5 * bias < means.std() < 1.5 * bias
        again = [Sensors(found).motions() for _ in range(2)]
        assert np.array_equal(*again)


def test_to_read_the_sensors_changes_nothing_that_the_arm_does():
    shapes = []
    for reading in (False, True):
        found = plant(lock_in_shift=0.02, tension_noise=0.1)
        sensors = Sensors(found)
        for _ in range(100):
            found.step(np.zeros(2), STIFF)
            if reading:
                sensors.tensions(), sensors.motions()
        shapes.append(found.joint_angles)
    assert np.abs(shapes[0]).max() > 1e-5
    assert np.array_equal(*shapes)


# On a computer that is late.

PAUSE, ROUNDS = 0.5, 40


class LateClock:
    """The computer stands still for PAUSE before the first look at the boards."""

    def __init__(self):
        self.now, self.times = 0.0, []

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        self.times.append(self.rig.plant.time)
        self.now += seconds if len(self.times) > 1 else PAUSE
        self.rig._closing = len(self.times) == ROUNDS


def test_a_late_plant_makes_up_for_it_and_keeps_its_sensors_waiting_for_20_ms_only():
    clock = LateClock()
    clock.rig = rig = TwinRig(
        load_arm(description_file()),
        read_model_errors(description_file().with_name('twin.yaml'), 'ideal'), clock=clock)
    rig._run()
    passed = [b - a for a, b in zip(clock.times, clock.times[1:], strict=False)]
    assert max(passed) == pytest.approx(0.02)
    assert rig.lost == pytest.approx(PAUSE - MAX_LATENESS)
    assert rig.plant.time == pytest.approx(clock.now - rig.lost, abs=TIME_STEP + PERIOD)
