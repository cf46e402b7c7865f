# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The command line as a process, also on a terminal that somebody types at."""

from collections.abc import Sequence
import fcntl
import json
import os
from pathlib import Path
import pty
import select
import signal
import struct
import subprocess
import sys
import termios
import threading
from time import monotonic, sleep
from typing import Any, Self

DEADLINE = 60.0  # s
CTRL_C = '\x03'
SCRIPT = Path(__file__).parents[2] / 'bin' / 'soft_continuum'


class Command:
    """A running command: what it has written so far, and how it ended."""

    def __init__(self, arguments: Sequence[str], terminal: bool = False) -> None:
        """Start it; ``terminal``: its output goes to a pseudo-terminal."""
        reading, writing = pty.openpty() if terminal else os.pipe()
        self._begin(reading, writing, subprocess.Popen(
            [sys.executable, SCRIPT, *arguments], stdin=subprocess.DEVNULL,
            stdout=writing, stderr=subprocess.PIPE, text=True))

    def _begin(self, reading: int, writing: int, process: 'subprocess.Popen[str]') -> None:
        """Read what a process writes to the other end."""
        os.close(writing)
        self.process, self._reading = process, reading
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
        """Close the reading end of its stdout, as head does, or the window of its terminal."""
        self._enough = True
        self._reader.join(DEADLINE)

    @property
    def output(self) -> str:
        """What it has written to stdout."""
        return self._written.decode(errors='replace')

    def wait_for(self, text: str, begin: int = 0) -> None:
        """Wait until it has written ``text`` after so many characters."""
        deadline = monotonic() + DEADLINE
        while text not in self.output[begin:]:
            assert self.process.poll() is None or self._reader.is_alive(), (
                f'ended without {text!r}: {self.output}')
            assert monotonic() < deadline, f'no {text!r} in: {self.output}\n{self._where()}'
            sleep(0.01)

    def _where(self) -> str:
        """End it; return where its threads were, which Python's faulthandler says."""
        self.process.send_signal(signal.SIGABRT)
        return str(self.end())

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
        if self.process.stderr is not None:
            self.process.stderr.close()
        self.stop_reading()


class Terminal(Command):
    """A command on a terminal of its own, at which somebody types."""

    def __init__(self, *words: Any, size: tuple[int, int] = (0, 0), **environment: str) -> None:
        """Start it; size: lines and columns, if it shall know them."""
        self._read_to = 0
        master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack('HHHH', *size, 0, 0))
        self._begin(master, slave, subprocess.Popen(
            [sys.executable, '-m', 'soft_continuum', *map(str, words)],
            stdin=slave, stdout=slave, stderr=slave, start_new_session=True, text=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
            env={**os.environ, **environment}))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def type(self, text: str) -> None:
        """Type some keys."""
        os.write(self._reading, text.encode())

    def answer(self, question: str, text: str) -> None:
        """Wait for a question, after all that was answered before, and type a line."""
        self.wait_for(question, self._read_to)
        self._read_to = self.output.index(question, self._read_to) + len(question)
        self.type(f'{text}\n')

    def status(self) -> int:
        """Wait for its end; return the exit status."""
        status = self.process.wait(DEADLINE)
        self._reader.join(DEADLINE)
        return status
