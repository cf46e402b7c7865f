# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tendons on spools of Dynamixel X servos, which limit their current and so the tension.

The servos are in mode 5, current-based position control.  One thread owns their bus.  Torque stays
on, also after close; nothing here writes their EEPROM, reboots them or switches torque off.
"""

from collections.abc import Callable, Mapping
import logging
from pathlib import Path
from typing import Any, ClassVar, Self

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.dynamixel import PARAMETERS
from soft_continuum.hardware.dynamixel.bus import DynamixelBus
from soft_continuum.hardware.dynamixel.exchange import read_states, take_over
from soft_continuum.hardware.dynamixel.reference import find_zeros, ZeroFile
from soft_continuum.hardware.dynamixel.session import DynamixelSession
from soft_continuum.hardware.dynamixel.setup import find_servos, problems, Spools
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.serial_tendons import POLL_INTERVAL, SerialTendons
from soft_continuum.parameters.parameter import Parameter
from soft_continuum.user_files import dynamixel_zeros

MAX_READ_TIME = 0.05  # s for all servos
LOG = logging.getLogger('soft_continuum.hardware.dynamixel')


class DynamixelTendons(SerialTendons[DynamixelBus, DynamixelSession]):
    """
    Servos on one bus, one per tendon; see TendonDriver for what the methods promise.

    ``reference`` takes the present position as zero, or takes up the slack slowly, one tendon
    after the other.
    """

    DEVICE = 'the Dynamixel servos are'
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = PARAMETERS
    COMMISSIONING = 'soft_continuum.hardware.dynamixel.commissioning'
    EMULATOR = 'soft_continuum.sim.emulators.dynamixel'

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], clock: Callable[[], float]) -> Self:
        """
        Return the driver that the parameters of the node describe.

        clock: not used; a device continues when a node's clock is paused or set.  Raises
        ParameterError.
        """
        return cls(values['dynamixel.port'], values['dynamixel.baud'],
                   Spools.from_parameters(values), dynamixel_zeros())

    def __init__(self, port: str, baud_rate: int, spools: Spools, zeros: Path,
                 clock: Clock = STEADY) -> None:
        """Describe the devices; nothing is opened yet.  zeros: file of their zeros."""
        super().__init__(
            spools.tendons, spools.pull_limits, spools.take_up_tension > 0.0, clock)
        self._port, self._baud_rate, self._spools = port, baud_rate, spools
        self._zero_file = ZeroFile(zeros, port)

    def close(self) -> None:
        """Disconnect, and wait until the zeros are written; log if they cannot be."""
        super().close()
        while self._zero_file.writing:
            self.clock.sleep(POLL_INTERVAL)
        try:
            self._zero_file.check_written()
        except HardwareError as error:  # the session reports it, unless it ended before
            LOG.error(error)

    def connect(self) -> DynamixelBus:
        """Open the port."""
        return DynamixelBus(self._port, self._baud_rate, self.clock)

    def start(self, link: DynamixelBus) -> DynamixelSession:
        """Take the servos over; raises HardwareError when they are not as needed."""
        spools = self._spools
        servos = find_servos(link, spools)
        if unfit := [line for servo in servos for line in problems(servo, spools.speed_limit)]:
            raise HardwareError('; '.join(unfit))
        states = read_states(link, servos)
        begin = self.clock()
        states = read_states(link, servos)
        if (took := self.clock() - begin) > MAX_READ_TIME:
            raise HardwareError(
                f'reading the servos takes {1e3 * took:.0f} ms at {link.baud_rate} baud; allowed: '
                f'{1e3 * MAX_READ_TIME:.0f} ms; set their Baud Rate (8) to 3 (1000000) or more, '
                'and Return Delay Time (9) to 0')
        zeros = find_zeros(link, servos, states, spools, self._zero_file)
        held = take_over(link, servos, spools, states)
        return DynamixelSession(link, servos, spools, held, zeros, self._zero_file)
