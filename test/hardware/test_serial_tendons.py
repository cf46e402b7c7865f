# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What every driver of tendons on a serial line promises, whatever the motors."""

from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest

from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.tendon_controller import TendonController, TendonLimits
from support import grbl_rig, servo_rig
from support.driver_waits import at_rest

WIDE, NARROW = (-0.06, 0.06), (-0.01, 0.01)  # m
BEYOND = (0.012, -0.012)
SPEED, INTERVAL = 0.02, 0.02  # m/s, s
NAMES = ('right_tendon', 'left_tendon')


@contextmanager
def steppers(folder):
    """An open driver of steppers with wide limits, and what makes another one."""
    with grbl_rig.rig(pull_limits=WIDE) as (board, tendons):
        yield tendons, partial(grbl_rig.driver, board)


@contextmanager
def servos(folder):
    """The same of servos."""
    with servo_rig.rig(folder, WIDE, 2) as made:
        yield made.driver, partial(servo_rig.driver_of, made.emulator, folder)


pytestmark = pytest.mark.parametrize('motors', [steppers, servos])


def test_a_tendon_beyond_its_limits_comes_back_in_one_motion(motors, tmp_path):
    with motors(tmp_path) as (before, another):
        before.move(BEYOND, 1.0)
        at_rest(before)
        before.close()
        tendons = another(pull_limits=NARROW)
        tendons.open()
        controller = TendonController(tendons, TendonLimits(NAMES, NARROW, SPEED))
        assert controller.reading.referenced
        assert controller.reading.pulls == pytest.approx(BEYOND, abs=1e-4)
        for further in ((0.0126, -0.012), (0.012, 0.0101), (0.012, -0.0126)):
            with pytest.raises(HardwareError, match=r'beyond pull_limits: -0.01 to 0.01 m'):
                tendons.move(further, 1.0)
        assert not tendons.read().moving
        begin = tendons.clock()
        controller.accept(np.array([begin + 2.0]), np.zeros((1, 2)), begin)
        while controller.busy:
            reading = controller.update(tendons.clock(), INTERVAL)
            assert max(map(abs, reading.pulls)) < 0.0122
            tendons.clock.sleep(INTERVAL)
        assert controller.reading.pulls == pytest.approx((0.0, 0.0), abs=1e-4)
        with pytest.raises(HardwareError, match='beyond pull_limits'):
            tendons.move((0.0101, 0.0), 1.0)
        tendons.close()


def test_a_second_program_cannot_open_the_port(motors, tmp_path):
    with motors(tmp_path) as (tendons, another):
        before = tendons.read().pulls
        with pytest.raises(HardwareError, match='in use by another program'):
            another().open()
        assert tendons.read().referenced
        assert tendons.read().pulls == before


def test_no_zero_is_set_in_motion(motors, tmp_path):
    with motors(tmp_path) as (tendons, _):
        tendons.move((0.01, -0.01), 1.0)
        tendons.clock.sleep(0.3)
        with pytest.raises(HardwareError, match='are moving; wait until they rest'):
            tendons.reference()
        assert at_rest(tendons).pulls == pytest.approx((0.01, -0.01), abs=2e-4)
