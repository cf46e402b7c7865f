# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Steppers on a GRBL 1.1 controller: its axes X, Y, Z, A are the tendons in their order."""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.grbl.boards import GrblBoards
from soft_continuum.hardware.grbl.link import GrblLink
from soft_continuum.hardware.grbl.motion import Motors
from soft_continuum.hardware.grbl.parameters import PARAMETERS
from soft_continuum.hardware.grbl.session import GrblSession
from soft_continuum.hardware.grbl.setup import find_controller, invalid_settings, UNLOCK
from soft_continuum.hardware.protocols import HardwareError, TendonDriver
from soft_continuum.hardware.serial_ports import open_serial
from soft_continuum.hardware.serial_tendons import SerialTendons
from soft_continuum.parameters.parameter import Parameter


class GrblTendons(SerialTendons[GrblLink, GrblSession]):
    """
    Steppers on a GRBL controller; see TendonDriver for what the methods promise.

    ``reference`` takes the present position as zero, or homes: it pays all tendons out to their
    switches and pulls them to zero, to be just taut on the straight arm.
    """

    DEVICE = 'the GRBL controller is'
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = PARAMETERS
    COMMISSIONING = 'soft_continuum.hardware.grbl.commissioning'
    EMULATOR = 'soft_continuum.emulators.grbl'

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
