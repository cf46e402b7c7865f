# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Motions are accepted within limits or refused with the reason, and a stop always wins."""

from dataclasses import replace
from math import inf, nan
from operator import methodcaller

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.hardware.protocols import HardwareError, TendonReading
from soft_continuum.hardware.simulated_tendons import SimulatedTendons
from soft_continuum.hardware.tendon_controller import (
    JOIN_TOLERANCE,
    MotionRefusedError,
    Reason,
    TendonController,
    TendonLimits,
)
from support.virtual_clock import ToldClock

SPEED, ACCELERATION, STEP = 0.03, 0.3, 5e-6
TENDONS = ('right_tendon', 'left_tendon')
LIMITS = TendonLimits(TENDONS, (-0.02, 0.04), SPEED)
INTERVAL = 0.02  # s between updates
END = {'hold': methodcaller('hold'), 'stop': methodcaller('stop', '~/stop was called')}
BRAKING = SPEED**2 / (2 * ACCELERATION)  # m


class ObedientDriver:
    """A driver that is at once where it is sent, and keeps what it was told."""

    reference_moves = False

    def __init__(self):
        self.reading = TendonReading((0.0, 0.0), (0.0, 0.0), referenced=True)
        self.calls = []
        self.broken = ''

    def read(self):
        return self.reading

    def move(self, pulls, duration):
        self._called('move')
        self.reading = replace(self.reading, pulls=pulls)

    def stop(self):
        self._called('stop')
        self.reading = replace(self.reading, speeds=(0.0, 0.0))

    def reference(self):
        self._called('reference')
        self.reading = replace(self.reading, pulls=(0.0, 0.0), referenced=True)

    def _called(self, name):
        self.calls.append(name)
        if name == self.broken:
            raise HardwareError('unplugged')


class WatchedTendons(SimulatedTendons):
    """Simulated steppers that keep the set-points they were sent."""

    def __init__(self, clock):
        super().__init__(clock, TENDONS, SPEED, ACCELERATION, STEP)
        self.sent, self.due, self.intervals = [], [], []

    def move(self, pulls, duration):
        self.sent.append(pulls)
        self.due.append(self._clock() + duration)
        self.intervals.append(duration)
        super().move(pulls, duration)


class Rig:
    """A controller on a driver, and its clock."""

    def __init__(self, simulated=True):
        self.clock = ToldClock()
        self.driver = WatchedTendons(self.clock) if simulated else ObedientDriver()
        self.controller = TendonController(self.driver, LIMITS)

    def trajectory(self, *points, since=None):
        """Times, pulls and the present from points: (s from now, right, left)."""
        start = self.clock.now if since is None else since
        values = np.array(points, dtype=float).reshape(len(points), 3)
        return start + values[:, 0], values[:, 1:], self.clock.now

    def accept(self, *points, since=None):
        self.controller.accept(*self.trajectory(*points, since=since))

    def update(self, times=1, interval=INTERVAL):
        """Readings of some updates, each followed by its interval of time."""
        readings = []
        for _ in range(times):
            readings.append(self.controller.update(self.clock.now, interval))
            self.clock.now += interval
        return readings

    def rest(self):
        """Go on until the tendons rest; return the reading."""
        for _ in range(1000):
            reading, = self.update()
            if not self.controller.busy:
                return reading
        raise AssertionError('the tendons do not come to rest')


@pytest.fixture
def rig():
    return Rig()


@pytest.fixture
def obedient():
    return Rig(simulated=False)


def in_motion(rig):
    """Start a long motion and go half-way."""
    rig.accept((1.0, 0.02, -0.01))
    rig.update(25)
    return rig


# What is accepted, and how it is followed.


def test_nothing_is_sent_before_a_trajectory_is_accepted(obedient):
    obedient.update(50)
    obedient.controller.hold()
    assert obedient.driver.calls == []


@pytest.mark.parametrize('points', [
    [(0.5, 0.01, -0.01), (1.0, 0.015, -0.012)], [(2.0, 0.04, -0.02)],  # the whole travel
    [(-1.0, 0.03, 0.03), (0.5, 0.01, 0.0)],  # one is past, and left out
    [(-0.02, 0.0002, 0.0)]])  # shorter than its way here
def test_a_trajectory_is_followed_to_its_end_and_held_there(rig, points):
    rig.accept(*points)
    assert rig.controller.following
    assert rig.rest().pulls == pytest.approx(points[-1][1:], abs=STEP)
    assert not rig.controller.following
    assert rig.update(50)[-1].pulls == pytest.approx(points[-1][1:], abs=STEP)


