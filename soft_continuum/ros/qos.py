# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The QoS profiles of the suite."""

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""State that late joiners need."""
STREAM = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
"""Streams that we publish."""
COMMAND = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE,
                     lifespan=Duration(seconds=0.5))
"""Requests to move, which nobody carries out later: a network that comes back has none of them."""
EVERY_STATE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE,
                         durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""State of which no change may be missed by a subscriber."""
OBSTACLES = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
"""Changes of which none may be missed, of publishers of any durability."""
SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Streams that we subscribe to: compatible with any publisher."""
