# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Priority for processes that control devices, where the system allows it."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
import os
import threading

PRIORITY = 20
"""Real-time priority, 1 to 99: below the kernel threads that serve the ports."""
NICENESS = -15
"""Nice value of the other threads: control waits for their locks, such as the interpreter's."""
LIMITS = '/etc/security/limits.d/99-soft_continuum.conf'


def ask_for_real_time() -> bool:
    """
    Give the calling thread real-time priority (SCHED_FIFO).

    Returns whether the system allows it; without it, a busy computer may delay the thread for
    longer than the timeouts of devices.  Threads that it starts have the usual priority.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK,
                              os.sched_param(PRIORITY))
    except OSError:
        return False
    return True


def ask_for_a_larger_share() -> None:
    """
    Raise the priority of all threads of this process, and of those that it starts.

    Otherwise a busy computer delays a thread that holds the interpreter, or a lock of DDS, and
    with it the thread that talks to the device.  They must not have real-time priority: the kernel
    threads that deliver serial data have the usual one and would wait for all computations of this
    process.  If the system does not allow it, nothing changes.
    """
    with suppress(OSError):
        for thread in os.listdir('/proc/self/task'):
            os.setpriority(os.PRIO_PROCESS, int(thread), NICENESS)


def priority_allowed() -> tuple[bool, bool]:
    """Return whether threads of this user may have each of the two priorities; changes nothing."""
    def ask() -> tuple[bool, bool]:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
            return ask_for_real_time(), True
        return ask_for_real_time(), False

    with ThreadPoolExecutor(1) as pool:
        return pool.submit(ask).result()