@pytest.mark.parametrize('points', [
    [(0.5, 0.01, -0.01), (1.0, 0.015, -0.012)],
    [(2.0, 0.01, 0.0), (3.0, 0.02, 0.0)]])  # it starts later, and is approached until then
def test_set_points_lie_on_the_trajectory_one_interval_ahead_and_tendons_near_them(rig, points):
    rig.accept(*points)
    times, *pulls = np.array([(0.0, 0.0, 0.0), *points]).T
    for n in range(1, 51):
        reading, = rig.update()
        assert rig.driver.sent[-1] == pytest.approx(
            [np.interp(n * INTERVAL, times, pull) for pull in pulls], abs=1e-9)
        lag = np.abs(np.subtract(reading.pulls, rig.driver.sent[-1])).max()
        assert lag <= BRAKING + SPEED * INTERVAL


@pytest.mark.parametrize('updates', [0, 5])
def test_what_an_update_came_late_is_not_caught_up_but_added_to_the_rest(rig, updates):
    rig.accept((1.0, 0.02, -0.01))
    rig.update(updates)
    rig.clock.now += 0.3
    for n in range(updates + 1, 50):
        rig.update()
        assert rig.driver.sent[-1] == pytest.approx((0.02 * n / 50, -0.01 * n / 50), abs=1e-9)
        assert rig.controller.delay == pytest.approx(0.3)
    assert rig.rest().pulls == pytest.approx((0.02, -0.01), abs=STEP)


@pytest.mark.parametrize('late', [0.0, 0.3])
def test_a_plan_begins_at_the_present_set_point_and_changes_nothing(late):
    disturbed, undisturbed = in_motion(Rig()), in_motion(Rig())
    for each in disturbed, undisturbed:
        each.clock.now += late
        each.update()
    _, pulls = disturbed.controller.plan(*disturbed.trajectory((0.5, 0.02, -0.01)))
    assert pulls[0] == pytest.approx(disturbed.driver.sent[-1])
    assert pulls[-1] == pytest.approx((0.02, -0.01))
    assert disturbed.rest() == undisturbed.rest()


# What is refused: the message says what was asked for and what is allowed.

REFUSALS = {
    'not a number': ([(0.5, nan, 0.0)], ['finite']),
    'infinite': ([(0.5, 0.0, -inf)], ['finite']),
    'at no time': ([(nan, 0.01, 0.0)], ['finite']),
    'times that do not increase': (
        [(0.5, 0.001, 0.0), (0.5, 0.002, 0.0)], ['time_from_start', 'increase']),
    'times that go back': (
        [(0.6, 0.001, 0.0), (0.5, 0.002, 0.0)], ['time_from_start', 'increase']),
    'past': ([(-2.0, 0.0, 0.0), (-0.5, 0.01, 0.0)], ['ended 0.500 s ago', 'header.stamp']),
    'pulled too far': (
        [(5.0, 0.041, 0.0)], ['0.041', 'pull_limits', '-0.02 to 0.04 m']),
    'paid out too far': (
        [(5.0, 0.0, -0.021)], ['-0.021', 'pull_limits', '-0.02 to 0.04 m']),
    'too fast': ([(0.1, 0.03, 0.0)], ['speed_limit', '0.03 m/s']),
    'too fast later on': (
        [(1.0, 0.02, 0.0), (1.1, 0.03, 0.0)], ['0.1 m/s', 'speed_limit', '0.03 m/s']),
    'a jump': ([(0.001, 0.035, 0.0), (2.0, 0.035, 0.0)], ['speed_limit', '0.03 m/s']),
}


@pytest.mark.parametrize(('points', 'words'), REFUSALS.values(), ids=REFUSALS)
def test_a_trajectory_is_refused_with_what_was_asked_and_what_is_allowed(obedient, points, words):
    disturbed, undisturbed = in_motion(Rig()), in_motion(Rig())
    for rig in obedient, disturbed:
        with pytest.raises(MotionRefusedError) as refused:
            rig.accept(*points)
        text = str(refused.value)
        assert all(word in text for word in words)
        limits = 'pull_limits' in text or 'speed_limit' in text
        assert refused.value.reason is (Reason.BEYOND_LIMITS if limits else
                                        Reason.LATE if 'ago' in text else Reason.INVALID)
    obedient.update(50)
    assert obedient.driver.calls == []
    assert disturbed.rest() == undisturbed.rest()  # the present one goes on
    assert disturbed.driver.sent == undisturbed.driver.sent


