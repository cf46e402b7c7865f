# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What doctor and calibrate need from drivers on topics; nothing is sent."""

from collections.abc import Iterator
import threading
from typing import Any

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.commissioning import Check, Drive, OK, WARN
from soft_continuum.hardware.protocols import HardwareError

DRIVE = Drive('ros_tendons.scales', 'ros_tendons.scales', inverse=True, zeros='ros_tendons.zeros',
              shared=True)
LISTENING = 2.0  # s
READ_INTERVAL = 0.02  # s
NAMES_TIMEOUT = 4.0
"""s; DDS repeats a lost name after 3 s."""
MIN_MESSAGES = 3.0
"""Messages that should come within the timeout, so that a lost one does no harm."""
MAX_LAG = 0.3
"""Difference of a stamp from this computer's time beyond which the clocks differ, s."""


def checks_opened(driver: Any) -> Iterator[Check]:
    """
    Yield publishers, rates and delays of the topics, from LISTENING s in which they are read.

    Raises HardwareError as the driver does.
    """
    from soft_continuum.ros_topics.link import Listener, names  # needs ROS, as the driver does
    link = driver.link
    topics = link.topics
    listeners = [topic for topic in topics if isinstance(topic, Listener)]
    before, begin = [listener.number for listener in listeners], STEADY()
    try:
        while STEADY() < begin + LISTENING:
            driver.read()
            STEADY.sleep(READ_INTERVAL)
    except HardwareError as error:  # such as for another publisher
        problem = link.wait_for_names(STEADY() + NAMES_TIMEOUT, threading.Event())
        raise HardwareError(problem or str(error)) from None
    passed = STEADY() - begin
    link.wait_for_names(STEADY() + NAMES_TIMEOUT, threading.Event())
    for listener, number in zip(listeners, before, strict=True):
        rate = (listener.number - number) / passed
        warnings = []
        if rate * listener.timeout < MIN_MESSAGES:
            warnings.append(f'{MIN_MESSAGES / listener.timeout:.0f} Hz or more are needed for a '
                            f'timeout of {listener.timeout:g} s')
        if abs(listener.lag) > MAX_LAG:
            warnings.append(f'its stamps are {listener.lag:.2f} s off the clock of this computer: '
                            'the clocks differ, or messages have no stamps')
        yield Check(listener.parameter, WARN if warnings else OK, '; '.join([
            f'{listener.topic} from {names(listener.publishers)} at {rate:.0f} Hz', *warnings]))
    for topic in topics:
        if topic not in listeners:
            yield Check(topic.parameter, OK, f'{topic.topic} to {names(topic.subscribers)}, with '
                        'no other publisher')
    if hasattr(driver, 'describe'):
        yield Check('joints', OK, f'{driver.describe()}; if this is not what you measure, correct '
                    'the scales')
