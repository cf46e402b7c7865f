# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A late motion, or part of one, keeps its path; and late states of other nodes refuse none.

One that was given up moves nothing, and what rests is reported seldom.
"""

from contextlib import nullcontext
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from soft_continuum.hardware import tendon_controller
from soft_continuum.hardware.protocols import Accuracy
from soft_continuum.hardware.simulated_tendons import SimulatedTendons
from soft_continuum.hardware.tendon_controller import (
    MotionRefusedError,
    Reason,
    TendonController,
    TendonLimits,
)
from soft_continuum.nodes import tendon_actuation, tendon_control
from soft_continuum.nodes.managed_node import RestingStream
from soft_continuum.nodes.tendon_actuation import TendonActuation
from soft_continuum.nodes.tendon_control import Request, TendonControl
from soft_continuum_interfaces.msg import MotionRequest
from support.ros_rig import DEADLINE

MAX_DELAY = tendon_controller.MAX_DELAY
PERIOD = 0.02  # s
TENDONS = ('right_tendon', 'left_tendon')
TIMES = np.linspace(0.0, 1.0, 11)
PATH = np.stack([0.02 * TIMES, -0.02 * TIMES**2], axis=1)
"""Far from the straight line between its ends."""


class Steered:
    """A TendonControl on simulated tendons, with a clock of its own."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        self.reported = []
        """When a reading was reported, s, and its pulls, m."""
        monkeypatch.setattr(tendon_control, 'STEADY', lambda: self.now)
        arm = Mock(stiffness=None)
        arm.motion_interlock.return_value = None
        driver = SimulatedTendons(lambda: self.now, TENDONS, 1.0, 100.0, 1e-6)
        self.controller = TendonController(driver, TendonLimits(TENDONS, (-0.06, 0.06), 0.1))
        self.control = TendonControl(
            TENDONS, arm, PERIOD, lambda: 0.0, lambda: 60.0, self._report, Mock())
        self.control.attach(self.controller)
        self.control.activate()
        self.start = self.now  # of the motion, as its sender has it
        self.pulls = [self.controller.reading.pulls]

    def _report(self, report):
        if report.reading is not None:
            self.reported.append((report.time, tuple(report.reading.pulls)))

    def send(self, begin, end, motion='a motion'):
        """Send the part of the motion between two times (s)."""
        part = (begin - 1e-9 <= TIMES) & (end + 1e-9 >= TIMES)
        self.control.follow(Request(
            motion, TIMES[part], PATH[part], self.start, self.control.revocations, 1), None)

    def go_on(self, seconds):
        """Let time pass."""
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            self.control.cycle(0.0)
            self.pulls.append(self.controller.reading.pulls)

    def assert_path_kept(self):
        """Claim that the tendons went the whole way, never far from the path."""
        right, left = np.array(self.pulls).T
        assert (right[-1], left[-1]) == pytest.approx(PATH[-1], abs=1e-5)
        assert left == pytest.approx(np.interp(right, *PATH.T), abs=3e-4)


@pytest.fixture
def steered(monkeypatch):
    return Steered(monkeypatch)


@pytest.mark.parametrize('late', [0.0, 0.3, 2.0])
def test_a_motion_that_comes_late_keeps_its_path(steered, late):
    steered.now += late
    steered.send(0.0, 1.0)
    steered.go_on(1.5)
    steered.assert_path_kept()


@pytest.mark.parametrize('late', [0.0, 0.3])
@pytest.mark.parametrize('gap', [0.2, 0.5, 0.9, 3.0])
def test_a_part_that_comes_late_goes_on_where_the_one_before_it_ends(steered, late, gap):
    steered.now += late
    steered.send(0.0, 0.5)
    steered.go_on(gap)
    steered.send(0.4, 1.0)
    steered.go_on(2.0)
    steered.assert_path_kept()


@pytest.mark.parametrize('busy', [0.1, 0.4, 0.9])
def test_a_part_that_is_judged_while_a_cycle_is_due_keeps_the_path(steered, busy, monkeypatch):
    monkeypatch.setattr(tendon_controller, 'MAX_DELAY', MAX_DELAY)  # as for a user
    steered.send(0.0, 0.5)
    steered.go_on(0.3)
    steered.now += busy  # no cycle came: a busy computer
    steered.send(0.4, 0.5)  # no longer than what was sent, such as the last one
    steered.send(0.4, 1.0)
    steered.go_on(2.0)
    steered.assert_path_kept()


def test_of_a_trajectory_without_an_id_points_that_are_past_are_left_out(steered):
    steered.now += 0.5
    steered.send(0.0, 1.0, motion='')
    steered.go_on(0.5 + 3 * PERIOD)
    assert steered.pulls[-1] == pytest.approx(PATH[-1], abs=1e-5)


@pytest.mark.parametrize(('arrives', 'refused'), [
    ('allowed', False), ('refused', True), ('', True)])