def test_a_driver_that_lost_its_position_is_not_moved(obedient):
    obedient.driver.reading = replace(obedient.driver.reading, referenced=False)
    obedient.update()
    with pytest.raises(MotionRefusedError, match='not referenced; .* ~/reference') as refused:
        obedient.accept((1.0, 0.01, 0.0))
    assert refused.value.reason is Reason.NOT_REFERENCED
    obedient.controller.reference()
    obedient.accept((1.0, 0.01, 0.0))


@pytest.mark.parametrize('spacing', [1e-3, 1e-5])
def test_many_small_steps_are_no_way_around_the_speed_limit(rig, spacing):
    count = 1000
    way = np.arange(1, count + 1) * 1.2 * SPEED * spacing
    with pytest.raises(MotionRefusedError, match='speed_limit'):
        rig.accept(*np.stack([spacing * np.arange(1, count + 1), way, 0.0 * way], axis=1))


@pytest.mark.parametrize('epoch', [0.0, 1.8e9])
@pytest.mark.parametrize('spacing', [1e-2, 1e-3])
def test_a_motion_at_the_speed_limit_is_accepted_however_time_is_counted(rig, epoch, spacing):
    rig.clock.now = epoch + 0.1
    way = np.arange(1, 101) * SPEED * spacing
    rig.accept(*np.stack([spacing * np.arange(1, 101), way, -0.5 * way], axis=1))
    assert rig.controller.following


@pytest.mark.parametrize('names', [('a',), ('a', 'b', 'c')])
def test_any_number_of_tendons_is_moved_and_named(names):
    clock = ToldClock()
    driver = SimulatedTendons(clock, names, SPEED, ACCELERATION, STEP)
    controller = TendonController(driver, TendonLimits(names, LIMITS.pull_limits, SPEED))
    goal = np.linspace(0.01, 0.005, len(names))
    controller.accept(np.array([clock.now + 1.0]), goal[None, :], clock.now)
    for _ in range(100):
        reading = controller.update(clock.now, INTERVAL)
        clock.now += INTERVAL
    assert reading.pulls == pytest.approx(goal, abs=STEP)
    with pytest.raises(MotionRefusedError, match=f'pulls of {names[-1]} reach'):
        controller.accept(np.array([clock.now + 9.0]), np.r_[goal[:-1], 0.05][None, :], clock.now)


@pytest.mark.parametrize('shape', [(0, 2), (1, 1), (1, 3), (2, 2)])
def test_pulls_that_are_not_one_for_each_tendon_and_time_are_refused_with_the_names(rig, shape):
    times = rig.clock.now + np.arange(1.0, 1.0 + min(shape[0], 1))
    with pytest.raises(MotionRefusedError, match='right_tendon, left_tendon') as refused:
        rig.controller.accept(times, np.zeros(shape), rig.clock.now)
    assert refused.value.reason is Reason.INVALID


# One trajectory after another.


@pytest.mark.parametrize('braking', [False, True])
def test_a_replacement_takes_over_from_the_last_set_point_without_a_jump(rig, braking):
    start = in_motion(rig).controller.reading.pulls
    first = 0
    if braking:
        rig.controller.hold()
        rig.update()
        assert rig.controller.reading.moving
        first, start = len(rig.driver.sent) - 1, (0.02, -0.01)
    rig.accept((1.0 if braking else 0.5, *start), (2.0, 0.0, 0.0))
    rig.rest()
    jumps = np.abs(np.diff(rig.driver.sent[first:], axis=0))
    assert jumps.max() <= SPEED * INTERVAL + JOIN_TOLERANCE


def test_the_same_motion_sent_piece_by_piece_is_the_same_motion():
    times = np.linspace(0.0, 2.0, 41)
    pulls = np.stack([0.02 * np.sin(times), -0.01 * np.sin(times)], axis=1)
    whole, pieces = Rig(), Rig()
    start = whole.clock.now
    whole.controller.accept(start + times, pulls, start)
    for _ in range(100):
        now = pieces.clock.now - INTERVAL / 2  # between the updates
        ahead = (start + times > now) & (start + times <= now + 0.5)
        pieces.controller.accept(start + times[ahead], pulls[ahead], now)
        pieces.update()
        whole.update()
    assert np.array(pieces.driver.sent) == pytest.approx(
        np.array(whole.driver.sent[:len(pieces.driver.sent)]), abs=1e-9)


