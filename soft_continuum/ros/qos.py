# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The QoS profiles of the suite."""

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""State that late joiners need."""
STREAM = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
"""Streams that the suite publishes."""
COMMAND = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE,
                     lifespan=Duration(seconds=0.5))
"""Motion requests, which are not delivered late after a network failure."""
EVERY_STATE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE,
                         durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""State of which subscribers must not miss a change."""
OBSTACLES = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
"""Changes that must not be missed, from publishers of any durability."""
SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Subscribed streams: compatible with any publisher."""
