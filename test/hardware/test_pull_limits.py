# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A tendon beyond its limits can come back in one motion, by whatever motor, and go no further."""

from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest

from soft_continuum.hardware.protocols import check_limits, HardwareError, MAX_AHEAD
from soft_continuum.hardware.tendon_controller import TendonController, TendonLimits
from support import grbl_rig, servo_rig
from support.driver_waits import at_rest

WIDE, NARROW = (-0.06, 0.06), (-0.01, 0.01)  # m
BEYOND = (0.012, -0.012)
SPEED, INTERVAL = 0.02, 0.02  # m/s, s
NAMES = ('right_tendon', 'left_tendon')


@contextmanager
def steppers(folder):
    """A driver of steppers with wide limits, and what makes another one."""
    with grbl_rig.rig(pull_limits=WIDE) as (board, tendons):
        yield tendons, partial(grbl_rig.driver, board)


@contextmanager
def servos(folder):
    """The same of servos."""
    with servo_rig.rig(folder, WIDE, 2) as made:
        yield made.driver, partial(servo_rig.driver_of, made.emulator, folder)


@pytest.mark.parametrize('motors', [steppers, servos])
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


@pytest.mark.parametrize(('pull', 'present', 'allowed'), [
    (0.01, 0.0, True), (0.0101, 0.0, False), (-0.0101, 0.0, False),
    (0.02, 0.02, True), (0.02 + 0.9 * MAX_AHEAD, 0.02, True), (0.021, 0.02, False),
    (-0.01, 0.02, True), (-0.0101, 0.02, False), (0.01, -0.02, True), (-0.021, -0.02, False)])
def test_a_tendon_may_be_sent_within_its_limits_and_wherever_is_no_further(pull, present, allowed):
    def check():
        check_limits(NAMES, (0.0, pull), (0.0, present), NARROW)

    if allowed:
        check()
    else:
        with pytest.raises(HardwareError, match='left_tendon'):
            check()
