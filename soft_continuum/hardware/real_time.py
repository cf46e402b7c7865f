# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Real-time priority for processes that control devices, where the system allows it."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
import os

PRIORITY = 20
"""Among real-time threads, of 1 to 99: below those of the kernel that serve the ports."""
OTHERS_PRIORITY = 1
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


def ask_for_real_time_around_it() -> None:
    """
    Let all threads of this process, and those that it starts, have the lowest one (SCHED_RR).

    Else a busy computer keeps a thread that holds the interpreter, or a lock of DDS, from running,
    and with it the thread that talks to the device.
    """
    with suppress(OSError):
        for thread in os.listdir('/proc/self/task'):
            os.sched_setscheduler(int(thread), os.SCHED_RR, os.sched_param(OTHERS_PRIORITY))


def real_time_allowed() -> bool:
    """Return whether threads of this user may have it; the calling one stays as it is."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(ask_for_real_time).result()
