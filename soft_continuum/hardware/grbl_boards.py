# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Several GRBL controllers as one driver: for arms with more tendons than one has axes."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
import threading
from typing import Protocol, TypeVar

from soft_continuum.hardware.protocols import HardwareError, TendonDriver, TendonReading

T = TypeVar('T')


class Board(TendonDriver, Protocol):
    """A driver that knows its tendons."""

    @property
    def tendons(self) -> tuple[str, ...]:
        """Their names."""


class GrblBoards:
    """
    Boards that each move some of the tendons, in their order; see TendonDriver.

    When one fails the others are stopped.  Nothing but the clock of this computer keeps them
    together: while they move, one may be some 20 ms behind another.
    """

    def __init__(self, boards: Sequence[Board]) -> None:
        """Describe the devices; nothing is opened yet."""
        self._boards = tuple(boards)
        self.reference_moves = boards[0].reference_moves
        self._lock = threading.Lock()
        self._closed = True

    def open(self) -> None:
        """Connect all of them, or none; raise HardwareError."""
        with self._lock:
            self._closed = False
        with ThreadPoolExecutor(len(self._boards)) as pool:
            opening = [pool.submit(board.open) for board in self._boards]
        with self._lock:
            closed = self._closed
        for board, opened in zip(self._boards, opening, strict=True):
            error = opened.exception()
            if error is not None or closed:
                self.close()
                raise self._named(board, error or 'closed while it was being opened') from error

    def close(self) -> None:
        """Stop, hold and disconnect; an ``open`` under way ends with HardwareError."""
        with self._lock:
            self._closed = True
        with ThreadPoolExecutor(len(self._boards)) as pool:
            list(pool.map(lambda board: board.close(), self._boards))

    def read(self) -> TendonReading:
        """Return the last state of all of them."""
        readings = self._each(lambda board: board.read())
        return TendonReading(
            tuple(pull for reading in readings for pull in reading.pulls),
            tuple(speed for reading in readings for speed in reading.speeds),
            all(reading.referenced for reading in readings))

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move all tendons to ``pulls`` (m), to arrive together after ``duration`` (s)."""
        tendons = [name for board in self._boards for name in board.tendons]
        if len(pulls) != len(tendons):
            raise HardwareError(
                f'{len(pulls)} pulls were given; needed: one for each of {", ".join(tendons)}')
        wanted = dict(zip(tendons, pulls, strict=True))
        self._each(lambda board: board.move(
            tuple(wanted[name] for name in board.tendons), duration))

    def stop(self) -> None:
        """Brake all of them, whichever of them fails, then hold."""
        failed: list[HardwareError] = []
        for board in self._boards:
            try:
                board.stop()
            except HardwareError as error:
                failed.append(self._named(board, error))
        if failed:
            raise failed[0]

    def reference(self) -> None:
        """Take the present position as zero pull, or home."""
        self._each(lambda board: board.reference())

    def _each(self, act: Callable[[Board], T]) -> list[T]:
        """Act on every board; when one fails stop all and raise HardwareError."""
        done = []
        for board in self._boards:
            try:
                done.append(act(board))
            except HardwareError as error:
                with suppress(HardwareError):
                    self.stop()
                raise self._named(board, error) from None
        return done

    def _named(self, board: Board, error: object) -> HardwareError:
        return HardwareError(f'{error} (the controller of {", ".join(board.tendons)})')
