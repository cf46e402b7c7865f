# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a node reports of itself reaches the log too."""

from types import SimpleNamespace

import pytest

from soft_continuum.nodes import suite_node as module
from soft_continuum.nodes.suite_node import ERROR, OK, Status, WARN
from soft_continuum.ros.names import RECORDER, TELEOP
from soft_continuum_interfaces.msg import RecorderState, TeleopState
from support.ros_rig import LATCHED


@pytest.fixture
def logged(rig, monkeypatch):
    """Return the list of what the observer of the rig logs."""
    lines = []

    class Logger:
        def __getattr__(self, _):
            return lines.append

    monkeypatch.setattr(rig.observer, 'get_logger', Logger)
    return lines


def test_the_state_of_a_node_that_rests_is_repeated_with_the_time_of_its_change(rig):
    states = {name: rig.record(kind, f'{name}/state', LATCHED) for name, kind in (
        (RECORDER, RecorderState), (TELEOP, TeleopState))} | rig.states
    rig.start_arm()
    rig.start(RECORDER, TELEOP, ready=False)

    def repeated(recording):
        """Whether the last three messages are the same, stamp and all."""
        return len(recording) > 3 and all(one == recording.last for one in list(recording)[-3:])

    rig.wait_for(lambda: all(map(repeated, states.values())), 'three of each', within=20.0)


def test_what_changes_fast_is_logged_once_it_lasts(rig, logged, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(module, 'time', SimpleNamespace(monotonic=lambda: now[0]))
    status = rig.on_ros_thread(Status, rig.observer, 'arm')
    for message in ('first', 'second', 'last'):
        rig.on_ros_thread(status.set, WARN, message)
    assert logged == ['first']
    now[0] = 2.0 * module.LOG_PERIOD
    rig.wait_for(lambda: len(logged) > 1, 'the last message in the log')
    assert logged == ['first', 'last']


def test_what_is_the_same_is_logged_once(rig, logged):
    status = rig.on_ros_thread(Status, rig.observer, 'arm')
    for _ in range(3):
        rig.on_ros_thread(status.set, OK, 'idle')
    assert logged == ['idle']


@pytest.mark.parametrize(('texts', 'lines'), [
    (['has 0.0 kPa', 'has -0.0 kPa', 'has 0 kPa', 'has 12.5 kPa'], 1),
    (['silent for 0.26 s', 'silent for 3 s', 'silent for 1.2e+03 s'], 1),
    (['servo 1: has 3 N', 'servo 2: has 3 N'], 2), (['step 1 of 3', 'step 2 of 3'], 2)])
def test_a_fault_is_logged_once_while_only_what_is_measured_of_it_changes(
        rig, logged, monkeypatch, texts, lines):
    monkeypatch.setattr(module, 'LOG_PERIOD', -1.0)
    status = rig.on_ros_thread(Status, rig.observer, 'arm')
    for text in texts * 2:
        rig.on_ros_thread(status.set, ERROR, text)
    assert len(logged) == lines * (2 if lines > 1 else 1)
