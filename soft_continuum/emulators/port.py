# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The serial port of an emulated device: a pseudo-terminal that can be unplugged."""

from contextlib import suppress
import os
from pathlib import Path
import tty


class EmulatedPort:
    """
    A port that appears under a new name whenever it is plugged in, as a real one might.

    The device reads from the file ``master``, which is negative while it is unplugged.
    """

    def __init__(self, link: str | Path | None = None) -> None:
        """Stay unplugged; link: path of a symbolic link to it, as a name that stays the same."""
        self.link = Path(link) if link else None
        self.name = ''
        self.master = self._slave = -1

    def plug(self) -> None:
        """Make the port; raises OSError when there is something else at the link."""
        if self.master >= 0:
            return
        # An open slave side keeps the line alive while no program has opened the port.
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.name = os.ttyname(self._slave)
        if self.link is not None:
            self._remove_link()
            self.link.symlink_to(self.name)

    def unplug(self) -> None:
        """Take the port away."""
        if self.master < 0:
            return
        os.close(self.master)
        os.close(self._slave)
        self.master = self._slave = -1
        self._remove_link()

    def _remove_link(self) -> None:
        if self.link is not None and self.link.is_symlink():
            self.link.unlink()

    def read(self) -> bytes:
        """Return what was received; raises BlockingIOError for nothing, OSError if unplugged."""
        return os.read(self.master, 4096)

    def write(self, data: bytes) -> None:
        """Send; what nothing reads is lost, as on a wire."""
        if self.master >= 0:
            with suppress(OSError):
                os.write(self.master, data)
