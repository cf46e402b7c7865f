# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The emergency stop of the suite."""

from collections.abc import Callable
from functools import partial
from time import monotonic
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool

from soft_continuum.ros.entries import LOG_PERIOD, repeat, subscribe
from soft_continuum.ros.names import TELEOP
from soft_continuum.text import plain

TOPIC = 'emergency_stop'
PERIOD = 0.1  # s between two looks at who publishes it
TELEOP_TIMEOUT = 0.5  # s; teleop repeats its emergency stop every 0.05 s
DEPTH = 100
"""Queue length over all publishers: a false of one must not displace a true."""
ANY = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)


class EmergencyStop:
    """
    Subscribes to emergency_stop (std_msgs/Bool): true stops the arm, false allows to resume.

    A true of any publisher counts at once.  rclpy does not report the sender of a message, so a
    false counts only while no other publisher exists that may have turned it on.  Teleop always is
    one, but repeats its true: while it does not, others count.

    No QoS of ROS 2 matches every publisher and also receives latched messages.  So the
    subscription uses the strictest QoS that all present publishers offer.  While it is replaced,
    both exist, and the old one can only stop.
    """

    def __init__(self, node: Any, on_change: Callable[[bool], None] = lambda on: None) -> None:
        """Call ``on_change`` whenever it is turned on or off."""
        self.on = False
        self._node, self._on_change = node, on_change
        self._topic = node.resolve_topic_name(TOPIC)
        self._true_time = 0.0  # s (steady), when the last true came
        self._known: set[bytes] = set()  # publishers at the last look
        self._old: Any = None
        self._begin(ANY)
        repeat(node, PERIOD, self._check_now)

    def _begin(self, profile: QoSProfile) -> None:
        self._profile = profile
        self._subscription = subscribe(
            self._node, Bool, TOPIC, partial(self._on_message, profile), profile)

    def _check_now(self) -> None:
        if self._old is not None:
            self._node.destroy_subscription(self._old)
            self._old = None
        if not self._known and not self._subscription.get_publisher_count():
            return  # to list them takes many times as long; ANY, which is used now, matches all
        present = {bytes(info.endpoint_gid): info.qos_profile for info in self._publishers()}
        profiles, profile = present.values(), ANY
        if present and all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles):
            latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
            # A message latched before it was turned on would arrive again, and turn it off.
            outdated = (self.on and self._profile is not LATCHED
                        and not self._known.isdisjoint(present))
            profile = LATCHED if latched and not outdated else RELIABLE
        self._known = set(present)
        if profile is not self._profile:
            self._old = self._subscription
            self._begin(profile)

    def _publishers(self) -> list[Any]:
        return list(self._node.get_publishers_info_by_topic(self._topic))

    def _on_message(self, profile: QoSProfile, message: Bool) -> None:
        if message.data:
            self._true_time = monotonic()
        elif not self.on or profile is not self._profile or self._may_be_of_others():
            return
        if message.data != self.on:
            self.on = message.data
            self._on_change(self.on)

    def _may_be_of_others(self) -> bool:
        """Return whether a publisher other than the sender of false may hold it on, and log it."""
        names = [info.node_name for info in self._publishers()]
        others = sorted(plain(name) for name in names if name != TELEOP)
        if TELEOP in names and monotonic() - self._true_time < TELEOP_TIMEOUT:
            others.append(TELEOP)
        if len(others) > 1:
            self._node.get_logger().warning(
                f'{TOPIC} stays on: {" and ".join(others)} publish it, and any of them may hold '
                'it on; stop all but the one that turns it off', throttle_duration_sec=LOG_PERIOD)
        return len(others) > 1
