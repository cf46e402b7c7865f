# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is believed of joint states and of their stamps, without ROS."""

from dataclasses import dataclass, field, replace
from math import pi

import pytest

from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros_topics.joint_states import Joints, JointWatch
from soft_continuum.ros_topics.link import Stamps

JOINTS = Joints(('right_tendon', 'left_tendon'), ('a', 'b'), (0.01, -0.02), (1.0, 2.0), False,
                (0.0,), (-0.06, 0.06), 0.03)


@dataclass
class State:
    """A message."""

    name: tuple[str, ...] = ('other', 'b', 'a')
    position: tuple[float, ...] = (9.0, 2.0, 1.0)
    velocity: tuple[float, ...] = ()
    effort: tuple[float, ...] = field(default_factory=tuple)


def test_joints_are_found_in_any_order_among_others():
    watch = JointWatch(JOINTS)
    watch.take(State(position=(9.0, 2.5, 1.2)), 1.0, 1.0, False)
    assert watch.pulls == pytest.approx((0.002, -0.01))
    assert JOINTS.positions(watch.pulls, watch.zeros) == pytest.approx((1.2, 2.5))


@pytest.mark.parametrize('scale', [0.0, 1e-5, 10.0])
def test_a_scale_that_is_off_by_a_thousand_is_refused(scale):
    with pytest.raises(ParameterError, match='a spool of 10 mm has 0.01'):
        replace(JOINTS, scales=(0.01, -scale))


@pytest.mark.parametrize('scale', [0.3e-3 / (2 * pi), 0.04, 2.0])
def test_fine_screws_large_spools_and_slides_with_a_pulley_are_scales(scale):
    assert replace(JOINTS, scales=(0.01, -scale)).scales[1] == -scale


def test_tendons_rest_only_when_that_was_watched_long_enough():
    watch = JointWatch(JOINTS)
    for step in range(40):
        now = 0.01 * step
        angle = 1.0 + 0.01 * min(step, 10)  # 10 mm/s for 0.1 s
        watch.take(State(position=(9.0, 2.0, angle)), now, now, False)
        assert watch.rests(0.0) == (step > 10 + 14), step
        if 2 < step <= 10:
            assert watch.speeds()[0] > 0.0


def test_what_was_commanded_just_now_does_not_rest():
    watch = JointWatch(JOINTS)
    for step in range(40):
        watch.take(State(), 0.01 * step, 0.01 * step, False)
    assert watch.rests(0.2)
    assert not watch.rests(0.3)


def test_without_states_of_afterwards_nobody_knows_that_a_command_has_come_to_rest():
    watch = JointWatch(JOINTS)
    for step in range(21):
        watch.take(State(), 0.01 * step, 0.01 * step, False)
    assert watch.rests(0.05)
    assert not watch.rests(0.19)  # whatever the time is now


@pytest.mark.parametrize('noise', [0.0, 0.004])  # rad: 40 um of pull
def test_noise_at_rest_is_no_other_unit(noise):
    watch = JointWatch(JOINTS)
    for step in range(3000):  # a velocity that is only noise, too
        angle = 1.0 + noise * (step % 2)
        watch.take(State(position=(9.0, 2.0, angle), velocity=(0.0, 0.001, -0.002)),
                   0.01 * step, 0.01 * step, False)
    assert watch.rests(0.0)


def move(watch, velocity, steps=300):
    """Let the right tendon move at 10 mm/s; velocity: in the message at each step, rad/s."""
    for step in range(steps):
        watch.take(State(position=(9.0, 2.0, 1.0 + 0.01 * step),
                         velocity=(0.0, 0.0, velocity(step))), 0.01 * step, 0.01 * step, False)


@pytest.mark.parametrize('factor', [57.3, 0.01, -1.0])
def test_velocities_in_another_unit_or_sense_are_refused(factor):
    with pytest.raises(HardwareError, match='according to the velocities'):
        move(JointWatch(JOINTS), lambda _: factor)


def test_a_velocity_that_is_wrong_now_and_then_is_believed():
    move(JointWatch(JOINTS), lambda step: 100.0 if step in (70, 200) else 1.0)


def test_a_velocity_of_zeros_counts_as_not_measured():
    watch = JointWatch(JOINTS)
    for step in range(200):
        watch.take(State(position=(9.0, 2.0, 1.0 + 0.01 * step), velocity=(0.0, 0.0, 0.0)),
                   0.01 * step, 0.01 * step, False)
    assert watch.pulls[0] == pytest.approx(0.0199)


def test_a_state_that_is_not_believed_leaves_no_position():
    watch = JointWatch(JOINTS)
    watch.take(State(), 1.0, 1.0, False)
    with pytest.raises(HardwareError, match='right_tendon jumped by 30.0 mm in 0.010 s'):
        watch.take(State(position=(9.0, 2.0, 4.0)), 1.01, 1.01, False)
    assert watch.positions is None


def test_only_what_is_newer_counts_and_only_what_comes_late_is_refused():
    stamps = Stamps(0.2)
    # The clock of the sender is an hour behind, and drifts by 0.05 %: nothing is late.
    for step in range(10000):
        assert stamps.newer(0.9995 * step - 3600.0, float(step))
    assert not stamps.newer(0.9995 * 9999 - 3600.0, 9999.5)
    assert not stamps.newer(0.9995 * 9998 - 3600.0, 9999.6)
    with pytest.raises(HardwareError, match='arrived 0.50 s later than others; allowed: 0.2 s'):
        stamps.newer(0.9995 * 10000 - 3600.0, 10000.5)
