# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The executor of the nodes: EventsExecutor, in one thread."""

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

    EventsExecutor needs a file behind stderr.  Without one, as in some notebooks, this is the
    slower SingleThreadedExecutor.
    """
    try:
        sys.stderr.fileno()
    except (AttributeError, OSError, ValueError):
        return SingleThreadedExecutor(context=context)
    return (EventsExecutor or SingleThreadedExecutor)(context=context)