def test_only_a_shape_from_after_a_trajectory_arrived_refuses_it(arrives, refused, monkeypatch):
    begin, model, tried = 10.0, Mock(offsets=0.0), []
    arm = Mock(agreed=True, stiffness='old', timeout=5.0, shape_and_model=('refused', model),
               jammed=lambda stiffness: (stiffness == 'old',))

    def check(pulls, shape, *_):
        tried.append((shape, arm.stiffness))
        if shape == 'refused':
            raise MotionRefusedError(Reason.TENSION, 'too much')

    node = Mock(_arm=arm, _prediction=Mock(check=check), _shape_time=begin - 0.1,
                parameters={'tension_limit': 60.0, 'co_contraction_limit': 5.0})
    clock = Mock(return_value=begin)

    def sleep(seconds):
        clock.return_value += seconds
        if arrives:
            arm.stiffness, arm.shape_and_model = 'new', (arrives, model)
            node._shape_time = clock.return_value

    clock.sleep = sleep
    monkeypatch.setattr(tendon_actuation, 'STEADY', clock)
    expected = pytest.raises(MotionRefusedError) if refused else nullcontext()
    with expected:
        assert TendonActuation._predict(
            node, np.zeros((2, 2)), begin, lambda: False) == arm.stiffness
    assert tried == [('refused', 'old')] + [(arrives, 'new')] * bool(arrives)
    assert clock.return_value <= begin + arm.timeout + 0.1


@pytest.mark.parametrize('begun', [False, True])
def test_a_trajectory_that_was_given_up_is_not_followed(begun):
    arm, controller = Mock(), Mock(reading=Mock(tensions=None, accuracy=Accuracy()))
    arm.motion_interlock.return_value = None
    control = TendonControl(('a', 'b'), arm, 0.02, lambda: 0.0, lambda: 10.0, Mock(), Mock())
    control.attach(controller)
    control.activate()
    request = Request('goal', np.array([1.0]), np.zeros((1, 2)), None, control.revocations)
    controller.plan.return_value = request.times, request.pulls
    control.prepare(request)
    if begun:
        control.follow(request, arm.stiffness)
    control.give_up('goal')
    assert controller.hold.called == begun
    assert control.snapshot().state.accepted.status == (
        MotionRequest.ENDED if begun else MotionRequest().status)
    with pytest.raises(MotionRefusedError, match='withdrew it'):
        control.prepare(request)


def test_a_jump_of_the_clock_before_a_motion_does_not_end_it(steered, monkeypatch):
    resting = steered.controller.reading
    steered.controller.reading = replace(resting, speeds=(0.01, 0.0))  # moved by hand
    jumps = iter([9.0])
    monkeypatch.setattr(steered.control, '_jump', lambda: next(jumps, 0.0))
    steered.send(0.0, 1.0)
    steered.go_on(0.1)
    assert steered.control.snapshot().state.accepted.status == MotionRequest.FOLLOWING


# What does not change is sent ten times a second; every reading of a motion is sent.


def test_tendons_at_rest_are_reported_ten_times_a_second(steered):
    steered.go_on(1.0)
    steered.reported.clear()
    steered.go_on(10.0)
    assert len(steered.reported) == 100
    begin = steered.now
    steered.send(0.0, 1.0)
    steered.go_on(0.5)
    times = [time for time, pulls in steered.reported if time > begin]
    assert times == pytest.approx([begin + PERIOD * k for k in range(1, 26)])
    moved = [pulls for pulls in steered.pulls if pulls != steered.pulls[0]]
    assert [pulls for _, pulls in steered.reported[-len(moved):]] == moved
    steered.go_on(1.0)
    assert steered.reported[-1][1] == steered.pulls[-1]  # where it came to rest


def test_a_pressure_is_sent_at_once_when_it_changes_or_anything_else_does():
    stream = RestingStream(200.0)
    assert stream.due(0.0, 'soft', (1e5, 1e5))
    assert not stream.due(0.05, 'soft', (1e5 + 150.0, 1e5))
    assert stream.due(0.1, 'soft', (1e5 + 150.0, 1e5))
    assert stream.due(0.15, 'soft', (1e5 + 150.0, 1e5 - 201.0))
    assert stream.due(0.2, 'stiff', (1e5 + 150.0, 1e5 - 201.0))
    assert not stream.due(0.25, 'stiff', (1e5 + 150.0, 1e5 - 201.0))
    assert stream.due(0.26, 'stiff', (float('nan'), 1e5 - 201.0))


def test_a_slow_drift_is_sent_once_it_is_as_large_as_the_resolution():
    stream, drift = RestingStream(1.0), [0.3 * k for k in range(10)]
    sent = [stream.due(1e-3 * k, None, (value,)) for k, value in enumerate(drift)]
    assert sent == [True, False, False, False] * 2 + [True, False]


def test_an_arm_at_rest_has_no_timer_of_more_than_ten_hertz(rig):
    nodes = rig.start_arm()

    def fast():
        return [(node.get_name(), timer.timer_period_ns) for node in nodes for timer in node.timers
                if timer.timer_period_ns < 1e8 and not timer.is_canceled()]

    for _ in range(2):  # before the first goal, and after it
        rig.until(lambda: not fast(), DEADLINE)
        assert fast() == []
        rig.goal((0.0, 0.0, 0.0)).assert_ended('SUCCEEDED')


def test_kinematics_receives_no_pressures_of_rigid_jams(rig):
    kinematics, = rig.start('kinematics', arm__stiffness_ratios=(10.0, 0.0, 10.0), ready=False)
    topics = [one.topic_name.removeprefix(f'{rig.namespace}/') for one in kinematics.subscriptions]
    assert [topic for topic in topics if topic.endswith('/pressure')] == [
        'segment_1/pressure', 'segment_3/pressure']
