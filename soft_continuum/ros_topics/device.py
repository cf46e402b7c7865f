# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Common base of devices on topics of other nodes: opening and closing."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
import threading
from typing import Any, TYPE_CHECKING

from soft_continuum.extras import needed
from soft_continuum.hardware.clock import Clock
from soft_continuum.hardware.protocols import HardwareError

if TYPE_CHECKING:
    from soft_continuum.ros_topics.link import RosLink

OPEN_TIMEOUT = 4.0
"""Time limit (s) of discovery and of the first states."""
NAMES_TIMEOUT = 1.5  # s more for the names of those who publish what is not theirs
POLL_INTERVAL = 0.01  # s


class RosDevice(ABC):
    """
    A driver that uses topics of other nodes as its device.

    It is open (``_opened``) once publishers, subscribers and first states were found.
    """

    node: Any = None
    """The node that uses this driver; None: it creates its own when opened."""
    driver = 'driver'
    """Kind of driver, for messages."""

    def __init__(self, clock: Clock) -> None:
        """Open nothing yet."""
        self._clock = clock
        self._lock = threading.RLock()  # of all that follows, and of what drivers add
        self._closing = threading.Event()
        self._opened = False
        self.link: RosLink | None = None

    @abstractmethod
    def _connect(self, link: 'RosLink') -> None:
        """Make the topics, with nothing received yet."""

    @abstractmethod
    def _take_first(self) -> str:
        """Take what came; return what is missing to be open, empty for nothing."""

    def open(self) -> None:
        """Find the topics and read the present state; raises HardwareError.  Nothing is sent."""
        self._closing.clear()
        with needed(HardwareError):
            from soft_continuum.ros_topics.link import RosLink
        try:
            with self._lock:
                link = self.link = RosLink(self.node, self._clock)
                self._connect(link)
            self._wait(link)
        except BaseException:
            self._disconnect()
            raise

    def _wait(self, link: 'RosLink') -> None:
        """Wait for publishers and subscribers, then for first states."""
        deadline = self._clock() + OPEN_TIMEOUT
        problem = link.wait_until(deadline, self._closing)
        while not self._closing.is_set():
            if problem:
                raise HardwareError(
                    link.wait_for_names(deadline + NAMES_TIMEOUT, self._closing) or problem)
            with self._lock:
                missing = self._take_first()
                if not missing:
                    self._opened = True
                    return
            if self._clock() > deadline:
                raise HardwareError(f'{missing} within {OPEN_TIMEOUT:g} s; are the publishers '
                                    'active?')
            self._clock.sleep(POLL_INTERVAL)
            problem = link.problem
        raise HardwareError(f'the {self.driver} was closed while it was being opened')

    def _disconnect(self) -> None:
        with self._lock:
            link, self.link, self._opened = self.link, None, False
        if link is not None:
            link.close()

    @contextmanager
    def _receiving(self) -> Iterator['RosLink']:
        """Raise HardwareError for all that fails while messages are taken."""
        if self.link is None:
            raise HardwareError(f'the {self.driver} is not open; configure the node')
        self.link.looks.look()
        try:
            yield self.link
        except HardwareError:
            raise
        except Exception as error:  # of rclpy, when its context was shut down
            raise HardwareError(f'ROS failed: {type(error).__name__}: {error}') from error
