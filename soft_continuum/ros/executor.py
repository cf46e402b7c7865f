# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The executor that serves these nodes best: events, in one thread."""

import sys

from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor

try:
    from rclpy.experimental import EventsExecutor
except ImportError:  # before rclpy 7.1.4
    EventsExecutor = None


def make_executor(context: Context | None = None) -> Executor:
    """
    Return an executor of a context, by default that of the process.

    That of events writes to the file behind stderr where it crashes.  Where there is none, as in
    some notebooks, it is the slower one without events.
    """
    try:
        sys.stderr.fileno()
    except (AttributeError, OSError, ValueError):
        return SingleThreadedExecutor(context=context)
    return (EventsExecutor or SingleThreadedExecutor)(context=context)
