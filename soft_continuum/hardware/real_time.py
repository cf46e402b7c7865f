# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Priority for processes that control devices, where the system allows it."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
import os
import threading

PRIORITY = 20
"""Among real-time threads, of 1 to 99: below those of the kernel that serve the ports."""
NICENESS = -15
"""Of the other threads of the process: control waits for what they hold, as the interpreter."""
LIMITS = '/etc/security/limits.d/99-soft_continuum.conf'


def ask_for_real_time() -> bool:
    """
    Let the calling thread go on before all that is not real-time (SCHED_FIFO).

    Returns whether the system allows it; without, a busy computer may keep it waiting for longer
    than devices wait for it.  What the thread starts has the usual priority.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK,
                              os.sched_param(PRIORITY))
    except OSError:
        return False
    return True


def ask_for_a_larger_share() -> None:
    """
    Let all threads of this process, and those that it starts, go on before those of most others.

    Else a busy computer keeps a thread that holds the interpreter, or a lock of DDS, from running,
    and with it the thread that talks to the device.  Real-time priority is none of theirs: threads
    of the kernel that hand on what a serial port receives have the usual one, and would wait
    for whatever this process computes.  Where the system does not allow it, nothing changes.
    """
    with suppress(OSError):
        for thread in os.listdir('/proc/self/task'):
            os.setpriority(os.PRIO_PROCESS, int(thread), NICENESS)


def priority_allowed() -> tuple[bool, bool]:
    """Return whether threads of this user may have each of both; the calling one stays as is."""
    def ask() -> tuple[bool, bool]:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
            return ask_for_real_time(), True
        return ask_for_real_time(), False

    with ThreadPoolExecutor(1) as pool:
        return pool.submit(ask).result()
