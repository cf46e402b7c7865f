# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The executor that serves these nodes best: events, in one thread."""

try:
    from rclpy.experimental import EventsExecutor as BestExecutor
except ImportError:  # before rclpy 7.1.4
    from rclpy.executors import SingleThreadedExecutor as BestExecutor

__all__ = ['BestExecutor']
