# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What does not change is sent ten times a second; every reading of a motion is sent."""

from typing import Any

import pytest

from soft_continuum.nodes.threads import RestingStream
from support.ros_rig import DEADLINE, Rig
from support.steered_tendons import PERIOD, Steered


def test_tendons_at_rest_are_reported_ten_times_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    steered = Steered(monkeypatch)
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


def test_a_pressure_is_sent_at_once_when_it_changes_or_anything_else_does() -> None:
    stream = RestingStream(200.0)
    assert stream.due(0.0, 'soft', (1e5, 1e5))
    assert not stream.due(0.05, 'soft', (1e5 + 150.0, 1e5))
    assert stream.due(0.1, 'soft', (1e5 + 150.0, 1e5))
    assert stream.due(0.15, 'soft', (1e5 + 150.0, 1e5 - 201.0))
    assert stream.due(0.2, 'stiff', (1e5 + 150.0, 1e5 - 201.0))
    assert not stream.due(0.25, 'stiff', (1e5 + 150.0, 1e5 - 201.0))
    assert stream.due(0.26, 'stiff', (float('nan'), 1e5 - 201.0))


def test_a_slow_drift_is_sent_once_it_is_as_large_as_the_resolution() -> None:
    stream, drift = RestingStream(1.0), [0.3 * k for k in range(10)]
    sent = [stream.due(1e-3 * k, None, (value,)) for k, value in enumerate(drift)]
    assert sent == [True, False, False, False] * 2 + [True, False]


def test_an_arm_at_rest_has_no_timer_of_more_than_ten_hertz(rig: Rig) -> None:
    nodes = rig.start_arm()

    def fast() -> list[Any]:
        return [(node.get_name(), timer.timer_period_ns) for node in nodes for timer in node.timers
                if timer.timer_period_ns < 1e8 and not timer.is_canceled()]

    for _ in range(2):  # before the first goal, and after it
        rig.until(lambda: not fast(), DEADLINE)
        assert fast() == []
        rig.goal((0.0, 0.0, 0.0)).assert_ended('SUCCEEDED')


def test_kinematics_receives_no_pressures_of_rigid_jams(rig: Rig) -> None:
    kinematics, = rig.start('kinematics', arm__stiffness_ratios=(10.0, 0.0, 10.0), ready=False)
    topics = [one.topic_name.removeprefix(f'{rig.namespace}/') for one in kinematics.subscriptions]
    assert [topic for topic in topics if topic.endswith('/pressure')] == [
        'segment_1/pressure', 'segment_3/pressure']