@pytest.mark.parametrize('left', [0.001, 0.019, 0.021, 0.03])
def test_a_replacement_that_ends_before_the_next_set_point_is_accepted_or_refused(rig, left):
    in_motion(rig)
    rig.clock.now -= INTERVAL  # right after an update
    try:
        rig.accept((left, 0.0102, -0.0051))
    except MotionRefusedError:
        assert rig.controller.following
    for _ in range(100):
        reading, = rig.update()
    assert not reading.moving


def test_a_motion_back_starts_from_the_set_point_and_not_from_the_target(rig):
    in_motion(rig)
    rig.accept((1.0, 0.0, 0.0))
    rig.update()
    assert rig.driver.sent[-1][0] < rig.driver.sent[-2][0]
    assert rig.rest().pulls == pytest.approx((0.0, 0.0), abs=STEP)


# Hold, stop and resume.


@pytest.mark.parametrize('ending', ['hold', 'stop'])
def test_a_hold_or_a_stop_ends_the_motion_within_the_braking_distance(rig, ending):
    moving = in_motion(rig).driver.read()
    END[ending](rig.controller)
    assert not rig.controller.following
    assert np.abs(np.subtract(rig.rest().pulls, moving.pulls)).max() <= BRAKING + 2 * STEP
    if ending == 'hold':  # it is ready for the next motion
        rig.accept((1.0, 0.0, 0.0))
        assert rig.rest().pulls == pytest.approx((0.0, 0.0), abs=STEP)


def test_a_hold_also_ends_a_motion_whose_last_set_point_was_just_sent(rig):
    rig.accept((INTERVAL / 2, 0.0004, 0.0))
    rig.controller.update(rig.clock.now, INTERVAL)
    rig.controller.hold()
    rig.clock.now += 1.0
    assert rig.driver.read().pulls == (0.0, 0.0)


@pytest.mark.parametrize('reason', ['~/stop was called', ''])
def test_after_a_stop_every_motion_is_refused_until_resume_which_moves_nothing(rig, reason):
    in_motion(rig).controller.stop(reason)
    rest, sent = rig.rest().pulls, list(rig.driver.sent)
    for _ in range(3):
        with pytest.raises(MotionRefusedError, match=f'{reason}.*~/resume') as refused:
            rig.accept((1.0, *rest))
        assert refused.value.reason is Reason.STOPPED
        assert rig.update(20)[-1].pulls == rest
    rig.controller.resume()
    assert rig.update(100)[-1].pulls == rest and rig.driver.sent == sent
    rig.accept((1.0, 0.0, 0.0))
    assert rig.rest().pulls == pytest.approx((0.0, 0.0), abs=STEP)


@pytest.mark.parametrize('braking', [False, True])
def test_the_set_point_after_resume_is_the_measured_position(rig, braking):
    in_motion(rig).controller.stop('~/stop was called')
    reading, = rig.update() if braking else [rig.rest()]
    assert reading.moving is braking
    rig.controller.resume()
    _, pulls = rig.controller.plan(*rig.trajectory((1.0, 0.0, 0.0)))
    assert pulls[0] == pytest.approx(reading.pulls, abs=1e-12)
    with pytest.raises(MotionRefusedError, match='speed_limit'):
        rig.accept((0.05, 0.02, -0.01))  # from where the stopped one would have been


def test_a_second_stop_changes_only_the_reason(rig):
    in_motion(rig).controller.stop('first')
    rest = rig.rest().pulls
    rig.controller.stop('second')
    assert rig.controller.stopped_because == 'second'
    assert rig.update(50)[-1].pulls == rest


def test_a_stop_reaches_the_driver_even_at_rest(obedient):
    obedient.controller.stop('~/stop was called')
    assert obedient.driver.calls == ['stop']


@pytest.mark.parametrize('ending', ['stop', 'hold'])
def test_a_stop_that_does_not_reach_the_device_still_ends_the_motion(obedient, ending):
    obedient.accept((1.0, 0.02, -0.01))
    obedient.update(5)
    obedient.driver.broken = 'stop'
    with pytest.raises(HardwareError):
        END[ending](obedient.controller)
    obedient.driver.calls.clear()
    obedient.update(50)
    assert 'move' not in obedient.driver.calls


