# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the command lines of the emulators share: serve, execute typed commands, end cleanly."""

from collections.abc import Callable
from contextlib import AbstractContextManager
import sys
import threading
from typing import TypeVar

Emulator = TypeVar('Emulator')


def serve(program: str, make: Callable[[], AbstractContextManager[Emulator]],
          introduce: Callable[[Emulator], str], obey: Callable[[Emulator, str], str]) -> int:
    """
    Serve an emulator until ``quit`` or Ctrl-C; return the exit status.

    introduce: what to print first.  obey: carries out a typed line and returns what to print;
    raises ValueError for one that is wrong.
    """
    try:
        with make() as emulator:
            print(introduce(emulator), flush=True)
            for line in sys.stdin:
                if line.strip() == 'quit':
                    return 0
                try:
                    print(obey(emulator, line) if line.strip() else '', flush=True)
                except ValueError as error:
                    print(error, flush=True)
            threading.Event().wait()  # no terminal: serve until Ctrl-C
    except OSError as error:
        print(f'{program}: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        pass
    return 0
