# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Several GRBL controllers as one driver: for arms with more tendons than one has axes."""

from collections.abc import Callable, Sequence
from contextlib import suppress
import threading
from typing import Protocol, TypeVar

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.protocols import (
    Accuracy,
    HardwareError,
    TendonDriver,
    TendonReading,
)

T = TypeVar('T')
POLL_INTERVAL = 0.005  # s
SAME_SPEED = 0.02  # relative


class Board(TendonDriver, Protocol):
    """A driver and its tendons."""

    @property
    def tendons(self) -> tuple[str, ...]:
        """Their names."""

    @property
    def fastest(self) -> float:
        """Speed of the fastest motion that an open board can brake in time, m/s."""


class GrblBoards:
    """
    Boards that each move some of the tendons, in their order; see TendonDriver.

    When one fails the others are stopped.  Only the clock of this computer synchronizes them: in
    motion, one may be some 20 ms behind another.
    """

    def __init__(self, boards: Sequence[Board], clock: Clock = STEADY) -> None:
        """Describe the devices; nothing is opened yet."""
        self._boards, self.clock = tuple(boards), clock
        self.reference_moves = boards[0].reference_moves
        self._lock = threading.Lock()
        self._closed = True

    def open(self) -> None:
        """Connect all of them, or none; raise HardwareError."""
        with self._lock:
            self._closed = False
        failed = self._at_once(lambda board: board.open())
        with self._lock:
            closed = self._closed
        if not (failed or closed):
            failed = self._uneven()
        if failed or closed:
            self.close()
            raise failed[0] if failed else HardwareError('closed while it was being opened')

    def _uneven(self) -> list[HardwareError]:
        """Return what to raise for boards of which some are slower: tendons would not arrive."""
        speeds = self._each(lambda board: board.fastest)
        if max(speeds) <= (1.0 + SAME_SPEED) * min(speeds):
            return []
        each = '; '.join(f'{1e3 * speed:.1f} mm/s for {", ".join(board.tendons)}'
                         for speed, board in zip(speeds, self._boards, strict=True))
        return [HardwareError(
            'the GRBL controllers accelerate differently, so some tendons would arrive later than '
            f'others: {each}; set $120 and following of all to the same acceleration')]

    def close(self) -> None:
        """Stop, hold and disconnect; an ``open`` under way ends with HardwareError."""
        with self._lock:
            self._closed = True
        self._at_once(lambda board: board.close())

    def read(self) -> TendonReading:
        """Return the last state of all of them."""
        readings = self._each(lambda board: board.read())
        return TendonReading(
            tuple(pull for reading in readings for pull in reading.pulls),
            tuple(speed for reading in readings for speed in reading.speeds),
            all(reading.referenced for reading in readings),
            accuracy=Accuracy(tuple(tolerance for reading in readings
                                    for tolerance in reading.accuracy.pull_tolerances)))

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move all tendons to ``pulls`` (m), to arrive together after ``duration`` (s)."""
        tendons = [name for board in self._boards for name in board.tendons]
        if len(pulls) != len(tendons):
            raise HardwareError(
                f'{len(pulls)} pulls were given; needed: one for each of {", ".join(tendons)}')
        wanted = dict(zip(tendons, pulls, strict=True))

        def move(board: Board) -> None:
            board.move(tuple(wanted[name] for name in board.tendons), duration)

        for board in self._boards:  # one that refuses must not have others stopped, or not homed
            if not board.read().referenced:
                try:
                    move(board)
                except HardwareError as error:
                    raise self._named(board, error) from None
        self._each(move)

    def stop(self) -> None:
        """Brake all of them, even if some fail, then hold."""
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
        if self.read().moving:  # of which the first to refuse would have the others stopped
            raise HardwareError('the tendons are moving; wait until they rest')
        self._each(lambda board: board.reference())

    def _at_once(self, act: Callable[[Board], None]) -> list[HardwareError]:
        """Act on all boards at the same time, and wait for them; return what they raised."""
        failed: dict[Board, HardwareError] = {}

        def run(board: Board) -> None:
            try:
                act(board)
            except HardwareError as error:
                failed[board] = self._named(board, error)
            except Exception as error:  # it must not pass for done because its thread ended
                failed[board] = self._named(board, f'{type(error).__name__}: {error}')

        threads = [threading.Thread(target=run, args=(board,), daemon=True)
                   for board in self._boards]
        for thread in threads:
            thread.start()
        while any(thread.is_alive() for thread in threads):
            self.clock.sleep(POLL_INTERVAL)
        return [failed[board] for board in self._boards if board in failed]

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