# Reference.


def test_a_reference_makes_the_present_position_zero(rig):
    in_motion(rig)
    rig.rest()
    rig.controller.reference()
    assert rig.controller.reading.pulls == (0.0, 0.0)
    rig.accept((1.0, 0.01, 0.0))
    assert rig.rest().pulls == pytest.approx((0.01, 0.0), abs=STEP)


@pytest.mark.parametrize('braking', [False, True])
def test_a_reference_is_refused_while_the_tendons_move_or_brake(rig, braking):
    in_motion(rig)
    if braking:
        rig.controller.hold()
        rig.update()
    with pytest.raises(MotionRefusedError, match='moving'):
        rig.controller.reference()
    assert braking or rig.rest().pulls == pytest.approx((0.02, -0.01), abs=STEP)


def test_a_reference_does_not_lift_a_stop(rig):
    rig.controller.stop('~/stop was called')
    rig.controller.reference()
    with pytest.raises(MotionRefusedError, match='resume'):
        rig.accept((1.0, 0.01, 0.0))


# Whatever is called, in whatever order.

points = st.lists(
    st.tuples(st.floats(0.001, 1.0), st.floats(-0.02, 0.04), st.floats(-0.02, 0.04)),
    min_size=1, max_size=4)
operations = st.one_of(
    st.tuples(st.just('accept'), points, st.floats(-0.5, 0.5)),
    st.tuples(st.just('go on'), st.floats(0.001, 1.0), st.floats(-1.0, 1.0),
              st.floats(-1.0, 1.0)),
    st.tuples(st.sampled_from(['hold', 'stop', 'resume', 'reference', 'refuse'])),
    st.tuples(st.just('update'), st.integers(1, 40), st.floats(0.001, 0.1)))


def operate(rig, name, *arguments):
    """Do one thing that a user could; return what it was refused with."""
    try:
        if name == 'accept':
            steps, start = arguments
            values = np.array(steps)
            values[:, 0] = start + np.cumsum(values[:, 0])
            rig.accept(*values)
        elif name == 'go on':  # at an allowed speed, from about where the tendons are
            duration, *shares = arguments
            rig.accept((duration, *np.clip(
                rig.controller.reading.pulls + duration * SPEED * np.array(shares),
                *LIMITS.pull_limits)))
        elif name == 'refuse':
            rig.accept((0.5, nan, nan))
        elif name == 'update':
            rig.update(*arguments)
        else:
            END.get(name, methodcaller(name))(rig.controller)
    except MotionRefusedError as error:
        return str(error)
    return ''


@settings(max_examples=120)
@given(st.lists(operations, max_size=12))
def test_limits_hold_a_stop_wins_and_the_arm_can_be_brought_back(script):
    rig, stopped = Rig(), False
    last, spare = None, 0.0  # m that joining may take beyond the limit, over its first part
    low, high = LIMITS.pull_limits
    for name, *arguments in script:
        first = len(rig.driver.sent)
        refusal = operate(rig, name, *arguments)
        # Nothing is sent after a stop before a resume.
        stopped = name == 'stop' or (stopped and name != 'resume')
        if stopped:
            assert len(rig.driver.sent) == first
            assert refusal or name not in ('accept', 'go on', 'refuse')
        # Set-points are as far apart as the speed limit allows.
        if not refusal and name in ('accept', 'go on'):
            spare += JOIN_TOLERANCE
        if name not in ('accept', 'go on', 'update', 'refuse'):
            last = None  # from here on set-points start from where the tendons are by then
        for due, interval, pulls in zip(
                rig.driver.due[first:], rig.driver.intervals[first:], rig.driver.sent[first:],
                strict=True):
            if last is not None:
                time = max(interval, abs(due - last[0]))
                moved = np.abs(np.subtract(pulls, last[1])).max()
                spare -= max(0.0, moved - SPEED * time - STEP)
                assert spare >= 0.0
            last = due, pulls
        assert all(low - STEP <= pull <= high + STEP for pull in rig.driver.read().pulls)
    rig.controller.stop('enough')
    rig.clock.now += 0.2
    rest = rig.driver.read()
    assert not rest.moving and rig.rest().pulls == rest.pulls
    rig.controller.resume()
    rig.accept((3.0, 0.0, 0.0))
    assert rig.rest().pulls == pytest.approx((0.0, 0.0), abs=STEP)
