# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a node reports of itself reaches the log too."""

from types import SimpleNamespace
from typing import Any

import pytest

from soft_continuum.nodes import status as module
from soft_continuum.nodes.status import OK, Status, WARN
from support.ros_rig import Rig


@pytest.fixture
def logged(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the list of what the observer of the rig logs."""
    lines: list[str] = []

    class Logger:
        def __getattr__(self, _: str) -> Any:
            return lines.append

    monkeypatch.setattr(rig.observer, 'get_logger', Logger)
    return lines


def test_what_changes_fast_is_logged_once_it_lasts(
        rig: Rig, logged: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(module, 'time', SimpleNamespace(monotonic=lambda: now[0]))
    status = rig.on_ros_thread(Status, rig.observer, 'arm')
    for message in ('first', 'second', 'last'):
        rig.on_ros_thread(status.set, WARN, message)
    assert logged == ['first']
    now[0] = 2.0 * module.LOG_PERIOD
    rig.wait_for(lambda: len(logged) > 1, 'the last message in the log')
    assert logged == ['first', 'last']


def test_what_is_the_same_is_logged_once(rig: Rig, logged: list[str]) -> None:
    status = rig.on_ros_thread(Status, rig.observer, 'arm')
    for _ in range(3):
        rig.on_ros_thread(status.set, OK, 'idle')
    assert logged == ['idle']
