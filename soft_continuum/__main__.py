# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The processes of the command line: ``python -m soft_continuum VERB`` and ``ros2 run``."""

import os
from pathlib import Path
import signal
import sys
import threading
from typing import NoReturn

from soft_continuum.ros.environment import choose_log_folder, choose_own_network


def run() -> NoReturn:
    """Run ``soft_continuum VERB`` and end the process with its exit status."""
    _run(sys.argv[1:])


def ros2_run() -> NoReturn:
    """Run the verb that this executable is named for, as ``ros2 run`` starts it."""
    _run([Path(sys.argv[0]).name, *sys.argv[1:]])


def _run(words: list[str]) -> NoReturn:
    # Until there is something to shut down, Ctrl-C ends the process at once without output.
    signal.signal(signal.SIGINT, lambda *_: os._exit(130))
    # The matrices of an arm are small: more threads only wait for each other and delay control.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    choose_own_network()
    choose_log_folder(os.environ)
    from soft_continuum.ui.cli.main import main
    try:
        status = main(words)
    except SystemExit as end:  # of argparse
        status = end.code if isinstance(end.code, int) else 1
    try:
        sys.stdout.flush()
    except BrokenPipeError:  # such as into head: what was printed so far was enough
        os._exit(status)
    sys.stderr.flush()
    if threading.active_count() > 1:  # such as of a verb that was interrupted while it connected
        os._exit(status)
    # With all that DDS still has: a thread of it that ends inside a lock in shared memory would
    # hold up every other process that uses it.
    sys.exit(status)


if __name__ == '__main__':
    run()
