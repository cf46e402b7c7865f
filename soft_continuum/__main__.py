# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m soft_continuum``: the command line."""

from contextlib import suppress
import os
import signal
import sys


def run() -> None:
    """Run the command line and end the process with its exit status."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # until there is something to take down
    from soft_continuum.cli.main import main
    try:
        status = main()
    except SystemExit as end:  # of argparse
        status = end.code if isinstance(end.code, int) else 1
    with suppress(BrokenPipeError):  # such as into head: what was printed so far was enough
        sys.stdout.flush()
    sys.stderr.flush()
    # Interrupted while it connects, there may be a thread that the interpreter would trip over.
    os._exit(status)


if __name__ == '__main__':
    run()
