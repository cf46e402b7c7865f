# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Servos that pull at the twin feel the tensions of its plant, and give way where they must."""

from contextlib import contextmanager

import pytest

from soft_continuum.hardware.dynamixel.tendons import DynamixelTendons
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.ros.description import load_arm
from soft_continuum.sim.emulators.dynamixel import SPOOL_RADIUS
from soft_continuum.sim.twin.model_errors import read_model_errors
from soft_continuum.sim.twin.rig import TwinRig
from soft_continuum.user_files import description_file
from support.servo_rig import go, SPEED, spools
from support.virtual_clock import VirtualClock

STALL_TORQUE = 4.1  # N m, of an XM430-W350 at 12 V


def friction(tension):
    """Tension (N) that the gears of the emulated servos may hide, while they stick."""
    return 1.2 * (0.1 * tension + 0.01 * STALL_TORQUE / SPOOL_RADIUS) + 2.0


@contextmanager
def twin(tmp_path, monkeypatch, jams, **changes):
    """The ideal twin, and a driver of its two servos, in a time of their own."""
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log
    differences = read_model_errors(description_file().with_name('twin.yaml'), 'ideal')
    clock = VirtualClock()
    with TwinRig(load_arm(description_file()), differences, clock=clock, jams=jams,
                 tendon_driver='dynamixel') as rig:
        given = rig.parameters()
        driver = DynamixelTendons(
            given['dynamixel.port'], given['dynamixel.baud'],
            spools(2, signs=given['dynamixel.signs'], radii=given['dynamixel.spool_radii'],
                   **changes), tmp_path / 'zeros.json', clock)
        driver.open()
        driver.reference()
        clock.sleep(0.2)
        yield rig, driver, clock
        driver.close()


def moved(driver, clock, goal, meanwhile=lambda: None):
    """Move as the node does; return the reading at rest."""
    way = max(abs(a - b) for a, b in zip(driver.read().pulls, goal, strict=True))
    go(driver, clock, goal, way / (0.5 * SPEED), lambda: (meanwhile(), driver.read()))
    clock.sleep(0.5)
    return driver.read()


def test_the_tension_of_a_bent_arm_shows_in_the_present_current(tmp_path, monkeypatch):
    with twin(tmp_path, monkeypatch, jams=False) as (rig, driver, clock):
        reading = moved(driver, clock, (0.01, -0.015))
        assert reading.pulls == pytest.approx((0.01, -0.015), abs=2e-4)
        assert reading.pulls == pytest.approx(rig.motors.pulls(), abs=5e-5)
        with rig.lock:
            tensions = rig.plant.tensions
            bent = abs(rig.plant.joint_angles.sum())
        assert bent > 0.2 and tensions.max() > 0.1, tensions
        for known, is_so in zip(reading.tensions, tensions, strict=True):
            assert known == pytest.approx(is_so, abs=friction(is_so))


def test_a_stiff_arm_stalls_a_servo_at_its_tension_limit(tmp_path, monkeypatch):
    limit = 15.0
    with twin(tmp_path, monkeypatch, jams=True, tension_limits=(limit, limit)) as (
            rig, driver, clock):
        tensions = []

        def look():
            with rig.lock:
                tensions.append(rig.plant.tensions[0])

        with pytest.raises(HardwareError, match=r'first.*tension_limits 15 N'):
            moved(driver, clock, (0.012, -0.012), look)
        # It comes with momentum, and bounces: the limit does not know that.
        assert 5.0 < max(tensions) < 4.0 * limit
        assert rig.motors.pulls()[0] < 0.008
