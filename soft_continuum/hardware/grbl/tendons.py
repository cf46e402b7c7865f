# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Steppers on GRBL 1.1 controllers: the axes X, Y, Z, A are the tendons in their order.

Several controllers are one driver, for arms with more tendons than one has axes.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
import threading
from typing import Any, ClassVar, TypeVar

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.grbl import PARAMETERS
from soft_continuum.hardware.grbl.link import GrblLink
from soft_continuum.hardware.grbl.motion import Motors
from soft_continuum.hardware.grbl.session import GrblSession
from soft_continuum.hardware.grbl.setup import find_controller, invalid_settings, UNLOCK
from soft_continuum.hardware.protocols import (
    Accuracy,
    check_motion,
    HardwareError,
    TendonDriver,
    TendonReading,
)
from soft_continuum.hardware.serial_ports import open_serial
from soft_continuum.hardware.serial_tendons import POLL_INTERVAL, SerialTendons
from soft_continuum.parameters.parameter import Parameter

T = TypeVar('T')
SAME_SPEED = 0.02  # relative


class GrblTendons(SerialTendons[GrblLink, GrblSession]):
    """
    Steppers on a GRBL controller; see TendonDriver for what the methods promise.

    ``reference`` takes the present position as zero, or homes: it pays all tendons out to their
    switches and pulls them to zero, to be just taut on the straight arm.
    """

    DEVICE = 'the GRBL controller is'
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = PARAMETERS
    COMMISSIONING = 'soft_continuum.hardware.grbl.commissioning'
    EMULATOR = 'soft_continuum.sim.emulators.grbl'

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]
                        ) -> TendonDriver:
        """
        Return the driver that the parameters of the node describe.

        clock: not used; a device continues when a node's clock is paused or set.  Raises
        ParameterError.
        """
        boards = [cls(port, values['grbl.baud_rate'], motors)
                  for port, motors in Motors.of_boards(values)]
        return boards[0] if len(boards) == 1 else GrblBoards(boards)

    def __init__(self, port: str, baud_rate: int, motors: Motors, clock: Clock = STEADY) -> None:
        """Describe the device; nothing is opened yet."""
        super().__init__(motors.tendons, motors.pull_limits, motors.homes, clock)
        self._port, self._baud_rate, self._motors = port, baud_rate, motors

    def connect(self) -> GrblLink:
        """Open the port."""
        return GrblLink(open_serial(self._port, self._baud_rate), self.clock)

    def start(self, link: GrblLink) -> GrblSession:
        """Take the controller over; raises HardwareError when its settings are not as needed."""
        found = find_controller(link)
        if unfit := invalid_settings(found.settings, self._motors):
            raise HardwareError('the settings of the GRBL controller contradict the '
                                'configuration: ' + '; '.join(unfit))
        if found.locked and not self.reference_moves:
            raise HardwareError(f'the GRBL controller is locked (Alarm); {UNLOCK}')
        return GrblSession(link, found, self._motors)

    @property
    def fastest(self) -> float:
        """Speed of the fastest motion that the controller can brake in time, m/s."""
        with self._lock:
            return self._connected().fastest


class GrblBoards:
    """
    Boards that each move some of the tendons, in their order; see TendonDriver.

    When one fails the others are stopped.  Only the clock of this computer synchronizes them: in
    motion, one may be some 20 ms behind another.
    """

    def __init__(self, boards: Sequence[GrblTendons], clock: Clock = STEADY) -> None:
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
            unreferenced='; '.join(dict.fromkeys(filter(None, (
                reading.unreferenced for reading in readings)))),
            accuracy=Accuracy(tuple(tolerance for reading in readings
                                    for tolerance in reading.accuracy.pull_tolerances)))

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move all tendons to ``pulls`` (m), to arrive together after ``duration`` (s)."""
        tendons = [name for board in self._boards for name in board.tendons]
        check_motion(tendons, pulls, duration)
        wanted = dict(zip(tendons, pulls, strict=True))

        def move(board: GrblTendons) -> None:
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

    def _at_once(self, act: Callable[[GrblTendons], None]) -> list[HardwareError]:
        """Act on all boards at the same time, and wait for them; return what they raised."""
        failed: dict[GrblTendons, HardwareError] = {}

        def run(board: GrblTendons) -> None:
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

    def _each(self, act: Callable[[GrblTendons], T]) -> list[T]:
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

    def _named(self, board: GrblTendons, error: object) -> HardwareError:
        return HardwareError(f'{error} (the controller of {", ".join(board.tendons)})')
