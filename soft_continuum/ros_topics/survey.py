# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Survey of the topics of a driver: publishers, rates and delays.  Sends nothing."""

from collections.abc import Iterator
from dataclasses import dataclass
import threading
from typing import Any

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.ros_topics.link import Listener, names

LISTENING = 2.0  # s
READ_INTERVAL = 0.02  # s
NAMES_TIMEOUT = 4.0
"""s; DDS repeats a lost name after 3 s."""
MIN_MESSAGES = 3.0
"""Messages that should come within the timeout, so that a lost one does no harm."""
MAX_LAG = 0.3
"""Difference of a stamp from this computer's time beyond which the clocks differ, s."""


@dataclass(frozen=True)
class Found:
    """Findings on a topic; step: the parameter that names it.  warning: empty for none."""

    step: str
    message: str
    warning: str = ''


def survey(driver: Any, clock: Clock = STEADY) -> Iterator[Found]:
    """
    Yield findings of LISTENING s on the topics of an open driver, which is read meanwhile.

    Raises HardwareError as the driver does.
    """
    link = driver.link
    topics = link.topics
    listeners = [topic for topic in topics if isinstance(topic, Listener)]
    before, begin = [listener.number for listener in listeners], clock()
    try:
        while clock() < begin + LISTENING:
            driver.read()
            clock.sleep(READ_INTERVAL)
    except HardwareError as error:  # such as for another publisher
        problem = link.wait_for_names(clock() + NAMES_TIMEOUT, threading.Event())
        raise HardwareError(problem or str(error)) from None
    passed = clock() - begin
    link.wait_for_names(clock() + NAMES_TIMEOUT, threading.Event())
    for listener, number in zip(listeners, before, strict=True):
        rate = (listener.number - number) / passed
        warnings = []
        if rate * listener.timeout < MIN_MESSAGES:
            warnings.append(f'{MIN_MESSAGES / listener.timeout:.0f} Hz or more are needed for a '
                            f'timeout of {listener.timeout:g} s')
        if abs(listener.lag) > MAX_LAG:
            warnings.append(f'its stamps are {listener.lag:.2f} s off the clock of this computer: '
                            'the clocks differ, or messages have no stamps')
        yield Found(listener.parameter, f'{listener.topic} from {names(listener.publishers)} at '
                    f'{rate:.0f} Hz', '; '.join(warnings))
    for topic in topics:
        if topic not in listeners:
            yield Found(topic.parameter, f'{topic.topic} to {names(topic.subscribers)}, with no '
                        'other publisher')
    if hasattr(driver, 'describe'):
        yield Found('joints', f'{driver.describe()}; if this is not what you measure, correct the '
                    'scales')
