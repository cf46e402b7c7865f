# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A device behind a serial port: a pseudo-terminal that can be unplugged, and a thread."""

from contextlib import suppress
import os
from pathlib import Path
import threading
import tty
from typing import Self

from soft_continuum.hardware.clock import Clock
from soft_continuum.hardware.real_time import ask_for_real_time

POLL_INTERVAL = 0.005  # s


class EmulatedDevice:
    """
    A device that is served by a thread between ``with`` and its end; times are s on ``clock``.

    The port appears under a new ``name`` whenever it is plugged in, as a real one might.  No other
    thread changes the device while ``lock`` is held.
    """

    def __init__(self, link: str | Path | None, clock: Clock) -> None:
        """Stay unplugged; link: path of a symbolic link to the port, which stays the same."""
        self.link = Path(link) if link else None
        self.clock = clock
        self.name = ''
        self.lock = threading.RLock()
        self._master = self._slave = -1  # negative while unplugged
        self._closing = False
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Self:
        """Plug in and begin to answer; raises OSError when there is something else at the link."""
        self.plug()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Unplug and end."""
        self._closing = True
        while self._thread.is_alive():
            self.clock.sleep(POLL_INTERVAL)
        self.unplug()

    @property
    def port(self) -> str:
        """The path of the port: of its link, if it has one."""
        return str(self.link or self.name)

    def plug(self) -> None:
        """Connect the cable; nothing is reset."""
        with self.lock:
            if self._master >= 0:
                return
            # An open slave side keeps the line alive while no program has opened the port.
            self._master, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self.name = os.ttyname(self._slave)
            if self.link is not None:
                self._remove_link()
                try:
                    self.link.symlink_to(self.name)
                except FileExistsError:
                    raise FileExistsError(
                        f'{self.link} is there and no symbolic link; give another path') from None

    def unplug(self) -> None:
        """Pull out the cable: the port is gone; motors, pump and valves go on as they are."""
        with self.lock:
            if self._master < 0:
                return
            os.close(self._master)
            os.close(self._slave)
            self._master = self._slave = -1
            self._remove_link()

    def send(self, data: bytes) -> None:
        """Put bytes on the line; what nothing reads is lost, as on a wire."""
        with self.lock:
            if self._master >= 0:
                with suppress(OSError):
                    os.write(self._master, data)

    def _remove_link(self) -> None:
        if self.link is not None and self.link.is_symlink():
            self.link.unlink()

    def _serve(self) -> None:
        ask_for_real_time()  # a board waits for no other program
        self._run()

    def _run(self) -> None:
        """Serve until ``_closing``."""
        raise NotImplementedError
