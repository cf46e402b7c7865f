# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The command line as a process."""

from collections.abc import Sequence
import json
import os
from pathlib import Path
import pty
import select
import subprocess
import sys
import threading
from time import monotonic, sleep
from typing import Any

DEADLINE = 60.0  # s
SCRIPT = Path(__file__).parents[2] / 'bin' / 'soft_continuum'


class Command:
    """A running command: what it has written so far, and how it ended."""

    def __init__(self, arguments: Sequence[str], terminal: bool = False) -> None:
        """Start it; ``terminal``: its output goes to a pseudo-terminal."""
        if terminal:
            reading, writing = pty.openpty()
        else:
            reading, writing = os.pipe()
        self.process = subprocess.Popen(
            [sys.executable, SCRIPT, *arguments], stdin=subprocess.DEVNULL,
            stdout=writing, stderr=subprocess.PIPE, text=True)
        os.close(writing)
        self._reading = reading
        self._written = b''
        self._enough = False
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        while not self._enough:
            if not select.select([self._reading], [], [], 0.02)[0]:
                continue
            try:
                part = os.read(self._reading, 65536)
            except OSError:  # a terminal without a writer
                break
            if not part:
                break
            self._written += part
        os.close(self._reading)

    def stop_reading(self) -> None:
        """Close the reading end of its stdout, as head does."""
        self._enough = True
        self._reader.join(DEADLINE)

    @property
    def output(self) -> str:
        """What it has written to stdout."""
        return self._written.decode()

    def wait_for(self, text: str) -> None:
        """Wait until it has written ``text``."""
        deadline = monotonic() + DEADLINE
        while text not in self.output:
            assert self.process.poll() is None or self._reader.is_alive(), (
                f'ended without {text!r}: {self.output}')
            assert monotonic() < deadline, f'no {text!r} in: {self.output}'
            sleep(0.01)

    def end(self) -> tuple[int, str, str]:
        """Wait for its end; return exit status, stdout, stderr."""
        assert self.process.stderr is not None
        errors = self.process.stderr.read()
        status = self.process.wait(DEADLINE)
        self._reader.join(DEADLINE)
        return status, self.output, errors

    def documents(self) -> list[Any]:
        """Wait for its end; return what each line of stdout says as JSON."""
        return [json.loads(line) for line in self.end()[1].splitlines()]

    def close(self) -> None:
        """Kill it if it still runs."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait(DEADLINE)
        assert self.process.stderr is not None
        self.process.stderr.close()
        self.stop_reading()
