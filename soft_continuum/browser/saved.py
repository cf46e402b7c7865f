# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes and sequences saved by the user; the file is accessed on a separate thread."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from soft_continuum.browser.log import LOG
from soft_continuum.client.own_file import OwnShapesError, read_saved, Saved
from soft_continuum.user_files import saved_shapes

if TYPE_CHECKING:
    from soft_continuum.browser.session import Session

TITLE = 'Saved shapes'


class SavedShapes:
    """
    Follows changes of the file by other programs, and changes it.

    A slow disk must not delay STOP.  The file is read on the thread of the node only to run a
    saved name.
    """

    def __init__(self, session: 'Session') -> None:
        """Start empty."""
        self._session = session
        self._all = Saved()
        self._signature: tuple[int, int] | None = None
        self._disk = ThreadPoolExecutor(1, 'saved_shapes')

    @property
    def offered(self) -> Saved:
        """Shapes and sequences that fit the arm; none before it is known."""
        description = self._session.description
        if description is None:
            return Saved()
        return self._all.offered(description.arm, description.shapes)

    def follow(self) -> None:
        """Read the file if it has changed."""
        self._disk.submit(self._read)

    def change(self, change: Callable[[], str]) -> None:
        """Carry out one of the changes of own_file; a notice reports success or the reason."""
        self._disk.submit(self._change, change)

    def _read(self) -> None:
        try:
            found = saved_shapes().stat()
            signature = found.st_mtime_ns, found.st_ino
        except OSError:  # no file, mostly; else a change says why
            signature = None
        if signature != self._signature:
            self._signature = signature
            self._tell(self._take, read_saved())

    def _change(self, change: Callable[[], str]) -> None:
        try:
            done = change()
            self._read()  # first: what a notice says is done is seen, too
            self._tell(self._session.notify, TITLE, done)
        except OwnShapesError as error:
            self._tell(self._problem, str(error))
        except Exception:
            LOG.exception('the saved file could not be changed')

    def _take(self, saved: Saved) -> None:
        self._all = saved
        if saved.problem:
            self._problem(f'{saved.problem}; the rest is available, and a copy of the file is '
                          'kept at the next save')

    def _problem(self, text: str) -> None:
        self._session.notify(TITLE, text, is_problem=True)

    def _tell(self, work: Callable[..., None], *arguments: object) -> None:
        """Call a function on the thread that spins the node."""
        self._session.requests.node.executor.create_task(work, *arguments)
